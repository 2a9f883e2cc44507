//! Lines as OBJ means them: a backslash at the end joins a line to the next, `#` starts a comment.

use std::borrow::Cow;

/// The lines of a text with their numbers, comments cut off, joined lines as one with the number of
/// the first.
pub(super) struct Lines<'a> {
    rest: Option<&'a str>,
    ending: char,
    number: u64,
}

impl<'a> Lines<'a> {
    pub(super) fn new(text: &'a str) -> Lines<'a> {
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        // Without a single line feed, carriage returns are the line ends, as on the oldest Macs.
        let ending = if !text.contains('\n') && text.contains('\r') { '\r' } else { '\n' };
        Lines { rest: Some(text), ending, number: 0 }
    }

    fn physical(&mut self) -> Option<&'a str> {
        let text = self.rest?;
        self.number += 1;
        let (line, rest) = match text.split_once(self.ending) {
            Some((line, rest)) => (line, Some(rest)),
            None => (text, None),
        };
        self.rest = rest;
        let line = line.split_once('#').map_or(line, |(before, _)| before);
        Some(line.trim_ascii())
    }
}

impl<'a> Iterator for Lines<'a> {
    type Item = (u64, Cow<'a, str>);

    fn next(&mut self) -> Option<(u64, Cow<'a, str>)> {
        let line = self.physical()?;
        let number = self.number;
        let Some(start) = line.strip_suffix('\\') else { return Some((number, line.into())) };
        let mut joined = start.to_owned();
        while let Some(next) = self.physical() {
            joined.push(' ');
            match next.strip_suffix('\\') {
                Some(middle) => joined.push_str(middle),
                None => {
                    joined.push_str(next);
                    break;
                }
            }
        }
        Some((number, joined.into()))
    }
}

/// Most bytes of a line that is joined from several, blanks between them among these; 0 where none is joined.
pub(super) fn longest_joined(text: &str) -> u64 {
    let mut lines = Lines::new(text);
    let (mut longest, mut length) = (0, 0);
    while let Some(line) = lines.physical() {
        let goes_on = line.ends_with('\\');
        if goes_on || length > 0 {
            length += line.len() as u64 + 1;
            longest = longest.max(length);
        }
        if !goes_on {
            length = 0;
        }
    }
    longest
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(text: &str) -> Vec<(u64, String)> {
        Lines::new(text).map(|(number, line)| (number, line.into_owned())).collect()
    }

    #[test]
    fn joined_commented_and_ended_in_every_way() {
        let want = vec![(1, "f 1  2  3".to_owned()), (4, "v 1".to_owned())];
        assert_eq!(lines("f 1 \\\n2 \\\r\n 3 # x\nv 1"), want);
        assert_eq!(lines("\u{feff}a\rb"), [(1, "a".to_owned()), (2, "b".to_owned())]);
        assert_eq!(lines("a\\"), [(1, "a".to_owned())]);
        assert_eq!(longest_joined("f 1 2 3\nv 1\n"), 0);
        assert_eq!(longest_joined("v 1 2 3 4 5\nf 1\\\n2 \\ # x\n3\nv 1\\\n2"), 5 + 4 + 2);
    }
}
