//! Shaders that count what each of their invocations does: rounds of loops, operations, loads and barriers.
//!
//! The entry point becomes a function that another calls and then adds up what was counted. In naga's form
//! every run of statements gets a call that counts it, so that branches which are not taken count nothing. An
//! operation is one of a scalar: `a + b` of two vectors counts three. What names and registers do for nothing
//! (copies, constructors, casts of bits, members) counts nothing.

use naga::front::wgsl;
use naga::ir::{
    AddressSpace, BinaryOperator, Block, Expression, Function, GlobalVariable, Literal, Module,
    ScalarKind, Statement, SwitchCase, TypeInner,
};
use naga::valid::{Capabilities, FunctionInfo, ModuleInfo, ValidationFlags, Validator};
use naga::{Handle, Range, Span};

use super::tally::{LANES_IN_STEP, WORDS};
use crate::moved as ledger;

/// What stands before the text of a shader.
const COUNTING: &str = "
var<private> counted_rounds: u32;
var<private> counted_operations: u32;
var<private> counted_loads: u32;
var<private> counted_barriers: u32;
var<private> counted_read: u32;
var<private> counted_written: u32;
fn counted_now(operations: u32, loads: u32, rounds: u32, barriers: u32, read: u32, written: u32) {
    counted_read += read;
    counted_written += written;
    counted_operations += operations;
    counted_loads += loads;
    counted_rounds += rounds;
    counted_barriers += barriers;
}
";

/// The function that counts a run of statements, and the beginning of all names that are not the shader's own.
const COUNT: &str = "counted_now";
const OWN: &str = "counted_";
/// The shader's entry point, now a function.
const MAIN: &str = "counted_main";

/// What stands behind it: sums over a workgroup, and over all, 64 bits each.
const SUMS: &str = "
var<workgroup> counted_lanes: array<vec4<u32>, LANES>;
var<workgroup> counted_moved: array<vec2<u32>, LANES>;
@group(0) @binding(BINDING) var<storage, read_write> counted_words: array<atomic<u32>, WORDS>;
fn counted_add(word: u32, part: vec2<u32>) {
    let before = atomicAdd(&counted_words[word], part.x);
    let carry = select(0u, 1u, before + part.x < before);
    atomicAdd(&counted_words[word + 1u], part.y + carry);
}
fn counted_plus(a: vec2<u32>, b: u32) -> vec2<u32> {
    let low = a.x + b;
    return vec2<u32>(low, a.y + select(0u, 1u, low < a.x));
}
fn counted_sum() {
    var rounds: vec2<u32>;
    var operations: vec2<u32>;
    var loads: vec2<u32>;
    var in_step: vec2<u32>;
    var read: vec2<u32>;
    var written: vec2<u32>;
    var longest: vec4<u32>;
    var slowest = 0u;
    for (var lane = 0u; lane < LANESu; lane++) {
        let one = counted_lanes[lane];
        rounds = counted_plus(rounds, one.x);
        operations = counted_plus(operations, one.y);
        loads = counted_plus(loads, one.z);
        read = counted_plus(read, counted_moved[lane].x);
        written = counted_plus(written, counted_moved[lane].y);
        longest = max(longest, one);
        slowest = max(slowest, one.y);
        if lane % STEPu == STEPu - 1u || lane == LANESu - 1u {
            in_step = counted_plus(in_step, slowest);
            slowest = 0u;
        }
    }
    atomicAdd(&counted_words[0], 1u);
    counted_add(2u, rounds);
    counted_add(4u, operations);
    counted_add(6u, loads);
    counted_add(8u, in_step);
    counted_add(10u, vec2<u32>(longest.w, 0u));
    counted_add(22u, read);
    counted_add(24u, written);
    atomicMax(&counted_words[12], longest.x);
    atomicMax(&counted_words[13], longest.y);
    atomicMax(&counted_words[14], longest.z);
    atomicMax(&counted_words[15], longest.w);
    // A loop that ends at once is one round: nothing to do.
    if longest.x != 1u {
        atomicAdd(&counted_words[1], 1u);
        counted_add(16u, operations);
        counted_add(18u, loads);
        counted_add(20u, in_step);
    }
}
";

