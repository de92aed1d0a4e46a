//! `man`: manual pages of all commands.

use std::path::{Path, PathBuf};

use clap::{Args, Command, CommandFactory};

use super::{Cli, print};
use crate::base::error::{Error, Result};
use crate::base::file::AtomicFile;

/// Write man pages, one for each command
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  # then: man vamaro-swarm-spawn
  vamaro-swarm man ~/.local/share/man/man1")]
pub struct Man {
    /// The folder to write them to; created if missing
    #[arg(value_name = "DIR")]
    folder: PathBuf,
}

impl Man {
    /// Runs the command.
    pub fn run(self) -> Result<()> {
        std::fs::create_dir_all(&self.folder).map_err(|e| Error::io("create", &self.folder, e))?;
        let mut program = Cli::command().disable_help_subcommand(true);
        // Commands know by what names they are called once all are put together.
        program.build();
        let pages = write(&program, &self.folder)?;
        print(&format!("wrote {pages} pages to {}\n", self.folder.display()))
    }
}

/// Writes the pages of a command and those below it; how many these are.
fn write(command: &Command, folder: &Path) -> Result<usize> {
    let page = clap_mangen::Man::new(command.clone());
    let mut text = Vec::new();
    page.render(&mut text).map_err(Error::outside)?;
    AtomicFile::write(&folder.join(page.get_filename()), &text)?;
    let visible = command.get_subcommands().filter(|command| !command.is_hide_set());
    visible.map(|command| write(command, folder)).try_fold(1, |pages, written| Ok(pages + written?))
}
