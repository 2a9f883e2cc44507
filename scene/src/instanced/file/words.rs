//! What JSON's reader may take to quote a word of the text.

/// Words up to here are quoted in memory that does not count.
const SHORT: usize = 4096;
/// How often a word may be there beside the text: as it is read without its escapes, as the field of an error, and in the error's message, where a letter may be written by six and
/// which is made from parts and copied.
const TIMES: u64 = 32;

/// Most bytes that errors of JSON's reader take to quote the longest string of a text.
pub(super) fn bytes_of_quotes(text: &str) -> u64 {
    let longest = longest(text);
    if longest <= SHORT { 0 } else { TIMES * longest as u64 }
}

/// Bytes of the longest string of a text as it stands there. Up to where it stops to be JSON all strings are found, and no further is read.
fn longest(text: &str) -> usize {
    let bytes = text.as_bytes();
    let (mut longest, mut at) = (0, 0);
    while let Some(before) = bytes[at..].iter().position(|byte| *byte == b'"') {
        let start = at + before + 1;
        at = start;
        while bytes.get(at).is_some_and(|byte| *byte != b'"') {
            at += if bytes[at] == b'\\' { 2 } else { 1 };
        }
        at = at.min(bytes.len());
        longest = longest.max(at - start);
        at = (at + 1).min(bytes.len());
    }
    longest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_longest_string_is_found() {
        for (text, length) in [
            ("", 0),
            ("[1, 2]", 0),
            ("{\"a\": \"bc\", \"d\": 1}", 2),
            ("[\"a\\\"bc\", \"\\\\\", \"xy\"]", 5),
            ("[\"ab\", \"never ends", 10),
            ("\"\\", 1),
            ("\"", 0),
        ] {
            assert_eq!(longest(text), length, "{text}");
        }
        assert_eq!(bytes_of_quotes(&format!("\"{}\"", "x".repeat(SHORT))), 0);
        let long = SHORT as u64 + 1;
        assert_eq!(bytes_of_quotes(&format!("\"{}\"", "x".repeat(SHORT + 1))), TIMES * long);
    }
}
