//! The outcome of a trial, and the line in which the child reports it.

use std::fmt::Display;

use crate::device::bounded::Bounds;
use crate::error::{DriverLimit, GpuError};
use crate::parity::Parity;

/// What the child's line begins with. Drivers may print too.
pub(super) const MARK: &str = "splitplane probe: ";

/// The outcome of trying an adapter.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Tried {
    /// It was opened and tested.
    Parity(Parity),
    /// It would not open, or failed its test; in words.
    Failed(String),
    /// Its driver exceeded a limit.
    Exceeded {
        /// What it was doing.
        doing: String,
        /// The limit.
        limit: DriverLimit,
    },
    /// The child ended without a word; in words, how.
    Died(String),
    /// There is no such process: nothing was tried.
    NotStarted,
}

/// A line of the child's, without its mark.
pub(super) fn parse(line: &str, bounds: Bounds) -> Option<Tried> {
    let (word, rest) = line.split_once(' ').unwrap_or((line, ""));
    let exceeded = |limit| Tried::Exceeded { doing: rest.to_owned(), limit };
    Some(match word {
        "bitwise" => Tried::Parity(Parity::Bitwise),
        "structural" => Tried::Parity(Parity::Structural(rest.to_owned())),
        "failed" => Tried::Failed(rest.to_owned()),
        "time" => exceeded(DriverLimit::Time(bounds.time)),
        "memory" => exceeded(DriverLimit::Memory(bounds.memory)),
        _ => return None,
    })
}

/// The child's line. Texts of drivers may have several.
pub(super) fn say(word: &str, text: impl Display) -> String {
    let text = text.to_string();
    let text = text.split_whitespace().collect::<Vec<_>>().join(" ");
    format!("{MARK}{word} {text}").trim_end().to_owned() + "\n"
}

/// The line about what the self-test found, or why it did not.
pub(super) fn encode(tested: Result<Parity, GpuError>) -> String {
    match tested {
        Ok(Parity::Bitwise) => say("bitwise", ""),
        Ok(Parity::Structural(difference)) => say("structural", difference),
        Err(GpuError::DriverLimit { doing, limit }) => over(&doing, limit),
        Err(error) => say("failed", format_args!("its self-test did not run: {error}")),
    }
}

/// The line about a limit that the driver exceeded.
pub(super) fn over(doing: &str, limit: DriverLimit) -> String {
    match limit {
        DriverLimit::Memory(_) => say("memory", doing),
        _ => say("time", doing),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    const BOUNDS: Bounds = Bounds { time: Duration::from_secs(600), memory: u64::MAX };

    #[test]
    fn what_the_child_says_comes_across() {
        let across = |line: String| parse(line.strip_prefix(MARK)?.trim_end(), BOUNDS);
        assert_eq!(across(encode(Ok(Parity::Bitwise))), Some(Tried::Parity(Parity::Bitwise)));
        let structural = Parity::Structural("the quotient of 1 and 3".into());
        assert_eq!(across(encode(Ok(structural.clone()))), Some(Tried::Parity(structural)));
        let refused = GpuError::Refused("line one\nsplitplane probe: bitwise".into());
        let line = encode(Err(refused));
        assert_eq!(line.lines().count(), 1);
        assert!(matches!(across(line), Some(Tried::Failed(text)) if text.ends_with("bitwise")));
        for limit in [DriverLimit::Time(BOUNDS.time), DriverLimit::Memory(BOUNDS.memory)] {
            let doing = "compiling `x y`".to_owned();
            let line = encode(Err(GpuError::DriverLimit { doing: doing.clone(), limit }));
            assert_eq!(across(line), Some(Tried::Exceeded { doing, limit }));
        }
        assert_eq!(parse("what a driver prints", BOUNDS), None);
    }
}
