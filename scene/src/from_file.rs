//! What comes out of files of users: read within limits, and quoted in messages.
//!
//! For the program and for readers of this crate; no part of the API.

use crate::budget::Budget;
use std::fs::{self, File};
use std::io::{self, Read};
use std::path::Path;
use std::sync::OnceLock;
use thiserror::Error;

/// Most bytes of what is no regular file, such as a pipe: how long it is shows only at its end.
const ENDLESS: u64 = 1 << 30;
/// The limit where the machine does not tell how much memory it has.
const UNKNOWN_MEMORY: u64 = 16 << 30;

/// Why the bytes of a file are not there.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ReadError {
    /// The system refuses.
    #[error("{0}")]
    System(io::Error),
    /// A folder, a pipe, a device or the like.
    #[error("it is not a regular file")]
    NotAFile,
    /// More bytes than are read.
    #[error("it has more than {limit} bytes, the most that are read")]
    TooLong {
        /// The most that are read.
        limit: u64,
    },
    /// The bytes do not fit into memory.
    #[error("there is not memory enough for its bytes")]
    Memory,
}

impl From<io::Error> for ReadError {
    fn from(error: io::Error) -> ReadError {
        match error.kind() {
            io::ErrorKind::OutOfMemory => ReadError::Memory,
            _ => ReadError::System(error),
        }
    }
}

impl ReadError {
    /// Whether a limit binds, not the file.
    pub fn is_limit(&self) -> bool {
        matches!(self, ReadError::TooLong { .. } | ReadError::Memory)
    }
}

/// Most bytes of a file that is read whole, where the user says nothing: half of the machine's
/// memory, since what is made of the bytes takes memory too.
pub fn usual_limit() -> u64 {
    static LIMIT: OnceLock<u64> = OnceLock::new();
    *LIMIT.get_or_init(|| memory().map_or(UNKNOWN_MEMORY, |bytes| bytes / 2))
}

/// The machine's memory where Linux tells it.
fn memory() -> Option<u64> {
    let text = fs::read_to_string("/proc/meminfo").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("MemTotal:"))?;
    let kilobytes: u64 = line.split_ascii_whitespace().next()?.parse().ok()?;
    kilobytes.checked_mul(1024)
}

/// Opens a regular file; gives its length too, which may change while it is read.
///
/// # Errors
/// The system refuses, or it is something else.
pub fn open_regular(path: &Path) -> Result<(File, u64), ReadError> {
    // Opening a pipe waits for somebody who writes to it.
    if !fs::metadata(path)?.is_file() {
        return Err(ReadError::NotAFile);
    }
    let file = File::open(path)?;
    // Something else may have the name since.
    let about = file.metadata()?;
    if about.is_file() { Ok((file, about.len())) } else { Err(ReadError::NotAFile) }
}

/// Reads a regular file of at most `limit` bytes.
///
/// # Errors
/// See [`ReadError`].
pub fn read(path: &Path, limit: u64) -> Result<Vec<u8>, ReadError> {
    let mut bytes = Vec::new();
    read_into(path, limit, &mut bytes)?;
    Ok(bytes)
}

/// As [`read`], in memory that is used again.
///
/// # Errors
/// As [`read`].
pub fn read_into(path: &Path, limit: u64, bytes: &mut Vec<u8>) -> Result<(), ReadError> {
    let (file, length) = open_regular(path)?;
    fill(file, length, limit, bytes)
}

/// As [`read_into`], where the bytes count for a budget: a file that is too large is refused by its length, before any of it is read.
///
/// # Errors
/// As [`read`], and [`ReadError::Memory`] where the budget does not suffice.
pub(crate) fn read_within(
    path: &Path,
    limit: u64,
    bytes: &mut Vec<u8>,
    budget: &Budget,
) -> Result<(), ReadError> {
    let (file, length) = open_regular(path)?;
    if length > limit {
        return Err(ReadError::TooLong { limit });
    }
    budget.take(length).map_err(|_| ReadError::Memory)?;
    // A file that grew meanwhile: a list that grows moves, and is there twice.
    let fits = length.saturating_add(budget.left() / 3);
    fill(file, length, limit.min(fits), bytes).map_err(|error| match error {
        ReadError::TooLong { .. } if fits < limit => ReadError::Memory,
        error => error,
    })?;
    budget.take((bytes.capacity() as u64).saturating_sub(length)).map_err(|_| ReadError::Memory)
}

