//! The ray tracer's records, constants and texts, of `splitplane_render`.

use core::mem::offset_of;

use splitplane_render::kernel::Kernel;
use splitplane_render::layout::{Counters, FirstCost, FirstHit, Frame, Path, Spawned, Surface};
use splitplane_shaders::{
    RENDER, RenderFeatures, TriangleTest, render_compressed, render_parts, render_retry,
    render_settle,
};

use super::constants::{self, Known};
use super::records::{Member, Record, kinds_of};
use crate::source::Text;

/// The records of the ray tracer.
pub(crate) fn records() -> Vec<Record> {
    vec![
        record!(Path { weight pixel sequence density sky_density history }),
        record!(Surface {
            point offset geometric_normal material normal lights scattering flags light incoming
        }),
        record!(Spawned { shadow_rays next_paths }),
        record!(FirstHit { normal depth triangle u v instance }),
        record!(FirstCost { nodes triangles }),
        record!(Counters { words }),
        record!(Frame {
            eye zero corner width step_x height step_y samples zenith depth horizon area_samples
            nadir seed minimum_weight ambient headlight exposure sample_weight slice_pixels
            path_room shadow_room lights emitters materials triangles lights_at emitters_at
            textures_at srgb_at material_of_at normals_at texcoords_at texels_at culling ignore
            tail_at transport first_sequence sky_samples padding
        }),
    ]
}

/// The constants of the core and of the ray tracer; where both have one of a name, the latter's.
pub(crate) fn known() -> Known {
    let mut known = constants::of_core();
    known.extend(constants::of("../render/src"));
    known
}

/// The part of shaders that go through compressed nodes.
pub(crate) const COMPRESSED_TREE: &str = "render_compressed_tree";

/// Every kernel with every choice of features, each combination of parts once.
pub(crate) fn variants() -> Vec<(Kernel, Vec<Text>)> {
    let mut variants: Vec<(Kernel, Vec<Text>)> = Vec::new();
    let own = Kernel::ALL.into_iter().zip(RENDER.iter().map(|shader| shader.name));
    let retries = Kernel::ALL.into_iter().filter_map(|k| Some((k, render_retry(k.name())?)));
    let settles = Kernel::ALL.into_iter().filter_map(|k| Some((k, render_settle(k.name())?)));
    let compressed =
        Kernel::ALL.into_iter().filter_map(|k| Some((k, render_compressed(k.name())?)));
    for (kernel, name) in own.chain(retries).chain(settles).chain(compressed) {
        for choice in 0..48u32 {
            let has = |bit: u32| choice & (1 << bit) != 0;
            let test = match choice >> 4 {
                0 => TriangleTest::MoellerTrumbore,
                1 => TriangleTest::Watertight,
                _ => TriangleTest::Certain,
            };
            // It follows exact hits only.
            if name.ends_with("_settle") && test != TriangleTest::Certain {
                continue;
            }
            // These find hits by one test.
            let compressed = name.ends_with("_compressed");
            if compressed && test != TriangleTest::Watertight {
                continue;
            }
            let features = RenderFeatures {
                textures: has(0),
                smooth_normals: has(1),
                area_lights: has(2),
                dielectrics: has(3),
                test,
                by_halves: false,
                compressed,
            };
            let parts = render_parts(name, &features).expect("a kernel of the table");
            let texts: Vec<Text> = parts.iter().map(Text::from).collect();
            let same = |held: &(Kernel, Vec<Text>)| {
                held.0 == kernel && held.1.iter().map(|t| &t.name).eq(texts.iter().map(|t| &t.name))
            };
            if !variants.iter().any(same) {
                variants.push((kernel, texts));
            }
        }
    }
    variants
}
