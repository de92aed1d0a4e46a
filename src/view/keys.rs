//! Keys, read from the bytes that a terminal sends.

/// A key that may mean something.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Key {
    /// A character of ASCII, tab and blank included.
    Char(char),
    /// A letter, with Ctrl.
    Ctrl(char),
    /// Shift and tab.
    BackTab,
    Up,
    Down,
    Right,
    Left,
}

/// The keys in what was read at once. Anything else, and what was cut off, is ignored.
pub(super) fn keys(bytes: &[u8]) -> Vec<Key> {
    let (mut keys, mut rest) = (Vec::new(), bytes);
    while let [first, behind @ ..] = rest {
        let (key, behind) = match (*first, behind) {
            (0x1b, [b'[' | b'O', behind @ ..]) => sequence(behind),
            (b'\t', _) => (Some(Key::Char('\t')), behind),
            (1..=26, _) => (Some(Key::Ctrl((first - 1 + b'a').into())), behind),
            (b' '..=b'~', _) => (Some(Key::Char((*first).into())), behind),
            _ => (None, behind),
        };
        keys.extend(key);
        rest = behind;
    }
    keys
}

/// The key of an escape sequence, which ends with its first letter, and what is behind it.
fn sequence(bytes: &[u8]) -> (Option<Key>, &[u8]) {
    let Some(end) = bytes.iter().position(|byte| (0x40..=0x7e).contains(byte)) else { return (None, &[]) };
    let key = match bytes[end] {
        b'A' => Some(Key::Up),
        b'B' => Some(Key::Down),
        b'C' => Some(Key::Right),
        b'D' => Some(Key::Left),
        b'Z' => Some(Key::BackTab),
        _ => None,
    };
    (key, &bytes[end + 1..])
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn keys_are_read_one_by_one() {
        let expected = [Key::Char('q'), Key::Char('\t'), Key::Char(' '), Key::Right, Key::Up, Key::BackTab];
        assert_eq!(keys(b"q\t \x1b[C\x1bOA\x1b[Z"), expected);
        assert_eq!(keys(b"\x03\x0c]"), [Key::Ctrl('c'), Key::Ctrl('l'), Key::Char(']')]);
        // Ctrl and an arrow, F5, an umlaut, a lone escape, a sequence that is cut off.
        assert_eq!(keys(b"\x1b[1;5D\x1b[15~\xc3\xa4x\x1bk"), [Key::Left, Key::Char('x'), Key::Char('k')]);
        assert_eq!(keys(b"\x1b"), []);
        assert_eq!(keys(b"n\x1b[1;2"), [Key::Char('n')]);
    }

    proptest! {
        #[test]
        fn anything_may_be_typed(bytes: Vec<u8>) {
            prop_assert!(keys(&bytes).len() <= bytes.len());
        }
    }
}
