//! Constants of WGSL against those of the core.
//!
//! Constants of the core are read from its text, since many are private: `const NAME: TYPE = VALUE;`
//! by `NAME`, in an `impl` also by `TYPE_NAME`, variants of enums as `ENUM_VARIANT`. A constant of
//! WGSL has the value of the core's of the same name, or is on the list of those that only devices
//! need.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use naga::ir::{Expression, Literal, ShaderStage};
use splitplane_core::config::MAX_DEPTH;
use splitplane_core::layout::NearBatch;

use crate::source::{Parsed, Text};

/// A number, with its type. `usize` counts as `u32`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Number {
    /// By its bits, so that equal means equal.
    F32(u32),
    U32(u32),
    I32(i32),
}

/// What a constant that only devices need must be.
enum Only {
    Equal(Number),
    /// Another name for a constant of the core.
    Alias(&'static str),
    /// The number of invocations of a workgroup.
    Lanes,
    /// Whatever: it has no meaning outside its file.
    Any,
}

const fn float(x: f32) -> Only {
    Only::Equal(Number::F32(x.to_bits()))
}

const fn word(x: u32) -> Only {
    Only::Equal(Number::U32(x))
}

/// Constants without namesake in the core: name, value, why.
const DEVICE_ONLY: &[(&str, Only, &str)] = &[
    ("LEAST_NORMAL", float(f32::MIN_POSITIVE), "has a name in Rust's library"),
    ("GREATEST", float(f32::MAX), "has a name in Rust's library"),
    ("HALF_GREATEST", float(0.5 * f32::MAX), "written out in the core"),
    ("GREATEST_BY_FAR", float(f32::MAX / 100.0), "a quotient that devices may not compute"),
    (
        "HUGE",
        float(f32::from_bits(0x7e80_0000)),
        "2^126: beyond, no two are added, lest they overflow",
    ),
    ("STACK_ENTRIES", word(MAX_DEPTH + 1), "written out in the core"),
    ("NEAR_BATCH_OVERFULL", word(NearBatch::OVERFULL), "a difference in the core"),
    ("NEAR_BATCH_MET", word(NearBatch::MET), "a difference in the core"),
    ("WALKED", word(0), "what is no mark"),
    ("SQUARE_SLACK", Only::Any, "bounds of distances are a device's"),
    ("LEAST_SQUARE", Only::Any, "bounds of distances are a device's"),
    ("LEAST_DIVISOR", Only::Any, "bounds of distances are a device's"),
    ("NEAR_ENTRIES", Only::Any, "an array's length"),
    ("LANES", Only::Lanes, "the core has no workgroups"),
    ("BOXES", Only::Any, "the core has no workgroups"),
    ("NO_PARENT", word(u32::MAX), "an `Option` on the CPU"),
    ("NO_LANE", word(u32::MAX), "an `Option` on the CPU"),
    ("NOTHING", word(u32::MAX), "an `Option` on the CPU"),
    ("SMALL_LANES", Only::Any, "the core has no workgroups"),
    ("MOST_PLANES", Only::Any, "an array's length"),
    ("FACES_STRIDE", Only::Any, "a stride within an array"),
    ("SLOTS", Only::Any, "an array's length"),
    ("DONE", Only::Any, "a state within a small root"),
    ("LEAF", Only::Any, "a state within a small root"),
    ("OPEN", Only::Any, "a state within a small root"),
    ("OUTGROWN_RULES", Only::Any, "why a middle root is not finished; 1 is the core's"),
    ("OUTGROWN_ROOM", Only::Any, "lists of the CPU grow"),
    ("OUTGROWN_UNFINISHED", Only::Any, "the CPU finishes every loop"),
    ("TO_BE_SWEPT", Only::Any, "a mark within build_middle"),
    ("NO_NEXT", Only::Any, "a mark within build_middle"),
    ("STARTS", Only::Any, "a place within an array"),
    ("CUTS", Only::Any, "a place within an array"),
    ("LEFTS", Only::Any, "a place within an array"),
    ("RIGHTS", Only::Any, "a place within an array"),
    ("SWEEP_SIDES", Only::Any, "a place within an array"),
    ("MOST_SUMMED", word(u32::MAX >> 1), "sums of the CPU are checked beforehand"),
    ("ARRIVED", word(1 << 31), "a mark within subtree_sizes_retry"),
    ("CHUNK_WORDS", word(4), "a size in words"),
    ("CHUNK_SPAN_SIDES", word(3), "a place within a record"),
    ("DECISION_WORDS", word(16), "a size in words"),
    ("DECISION_AXIS", word(8), "a place within a record"),
    ("DECISION_POSITION", word(9), "a place within a record"),
    ("DECISION_COUNTS", word(10), "a place within a record"),
    ("DECISION_SOURCE_FIRST", word(15), "a place within a record"),
    ("SWEEP_FACES", Only::Any, "a length within an array"),
    ("SPLIT", Only::Any, "a verdict within allocate_children"),
    ("REFUSED", Only::Any, "a verdict within allocate_children"),
    ("REFUSED_ALL", Only::Any, "a verdict within allocate_children"),
    ("NO_TRIANGLE", word(u32::MAX), "an `Option` on the CPU"),
    ("INFINITY_BITS", word(0x7f80_0000), "WGSL has no infinity; the bits of `f32::INFINITY`"),
    ("UNFINISHED", word(u32::MAX - 1), "the CPU finishes every ray"),
    ("DEFERRED", word(u32::MAX - 3), "the CPU has one kernel for all rays"),
    ("UNSETTLED", word(u32::MAX - 4), "the CPU has one kernel for all rays"),
    ("DEFERRED_PATHS", word(0), "the CPU has one kernel for all rays"),
    ("DEFERRED_SHADOW_RAYS", word(1), "the CPU has one kernel for all rays"),
    ("SIDE_OPEN", Only::Any, "an `Option` on the CPU"),
    ("STACK_STEP", Only::Any, "a stride within a stack"),
    ("TOP_INSTANCE", word(1 << 31), "one of several of its name in the core"),
    ("TOP_ALWAYS", Only::Alias("ALWAYS"), "has a module of its own in the core"),
    ("TOP_NONE", word(u32::MAX), "one of several of its name in the core"),
    ("NO_INSTANCE", word(u32::MAX), "an `Option` on the CPU"),
    ("NEGLIGIBLE", float(f32::from_bits(0x2180_0000)), "one of several of its name in the core"),
    (
        "POINT_BLOCK",
        word(splitplane_core::points::tree::BLOCK as u32),
        "one of several of its name",
    ),
    ("SHARE", Only::Any, "points of an invocation"),
    ("MOST_SMALL", Only::Any, "an array's length"),
    ("SIDES", Only::Any, "an array's length"),
    ("LEVELS", Only::Any, "walks of the CPU have a stack"),
    ("ALL_LEVELS", Only::Any, "a mask of levels"),
    ("HEAP_SIZE", Only::Any, "an array's length"),
    ("SHORT_ENTRIES", Only::Any, "a stack's depth; deeper rays go elsewhere"),
    ("VERDICT_MET", Only::Any, "an enum on the CPU"),
    ("CROSSES_NOT", Only::Any, "an enum on the CPU"),
    ("CROSSES_FROM_FRONT", Only::Any, "an enum on the CPU"),
    ("CROSSES_FROM_BACK", Only::Any, "an enum on the CPU"),
    ("CROSSES_IN_DOUBT", Only::Any, "an enum on the CPU"),
    ("MOST_QUANTUM", Only::Equal(Number::I32(112)), "a difference in the core"),
    ("UNITS", Only::Equal(Number::I32(15)), "a difference in the core"),
    ("VERDICT_IN_DOUBT", Only::Any, "an enum on the CPU"),
    ("COMPARED_LESS", Only::Any, "an enum on the CPU"),
    ("COMPARED_EQUAL", Only::Any, "an enum on the CPU"),
    ("COMPARED_GREATER", Only::Any, "an enum on the CPU"),
    ("COMPARED_OPEN", Only::Any, "an enum on the CPU"),
    ("CULL_NONE", Only::Alias("CULLING_NONE"), "an enum on the CPU"),
    ("CULL_BACK", Only::Alias("CULLING_BACK"), "an enum on the CPU"),
    ("ONE_BITS", word(0x3f80_0000), "the bits of 1, beside those of infinity"),
    ("CULL_FRONT", Only::Alias("CULLING_FRONT"), "an enum on the CPU"),
];

/// Numbers by name; several where one name stands for several.
pub(crate) type Known = BTreeMap<String, BTreeSet<Number>>;

/// The constants of the core.
pub(crate) fn of_core() -> Known {
    of("../core/src")
}

/// The constants of the files of a folder, relative to this package, and of the folders in it.
pub(crate) fn of(folder: &str) -> Known {
    let mut known = Known::new();
    scan_folder(
        &Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shaders")).join(folder),
        &mut known,
    );
    known
}

fn scan_folder(folder: &Path, known: &mut Known) {
    for entry in std::fs::read_dir(folder).expect("a folder of sources") {
        let path = entry.expect("an entry of the folder").path();
        if path.is_dir() {
            scan_folder(&path, known);
        } else if path.extension().is_some_and(|ending| ending == "rs")
            && path.file_name().is_none_or(|name| name != "tests.rs")
        {
            scan(&std::fs::read_to_string(&path).expect("a source file"), known);
        }
    }
}

/// Collects the constants of one file of Rust, up to its tests.
pub(crate) fn scan(text: &str, known: &mut Known) {
    let mut add = |name: String, number| {
        known.entry(name).or_default().insert(number);
    };
    // The type of the `impl` or the enum at hand, and the next discriminant.
    let mut owner: Option<&str> = None;
    let mut next: Option<u32> = None;
    for line in text.lines().take_while(|line| *line != "#[cfg(test)]") {
        if let Some(rest) = line.strip_prefix("impl ") {
            let name = rest.rsplit(" for ").next().unwrap_or(rest);
            owner = name.split([' ', '<', '{']).next();
        } else if let Some(rest) = line.strip_prefix("pub enum ") {
            owner = rest.split([' ', '<', '{']).next();
            next = Some(0);
        } else if line == "}" {
            (owner, next) = (None, None);
        }
        if let Some((name, number)) = constant(line.trim()) {
            if let Some(owner) = owner {
                add(format!("{}_{name}", screaming(owner)), number);
            }
            add(name.to_owned(), number);
        } else if let (Some(owner), Some(discriminant)) = (owner, next)
            && let Some(variant) = line.strip_prefix("    ").and_then(|line| line.strip_suffix(','))
            && variant.starts_with(|c: char| c.is_ascii_uppercase())
        {
            let (variant, value) = variant.split_once(" = ").unwrap_or((variant, ""));
            if variant.chars().all(|c| c.is_ascii_alphanumeric()) {
                let value = integer(value).and_then(|v| u32::try_from(v).ok());
                let value = value.unwrap_or(discriminant);
                add(format!("{}_{}", screaming(owner), screaming(variant)), Number::U32(value));
                next = Some(value.wrapping_add(1));
            } else {
                // A variant with data: its numbers are the compiler's.
                next = None;
            }
        }
    }
}

/// The constant a line defines, if its value can be read.
fn constant(line: &str) -> Option<(&str, Number)> {
    let line = line.strip_prefix("pub ").unwrap_or(line);
    let line = line.strip_prefix("pub(crate) ").unwrap_or(line).strip_prefix("const ")?;
    let (name, rest) = line.split_once(": ")?;
    let (ty, rest) = rest.split_once(" = ")?;
    let (value, _) = rest.split_once(';')?;
    let number = match ty {
        "f32" => Number::F32(float_value(value)?.to_bits()),
        "u32" | "usize" => Number::U32(integer(value)?.try_into().ok()?),
        "i32" => Number::I32(integer(value)?.try_into().ok()?),
        _ => return None,
    };
    Some((name, number))
}

fn float_value(text: &str) -> Option<f32> {
    match text {
        "f32::MAX" => Some(f32::MAX),
        "f32::MIN_POSITIVE" => Some(f32::MIN_POSITIVE),
        "core::f32::consts::FRAC_1_PI" => Some(std::f32::consts::FRAC_1_PI),
        _ if text.contains(" / ") => {
            let (a, b) = text.split_once(" / ")?;
            Some(float_value(a)? / float_value(b)?)
        }
        _ => text.replace('_', "").parse().ok(),
    }
}

/// A literal, a shift of one, or that less one.
fn integer(text: &str) -> Option<i64> {
    if text == "u32::MAX" {
        return Some(u32::MAX.into());
    }
    if let Some((shift, less)) = text.strip_prefix('(').and_then(|text| text.split_once(") - ")) {
        return Some(integer(shift)? - integer(less)?);
    }
    if let Some((one, by)) = text.split_once(" << ") {
        return Some(integer(one)? << integer(by)?);
    }
    let digits = text.replace('_', "");
    match digits.strip_prefix("0x") {
        Some(hex) => i64::from_str_radix(hex, 16).ok(),
        None => digits.parse().ok(),
    }
}

/// `ActiveNodes` as `ACTIVE_NODES`.
pub(crate) fn screaming(name: &str) -> String {
    snake(name).to_uppercase()
}

/// `ActiveNodes` as `active_nodes`.
pub(crate) fn snake(name: &str) -> String {
    let mut out = String::new();
    for c in name.chars() {
        if c.is_ascii_uppercase() && !out.is_empty() {
            out.push('_');
        }
        out.push(c.to_ascii_lowercase());
    }
    out
}

/// Faults of a shader's module-scope constants.
pub(crate) fn faults(parsed: &Parsed, parts: &[Text], known: &Known) -> Vec<String> {
    let module = &parsed.module;
    let mut faults = Vec::new();
    let mut seen = BTreeSet::new();
    for (_, constant) in module.constants.iter() {
        // Without a name: a value that naga made a constant of.
        let Some(name) = constant.name.as_deref() else { continue };
        seen.insert(name);
        let value = match module.global_expressions[constant.init] {
            Expression::Literal(Literal::F32(x)) => Some(Number::F32(x.to_bits())),
            Expression::Literal(Literal::U32(x)) => Some(Number::U32(x)),
            Expression::Literal(Literal::I32(x)) => Some(Number::I32(x)),
            _ => None,
        };
        let lanes = module.entry_points.iter().find(|entry| entry.stage == ShaderStage::Compute);
        let lanes = lanes.map_or(0, |entry| entry.workgroup_size.iter().product());
        let only = DEVICE_ONLY.iter().find(|(only, ..)| *only == name);
        let of_core = |name: &str| known.get(name).cloned().unwrap_or_default();
        let wanted = match only {
            None if known.contains_key(name) => of_core(name),
            None => {
                faults.push(format!("constant {name} is not the core's and on no list"));
                continue;
            }
            Some((_, Only::Equal(number), _)) => [*number].into(),
            Some((_, Only::Alias(of), _)) => of_core(of),
            Some((_, Only::Lanes, _)) => [Number::U32(lanes)].into(),
            Some((_, Only::Any, _)) => continue,
        };
        // A name that stands for several numbers is no name.
        if wanted.len() != 1 || value.is_none_or(|value| !wanted.contains(&value)) {
            faults.push(format!("constant {name} is {value:?}, not {wanted:?}"));
        }
    }
    // naga keeps no constants without a type.
    for part in parts {
        for name in declared(&part.text) {
            if !seen.contains(name) {
                faults.push(format!("constant {name} of {}.wgsl has no type", part.name));
            }
        }
    }
    if !module.overrides.is_empty() {
        faults.push("an override, which nobody sets".to_owned());
    }
    faults
}

/// Names of the constants that a text of WGSL defines outside functions.
fn declared(text: &str) -> Vec<&str> {
    let mut depth = 0;
    let mut names = Vec::new();
    for line in text.lines() {
        let line = line.split("//").next().unwrap_or("");
        if depth == 0
            && let Some(rest) = line.trim_start().strip_prefix("const ")
        {
            names.extend(rest.split([':', '=', ' ']).next());
        }
        depth += line.matches('{').count();
        depth -= line.matches('}').count();
    }
    names
}

/// Entries of the list that the core knows by the same name, and so need no list.
pub(crate) fn needless(known: &Known) -> Vec<&'static str> {
    DEVICE_ONLY.iter().map(|(name, ..)| *name).filter(|name| known.contains_key(*name)).collect()
}
