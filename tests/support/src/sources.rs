//! Rust sources as tests read them: what is left of a file without comments, literals and tests.

use std::fs;
use std::path::{Path, PathBuf};

/// The root of the workspace.
pub fn workspace() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// The folders of the workspace's packages, relative to its root.
///
/// # Panics
/// If the root's manifest cannot be read, or lists no members.
pub fn packages() -> Vec<String> {
    let manifest = fs::read_to_string(workspace().join("Cargo.toml")).expect("the root's manifest");
    let list = manifest.split("\nmembers = [").nth(1).expect("members");
    let list = list.split(']').next().expect("their end");
    let members = list.split('"').skip(1).step_by(2).map(str::to_owned);
    members.chain(["".to_owned()]).collect()
}

/// All files below a folder whose names end in `.rs`, sorted.
///
/// # Panics
/// If a folder cannot be read.
pub fn rust_files(folder: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    for entry in fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            files.extend(rust_files(&path));
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            files.push(path);
        }
    }
    files.sort();
    files
}

/// A source in which comments and the contents of strings and characters are spaces. Lines keep their numbers.
pub fn code(source: &str) -> String {
    let bytes = source.as_bytes();
    let mut out: Vec<u8> = Vec::with_capacity(bytes.len());
    let mut i = 0;
    while i < bytes.len() {
        let end = if source[i..].starts_with("//") {
            source[i..].find('\n').map_or(bytes.len(), |at| i + at)
        } else if source[i..].starts_with("/*") {
            end_of_comment(source, i)
        } else if let Some(end) = end_of_literal(bytes, i) {
            end
        } else {
            // A whole character, so that slices of the source stay on borders.
            let width = source[i..].chars().next().map_or(1, char::len_utf8);
            out.extend_from_slice(&bytes[i..i + width]);
            i += width;
            continue;
        };
        out.extend(bytes[i..end].iter().map(|&byte| if byte == b'\n' { b'\n' } else { b' ' }));
        i = end;
    }
    String::from_utf8(out).expect("whole characters were copied")
}

/// Where a block comment ends that begins here; they nest.
fn end_of_comment(source: &str, start: usize) -> usize {
    let (mut depth, mut i) = (0, start);
    while i < source.len() {
        if source.as_bytes()[i..].starts_with(b"/*") {
            depth += 1;
            i += 2;
        } else if source.as_bytes()[i..].starts_with(b"*/") {
            depth -= 1;
            i += 2;
            if depth == 0 {
                break;
            }
        } else {
            i += 1;
        }
    }
    i.min(source.len())
}

/// Where a string or a character ends that begins here; lifetimes are none.
fn end_of_literal(bytes: &[u8], start: usize) -> Option<usize> {
    let is_word = |byte: u8| byte.is_ascii_alphanumeric() || byte == b'_';
    let after_word = start > 0 && is_word(bytes[start - 1]);
    let mut i = start;
    if !after_word && bytes[i] == b'b' {
        i += 1;
    }
    if !after_word && bytes.get(i) == Some(&b'r') {
        let hashes = bytes[i + 1..].iter().take_while(|&&byte| byte == b'#').count();
        if bytes.get(i + 1 + hashes) == Some(&b'"') {
            let end = [b"\"".to_vec(), vec![b'#'; hashes]].concat();
            let body = i + 2 + hashes;
            let length = bytes[body..].windows(end.len()).position(|window| window == end)?;
            return Some(body + length + end.len());
        }
    }
    let quote = *bytes.get(i)?;
    if quote == b'\'' && bytes.get(i + 1) != Some(&b'\\') {
        // A character is closed right behind one; a lifetime is not closed.
        let rest = std::str::from_utf8(&bytes[i + 1..]).ok()?;
        let width = rest.chars().next()?.len_utf8();
        return (bytes.get(i + 1 + width) == Some(&b'\'')).then_some(i + width + 2);
    }
    if quote != b'"' && quote != b'\'' {
        return None;
    }
    i += 1;
    while i < bytes.len() && bytes[i] != quote {
        i += if bytes[i] == b'\\' { 2 } else { 1 };
    }
    Some((i + 1).min(bytes.len()))
}

/// Code (see [`code`]) in which items under `#[cfg(test)]` are spaces, also under `#[cfg(all(test, ..))]`.
pub fn without_tests(code: &str) -> String {
    let mut out = code.to_owned();
    let mut from = 0;
    while let Some(at) = ["#[cfg(test)]", "#[cfg(all(test"]
        .iter()
        .filter_map(|mark| out[from..].find(mark).map(|at| from + at))
        .min()
    {
        let end = end_of_item(&out, at);
        let blank: String = out[at..end].chars().map(|c| if c == '\n' { c } else { ' ' }).collect();
        out.replace_range(at..end, &blank);
        from = at;
    }
    out
}

/// Where the item ends whose attributes begin here: behind its first semicolon or block outside of brackets.
fn end_of_item(code: &str, start: usize) -> usize {
    let mut depth = 0usize;
    for (i, c) in code[start..].char_indices() {
        match c {
            '(' | '[' | '{' => depth += 1,
            ')' | ']' => depth = depth.saturating_sub(1),
            '}' => {
                depth = depth.saturating_sub(1);
                if depth == 0 {
                    return start + i + 1;
                }
            }
            ';' if depth == 0 => return start + i + 1,
            _ => {}
        }
    }
    code.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn comments_literals_and_tests_are_blank() {
        let source = "let a = 1; // word >> 2\n/* b /* c */ d */ let e = \"f \\\" g\"; let h = 'i';\n\
                      fn j<'k>(l: &'k str) {}\nlet m = r#\"n \" o\"#; let p = b'\\''; let q = 2;";
        let kept: String = code(source).split_whitespace().collect();
        assert_eq!(kept, "leta=1;lete=;leth=;fnj<'k>(l:&'kstr){}letm=;letp=;letq=2;");
        assert_eq!(code(source).lines().count(), source.lines().count());
        let source = "use a::b;\n#[cfg(test)]\nmod tests;\nfn c() { d() }\n#[cfg(test)]\nmod tests {\n    \
                      use super::{e, f};\n    fn g() { [1; 2] }\n}\nfn h() {}\n";
        let kept: String = without_tests(source).split_whitespace().collect();
        assert_eq!(kept, "usea::b;fnc(){d()}fnh(){}");
    }
}