/// A shader that counts into the buffer at this binding.
///
/// # Errors
/// A text that has no such entry point as ours have, or that naga refuses.
pub(crate) fn counting(source: &str, binding: u32) -> Result<String, String> {
    let (mut module, info) = parsed(&wrapped(source, binding)?)?;
    let count = module.functions.iter().find(|(_, function)| is(function, COUNT));
    let (count, _) = count.ok_or("the function that counts is gone")?;
    let functions: Vec<Handle<Function>> =
        module.functions.iter().filter(|(_, function)| is_shaders(function)).map(|f| f.0).collect();
    for handle in functions {
        // Taken out meanwhile, so that the module can be asked.
        let mut function = std::mem::take(&mut module.functions[handle]);
        let body = std::mem::take(&mut function.body);
        let costs = Costs { module: &module, info: &info[handle] };
        function.body = Counted { costs, count, function: &mut function }.block(body, 0);
        module.functions[handle] = function;
    }
    let info = validated(&module)?;
    let flags = naga::back::wgsl::WriterFlags::empty();
    naga::back::wgsl::write_string(&module, &info, flags).map_err(|error| error.to_string())
}

/// The operations that stand in a shader, as often as functions that are called are written out in place of their
/// calls; each once, however often it runs.
///
/// # Errors
/// As for [`counting`].
pub(crate) fn written(source: &str) -> Result<u64, String> {
    let (module, info) = parsed(source)?;
    let mut of_function = std::collections::HashMap::new();
    for (handle, function) in module.functions.iter() {
        let costs = Costs { module: &module, info: &info[handle] };
        // What a function calls comes before it.
        let all = written_in(&function.body, function, &costs, &of_function);
        of_function.insert(handle, all);
    }
    let entry = module.entry_points.first().ok_or("no entry point")?;
    let costs = Costs { module: &module, info: info.get_entry_point(0) };
    Ok(written_in(&entry.function.body, &entry.function, &costs, &of_function))
}

fn written_in(
    block: &Block,
    function: &Function,
    costs: &Costs<'_>,
    of: &std::collections::HashMap<Handle<Function>, u64>,
) -> u64 {
    let inner = |block: &Block| written_in(block, function, costs, of);
    block
        .iter()
        .map(|statement| {
            let own = u64::from(costs.of_statement(function, statement).operations);
            own + match statement {
                Statement::Block(block) => inner(block),
                Statement::If { accept, reject, .. } => inner(accept) + inner(reject),
                Statement::Switch { cases, .. } => cases.iter().map(|case| inner(&case.body)).sum(),
                Statement::Loop { body, continuing, .. } => inner(body) + inner(continuing),
                Statement::Call { function, .. } => of.get(function).copied().unwrap_or(0),
                _ => 0,
            }
        })
        .sum()
}

fn is(function: &Function, name: &str) -> bool {
    function.name.as_deref() == Some(name)
}

/// Whether a function is the shader's and not one that counts.
fn is_shaders(function: &Function) -> bool {
    let name = function.name.as_deref().unwrap_or("");
    name == MAIN || !name.starts_with(OWN)
}

fn parsed(source: &str) -> Result<(Module, ModuleInfo), String> {
    let module = wgsl::parse_str(source).map_err(|error| error.emit_to_string(source))?;
    let info = validated(&module)?;
    Ok((module, info))
}

fn validated(module: &Module) -> Result<ModuleInfo, String> {
    let mut validator = Validator::new(ValidationFlags::all(), Capabilities::all());
    validator.validate(module).map_err(|error| error.emit_to_string(""))
}

/// The text with its entry point called by one that adds up.
fn wrapped(source: &str, binding: u32) -> Result<String, String> {
    let stage = source.find("@compute").ok_or("no entry point")?;
    let lanes = lanes(&source[stage..])?;
    let main = stage + source[stage..].find("fn main(").ok_or("no function main")?;
    let start = main + "fn main(".len();
    let end = start + source[start..].find(") {").ok_or("no body")?;
    let mut names = Vec::new();
    let mut arguments = Vec::new();
    let mut lane = None;
    let parameters = source[start..end].split("@builtin(").skip(1);
    for parameter in parameters {
        let (builtin, rest) = parameter.split_once(')').ok_or("a parameter")?;
        let argument = rest.trim().trim_end_matches(',').trim();
        let (name, _) = argument.split_once(':').ok_or("a parameter without a type")?;
        if builtin == "local_invocation_index" {
            lane = Some(name.to_owned());
        }
        names.push(name.to_owned());
        arguments.push(argument.to_owned());
    }
    let mut outer: Vec<String> = vec![source[start..end].trim().trim_end_matches(',').to_owned()];
    let lane = lane.unwrap_or_else(|| {
        outer.push("@builtin(local_invocation_index) counted_lane: u32".to_owned());
        "counted_lane".to_owned()
    });
    outer.retain(|parameter| !parameter.is_empty());
    let sums = SUMS
        .replace("LANES", &lanes.to_string())
        .replace("BINDING", &binding.to_string())
        .replace("WORDS", &WORDS.to_string())
        .replace("STEP", &LANES_IN_STEP.to_string());
    // Directives come first in a text.
    let head = source.lines().take_while(|line| {
        line.is_empty() || ["//", "enable ", "requires "].iter().any(|word| line.starts_with(word))
    });
    let head: usize = head.map(|line| line.len() + 1).sum();
    Ok(format!(
        "{}{COUNTING}{}fn {MAIN}({}) {}{sums}
@compute @workgroup_size({lanes})
fn main({}) {{
    {MAIN}({});
    counted_lanes[{lane}] = vec4<u32>(counted_rounds, counted_operations, counted_loads, counted_barriers);
    counted_moved[{lane}] = vec2<u32>(counted_read, counted_written);
    workgroupBarrier();
    if {lane} == 0u {{ counted_sum(); }}
}}
",
        &source[..head],
        &source[head..stage],
        arguments.join(", "),
        &source[end + 2..],
        outer.join(", "),
        names.join(", "),
    ))
}

