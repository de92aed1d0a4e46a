//! How much memory a process holds.

use std::path::PathBuf;

use crate::base::error::{Error, Result};
use crate::failed;

/// The memory of a process, in bytes, as the kernel counts it in `smaps_rollup`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Memory {
    /// All pages it has in memory.
    pub rss: u64,
    /// The same, with each page that several processes have divided among them.
    pub pss: u64,
    /// Pages that no other process has.
    pub private: u64,
}

impl Memory {
    /// That of a process.
    pub fn of(process: u32) -> Result<Memory> {
        let path = PathBuf::from(format!("/proc/{process}/smaps_rollup"));
        let text = std::fs::read_to_string(&path).map_err(|e| Error::io("read", &path, e))?;
        Memory::parse(&text).ok_or_else(|| failed!("{} has no Rss, Pss and Private lines", path.display()))
    }

    fn parse(text: &str) -> Option<Memory> {
        let bytes = |name: &str| -> Option<u64> {
            let line = text.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(':'))?;
            Some(1024 * line.trim().strip_suffix(" kB")?.parse::<u64>().ok()?)
        };
        let private = bytes("Private_Clean")? + bytes("Private_Dirty")?;
        Some(Memory { rss: bytes("Rss")?, pss: bytes("Pss")?, private })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_lines_of_the_kernel_are_read() {
        let text = "55d0-7ffc ---p 00000000 00:00 0  [rollup]\nRss:   2048 kB\nPss:   1024 kB\nPss_Dirty: 7 kB\n\
                    Private_Clean:  8 kB\nPrivate_Dirty:  512 kB\n";
        let expected = Memory { rss: 2048 << 10, pss: 1024 << 10, private: 520 << 10 };
        assert_eq!(Memory::parse(text), Some(expected));
        assert_eq!(Memory::parse("Rss: 1 kB\nPss: 1 kB\n"), None);
    }

    #[test]
    fn a_process_holds_its_private_pages_whole_and_shared_ones_in_part() {
        let mine = Memory::of(std::process::id()).unwrap();
        assert!(mine.private > 0 && mine.private <= mine.pss && mine.pss <= mine.rss, "{mine:?}");
    }
}