/// Reads what may be a pipe or a device too: at most `limit` bytes; without one, as many as is usual,
/// and fewer of what may never end.
///
/// # Errors
/// See [`ReadError`].
pub fn read_any(path: &Path, limit: Option<u64>) -> Result<Vec<u8>, ReadError> {
    let file = File::open(path)?;
    let about = file.metadata()?;
    let (length, usual) = match about.is_file() {
        true => (about.len(), usual_limit()),
        false => (0, usual_limit().min(ENDLESS)),
    };
    let mut bytes = Vec::new();
    fill(file, length, limit.unwrap_or(usual), &mut bytes)?;
    Ok(bytes)
}

/// All bytes of a source that says it has `length`.
pub(crate) fn fill(
    source: impl Read,
    length: u64,
    limit: u64,
    bytes: &mut Vec<u8>,
) -> Result<(), ReadError> {
    bytes.clear();
    if length > limit {
        return Err(ReadError::TooLong { limit });
    }
    let expected = usize::try_from(length).map_err(|_| ReadError::Memory)?;
    bytes.try_reserve_exact(expected).map_err(|_| ReadError::Memory)?;
    // The file may have grown, or may not know its length: the limit holds all the same.
    source.take(limit.saturating_add(1)).read_to_end(bytes)?;
    if bytes.len() as u64 > limit {
        return Err(ReadError::TooLong { limit });
    }
    Ok(())
}

/// A file, whatever name leads to it.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Identity {
    #[cfg(unix)]
    number: (u64, u64),
    #[cfg(not(unix))]
    path: std::path::PathBuf,
}

impl Identity {
    /// The file that a name leads to, through links of all kinds where the system numbers its files.
    pub(crate) fn of(path: &Path) -> io::Result<Identity> {
        #[cfg(unix)]
        {
            use std::os::unix::fs::MetadataExt;
            let about = fs::metadata(path)?;
            Ok(Identity { number: (about.dev(), about.ino()) })
        }
        #[cfg(not(unix))]
        Ok(Identity { path: path.canonicalize()? })
    }
}

/// Enough of a name out of a file for a message: of a file, of a material. It may be any text, so what
/// would not be printed as it is, such as what commands a terminal, is written by its number.
pub fn quoted(name: &str) -> String {
    quote(name, 160, 0)
}

/// Enough of a word for a message: of what should have been a number or the like.
pub fn quoted_word(word: &str) -> String {
    quote(word, 24, 0)
}

/// What a library says of a file, of which it may quote any part. The position comes last.
pub fn quoted_reason(reason: &str) -> String {
    quote(reason.trim(), 240, 80)
}

/// A path for a message. Its end tells most.
pub fn quoted_path(path: impl AsRef<Path>) -> String {
    quote(&path.as_ref().to_string_lossy(), 300, 400)
}

/// Text for a terminal: lines stay lines, and what would command it is written by its number.
pub fn printable(text: &str) -> std::borrow::Cow<'_, str> {
    let commands = |letter: char| letter.is_control() && letter != '\n';
    if !text.contains(commands) {
        return text.into();
    }
    let mut shown = String::with_capacity(text.len());
    for letter in text.chars() {
        match commands(letter) {
            true => shown.extend(letter.escape_debug()),
            false => shown.push(letter),
        }
    }
    shown.into()
}

