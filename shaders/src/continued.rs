//! Lists that two bindings hold, where one binding is too small.

use alloc::format;
use alloc::string::String;
use alloc::vec::Vec;

use crate::table::BY_HALVES;
use crate::{Part, Shader};

/// The parts of a kernel of the tree builder where the lists of references go on in second bindings.
pub fn parts_by_halves(shader: &Shader) -> Vec<Part> {
    let by_halves = |part: &Part| {
        let replaced = BY_HALVES.iter().find(|(whole, _)| whole == part);
        replaced.map_or(*part, |(_, halves)| *halves)
    };
    shader.parts.iter().map(by_halves).collect()
}

/// The text of a shader in which each of these lists goes on in a second binding, where the first one ends: the
/// bindings of group 0 from `first_binding` on, in the order of `names`. `None` where a list is not declared as
/// `@group(0) @binding(N) var<storage, ACCESS> NAME: array<TYPE>;`.
///
/// `NAME[AT]` becomes a call of a function that looks in the one or the other. Only whole elements can be written.
pub fn continue_lists(source: &str, names: &[&str], first_binding: u32) -> Option<String> {
    let mut text = String::from(source);
    for (name, binding) in names.iter().zip(first_binding..) {
        text = continue_list(&text, name, binding)?;
    }
    Some(text)
}

fn continue_list(source: &str, name: &str, binding: u32) -> Option<String> {
    let line = source.lines().find(|line| {
        line.starts_with("@group(0) ") && line.contains(&format!("> {name}: array<"))
    })?;
    let access = line.split_once("var<storage, ")?.1.split_once('>')?.0;
    let element = line.split_once(": array<")?.1.strip_suffix(">;")?;
    let mut text = calls(source, name);
    text.push_str(&format!(
        "
@group(0) @binding({binding}) var<storage, {access}> more_{name}: array<{element}>;

fn {name}_at(at: u32) -> {element} {{
    let here = arrayLength(&{name});
    if at < here {{
        return {name}[at];
    }}
    return more_{name}[at - here];
}}
"
    ));
    if access == "read_write" {
        text.push_str(&format!(
            "
fn put_{name}(at: u32, element: {element}) {{
    let here = arrayLength(&{name});
    if at < here {{
        {name}[at] = element;
    }} else {{
        more_{name}[at - here] = element;
    }}
}}
"
        ));
    }
    Some(text)
}

/// The text with calls in place of every `NAME[AT]`, within `AT` too.
fn calls(source: &str, name: &str) -> String {
    let mut text = String::new();
    let mut rest = source;
    let mark = format!("{name}[");
    while let Some(at) = rest.find(&mark) {
        let (before, found) = rest.split_at(at);
        text.push_str(before);
        let inside = &found[mark.len()..];
        let whole_name =
            !before.ends_with(|c: char| c.is_ascii_alphanumeric() || c == '_' || c == '.');
        let Some(end) = closing(inside).filter(|_| whole_name) else {
            text.push_str(&mark);
            rest = inside;
            continue;
        };
        let index = calls(&inside[..end], name);
        let after = &inside[end + 1..];
        match after.strip_prefix(" = ").and_then(|value| value.split_once(';')) {
            Some((value, behind)) => {
                text.push_str(&format!("put_{name}({index}, {});", calls(value, name)));
                rest = behind;
            }
            None => {
                text.push_str(&format!("{name}_at({index})"));
                rest = after;
            }
        }
    }
    text.push_str(rest);
    text
}

/// Where the bracket closes that was opened right before the text.
fn closing(text: &str) -> Option<usize> {
    let mut open = 1;
    for (at, byte) in text.bytes().enumerate() {
        match byte {
            b'[' => open += 1,
            b']' => open -= 1,
            _ => {}
        }
        if open == 0 {
            return Some(at);
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    const SOURCE: &str = "\
@group(0) @binding(0) var<storage, read> more: array<u32>;
@group(0) @binding(1) var<storage, read_write> list: array<vec2<u32>>;

fn f(i: u32) -> u32 {
    my_list[i] = list[more[list[i].x] + 1u].y;
    list[i + more[0u]] = vec2<u32>(list[2u].x, 0u);
    return here.list[i];
}
";

    #[test]
    fn elements_become_calls() {
        let text = continue_lists(SOURCE, &["list"], 2).unwrap();
        let lines: Vec<&str> = text.lines().map(str::trim).collect();
        assert_eq!(lines[4], "my_list[i] = list_at(more[list_at(i).x] + 1u).y;");
        assert_eq!(lines[5], "put_list(i + more[0u], vec2<u32>(list_at(2u).x, 0u));");
        assert_eq!(lines[6], "return here.list[i];");
        let declared =
            "@group(0) @binding(2) var<storage, read_write> more_list: array<vec2<u32>>;";
        assert!(lines.contains(&declared), "{text}");
        assert!(text.contains("fn put_list(at: u32, element: vec2<u32>)"), "{text}");
        let read = continue_lists(SOURCE, &["more"], 2).unwrap();
        assert!(read.contains("fn more_at(") && !read.contains("fn put_more("), "{read}");
    }

    #[test]
    fn nothing_is_continued_that_is_not_declared() {
        assert_eq!(continue_lists(SOURCE, &["list", "lists"], 2), None);
        assert_eq!(continue_lists(SOURCE, &[], 2).as_deref(), Some(SOURCE));
    }
}
