//! Rules that look at one expression at a time, and so miss nothing: which operations may stand
//! where.

use naga::Handle;
use naga::ir::{
    BinaryOperator, Block, Expression, Literal, MathFunction, ScalarKind, Statement,
    SubgroupOperation,
};

use super::rules::{Body, Finding, Rule, finding, is_float};
use crate::source::Parsed;

/// Applies the rules to every function, called or not.
pub(crate) fn check(parsed: &Parsed, bodies: &[Body<'_>], findings: &mut Vec<Finding>) {
    for body in bodies {
        for (handle, _) in body.function.expressions.iter() {
            if let Some((rule, what)) = expression_fault(parsed, body, handle) {
                let span = body.function.expressions.get_span(handle);
                findings.push(finding(parsed, rule, body, span, what));
            }
        }
        statements(parsed, body, &body.function.body, findings);
    }
    for (handle, expression) in parsed.module.global_expressions.iter() {
        if let Expression::Literal(literal) = expression
            && !is_finite(literal)
        {
            let place = parsed.place(parsed.module.global_expressions.get_span(handle));
            findings.push(Finding {
                rule: Rule::NotFinite,
                function: String::new(),
                place,
                what: format!("literal {literal:?}"),
                calls: Default::default(),
            });
        }
    }
}

fn expression_fault(
    parsed: &Parsed,
    body: &Body<'_>,
    handle: Handle<Expression>,
) -> Option<(Rule, String)> {
    use BinaryOperator as Op;
    let expressions = &body.function.expressions;
    match expressions[handle] {
        Expression::Binary { op, left, right }
            if is_float(parsed, body, left) || is_float(parsed, body, right) =>
        {
            match op {
                Op::Add | Op::Subtract | Op::Multiply => (!body.is_guarded() && !body.is_free())
                    .then(|| (Rule::Raw, format!("float {op:?} outside the arithmetic"))),
                Op::Divide if body.is_free() && body.name == "free_reciprocal" => None,
                Op::Divide | Op::Modulo => Some((Rule::Inexact, format!("float {op:?}"))),
                _ => None,
            }
        }
        Expression::Math { fun, arg, arg1, .. } => {
            let float = is_float(parsed, body, arg)
                || arg1.is_some_and(|arg1| is_float(parsed, body, arg1))
                || is_float(parsed, body, handle);
            (float && !is_exact(fun)).then(|| (Rule::Inexact, format!("function {fun:?}")))
        }
        Expression::Derivative { .. } => Some((Rule::Inexact, "a derivative".to_owned())),
        Expression::ImageSample { .. } | Expression::ImageLoad { .. } => {
            Some((Rule::Unknown, "an image".to_owned()))
        }
        Expression::Literal(ref literal) if !is_finite(literal) => {
            Some((Rule::NotFinite, format!("literal {literal:?}")))
        }
        // A bit pattern that the compiler knows: it may assume that what it stands for cannot occur.
        Expression::As { expr, kind: ScalarKind::Float, convert: None } => {
            constant_bits(parsed, body, expr)
                .is_some_and(|bits| !f32::from_bits(bits).is_finite())
                .then(|| (Rule::NotFinite, "a bitcast to a value that is not finite".to_owned()))
        }
        _ => None,
    }
}

/// The functions of floats whose result is exact, hence the same on every device.
pub(crate) fn is_exact(fun: MathFunction) -> bool {
    use MathFunction as F;
    matches!(
        fun,
        F::Abs | F::Min | F::Max | F::Clamp | F::Saturate | F::Sign | F::Floor | F::Ceil | F::Trunc
    )
}

fn is_finite(literal: &Literal) -> bool {
    match *literal {
        Literal::F32(x) => x.is_finite(),
        Literal::F64(x) | Literal::AbstractFloat(x) => x.is_finite(),
        Literal::F16(x) => f32::from(x).is_finite(),
        _ => true,
    }
}

/// The value of an integer that is a constant.
fn constant_bits(parsed: &Parsed, body: &Body<'_>, handle: Handle<Expression>) -> Option<u32> {
    let literal = match body.function.expressions[handle] {
        Expression::Literal(literal) => literal,
        Expression::Constant(constant) => {
            let init = parsed.module.constants[constant].init;
            let Expression::Literal(literal) = parsed.module.global_expressions[init] else {
                return None;
            };
            literal
        }
        _ => return None,
    };
    match literal {
        Literal::U32(x) => Some(x),
        Literal::I32(x) => Some(x.cast_unsigned()),
        _ => None,
    }
}

/// Statements that compute: reductions over subgroups add and multiply in any order.
fn statements(parsed: &Parsed, body: &Body<'_>, block: &Block, findings: &mut Vec<Finding>) {
    for (statement, &span) in block.span_iter() {
        match statement {
            Statement::SubgroupCollectiveOperation { op, argument, .. }
                if matches!(op, SubgroupOperation::Add | SubgroupOperation::Mul)
                    && is_float(parsed, body, *argument) =>
            {
                let what = format!("subgroup {op:?} of floats");
                findings.push(finding(parsed, Rule::Raw, body, span, what));
            }
            Statement::ImageStore { .. }
            | Statement::ImageAtomic { .. }
            | Statement::RayQuery { .. }
            | Statement::RayPipelineFunction(_)
            | Statement::CooperativeStore { .. } => {
                let what = "a statement of graphics".to_owned();
                findings.push(finding(parsed, Rule::Unknown, body, span, what));
            }
            _ => inner_blocks(statement, |inner| statements(parsed, body, inner, findings)),
        }
    }
}

/// Calls `visit` with every block directly inside a statement.
pub(crate) fn inner_blocks<'a>(statement: &'a Statement, mut visit: impl FnMut(&'a Block)) {
    match statement {
        Statement::Block(block) => visit(block),
        Statement::If { accept, reject, .. } => {
            visit(accept);
            visit(reject);
        }
        Statement::Switch { cases, .. } => cases.iter().for_each(|case| visit(&case.body)),
        Statement::Loop { body, continuing, .. } => {
            visit(body);
            visit(continuing);
        }
        _ => {}
    }
}
