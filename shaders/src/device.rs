//! What some devices are given in place of what others are.

use alloc::borrow::Cow;

use crate::Part;
use crate::table::{ONE_EACH, WORKGROUP_STACKS};

/// The parts of a shader for a device that is a CPU, which has an invocation for each entry of a list: the loop over
/// entries, for few invocations on hardware, makes some software take minutes to compile.
pub fn for_software(parts: Cow<'static, [Part]>) -> Cow<'static, [Part]> {
    replaced(parts, &ONE_EACH)
}

/// The parts of a shader whose rays keep their short stacks in the memory of the workgroup, in place of that of the invocation.
/// Shaders that have no short stack stay as they are.
pub fn with_workgroup_stacks(parts: Cow<'static, [Part]>) -> Cow<'static, [Part]> {
    replaced(parts, &WORKGROUP_STACKS)
}

fn replaced(parts: Cow<'static, [Part]>, replacements: &[(Part, Part)]) -> Cow<'static, [Part]> {
    let replacement = |part: &Part| {
        replacements.iter().find(|(old, _)| old == part).map_or(*part, |(_, new)| *new)
    };
    if !parts.iter().any(|part| replacement(part) != *part) {
        return parts;
    }
    parts.iter().map(replacement).collect()
}
