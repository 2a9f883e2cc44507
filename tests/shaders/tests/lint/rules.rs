//! What the lint knows of a module, and what it may say.

use std::collections::BTreeSet;
use std::fmt;

use naga::ir::{Expression, Function, ScalarKind, TypeInner};
use naga::valid::FunctionInfo;
use naga::{Handle, Span};

use crate::source::{Parsed, Place};

/// The file that owns float arithmetic.
pub(crate) const ARITHMETIC: &str = "arithmetic";
/// Guarded operations: their results pass the barrier.
pub(crate) const GUARDED: [&str; 3] = ["product", "sum", "difference"];
/// Free operations: a compiler may do with them as it likes.
pub(crate) const FREE: [&str; 4] = ["free_mul", "free_mul_add", "free_sub", "free_reciprocal"];
/// What may call free operations everywhere: whatever they round, its caller makes the result exact.
pub(crate) const MADE_EXACT: [&str; 1] = ["near_quotient"];
/// The global that no compiler knows to be zero.
pub(crate) const OPAQUE_ZERO: &str = "opaque_zero";

/// What is wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Rule {
    /// A float operation outside the functions that may have one.
    Raw,
    /// A division, or a function that is not exact on every device.
    Inexact,
    /// An infinity or NaN that a compiler can see.
    NotFinite,
    /// A result reaches another operation without passing the barrier: a compiler may merge the two.
    Merged,
    /// A guarded operation returns without passing the barrier.
    Unguarded,
    /// The result of a free operation, or of one without guard, is written to a buffer.
    Written,
    /// A free operation where none is allowed.
    Free,
    /// The barrier's zero is not set as it must be.
    Barrier,
    /// Something the lint does not understand.
    Unknown,
}

/// One fault.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Finding {
    /// The rule.
    pub rule: Rule,
    /// The function.
    pub function: String,
    /// The line.
    pub place: Place,
    /// In words.
    pub what: String,
    /// Calls that bring the fault into this function, for one that depends on the arguments.
    pub calls: BTreeSet<String>,
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?}: {} in `{}`, {}", self.rule, self.what, self.function, self.place)?;
        for call in &self.calls {
            write!(f, "\n    called from {call}")?;
        }
        Ok(())
    }
}

/// A function or an entry point.
pub(crate) struct Body<'a> {
    /// Its name.
    pub name: &'a str,
    /// The function.
    pub function: &'a Function,
    /// What validation found out.
    pub info: &'a FunctionInfo,
    /// The file it stands in.
    pub part: String,
    /// The entry point's number, if it is one.
    pub entry: Option<usize>,
}

impl Body<'_> {
    /// One of [`GUARDED`], not a namesake in another file.
    pub(crate) fn is_guarded(&self) -> bool {
        self.part == ARITHMETIC && GUARDED.contains(&self.name)
    }

    /// One of [`FREE`].
    pub(crate) fn is_free(&self) -> bool {
        self.part == ARITHMETIC && FREE.contains(&self.name)
    }

    /// One of [`MADE_EXACT`].
    pub(crate) fn is_made_exact(&self) -> bool {
        self.part == ARITHMETIC && MADE_EXACT.contains(&self.name)
    }
}

/// All functions, then all entry points. The number of a function is the index of its handle.
pub(crate) fn bodies(parsed: &Parsed) -> Vec<Body<'_>> {
    let module = &parsed.module;
    let functions = module.functions.iter().map(|(handle, function)| Body {
        name: function.name.as_deref().unwrap_or("?"),
        function,
        info: &parsed.info[handle],
        part: parsed.place(module.functions.get_span(handle)).part,
        entry: None,
    });
    let entries = module.entry_points.iter().enumerate().map(|(index, entry)| Body {
        name: &entry.name,
        function: &entry.function,
        info: parsed.info.get_entry_point(index),
        // Entry points have no span.
        part: String::new(),
        entry: Some(index),
    });
    functions.chain(entries).collect()
}

/// The type of an expression.
pub(crate) fn type_of<'a>(
    parsed: &'a Parsed,
    body: &'a Body<'_>,
    expression: Handle<Expression>,
) -> &'a TypeInner {
    body.info[expression].ty.inner_with(&parsed.module.types)
}

/// The kind of scalar a scalar, vector or matrix is made of.
pub(crate) fn scalar_kind(inner: &TypeInner) -> Option<ScalarKind> {
    match inner {
        TypeInner::Scalar(scalar)
        | TypeInner::Vector { scalar, .. }
        | TypeInner::Matrix { scalar, .. } => Some(scalar.kind),
        _ => None,
    }
}

/// Whether an expression is a float scalar, vector or matrix.
pub(crate) fn is_float(parsed: &Parsed, body: &Body<'_>, expression: Handle<Expression>) -> bool {
    matches!(
        scalar_kind(type_of(parsed, body, expression)),
        Some(ScalarKind::Float | ScalarKind::AbstractFloat)
    )
}

/// Whether an expression is the value of [`OPAQUE_ZERO`].
pub(crate) fn is_opaque_zero(
    parsed: &Parsed,
    body: &Body<'_>,
    expression: Handle<Expression>,
) -> bool {
    let expressions = &body.function.expressions;
    let Expression::Load { pointer } = expressions[expression] else { return false };
    let Expression::GlobalVariable(global) = expressions[pointer] else { return false };
    let global = &parsed.module.global_variables[global];
    global.name.as_deref() == Some(OPAQUE_ZERO) && global.space == naga::AddressSpace::Private
}

/// A fault at a place.
pub(crate) fn finding(
    parsed: &Parsed,
    rule: Rule,
    body: &Body<'_>,
    span: Span,
    what: String,
) -> Finding {
    Finding {
        rule,
        function: body.name.to_owned(),
        place: parsed.place(span),
        what,
        calls: BTreeSet::new(),
    }
}
