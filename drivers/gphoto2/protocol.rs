//! What the camera helper is asked and answers: lines of words, and after `PICTURE` its bytes.

use std::time::Duration;

use beampose_core::InstrumentError;

/// Passes over what the camera has said before.
pub(super) const ARM: &str = "ARM\n";

/// Whether pictures stay on the card.
pub(super) fn keep(keep: bool) -> String {
    format!("KEEP {}\n", if keep { "yes" } else { "no" })
}

/// Releases at `at` of the monotonic clock, or at once where that is over. So many earlier pictures may come ahead of this one; it is the last when it has been
/// quiet for so long.
pub(super) fn trigger(at: Duration, ahead: usize, quiet: Duration) -> String {
    format!("TRIGGER {} {ahead} {}\n", at.as_nanos(), quiet.as_millis())
}

/// What the helper says on a line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Reply {
    /// The session is open.
    Ready {
        /// What the camera calls itself.
        model: String,
        /// Its serial number; may be empty.
        serial: String,
    },
    /// Done.
    Done,
    /// This picture came before it was asked for.
    Late(String),
    /// The camera took the request; when it went out, of the monotonic clock.
    Released(Duration),
    /// So many bytes follow.
    Picture {
        /// Bytes.
        length: usize,
        /// Its name on the card.
        name: String,
    },
    /// It did not work.
    Failed(InstrumentError),
}

/// A picture longer than this is a mistake.
const LONGEST: usize = 1 << 30;

/// Reads a line. `None` where it is none of the helper's.
pub(super) fn reply(line: &str) -> Option<Reply> {
    let words: Vec<&str> = line.split('\t').collect();
    let text = |word: &str| word.to_owned();
    Some(match words.as_slice() {
        ["READY", model, serial] => Reply::Ready { model: text(model), serial: text(serial) },
        ["OK"] => Reply::Done,
        ["LATE", name] => Reply::Late(text(name)),
        ["RELEASED", at] => Reply::Released(Duration::from_nanos(at.parse().ok()?)),
        ["PICTURE", length, name] => {
            let length = length.parse().ok().filter(|length| *length <= LONGEST)?;
            Reply::Picture { length, name: text(name) }
        }
        ["ERROR", word, why] => Reply::Failed(failure(word, why)?),
        _ => return None,
    })
}

fn failure(word: &str, why: &str) -> Option<InstrumentError> {
    let cure = "is the camera on, awake and reachable, or does another program hold it (only one \
                can; on desktops gvfs does)?";
    Some(match word {
        "gone" => InstrumentError::Disconnected(format!("{why}: {cure}")),
        "refused" => InstrumentError::Refused(why.to_owned()),
        "timeout" => InstrumentError::Disconnected(format!("no answer in time ({why}): {cure}")),
        "fault" => InstrumentError::Fault(why.to_owned()),
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_of_the_helper_are_understood() {
        let ready = Reply::Ready { model: "Canon R5".to_owned(), serial: String::new() };
        let picture = Reply::Picture { length: 12, name: "DSC_0001.JPG".to_owned() };
        for (line, expected) in [
            ("READY\tCanon R5\t", Some(ready)),
            ("OK", Some(Reply::Done)),
            ("RELEASED\t2000000007", Some(Reply::Released(Duration::new(2, 7)))),
            ("RELEASED\tsoon", None),
            ("LATE\ta.jpg", Some(Reply::Late("a.jpg".to_owned()))),
            ("PICTURE\t12\tDSC_0001.JPG", Some(picture)),
            ("PICTURE\t-1\ta", None),
            ("PICTURE\t99999999999\ta", None),
            ("ERROR\tfault\tlens", Some(Reply::Failed(InstrumentError::Fault("lens".to_owned())))),
            ("ERROR\tother\tlens", None),
            ("hello", None),
            ("", None),
        ] {
            assert_eq!(reply(line), expected, "{line:?}");
        }
    }
}