/// Invocations of a workgroup.
///
/// # Errors
/// As for [`counting`].
pub(crate) fn lanes(source: &str) -> Result<u32, String> {
    let size = between(source, "@workgroup_size(", ")").ok_or("no size of a workgroup")?;
    let size = size.trim_end_matches('u').parse();
    size.map_err(|_| "a size of a workgroup in several dimensions".to_owned())
}

fn between<'a>(text: &'a str, start: &str, end: &str) -> Option<&'a str> {
    let (_, rest) = text.split_once(start)?;
    Some(rest.split_once(end)?.0)
}

/// What a run of statements does.
#[derive(Clone, Copy, Debug, Default)]
struct Cost {
    operations: u32,
    loads: u32,
    rounds: u32,
    barriers: u32,
    /// Words of lists whose length nothing but the shader knows.
    read: u32,
    written: u32,
}

impl Cost {
    fn plus(self, other: Cost) -> Cost {
        Cost {
            operations: self.operations + other.operations,
            loads: self.loads + other.loads,
            rounds: self.rounds + other.rounds,
            barriers: self.barriers + other.barriers,
            read: self.read + other.read,
            written: self.written + other.written,
        }
    }
}

/// What statements of a function cost.
struct Costs<'a> {
    module: &'a Module,
    info: &'a FunctionInfo,
}

