//! The ray tracer's shaders, with no more in them than a scene needs.

use alloc::vec::Vec;

use crate::embed::TriangleTest;
use crate::table::{
    MESH, RENDER, RENDER_COMPRESSED, RENDER_RETRIES, RENDER_SETTLES, SCENE_WORDS, SUBSTITUTES,
};
use crate::{Part, Shader};

/// What a shader of the ray tracer must be able to do. Pictures do not depend on it, as long as it
/// covers what the scene has.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct RenderFeatures {
    /// Textures.
    pub textures: bool,
    /// Normals at the corners of triangles.
    pub smooth_normals: bool,
    /// Surfaces that shine.
    pub area_lights: bool,
    /// Clear bodies.
    pub dielectrics: bool,
    /// The triangle test.
    pub test: TriangleTest,
    /// Triangles that two bindings hold. Kernels that have a binding to spare take the second one; for the others
    /// ([`has_tail`]) what does not fit stands behind the words of the scene.
    pub by_halves: bool,
    /// Compressed nodes: kernels that have a shader for them ([`render_compressed`]) take it in place of their own. With the
    /// watertight test only.
    pub compressed: bool,
}

impl RenderFeatures {
    /// All that a scene may have, and the watertight test.
    pub const ALL: RenderFeatures = RenderFeatures {
        textures: true,
        smooth_normals: true,
        area_lights: true,
        dielectrics: true,
        test: TriangleTest::Watertight,
        by_halves: false,
        compressed: false,
    };
}

/// The parts of a kernel of the ray tracer, without those that `features` does not ask for; `None` for
/// a name that no kernel has. Joined they are the shader: see [`join`](crate::join).
pub fn render_parts(kernel: &str, features: &RenderFeatures) -> Option<Vec<Part>> {
    let all = [RENDER, RENDER_COMPRESSED, RENDER_RETRIES, RENDER_SETTLES].into_iter().flatten();
    let shader = { all }.find(|shader| shader.name == kernel)?;
    let substitutes = [
        (features.textures, &SUBSTITUTES.textures[..]),
        (features.smooth_normals, &SUBSTITUTES.smooth_normals),
        (features.area_lights, &SUBSTITUTES.area_lights),
        (features.dielectrics, &SUBSTITUTES.dielectrics),
        (features.test != TriangleTest::MoellerTrumbore, &SUBSTITUTES.fast),
        (features.test != TriangleTest::Certain, &SUBSTITUTES.certain),
        (!features.by_halves || !has_tail(shader), &SUBSTITUTES.one_binding),
    ];
    let part = |part: &Part| {
        let missing = substitutes.iter().filter(|(needed, _)| !needed);
        let mut pairs = missing.flat_map(|(_, pairs)| pairs.iter());
        match pairs.find(|(given, _)| given == part) {
            Some((_, substitute)) => substitute.to_vec(),
            None => alloc::vec![*part],
        }
    };
    Some(shader.parts.iter().flat_map(part).collect())
}

/// Whether a kernel that reads triangles has no binding to spare for those that one does not hold: it reads the words of the
/// scene too, behind which these stand.
pub fn has_tail(shader: &Shader) -> bool {
    [MESH, SCENE_WORDS].iter().all(|part| shader.parts.contains(part))
}

/// The name of the shader that stands in this kernel's place where the tree has compressed nodes, if there is one. It finds
/// hits by the watertight test alone, and binds compressed nodes and their references where the kernel binds the tree's.
pub fn render_compressed(kernel: &str) -> Option<&'static str> {
    let is_compressed = |shader: &&Shader| shader.name.strip_suffix("_compressed") == Some(kernel);
    RENDER_COMPRESSED.iter().find(is_compressed).map(|shader| shader.name)
}

/// The name of the shader that finishes what this kernel leaves to it, if there is one.
pub fn render_retry(kernel: &str) -> Option<&'static str> {
    let is_retry = |shader: &&Shader| shader.name.strip_suffix("_retry") == Some(kernel);
    RENDER_RETRIES.iter().find(is_retry).map(|shader| shader.name)
}

/// The name of the shader that follows this kernel and its retry where hits are exact, if there is one: it tells which records
/// are certain.
pub fn render_settle(kernel: &str) -> Option<&'static str> {
    let settles = |shader: &&Shader| shader.name.strip_suffix("_settle") == Some(kernel);
    RENDER_SETTLES.iter().find(settles).map(|shader| shader.name)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::join;

    #[test]
    fn all_features_are_the_table() {
        for shader in RENDER {
            assert_eq!(render_parts(shader.name, &RenderFeatures::ALL).unwrap(), shader.parts);
        }
        assert_eq!(render_parts("no kernel", &RenderFeatures::ALL), None);
    }

    #[test]
    fn what_is_not_needed_is_not_there() {
        let plain = RenderFeatures {
            textures: false,
            smooth_normals: false,
            area_lights: false,
            dielectrics: false,
            test: TriangleTest::MoellerTrumbore,
            by_halves: false,
            compressed: false,
        };
        let text = |kernel| join(&render_parts(kernel, &plain).unwrap());
        let shade = text("shade");
        for absent in ["fn texel(", "fn emitter_at(", "fn part(", "normals_at +"] {
            assert!(!shade.contains(absent), "{absent}");
        }
        assert!(!text("next_paths").contains("fn refracted("));
        assert!(!text("closest_hits").contains("fn watertight("));
    }
}
