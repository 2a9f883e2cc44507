//! What a device that is a CPU is given in place of what others are.

use alloc::borrow::Cow;

use crate::Part;
use crate::table::ONE_EACH;

/// The parts of a shader for a device that is a CPU, which has an invocation for each entry of a list: the loop over
/// entries, for few invocations on hardware, makes some software take minutes to compile.
pub fn for_software(parts: Cow<'static, [Part]>) -> Cow<'static, [Part]> {
    let [(many, one)] = ONE_EACH;
    if !parts.contains(&many) {
        return parts;
    }
    parts.iter().map(|part| if *part == many { one } else { *part }).collect()
}