impl Costs<'_> {
    /// Without the blocks within it.
    fn of_statement(&self, function: &Function, statement: &Statement) -> Cost {
        let one = Cost { operations: 1, ..Cost::default() };
        match statement {
            Statement::Emit(range) => self.of_range(function, range),
            Statement::If { .. } | Statement::Switch { .. } | Statement::Loop { .. } => one,
            Statement::Store { pointer, value } => match self.space(function, *pointer) {
                Some(AddressSpace::Storage { .. } | AddressSpace::WorkGroup) => {
                    Cost { written: self.uncounted(function, *pointer, *value), ..one }
                }
                _ => Cost::default(),
            },
            Statement::Atomic { pointer, value, .. } => {
                let moved = self.uncounted(function, *pointer, *value);
                let in_buffer =
                    matches!(self.space(function, *pointer), Some(AddressSpace::Storage { .. }));
                Cost { loads: u32::from(in_buffer), read: moved, written: moved, ..one }
            }
            Statement::ControlBarrier(_) | Statement::MemoryBarrier(_) => {
                Cost { barriers: 1, ..one }
            }
            // A barrier before it and one behind it.
            Statement::WorkGroupUniformLoad { .. } => Cost { barriers: 2, ..one },
            Statement::SubgroupBallot { .. }
            | Statement::SubgroupGather { .. }
            | Statement::SubgroupCollectiveOperation { .. } => one,
            _ => Cost::default(),
        }
    }

    fn of_range(&self, function: &Function, range: &Range<Expression>) -> Cost {
        let each = range.clone().map(|handle| self.of_expression(function, handle));
        each.fold(Cost::default(), Cost::plus)
    }

    fn of_expression(&self, function: &Function, handle: Handle<Expression>) -> Cost {
        let operations = |operations| Cost { operations, ..Cost::default() };
        match &function.expressions[handle] {
            Expression::Load { pointer } => match self.space(function, *pointer) {
                // Four words at a time.
                Some(AddressSpace::Storage { .. }) => {
                    let read = self.uncounted(function, *pointer, handle);
                    Cost { loads: 1, read, ..operations(self.words(handle).div_ceil(4)) }
                }
                Some(AddressSpace::WorkGroup) => operations(self.words(handle).div_ceil(4)),
                _ => Cost::default(),
            },
            // One operation with the product, as compilers have it.
            Expression::Binary {
                op: BinaryOperator::Add | BinaryOperator::Subtract,
                left,
                right,
            } if self.is_free_product(function, *left)
                || self.is_free_product(function, *right) =>
            {
                operations(0)
            }
            Expression::Binary { .. }
            | Expression::Unary { .. }
            | Expression::Select { .. }
            | Expression::Math { .. }
            | Expression::Relational { .. }
            | Expression::As { convert: Some(_), .. } => operations(self.words(handle)),
            Expression::Access { .. } | Expression::ArrayLength(_) => operations(1),
            _ => Cost::default(),
        }
    }

    /// Whether a float is a product that nothing keeps from being fused with the one sum that it is in.
    fn is_free_product(&self, function: &Function, handle: Handle<Expression>) -> bool {
        let types = &self.module.types;
        let scalar = self.info[handle].ty.inner_with(types).scalar();
        scalar.is_some_and(|scalar| scalar.kind == ScalarKind::Float)
            && self.info[handle].ref_count == 1
            && matches!(
                function.expressions[handle],
                Expression::Binary { op: BinaryOperator::Multiply, .. }
            )
    }

    /// Scalars of the type of an expression.
    fn words(&self, handle: Handle<Expression>) -> u32 {
        let types = &self.module.types;
        match self.info[handle].ty.inner_with(types) {
            TypeInner::Vector { size, .. } => *size as u32,
            TypeInner::Scalar(_) => 1,
            inner => inner.size(self.module.to_ctx()).div_ceil(4),
        }
    }

    /// Words of a value that is read from a pointer or written to it, if it points into a list whose length no counter tells.
    fn uncounted(
        &self,
        function: &Function,
        pointer: Handle<Expression>,
        value: Handle<Expression>,
    ) -> u32 {
        let name = self.variable(function, pointer).and_then(|variable| variable.name.as_deref());
        let is_counted = !name.is_some_and(ledger::is_counted_by_shaders);
        if is_counted { 0 } else { self.words(value) }
    }

    /// Where a pointer points.
    fn space(&self, function: &Function, pointer: Handle<Expression>) -> Option<AddressSpace> {
        self.variable(function, pointer).map(|variable| variable.space)
    }

    /// The variable that a pointer points into, if it is a global one.
    fn variable(
        &self,
        function: &Function,
        mut pointer: Handle<Expression>,
    ) -> Option<&GlobalVariable> {
        loop {
            match function.expressions[pointer] {
                Expression::Access { base, .. } | Expression::AccessIndex { base, .. } => {
                    pointer = base;
                }
                Expression::GlobalVariable(variable) => {
                    return Some(&self.module.global_variables[variable]);
                }
                _ => return None,
            }
        }
    }
}

/// A function that is given calls that count.
struct Counted<'a, 'b> {
    costs: Costs<'a>,
    count: Handle<Function>,
    function: &'b mut Function,
}

impl Counted<'_, '_> {
    /// The block with calls; `rounds` are counted at its start.
    fn block(&mut self, block: Block, rounds: u32) -> Block {
        let mut out = Block::new();
        let mut cost = Cost { rounds, ..Cost::default() };
        let mut ended = false;
        for (statement, span) in block.span_into_iter() {
            cost = cost.plus(self.costs.of_statement(self.function, &statement));
            let statement = match statement {
                Statement::Block(block) => {
                    self.flush(&mut out, &mut cost);
                    Statement::Block(self.block(block, 0))
                }
                Statement::If { condition, accept, reject } => {
                    self.flush(&mut out, &mut cost);
                    let accept = self.block(accept, 0);
                    Statement::If { condition, accept, reject: self.block(reject, 0) }
                }
                Statement::Switch { selector, cases } => {
                    self.flush(&mut out, &mut cost);
                    let cases = cases.into_iter().map(|case| {
                        let body = self.block(case.body, 0);
                        SwitchCase { body, ..case }
                    });
                    let cases = cases.collect();
                    Statement::Switch { selector, cases }
                }
                Statement::Loop { body, continuing, break_if } => {
                    self.flush(&mut out, &mut cost);
                    let body = self.block(body, 1);
                    Statement::Loop { body, continuing: self.block(continuing, 0), break_if }
                }
                leaving @ (Statement::Break
                | Statement::Continue
                | Statement::Return { .. }
                | Statement::Kill) => {
                    self.flush(&mut out, &mut cost);
                    ended = true;
                    leaving
                }
                other => other,
            };
            out.push(statement, span);
        }
        if !ended {
            self.flush(&mut out, &mut cost);
        }
        out
    }

