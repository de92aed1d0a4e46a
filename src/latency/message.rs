//! What a message of a hop says: when it was sent, and how long the one before it took.

use crate::base::error::Result;
use crate::bus::now_ns;
use crate::failed;

/// How long a message took, in nanoseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Took {
    /// From the moment its bytes were all in their place until the receiver had them before him.
    pub(super) hop: u64,
    /// All of it: room for the message, writing it, the hop, reading it.
    pub(super) whole: u64,
}

/// A message that was received.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Received {
    pub(super) number: u64,
    pub(super) took: Took,
    /// How long the one took that this one answers.
    pub(super) answers: Took,
}

/// The words at its front: number, beginning, sent, hop and whole of the message that it answers.
const WORDS: usize = 5;
const FRONT: usize = 8 * WORDS;

/// Writes message `number`, which was begun at `begun`, into memory that is sent next.
pub(super) fn fill(bytes: &mut [u8], number: u64, begun: u64, answers: Took) {
    let (front, rest) = bytes.split_at_mut(FRONT);
    rest.fill(number as u8);
    // The clock comes last: what is written before it is no part of the hop.
    let words = [number, begun, answers.hop, answers.whole, now_ns()];
    front.chunks_exact_mut(8).zip(words).for_each(|(place, word)| place.copy_from_slice(&word.to_ne_bytes()));
}

/// Reads a message, every byte of it.
pub(super) fn read(bytes: &[u8]) -> Result<Received> {
    let received = now_ns();
    let (front, rest) = bytes.split_at(FRONT);
    let word = |at: usize| u64::from_ne_bytes(front[8 * at..][..8].try_into().expect("a word has 8 bytes"));
    let [number, begun, hop, whole, sent] = std::array::from_fn(word);
    let differing = rest.iter().fold(0, |differing, byte| differing | (byte ^ number as u8));
    let read = now_ns();
    if differing != 0 || sent > received || begun > sent {
        return Err(failed!("message {number} arrived damaged"));
    }
    let took = Took { hop: received - sent, whole: read - begun };
    Ok(Received { number, took, answers: Took { hop, whole } })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_message_says_how_long_it_and_the_last_one_took() {
        let mut bytes = [0; 64];
        let (begun, answers) = (now_ns(), Took { hop: 3, whole: 7 });
        fill(&mut bytes, 300, begun, answers);
        let received = read(&bytes).unwrap();
        assert_eq!((received.number, received.answers), (300, answers));
        let Took { hop, whole } = received.took;
        assert!(hop <= whole && whole <= now_ns() - begun, "{received:?}");
    }

    #[test]
    fn a_damaged_message_is_found() {
        let mut bytes = [0; 64];
        for at in [FRONT, 63] {
            fill(&mut bytes, 5, now_ns(), Took::default());
            bytes[at] ^= 1;
            assert!(read(&bytes).is_err());
        }
    }
}
