//! Follows results that have not passed the barrier to where a compiler could merge them with
//! another operation.
//!
//! Every value is a row of *slots*: one for each scalar, vector or matrix in it, one for all
//! elements of an array. A slot holds which kinds of unguarded results may be in it. Variables are
//! tracked without regard to the order of statements, functions once for each combination of what
//! their arguments hold, globals over the whole module. All sets only grow, so repeating until
//! nothing changes ends.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use naga::Handle;
use naga::ir::{
    AddressSpace, BinaryOperator, Block, Expression, Function, GlobalVariable, LocalVariable,
    ScalarKind, Statement, TypeInner,
};

use super::rules::{Body, Finding, Rule, finding, is_float, is_opaque_zero, type_of};
use super::strict::{inner_blocks, is_exact};
use crate::source::{Parsed, Place};

/// Kinds of results that have not passed the barrier.
type Kinds = u8;
const PRODUCT: Kinds = 1;
const SUM: Kinds = 2;
const QUOTIENT: Kinds = 4;
const FUNCTION: Kinds = 8;

/// A value's slots.
type Slots = Vec<Kinds>;

/// Applies the rules.
pub(crate) fn check(parsed: &Parsed, bodies: &[Body<'_>], findings: &mut Vec<Finding>) {
    let mut flow = Flow::new(parsed, bodies);
    loop {
        flow.changed = false;
        flow.summaries.clear();
        for number in 0..bodies.len() {
            let arguments = bodies[number].function.arguments.iter();
            let clean = arguments.map(|a| vec![0; flow.pointee_slots(a.ty)]).collect();
            flow.summary(number, clean);
        }
        if !flow.changed {
            break;
        }
    }
    findings.extend(flow.found.into_iter().map(|((rule, function, place, what), calls)| Finding {
        rule,
        function,
        place,
        what,
        calls,
    }));
}

/// What identifies a finding.
type Key = (Rule, String, Place, String);

/// What a call does: the slots of its result, and of its arguments afterwards (they change only
/// behind pointers).
#[derive(Clone)]
struct Summary {
    result: Slots,
    arguments: Vec<Slots>,
    /// Findings that some argument brought about.
    brought: BTreeSet<Key>,
}

/// The value of an expression.
#[derive(Clone)]
enum Value {
    Slots(Slots),
    Pointer { root: Root, start: usize, length: usize },
}

/// What a pointer points into.
#[derive(Clone, Copy)]
enum Root {
    Local(Handle<LocalVariable>),
    Global(Handle<GlobalVariable>),
    Argument(usize),
}

/// A function under study.
struct Frame {
    number: usize,
    arguments: Vec<Slots>,
    locals: Vec<Slots>,
    values: Vec<Value>,
    /// Results of calls, atomics and the like, by expression.
    results: HashMap<Handle<Expression>, Slots>,
    result: Slots,
    found: BTreeSet<Key>,
    changed: bool,
}

struct Flow<'a> {
    parsed: &'a Parsed,
    bodies: &'a [Body<'a>],
    /// Slots of each type.
    slots: Vec<usize>,
    globals: Vec<Slots>,
    summaries: HashMap<(usize, Vec<Slots>), Summary>,
    found: BTreeMap<Key, BTreeSet<String>>,
    changed: bool,
}

