//! The traversal as a library for a host's own shaders.

use alloc::format;
use alloc::string::String;

use crate::table::{TRAVERSAL, TRAVERSAL_BINDINGS, TRAVERSAL_TESTS};
use crate::{Part, join};

/// Which ray/triangle test a traversal has.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum TriangleTest {
    /// Woop, Benthin and Wald 2013 in guarded arithmetic: no ray slips between two triangles that
    /// share an edge, and hits have the same bits on every device.
    #[default]
    Watertight,
    /// Moeller and Trumbore 1997: a little faster; rays may leak at edges.
    MoellerTrumbore,
    /// The hit of real arithmetic, decided with bounds on every error: where these do not suffice,
    /// the hit's `triangle` is `UNDECIDED_HIT`.
    Certain,
}

/// How many consecutive bindings a traversal takes: nodes, leaf references, triangles
/// (storage, read only) and the scene (uniform, 64 bytes).
pub const TRAVERSAL_BINDING_COUNT: u32 = 4;

/// The WGSL declarations of what a traversal reads: `nodes`, `leaf_references`, `triangles` and
/// `scene`, at four bindings of `group` from `first_binding` on.
pub fn traversal_bindings(group: u32, first_binding: u32) -> String {
    bindings_at(&TRAVERSAL_BINDINGS, TRAVERSAL_BINDING_COUNT, group, first_binding)
}

/// A part that declares so many bindings from the first of group 0 on, with them elsewhere.
pub(crate) fn bindings_at(part: &Part, count: u32, group: u32, first_binding: u32) -> String {
    let mut text = String::from(part.text);
    for place in 0..count {
        let old = format!("@group(0) @binding({place}) ");
        // A mark keeps a number that was replaced from being replaced again.
        let new = format!("@group({group}) @/binding({}) ", first_binding + place);
        text = text.replace(&old, &new);
    }
    text.replace("@/binding", "@binding")
}

/// The traversal as WGSL text to put before a host's own entry points, with its declarations at
/// four bindings of `group` from `first_binding` on. It has no entry point.
///
/// A shader that begins with it calls
///
/// - `closest_hit(ray: Ray, options: QueryOptions) -> Hit`: the hit of least `(t, triangle)`; for
///   a miss `triangle` is `NO_TRIANGLE`;
/// - `any_hit(ray: Ray, options: QueryOptions) -> bool`.
///
/// Some drivers end long loops early, as Mesa's llvmpipe does after 65,535 rounds. The `triangle` of a
/// ray that was not followed to its end is `UNFINISHED`; for `is_hit` and `any_hit` it hits nothing.
/// A shader that must know calls `trace_ray(ray, options, any) -> Hit` and compares with `UNFINISHED`.
///
/// The test [`TriangleTest::Certain`] leaves some rays open: their `triangle` is `UNDECIDED_HIT`, and nothing
/// that may be hit is nearer than their `t`. For `is_hit` and `any_hit` they hit nothing; a shader
/// that must know compares as above. `t`, `u` and `v` of the others are not rounded from exact numbers, but
/// within a few units in the last place of the distances involved.
///
/// `Ray(origin, t_min, direction, t_max)` is as [`Ray` in Rust][ray]; `GREATEST` serves as a
/// `t_max` without limit. `default_options()` gives options under which both sides of a triangle
/// count and none is ignored. All names of the text are taken; they are those of the files in `lib/`.
///
/// [ray]: https://docs.rs/splitplane-core/latest/splitplane_core/ray/struct.Ray.html
pub fn traversal(group: u32, first_binding: u32, test: TriangleTest) -> String {
    let mut text = join(&TRAVERSAL);
    text.push_str(&join(TRAVERSAL_TESTS[test as usize]));
    text.push_str(&traversal_bindings(group, first_binding));
    text
}

/// Where a search decides whether to take a hit, in `search.wgsl`.
const TAKES: &str = "if any || precedes(t, triangle, search) {";
/// The same where the host has a say.
const ASKS: &str = "if (any || precedes(t, triangle, search)) && host_accepts(ray, triangle, t, candidate.weights) {";
/// What hands the host a hit.
const HOST_ACCEPTS: &str = "
// A hit for the host's `accept_hit`.
fn host_accepts(ray: PreparedRay, triangle: u32, t: f32, weights: vec3<f32>) -> bool {
    let at = barycentric(ray, triangle, weights);
    return accept_hit(Hit(t, triangle, at.x, at.y));
}
";

/// As [`traversal`], for a host that decides which hits count: it must define
///
/// `fn accept_hit(hit: Hit) -> bool`
///
/// anywhere in the module. A hit that it does not accept is as if it were not there, so among hits at the same `t` the lowest triangle that is
/// accepted is the answer: the hits of the CPU with such a filter, bit for bit where the function computes the same. It is asked only for
/// hits that would be the best so far, in any order, and may be asked for one hit several times, since several leaves may name a
/// triangle. It must be pure, and should be cheap: an alpha test, a list of what to ignore. It may read the host's own bindings and private variables.
///
/// The text is complete with the host's function only; without it the module does not validate.
///
/// `None` for [`TriangleTest::Certain`], whose bounds know nothing of a host's function.
pub fn filtered_traversal(group: u32, first_binding: u32, test: TriangleTest) -> Option<String> {
    let text = traversal(group, first_binding, test);
    // Nothing where the text has no such place, or several.
    (text.matches(TAKES).count() == 1).then(|| text.replace(TAKES, ASKS) + HOST_ACCEPTS)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bindings_are_moved() {
        let text = traversal_bindings(2, 1);
        for (binding, name) in [(1, "nodes"), (2, "leaf_references"), (3, "triangles")] {
            let line = format!("@group(2) @binding({binding}) var<storage, read> {name}:");
            assert!(text.contains(&line), "{text}");
        }
        assert!(text.contains("@group(2) @binding(4) var<uniform> scene:"), "{text}");
        assert!(!text.contains("@group(0)"), "{text}");
    }

    #[test]
    fn a_host_is_asked_where_a_hit_is_taken() {
        for test in [TriangleTest::Watertight, TriangleTest::MoellerTrumbore] {
            let text = filtered_traversal(0, 0, test).unwrap();
            assert_eq!(text.matches("host_accepts(").count(), 2);
            assert!(!text.contains(TAKES) && !text.contains("fn accept_hit("));
        }
        assert_eq!(filtered_traversal(0, 0, TriangleTest::Certain), None);
    }

    #[test]
    fn a_traversal_has_one_test_and_no_entry_point() {
        for (test, has, lacks) in [
            (TriangleTest::Watertight, "fn watertight(", "fn moeller_trumbore("),
            (TriangleTest::MoellerTrumbore, "fn moeller_trumbore(", "fn watertight("),
            (TriangleTest::Certain, "fn examine(", "fn precedes("),
        ] {
            let text = traversal(0, 0, test);
            assert!(text.contains(has) && !text.contains(lacks));
            assert!(!text.contains("@compute"));
        }
    }
}
