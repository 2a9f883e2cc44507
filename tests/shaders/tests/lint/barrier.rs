//! The barrier holds only while no compiler knows the zero: it is set from a buffer before anything
//! needs it, and nothing else writes it. And where no free operation is allowed, none is called.
//!
//! A function that sets the zero does so first of all; what it calls may then need it. A function
//! that needs the zero without setting it leaves that to its callers. No entry point may be left
//! needing it.

use naga::ir::{AddressSpace, Block, Expression, Statement, TypeInner};
use naga::{Handle, Span};

use super::rules::{Body, Finding, OPAQUE_ZERO, Rule, finding, is_opaque_zero, type_of};
use super::strict::inner_blocks;
use crate::source::Parsed;

/// Applies the rules.
pub(crate) fn check(
    parsed: &Parsed,
    bodies: &[Body<'_>],
    free_allowed: bool,
    findings: &mut Vec<Finding>,
) {
    // Whether each function needs the zero to be set. Functions stand after those they call.
    let mut needs = Vec::new();
    for body in bodies {
        let set_first = sets_zero_first(parsed, body);
        let mut expressions = body.function.expressions.iter();
        let mut needed = expressions.any(|(e, _)| is_opaque_zero(parsed, body, e));
        let mut writes = 0;
        visit(&body.function.body, &mut |statement, span| match statement {
            Statement::Store { pointer, .. } if is_zero(parsed, body, *pointer) => {
                writes += 1;
                if !set_first || writes > 1 {
                    let what = "the barrier's zero is written here".to_owned();
                    findings.push(finding(parsed, Rule::Barrier, body, span, what));
                }
            }
            Statement::Call { function, arguments, .. } => {
                if arguments.iter().any(|&argument| is_zero(parsed, body, argument)) {
                    let what = "the barrier's zero is passed by reference".to_owned();
                    findings.push(finding(parsed, Rule::Barrier, body, span, what));
                }
                let callee = &bodies[function.index()];
                needed |= needs[function.index()];
                if !free_allowed && callee.is_free() && !body.is_made_exact() {
                    let what = format!("call of `{}`", callee.name);
                    findings.push(finding(parsed, Rule::Free, body, span, what));
                }
            }
            _ => {}
        });
        needed &= !set_first;
        if needed && body.entry.is_some() {
            let what = "the barrier's zero is not set first, from a member `zero` of a buffer";
            let first = body.function.body.span_iter().next();
            let span = first.map_or(Span::UNDEFINED, |(_, &span)| span);
            findings.push(finding(parsed, Rule::Barrier, body, span, what.to_owned()));
        }
        needs.push(needed);
    }
}

/// Whether an expression points to the zero.
fn is_zero(parsed: &Parsed, body: &Body<'_>, expression: Handle<Expression>) -> bool {
    let Expression::GlobalVariable(global) = body.function.expressions[expression] else {
        return false;
    };
    parsed.module.global_variables[global].name.as_deref() == Some(OPAQUE_ZERO)
}

/// Whether the first thing a function does is to set the zero from a buffer.
fn sets_zero_first(parsed: &Parsed, body: &Body<'_>) -> bool {
    let expressions = &body.function.expressions;
    let first = body.function.body.iter().find(|s| !matches!(s, Statement::Emit(_)));
    let Some(&Statement::Store { pointer, value }) = first else { return false };
    let Expression::Load { pointer: source } = expressions[value] else { return false };
    let Expression::AccessIndex { base, index } = expressions[source] else { return false };
    let Expression::GlobalVariable(global) = expressions[base] else { return false };
    let TypeInner::Pointer { base: pointee, .. } = *type_of(parsed, body, base) else {
        return false;
    };
    let TypeInner::Struct { ref members, .. } = parsed.module.types[pointee].inner else {
        return false;
    };
    let space = parsed.module.global_variables[global].space;
    is_zero(parsed, body, pointer)
        && matches!(space, AddressSpace::Uniform | AddressSpace::Storage { .. })
        && members[index as usize].name.as_deref() == Some("zero")
}

/// Calls `see` with every statement.
fn visit(block: &Block, see: &mut impl FnMut(&Statement, Span)) {
    for (statement, &span) in block.span_iter() {
        see(statement, span);
        inner_blocks(statement, |inner| visit(inner, see));
    }
}