/// At most `head` letters of the start and `tail` of the end, after what cannot be printed is written
/// by its number.
fn quote(text: &str, head: usize, tail: usize) -> String {
    let mut shown = Vec::new();
    // Where the head ends: no number is cut in two.
    let mut end = 0;
    for letter in text.chars() {
        escape(letter, &mut shown);
        if shown.len() <= head {
            end = shown.len();
        }
        if shown.len() > head + tail {
            break;
        }
    }
    if shown.len() <= head + tail {
        return shown.into_iter().collect();
    }
    shown.truncate(end);
    // From the end on, so that a long text is not copied.
    let mut last: Vec<Vec<char>> = Vec::new();
    let mut length = 0;
    for letter in text.chars().rev() {
        let mut one = Vec::new();
        escape(letter, &mut one);
        length += one.len();
        if length > tail {
            break;
        }
        last.push(one);
    }
    let last = last.into_iter().rev().flatten();
    shown.into_iter().chain("...".chars()).chain(last).collect()
}

fn escape(letter: char, to: &mut Vec<char>) {
    match letter {
        '\'' | '"' | '\\' => to.push(letter),
        _ => to.extend(letter.escape_debug()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_told_as_they_can_be_printed() {
        assert_eq!(quoted("C:\\a \"b\"'\u{e4}.png"), "C:\\a \"b\"'\u{e4}.png");
        assert_eq!(quoted("\u{1b}[2J\n\0\u{202e}"), "\\u{1b}[2J\\n\\0\\u{202e}");
        assert_eq!(quoted(&"9".repeat(160)), "9".repeat(160));
        assert_eq!(quoted(&"9".repeat(400)), "9".repeat(160) + "...");
        assert_eq!(quoted_word(&"9".repeat(400)), "9".repeat(24) + "...");
        // What is written by its number counts as what is written.
        assert!(quoted(&"\u{1b}".repeat(400)).len() <= 163);
        assert_eq!(printable("a\tb\n\u{1b}[2J\u{9b}\r"), "a\\tb\n\\u{1b}[2J\\u{9b}\\r");
    }

    #[test]
    fn both_ends_of_a_reason_and_of_a_path_are_kept() {
        let reason = format!("unknown field `{}` at line 3", "\u{7}x".repeat(1 << 20));
        let told = quoted_reason(&reason);
        assert!(told.starts_with("unknown field `\\u{7}x") && told.ends_with("x` at line 3"));
        assert!(told.len() < 340, "{told}");
        assert_eq!(quoted_path("a/b.obj"), "a/b.obj");
        let long = "d/".repeat(1000) + "scene.obj";
        assert!(quoted_path(&long).len() < 720 && quoted_path(&long).ends_with("d/scene.obj"));
    }

    #[test]
    fn no_more_is_read_than_the_limit_allows() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        fs::write(&path, [7; 100]).unwrap();
        assert_eq!(read(&path, 100).unwrap(), [7; 100]);
        assert!(matches!(read(&path, 99), Err(ReadError::TooLong { limit: 99 })));
        assert!(matches!(read(folder.path(), 99), Err(ReadError::NotAFile)));
        // A file that grew since it was asked, and one that never ends.
        let mut bytes = Vec::new();
        let grown = fill(&[7u8; 100][..], 10, 99, &mut bytes);
        assert!(matches!(grown, Err(ReadError::TooLong { limit: 99 })));
        let endless = fill(io::repeat(7), 0, 1 << 20, &mut bytes);
        assert!(matches!(endless, Err(ReadError::TooLong { .. })));
        assert!(bytes.capacity() <= 4 << 20, "{}", bytes.capacity());
    }

    #[cfg(unix)]
    #[test]
    fn a_file_is_the_same_by_all_its_names() {
        let folder = tempfile::tempdir().unwrap();
        let [one, hard, soft, other] = ["a", "b", "c", "d"].map(|name| folder.path().join(name));
        fs::write(&one, "1").unwrap();
        fs::write(&other, "1").unwrap();
        fs::hard_link(&one, &hard).unwrap();
        std::os::unix::fs::symlink("a", &soft).unwrap();
        let of = |path| Identity::of(path).unwrap();
        assert!(of(&one) == of(&hard) && of(&one) == of(&soft) && of(&one) != of(&other));
    }
}
