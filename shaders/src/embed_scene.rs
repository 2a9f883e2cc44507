//! The traversal of scenes of many objects as a library for a host's own shaders.

use alloc::string::String;

use crate::embed::bindings_at;
use crate::join;
use crate::table::{SCENE_BOXES, SCENE_TRAVERSAL, SCENE_TRAVERSAL_BINDINGS};

/// How many consecutive bindings the traversal of a scene takes: the tree over instances, the instances, nodes, references, triangles and shapes of
/// all geometries (storage, read only: six of the eight that a stage has under WebGPU's default limits), and a uniform of 16 bytes.
pub const SCENE_BINDING_COUNT: u32 = 7;

/// The traversal of a scene of many objects as WGSL text to put before a host's own entry points, with its declarations at seven bindings of `group`
/// from `first_binding` on. It has no entry point.
///
/// A shader that begins with it calls
///
/// - `scene_closest_hit(ray: Ray, options: SceneOptions) -> SceneHit`: the hit of least `(t, instance, triangle)`; for a miss `instance` is
///   `NO_INSTANCE`;
/// - `scene_any_hit(ray: Ray, options: SceneOptions) -> bool`.
///
/// The test is the watertight one, and the hits are those of the CPU with the accuracy `Watertight`, bit for bit. Rays and triangles of every kind are answered: none is
/// left to another shader. Opacity masks, spheres and capsules count as on the CPU.
///
/// The whole way of a ray is in one invocation. Some drivers end long loops early, as Mesa's llvmpipe does after 65,535 rounds, and here those of all
/// instances count together. The `triangle` of a ray that was not followed to its end is `UNFINISHED`; for `is_scene_hit` and `scene_any_hit` it hits nothing. A shader that must
/// know calls `trace_scene(ray, options, any) -> SceneHit` and compares with `UNFINISHED`.
///
/// `Ray(origin, t_min, direction, t_max)` is as for [`traversal`](crate::traversal), `SceneOptions(culling, mask, ignored_instance, ignored_triangle)` as
/// [`SceneOptions` in Rust][options] and `SceneHit` (`t`, `u`, `v`, `triangle`, `geometry`, `instance`) as [`SceneHit`][hit], but that `t` of a miss is `GREATEST`;
/// `scene_hit_words(hit)` gives the words of the record. `default_scene_options()` gives options under which both sides count, all instances answer and nothing is
/// ignored. All names of the text are taken; they are those of the files in `lib/`.
///
/// [options]: https://docs.rs/splitplane-core/latest/splitplane_core/scene/struct.SceneOptions.html
/// [hit]: https://docs.rs/splitplane-core/latest/splitplane_core/scene/struct.SceneHit.html
pub fn scene_traversal(group: u32, first_binding: u32) -> String {
    let mut text =
        bindings_at(&SCENE_TRAVERSAL_BINDINGS, SCENE_BINDING_COUNT, group, first_binding);
    text.push_str(&join(&SCENE_TRAVERSAL));
    text.push_str(&without_function(SCENE_BOXES.text, TWICE));
    text
}

/// The function that both walks have, with the same body.
const TWICE: &str = "fn loops_run() -> bool {\n";

/// A text without one of its functions, which begins on this line.
fn without_function(text: &str, begins: &str) -> String {
    match text.split_once(begins) {
        Some((before, rest)) => {
            let end = rest.find("\n}\n").map_or(rest.len(), |end| end + 3);
            String::from(before) + &rest[end..]
        }
        None => String::from(text),
    }
}