    fn flush(&mut self, out: &mut Block, cost: &mut Cost) {
        let Cost { operations, loads, rounds, barriers, read, written } = std::mem::take(cost);
        if operations + loads + rounds + barriers + read + written == 0 {
            return;
        }
        let arguments = [operations, loads, rounds, barriers, read, written].map(|number| {
            let literal = Expression::Literal(Literal::U32(number));
            self.function.expressions.append(literal, Span::UNDEFINED)
        });
        let (function, arguments) = (self.count, arguments.to_vec());
        out.push(Statement::Call { function, arguments, result: None }, Span::UNDEFINED);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SHADER: &str = "
@group(0) @binding(0) var<storage, read_write> words: array<u32>;
fn twice(x: u32) -> u32 { return x * 2u; }
@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>) {
    var sum = vec3<u32>();
    for (var i = 0u; i < words[0]; i++) {
        sum += vec3<u32>(i, twice(i), 1u);
    }
    words[group.x] = sum.x + sum.y;
}
";

    #[test]
    fn a_shader_is_counted_and_stays_one() {
        let counted = counting(SHADER, 1).unwrap();
        assert!(counted.contains("fn counted_main(group"), "{counted}");
        assert!(counted.contains("@binding(1)"), "{counted}");
        // At the start of the loop's body: the load, the comparison and its branch, and the round.
        assert!(counted.contains("counted_now(3u, 1u, 1u, 0u, 0u, 0u);"), "{counted}");
        assert!(parsed(&counted).is_ok());
    }

    /// Loop 1; load of words[0] 1, comparison 1, branch 1; vector sum 3, product 1, i++ 1; sum 1, access 1, store 1.
    #[test]
    fn operations_that_stand_there() {
        assert_eq!(written(SHADER), Ok(12));
        let other = SHADER.replace("x * 2u", "x * 2u + 1u");
        assert_eq!(written(&other), Ok(13));
    }

    /// Words of lists whose length no counter tells: a record of eight is read, an atomic sum reads and writes one.
    #[test]
    fn words_of_lists_that_no_counter_tells() {
        let shader = "
struct Reference { lo: vec3<f32>, triangle: u32, hi: vec3<f32>, padding: u32 }
@group(0) @binding(0) var<storage, read_write> middle_references: array<Reference>;
@group(0) @binding(1) var<storage, read_write> middle_nodes: array<atomic<u32>>;
@group(0) @binding(2) var<storage, read_write> references: array<Reference>;
@compute @workgroup_size(64)
fn main(@builtin(local_invocation_index) lane: u32) {
    references[lane] = middle_references[lane];
    atomicAdd(&middle_nodes[0], 1u);
    middle_references[lane].hi = vec3<f32>();
}
";
        let counted = counting(shader, 3).unwrap();
        // The store of the record is the load's; three words of the pool are written, and one by the sum.
        assert!(counted.contains(", 9u, 4u);"), "{counted}");
        let other = shader.replace("middle_references", "next_references");
        assert!(counting(&other, 3).unwrap().contains(", 1u, 1u);"));
    }

    #[test]
    fn a_product_and_its_sum_are_one_operation() {
        let shader = "
@group(0) @binding(0) var<storage, read_write> words: array<f32>;
fn fused(a: f32, b: f32, c: f32) -> f32 { return a * b + c; }
fn kept(a: f32, b: f32) -> f32 { let p = a * b; return p + p; }
@compute @workgroup_size(64)
fn main(@builtin(local_invocation_index) lane: u32) {
    words[lane] = fused(1.5, words[lane], 0.5) + kept(0.5, words[lane]);
}
";
        // Access 1 and load 1, twice; fused 1, kept 2, their sum 1; access 1, store 1.
        assert_eq!(written(shader), Ok(10));
    }

    #[test]
    fn every_shader_can_be_counted() {
        let sets = [splitplane_shaders::KERNELS, splitplane_shaders::QUERIES];
        for shader in sets.into_iter().flatten() {
            let counted = counting(&shader.source(), 9);
            assert!(counted.is_ok(), "{}: {}", shader.name, counted.unwrap_err());
            assert!(written(&shader.source()).unwrap() > 0, "{}", shader.name);
        }
    }

    #[test]
    fn what_is_no_kernel_is_refused() {
        assert!(counting("fn main() {}", 0).is_err());
        assert!(counting("@compute @workgroup_size(8, 8) fn main() {}", 0).is_err());
        assert!(counting(&SHADER.replace("words[0]", "wards[0]"), 1).is_err());
    }
}
