//! A shader parsed and validated by naga, and the place of every span in the files it came from.

use std::borrow::Cow;

use naga::Span;
use naga::valid::{Capabilities, ModuleInfo, ValidationFlags, Validator};
use splitplane_shaders::{Part, Shader, with_workgroup_stacks};

/// A file of a shader; like [`Part`], but owned, so that tests can change it.
#[derive(Clone, Debug)]
pub(crate) struct Text {
    /// Name of the file.
    pub name: String,
    /// The text.
    pub text: String,
}

impl From<&Part> for Text {
    fn from(part: &Part) -> Text {
        Text { name: part.name.to_owned(), text: part.text.to_owned() }
    }
}

/// The files of a shader, in the order they are joined.
pub(crate) fn texts(shader: &Shader) -> Vec<Text> {
    shader.parts.iter().map(Text::from).collect()
}

/// The files of a shader whose rays keep their stacks in the memory of the workgroup; `None` where that changes nothing.
pub(crate) fn workgroup_stacks(shader: &Shader) -> Option<Vec<Text>> {
    match with_workgroup_stacks(Cow::Borrowed(shader.parts)) {
        Cow::Borrowed(_) => None,
        Cow::Owned(parts) => Some(parts.iter().map(Text::from).collect()),
    }
}

/// A line of a file.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Place {
    /// Name of the file.
    pub part: String,
    /// The line, from 1.
    pub line: usize,
    /// What stands there.
    pub text: String,
}

impl std::fmt::Display for Place {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}.wgsl:{}: `{}`", self.part, self.line, self.text)
    }
}

/// A shader in naga's form.
pub(crate) struct Parsed {
    /// The module.
    pub module: naga::Module,
    /// What validation found out: types of expressions, uses of globals.
    pub info: ModuleInfo,
    parts: Vec<Text>,
}

impl Parsed {
    /// Joins, parses and validates, with nothing that plain WebGPU lacks: no capability of naga's is
    /// granted.
    pub(crate) fn new(parts: Vec<Text>) -> Result<Parsed, String> {
        // As `splitplane_shaders::join` does.
        let source: String = parts.iter().map(|part| format!("{}\n", part.text)).collect();
        let module =
            naga::front::wgsl::parse_str(&source).map_err(|e| e.emit_to_string(&source))?;
        let info = Validator::new(ValidationFlags::all(), Capabilities::empty())
            .validate(&module)
            .map_err(|e| e.emit_to_string(&source))?;
        Ok(Parsed { module, info, parts })
    }

    /// The line on which a span begins.
    pub(crate) fn place(&self, span: Span) -> Place {
        let mut offset = span.to_range().map_or(0, |range| range.start);
        for part in &self.parts {
            if offset <= part.text.len() {
                let line = part.text[..offset].matches('\n').count();
                let text = part.text.lines().nth(line).unwrap_or("").trim().to_owned();
                return Place { part: part.name.clone(), line: line + 1, text };
            }
            offset -= part.text.len() + 1;
        }
        Place { part: String::new(), line: 0, text: String::new() }
    }
}