/// Where a search decides whether to take a hit with a triangle, in `opaque_search.wgsl`.
const TAKES: &str = "|| !is_opaque(triangle, candidate.weights) {";
/// The same where the host has a say.
const ASKS: &str = "|| !is_opaque(triangle, candidate.weights) || !host_accepts(ray, triangle, t, candidate.weights) {";
/// Where a hit with a shape is taken, in `entered_shapes.wgsl`.
const TAKES_SHAPE: &str = "&& !is_culled && first {";
/// The same where the host has a say.
const ASKS_SHAPE: &str = "&& !is_culled && first
                && accept_hit(SceneHit(t, select(span.u.x, span.u.y, k == 1u), 0.0, next.instance, asked.y >> 3u, instance)) {";
/// What hands the host a hit with a triangle.
const HOST_ACCEPTS: &str = "
// A hit for the host's `accept_hit`.
fn host_accepts(ray: PreparedRay, triangle: u32, t: f32, weights: vec3<f32>) -> bool {
    let at = barycentric(ray, triangle, weights);
    let own = instances[8u * entered + 3u];
    return accept_hit(SceneHit(t, at.x, at.y, triangle - own.w, own.y >> 3u, entered));
}
";

/// As [`scene_traversal`], for a host that decides which hits count: it must define
///
/// `fn accept_hit(hit: SceneHit) -> bool`
///
/// anywhere in the module. It is what a [`Filter`][filter] is on the CPU, with the same rule: a hit that it does not accept is as if it were not there, so among hits at the same
/// `t` the least `(instance, triangle)` that is accepted is the answer: the CPU's hits with such a filter, bit for bit where the function computes the same.
///
/// # What it is told
/// All fields are those of the hit as the answer would have them, bit for bit:
///
/// | field | of a triangle | of a sphere or capsule |
/// |---|---|---|
/// | `t` | the caller's, in the world; finite, within the ray's limits | the same |
/// | `u`, `v` | weights of the second and third corner | how far along the axis, from 0 to 1; 0 |
/// | `triangle` | its number in its mesh | the number of the shape in its set |
/// | `geometry`, `instance` | names | names |
///
/// It is not told which side was hit, nor where the ray is: a host that must know the ray puts it in a private variable of its own before it calls the traversal.
///
/// # What is decided before
/// Hits of instances that the masks of ray and instance exclude, on sides that are culled, of the triangle or shape that is ignored, beyond the ray's limits, and in
/// transparent cells of opacity masks are not shown.
///
/// # When it is asked
/// For hits that would be the best so far in their instance, in the order in which the ray comes to them, which is not that of `t`. What it accepts need not be the answer: a nearer hit may follow, and a hit of an
/// instance before may precede it at the same `t`. A triangle lies in as many leaves as its box meets. So it is asked for the same hit again wherever the ray comes to a triangle that it rejected. Of a sphere or capsule both ends of the
/// ray's way through it are shown, each once. For `scene_any_hit` it is asked until it accepts a hit. Nothing says how often it is asked: the count depends on the tree. It may have been asked about a ray whose triangle is then `UNFINISHED`.
///
/// # What it must be
/// - Pure: for one ray the same hit gets the same answer each time. Otherwise the answer depends on the tree, and that of `scene_closest_hit` may not be the nearest hit.
/// - Free of what needs uniform control flow, since the invocations of a group ask at different times: no barriers, no operations of subgroups, no derivatives. So no `textureSample`; `textureSampleLevel`, `textureSampleGrad` and `textureLoad` serve.
/// - Without calls of the traversal, which would be recursion: WGSL has none. It may call `scene_hit_words`, `is_scene_hit` and what of the text's arithmetic only computes.
/// - Without writes to variables of the text. The text's names are all taken. The host's own bindings and private variables may be read. What it writes must not change its answers.
/// - Cheap: it is part of the innermost loop, and its registers count with the loop's.
///
/// The text is complete with the host's function only; without it the module does not validate.
///
/// [filter]: https://docs.rs/splitplane-core/latest/splitplane_core/scene/trait.Filter.html
pub fn filtered_scene_traversal(group: u32, first_binding: u32) -> String {
    let text = scene_traversal(group, first_binding);
    replaced(&replaced(&text, TAKES, ASKS), TAKES_SHAPE, ASKS_SHAPE) + HOST_ACCEPTS
}

/// A text with one line in place of another, which it has once: the tests hold the texts to that.
fn replaced(text: &str, from: &str, to: &str) -> String {
    debug_assert_eq!(text.matches(from).count(), 1, "{from}");
    text.replacen(from, to, 1)
}

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;
    use crate::table::LIBRARY;
    use alloc::format;

    const HOST: &str = "
fn accept_hit(hit: SceneHit) -> bool { return hit.triangle % 2u == 0u; }
@compute @workgroup_size(1) fn main() { _ = scene_any_hit(Ray(), default_scene_options()); }";

    fn part(name: &str) -> &'static str {
        LIBRARY.iter().find(|part| part.name == name).expect("a part").text
    }

    #[test]
    fn texts_are_wgsl() {
        for text in [scene_traversal(2, 1), filtered_scene_traversal(2, 1)] {
            naga::front::wgsl::parse_str(&(text.clone() + HOST)).expect("valid WGSL");
            assert!(!text.contains("@compute") && !text.contains("@group(0)"));
            for binding in 1..=SCENE_BINDING_COUNT {
                assert_eq!(text.matches(&format!("@group(2) @binding({binding}) ")).count(), 1);
            }
        }
    }

    /// Both walks have it once, and say the same.
    #[test]
    fn one_function_is_left_out() {
        let body = |text: &'static str| {
            let (_, rest) = text.split_once(TWICE).expect("the function");
            rest.split_once("\n}\n").expect("its end").0
        };
        assert_eq!(body(SCENE_BOXES.text), body(part("walk")));
        assert_eq!(scene_traversal(0, 0).matches(TWICE).count(), 1);
    }

    #[test]
    fn a_host_is_asked_where_a_hit_is_taken() {
        let plain = scene_traversal(0, 0);
        assert_eq!((plain.matches(TAKES).count(), plain.matches(TAKES_SHAPE).count()), (1, 1));
        assert!(!plain.contains("accept_hit(") && !plain.contains("host_accepts("));
        let text = filtered_scene_traversal(0, 0);
        assert_eq!(text.matches("host_accepts(").count(), 2);
        assert_eq!(text.matches("accept_hit(").count(), 2);
        assert!(!text.contains("fn accept_hit("));
        // Nothing else is different.
        assert_eq!(
            text,
            plain.replace(TAKES, ASKS).replace(TAKES_SHAPE, ASKS_SHAPE) + HOST_ACCEPTS
        );
    }

    /// A line that is not there, or twice, would leave the host unasked.
    #[test]
    fn lines_that_are_not_there_once_are_found() {
        for text in ["", "a line, another", "line line"] {
            let replaced = || replaced(text, "line", "other");
            assert_eq!(std::panic::catch_unwind(replaced).is_ok(), text.len() == 15, "{text}");
        }
    }

    /// A ray meets shapes as in the kernel: the same lines from there on.
    #[test]
    fn shapes_are_met_as_in_the_kernel() {
        let kernel = crate::find("trace_shapes").expect("the kernel").parts.last().expect("a text");
        let from = "    // Mask, sides, root and the block of the first shape.\n";
        let rest = |text: &'static str| text.split_once(from).expect("the line").1;
        assert_eq!(rest(part("entered_shapes")), rest(kernel.text));
        assert!(rest(kernel.text).lines().count() > 50);
    }
}
