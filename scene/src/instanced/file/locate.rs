//! Finds where in a JSON text a value stands. The text has been read as JSON before, so what is not JSON is not looked for.

/// A step into a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Step {
    /// A field of an object.
    Field(&'static str),
    /// An element of an array.
    Element(usize),
}

/// The path as text, such as `instances[3].geometry`.
pub(super) fn shown(path: &[Step]) -> String {
    let mut text = String::new();
    for step in path {
        match step {
            Step::Field(name) => {
                if !text.is_empty() {
                    text.push('.');
                }
                text.push_str(name);
            }
            Step::Element(index) => text.push_str(&format!("[{index}]")),
        }
    }
    text
}

/// Line and column of a value, both from 1, columns in bytes as the reader of JSON counts them; of the innermost that is there.
pub(super) fn place(text: &str, path: &[Step]) -> (usize, usize) {
    let bytes = text.as_bytes();
    let mut at = skip_space(bytes, 0);
    for step in path {
        match into(bytes, at, *step) {
            Some(inner) => at = inner,
            None => break,
        }
    }
    let before = &bytes[..at.min(bytes.len())];
    let line = 1 + before.iter().filter(|byte| **byte == b'\n').count();
    let start = before.iter().rposition(|byte| *byte == b'\n').map_or(0, |end| end + 1);
    (line, at - start + 1)
}

fn skip_space(bytes: &[u8], mut at: usize) -> usize {
    while bytes.get(at).is_some_and(u8::is_ascii_whitespace) {
        at += 1;
    }
    at
}

/// The end of the value that begins here.
fn end(bytes: &[u8], mut at: usize) -> usize {
    let mut depth = 0;
    while let Some(byte) = bytes.get(at) {
        match byte {
            b'"' => {
                at += 1;
                while bytes.get(at).is_some_and(|byte| *byte != b'"') {
                    at += if bytes[at] == b'\\' { 2 } else { 1 };
                }
                if depth == 0 {
                    return at + 1;
                }
            }
            b'[' | b'{' => depth += 1,
            b']' | b'}' if depth == 0 => return at,
            b']' | b'}' => {
                depth -= 1;
                if depth == 0 {
                    return at + 1;
                }
            }
            b',' if depth == 0 => return at,
            _ => {}
        }
        at += 1;
    }
    bytes.len()
}

/// Where a part of the value that begins here begins.
fn into(bytes: &[u8], at: usize, step: Step) -> Option<usize> {
    let opening = if matches!(step, Step::Field(_)) { b'{' } else { b'[' };
    if bytes.get(at) != Some(&opening) {
        return None;
    }
    let mut at = skip_space(bytes, at + 1);
    let mut number = 0;
    loop {
        let here = match step {
            Step::Field(name) => {
                let ends = end(bytes, at);
                let is_it = bytes.get(at + 1..ends.checked_sub(1)?)? == name.as_bytes();
                at = skip_space(bytes, ends);
                at = skip_space(bytes, at + usize::from(bytes.get(at) == Some(&b':')));
                is_it
            }
            Step::Element(wanted) => number == wanted,
        };
        if here {
            return Some(at);
        }
        at = skip_space(bytes, end(bytes, at));
        if bytes.get(at) != Some(&b',') {
            return None;
        }
        at = skip_space(bytes, at + 1);
        number += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_found_where_they_stand() {
        let text = "{ \"a\": [1, {\"b, ]\\\"\": 2,\n  \"c\": [\"}\",\n 30]}],\"d\":4 }";
        let found = |path: &[Step]| place(text, path);
        assert_eq!(found(&[]), (1, 1));
        assert_eq!(found(&[Step::Field("a"), Step::Element(0)]), (1, 9));
        let inner = [Step::Field("a"), Step::Element(1), Step::Field("c"), Step::Element(1)];
        assert_eq!(found(&inner), (3, 2));
        assert_eq!(found(&[Step::Field("d")]), (3, 12));
        // What is not there is placed where it would be looked for.
        assert_eq!(found(&[Step::Field("a"), Step::Element(7)]), (1, 8));
        assert_eq!(shown(&inner), "a[1].c[1]");
    }

    #[test]
    fn no_text_makes_it_fail() {
        for text in
            ["", "{", "[", "{\"", "{\"a", "{\"a\"", "{\"a\":", "[1", "\"\\", "{,}", "{\"a\\"]
        {
            let path = [Step::Field("a"), Step::Element(1)];
            place(text, &path);
            place(text, &path[1..]);
        }
    }
}