impl<'a> Flow<'a> {
    fn new(parsed: &'a Parsed, bodies: &'a [Body<'a>]) -> Flow<'a> {
        // Types stand after those they are made of.
        let mut slots: Vec<usize> = Vec::new();
        for (_, ty) in parsed.module.types.iter() {
            let count = match &ty.inner {
                TypeInner::Struct { members, .. } => {
                    members.iter().map(|member| slots[member.ty.index()]).sum()
                }
                TypeInner::Array { base, .. } => slots[base.index()],
                _ => 1,
            };
            slots.push(count);
        }
        let globals = parsed.module.global_variables.iter();
        let globals = globals.map(|(_, global)| vec![0; slots[global.ty.index()]]).collect();
        Flow {
            parsed,
            bodies,
            slots,
            globals,
            summaries: HashMap::new(),
            found: BTreeMap::new(),
            changed: false,
        }
    }

    /// Slots of a type, or of what it points to.
    fn pointee_slots(&self, ty: Handle<naga::Type>) -> usize {
        match self.parsed.module.types[ty].inner {
            TypeInner::Pointer { base, .. } => self.slots[base.index()],
            _ => self.slots[ty.index()],
        }
    }

    /// Slots of a type that may have no handle: those that have none are scalars and the like.
    fn inner_slots(&self, inner: &TypeInner) -> usize {
        match inner {
            TypeInner::Struct { members, .. } => {
                members.iter().map(|member| self.slots[member.ty.index()]).sum()
            }
            TypeInner::Array { base, .. } => self.slots[base.index()],
            _ => 1,
        }
    }

    /// Studies a function under what its arguments hold.
    fn summary(&mut self, number: usize, arguments: Vec<Slots>) -> Summary {
        let key = (number, arguments);
        if let Some(summary) = self.summaries.get(&key) {
            return summary.clone();
        }
        let body = &self.bodies[number];
        let function: &Function = body.function;
        let locals = function.local_variables.iter();
        let mut frame = Frame {
            number,
            arguments: key.1.clone(),
            locals: locals.map(|(_, local)| vec![0; self.slots[local.ty.index()]]).collect(),
            values: Vec::new(),
            results: HashMap::new(),
            result: function
                .result
                .as_ref()
                .map_or(Slots::new(), |r| vec![0; self.slots[r.ty.index()]]),
            found: BTreeSet::new(),
            changed: true,
        };
        while frame.changed {
            frame.changed = false;
            frame.values.clear();
            for (handle, _) in function.expressions.iter() {
                let value = self.evaluate(&mut frame, handle);
                frame.values.push(value);
            }
            for (handle, local) in function.local_variables.iter() {
                if let Some(init) = local.init {
                    let slots = slots_of(&frame, init);
                    frame.changed |= join(&mut frame.locals[handle.index()], &slots);
                }
            }
            self.walk(&mut frame, &function.body);
        }
        if body.is_guarded()
            && key.1.iter().flatten().all(|&kinds| kinds == 0)
            && let Some(kinds) = mixed(&frame.result)
        {
            let place = place_of_return(self.parsed, function);
            let what = format!("{} returned without the barrier", name(kinds));
            self.report(&mut frame, (Rule::Unguarded, body.name.to_owned(), place, what));
        }
        let brought = if key.1.iter().flatten().any(|&kinds| kinds != 0) {
            frame.found
        } else {
            BTreeSet::new()
        };
        let summary = Summary { result: frame.result, arguments: frame.arguments, brought };
        self.summaries.insert(key, summary.clone());
        summary
    }

    fn report(&mut self, frame: &mut Frame, key: Key) {
        self.found.entry(key.clone()).or_default();
        frame.found.insert(key);
    }

    fn report_at(&mut self, frame: &mut Frame, rule: Rule, span: naga::Span, what: String) {
        let body = &self.bodies[frame.number];
        let Finding { rule, function, place, what, .. } =
            finding(self.parsed, rule, body, span, what);
        self.report(frame, (rule, function, place, what));
    }

    fn read(&self, frame: &Frame, root: Root, start: usize, length: usize) -> Slots {
        self.memory(frame, root)[start..start + length].to_vec()
    }

    fn memory<'f>(&'f self, frame: &'f Frame, root: Root) -> &'f Slots {
        match root {
            Root::Local(local) => &frame.locals[local.index()],
            Root::Global(global) => &self.globals[global.index()],
            Root::Argument(index) => &frame.arguments[index],
        }
    }

    /// Joins slots into what a pointer points to.
    fn write(&mut self, frame: &mut Frame, pointer: Handle<Expression>, slots: &Slots) {
        let Value::Pointer { root, start, length } = frame.values[pointer.index()] else { return };
        let memory = match root {
            Root::Local(local) => &mut frame.locals[local.index()],
            Root::Global(global) => &mut self.globals[global.index()],
            Root::Argument(index) => &mut frame.arguments[index],
        };
        let changed = join(&mut memory[start..start + length], slots);
        frame.changed |= changed;
        self.changed |= changed && matches!(root, Root::Global(_));
        // What is written through an argument is looked at where the pointer comes from.
        if let Root::Global(global) = root
            && let Some(kinds) = mixed(slots)
        {
            let global = &self.parsed.module.global_variables[global];
            if matches!(global.space, AddressSpace::Storage { .. }) {
                let body = &self.bodies[frame.number];
                let span = body.function.expressions.get_span(pointer);
                let to = global.name.as_deref().unwrap_or("?");
                let what = format!("{} is written to `{to}`", name(kinds));
                self.report_at(frame, Rule::Written, span, what);
            }
        }
    }

    fn evaluate(&mut self, frame: &mut Frame, handle: Handle<Expression>) -> Value {
        let body = &self.bodies[frame.number];
        let parsed = self.parsed;
        let inner = type_of(parsed, body, handle);
        let count = self.inner_slots(inner);
        let slots = match body.function.expressions[handle] {
            Expression::Compose { ref components, .. } => {
                let parts = components.iter().map(|&part| slots_of(frame, part));
                if matches!(inner, TypeInner::Struct { .. }) {
                    parts.flatten().collect()
                } else {
                    parts.fold(vec![0; count], joined)
                }
            }
            Expression::Access { base, .. } => return self.part(frame, base, None),
            Expression::AccessIndex { base, index } => {
                return self.part(frame, base, Some(index as usize));
            }
            Expression::Splat { value: from, .. }
            | Expression::Swizzle { vector: from, .. }
            | Expression::Unary { expr: from, .. }
            | Expression::As { expr: from, .. } => slots_of(frame, from),
            Expression::FunctionArgument(index) => {
                let index = index as usize;
                let length = frame.arguments[index].len();
                if let TypeInner::Pointer { .. } = inner {
                    return Value::Pointer { root: Root::Argument(index), start: 0, length };
                }
                frame.arguments[index].clone()
            }
            Expression::GlobalVariable(global) => {
                let length = self.globals[global.index()].len();
                return Value::Pointer { root: Root::Global(global), start: 0, length };
            }
            Expression::LocalVariable(local) => {
                let length = frame.locals[local.index()].len();
                return Value::Pointer { root: Root::Local(local), start: 0, length };
            }
            Expression::Load { pointer } => match frame.values[pointer.index()] {
                Value::Pointer { root, start, length } => self.read(frame, root, start, length),
                Value::Slots(ref slots) => slots.clone(),
            },
            Expression::Binary { op, left, right } => {
                let float = is_float(parsed, body, left) || is_float(parsed, body, right);
                vec![self.binary(frame, handle, op, left, right, float)]
            }
            Expression::Select { accept, reject, .. } => {
                joined(slots_of(frame, accept), slots_of(frame, reject))
            }
            Expression::Math { fun, arg, arg1, arg2, arg3 } => {
                let arguments = [Some(arg), arg1, arg2, arg3].into_iter().flatten();
                let mut kinds = 0;
                for argument in arguments {
                    kinds |= mixed(&slots_of(frame, argument)).unwrap_or(0);
                }
                let float = is_float(parsed, body, arg) || is_float(parsed, body, handle);
                if float && !is_exact(fun) {
                    kinds = FUNCTION;
                }
                vec![kinds; count]
            }
            Expression::CallResult(_)
            | Expression::AtomicResult { .. }
            | Expression::WorkGroupUniformLoadResult { .. }
            | Expression::SubgroupOperationResult { .. } => {
                frame.results.get(&handle).cloned().unwrap_or_else(|| vec![0; count])
            }
            // Constants, truth values, lengths.
            _ => vec![0; count],
        };
        Value::Slots(slots)
    }

    fn binary(
        &mut self,
        frame: &mut Frame,
        handle: Handle<Expression>,
        op: BinaryOperator,
        left: Handle<Expression>,
        right: Handle<Expression>,
        float: bool,
    ) -> Kinds {
        use BinaryOperator as Op;
        let body = &self.bodies[frame.number];
        let operands = mixed(&slots_of(frame, left)).unwrap_or(0)
            | mixed(&slots_of(frame, right)).unwrap_or(0);
        match op {
            Op::Equal
            | Op::NotEqual
            | Op::Less
            | Op::LessEqual
            | Op::Greater
            | Op::GreaterEqual
            | Op::LogicalAnd
            | Op::LogicalOr => 0,
            Op::ExclusiveOr
                if self.is_bits(body, left) && is_opaque_zero(self.parsed, body, right)
                    || self.is_bits(body, right) && is_opaque_zero(self.parsed, body, left) =>
            {
                0
            }
            Op::Add | Op::Subtract | Op::Multiply | Op::Divide | Op::Modulo if float => {
                if operands != 0 && !body.is_free() {
                    let span = body.function.expressions.get_span(handle);
                    let what =
                        format!("{} reaches a float {op:?} without the barrier", name(operands));
                    self.report_at(frame, Rule::Merged, span, what);
                }
                match op {
                    Op::Add | Op::Subtract => SUM,
                    Op::Multiply => PRODUCT,
                    _ => QUOTIENT,
                }
            }
            // Integer operations: the bits of a float may be among the operands, and a compiler
            // sees through masks and signs.
            _ => operands,
        }
    }

    /// Whether an expression is the bits of a float.
    fn is_bits(&self, body: &Body<'_>, handle: Handle<Expression>) -> bool {
        matches!(
            body.function.expressions[handle],
            Expression::As { expr, kind: ScalarKind::Uint | ScalarKind::Sint, convert: None }
                if is_float(self.parsed, body, expr)
        )
    }

    /// A member of a struct, or an element.
    fn part(&self, frame: &Frame, base: Handle<Expression>, index: Option<usize>) -> Value {
        let body = &self.bodies[frame.number];
        let types = &self.parsed.module.types;
        let inner = match type_of(self.parsed, body, base) {
            TypeInner::Pointer { base, .. } => &types[*base].inner,
            inner => inner,
        };
        let range = match (inner, index) {
            (TypeInner::Struct { members, .. }, Some(index)) => {
                let count = |member: &naga::StructMember| self.slots[member.ty.index()];
                let skipped = members[..index].iter().map(count).sum();
                Some((skipped, count(&members[index])))
            }
            _ => None,
        };
        match (&frame.values[base.index()], range) {
            (value, None) => value.clone(),
            (Value::Slots(slots), Some((skipped, length))) => {
                Value::Slots(slots[skipped..skipped + length].to_vec())
            }
            (&Value::Pointer { root, start, .. }, Some((skipped, length))) => {
                Value::Pointer { root, start: start + skipped, length }
            }
        }
    }

    /// What statements do to memory.
    fn walk(&mut self, frame: &mut Frame, block: &Block) {
        for (statement, &span) in block.span_iter() {
            match *statement {
                Statement::Store { pointer, value } => {
                    let slots = slots_of(frame, value);
                    self.write(frame, pointer, &slots);
                }
                Statement::Return { value: Some(value) } => {
                    let slots = slots_of(frame, value);
                    frame.changed |= join(&mut frame.result, &slots);
                }
                Statement::Call { function, ref arguments, result } => {
                    self.call(frame, function.index(), arguments, result, span);
                }
                Statement::Atomic { pointer, value, result, .. } => {
                    let slots = slots_of(frame, value);
                    self.write(frame, pointer, &slots);
                    if let Some(result) = result {
                        self.result_of_load(frame, pointer, result);
                    }
                }
                Statement::WorkGroupUniformLoad { pointer, result } => {
                    self.result_of_load(frame, pointer, result);
                }
                Statement::SubgroupGather { argument, result, .. }
                | Statement::SubgroupCollectiveOperation { argument, result, .. } => {
                    let slots = slots_of(frame, argument);
                    set_result(frame, result, slots);
                }
                _ => inner_blocks(statement, |inner| self.walk(frame, inner)),
            }
        }
    }

    /// A result that is what a pointer points to; all of it may hold what any of that does.
    fn result_of_load(
        &self,
        frame: &mut Frame,
        pointer: Handle<Expression>,
        result: Handle<Expression>,
    ) {
        let slots = match frame.values[pointer.index()] {
            Value::Pointer { root, start, length } => self.read(frame, root, start, length),
            Value::Slots(ref slots) => slots.clone(),
        };
        let count = slots_of(frame, result).len();
        let slots =
            if slots.len() == count { slots } else { vec![mixed(&slots).unwrap_or(0); count] };
        set_result(frame, result, slots);
    }

    fn call(
        &mut self,
        frame: &mut Frame,
        number: usize,
        arguments: &[Handle<Expression>],
        result: Option<Handle<Expression>>,
        span: naga::Span,
    ) {
        let given: Vec<Slots> = arguments
            .iter()
            .map(|argument| match frame.values[argument.index()] {
                Value::Pointer { root, start, length } => self.read(frame, root, start, length),
                Value::Slots(ref slots) => slots.clone(),
            })
            .collect();
        let summary = self.summary(number, given);
        let body = &self.bodies[frame.number];
        for key in summary.brought {
            let call = format!("`{}`, {}", body.name, self.parsed.place(span));
            self.found.entry(key.clone()).or_default().insert(call);
            frame.found.insert(key);
        }
        for (argument, slots) in arguments.iter().zip(&summary.arguments) {
            self.write(frame, *argument, slots);
        }
        if let Some(result) = result {
            set_result(frame, result, summary.result);
        }
    }
}

fn set_result(frame: &mut Frame, result: Handle<Expression>, slots: Slots) {
    let held = frame.results.entry(result).or_insert_with(|| vec![0; slots.len()]);
    frame.changed |= join(held, &slots);
}

/// The slots of a value; none for a pointer.
fn slots_of(frame: &Frame, handle: Handle<Expression>) -> Slots {
    match &frame.values[handle.index()] {
        Value::Slots(slots) => slots.clone(),
        Value::Pointer { .. } => Slots::new(),
    }
}

/// Adds what `from` holds; true when that changes anything.
fn join(into: &mut [Kinds], from: &[Kinds]) -> bool {
    let mut changed = false;
    for (into, from) in into.iter_mut().zip(from) {
        changed |= *from & !*into != 0;
        *into |= from;
    }
    changed
}

fn joined(mut a: Slots, b: Slots) -> Slots {
    join(&mut a, &b);
    a
}

/// All kinds in any slot; `None` for none.
fn mixed(slots: &[Kinds]) -> Option<Kinds> {
    Some(slots.iter().fold(0, |all, kinds| all | kinds)).filter(|&kinds| kinds != 0)
}

fn name(kinds: Kinds) -> String {
    let names = [
        (PRODUCT, "a product"),
        (SUM, "a sum"),
        (QUOTIENT, "a quotient"),
        (FUNCTION, "the result of a function"),
    ];
    let names: Vec<_> =
        names.iter().filter(|(kind, _)| kinds & kind != 0).map(|(_, name)| *name).collect();
    names.join(" or ")
}

/// The line of a function's last statement: where it returns.
fn place_of_return(parsed: &Parsed, function: &Function) -> Place {
    let last = function.body.span_iter().last();
    parsed.place(last.map_or(naga::Span::UNDEFINED, |(_, &span)| span))
}
