//! The kernels of the ray tracer against `splitplane_render`.

use core::mem::offset_of;

use naga::GlobalVariable;
use naga::ir::{AddressSpace, ArraySize, TypeInner};
use splitplane_core::kernel::Access;
use splitplane_render::kernel::{Buffer, Kernel};
use splitplane_render::layout::{Counters, FirstCost, FirstHit, Frame, Path, Spawned, Surface};
use splitplane_shaders::{RENDER, RenderFeatures, TriangleTest, render_parts};

use crate::bindings::{is_counters, name_of, storage};
use crate::constants::{self, Known, snake};
use crate::records::{self, Member, Record, kinds_of};
use crate::source::{Parsed, Text};

/// Whether a variable has the type that a binding must have.
type Suits = Box<dyn Fn(&Parsed, &GlobalVariable) -> bool>;

/// A binding: its name, its space, and whether its type is right.
struct Wanted {
    name: String,
    space: AddressSpace,
    suits: Suits,
}

/// The name of a buffer in WGSL. A traversal has a `scene` already.
fn name(buffer: Buffer) -> String {
    if buffer == Buffer::Scene { "scene_words".to_owned() } else { snake(&format!("{buffer:?}")) }
}

/// Whether a variable is a list with elements of one of these sizes.
fn is_list(parsed: &Parsed, global: &GlobalVariable, sizes: &[usize]) -> bool {
    let TypeInner::Array { size: ArraySize::Dynamic, stride, .. } =
        parsed.module.types[global.ty].inner
    else {
        return false;
    };
    sizes.contains(&(stride as usize))
}

fn wanted(kernel: Kernel) -> Vec<Wanted> {
    let list = |name: &str, written: bool, sizes: Vec<usize>| Wanted {
        name: name.to_owned(),
        space: storage(written),
        suits: Box::new(move |parsed, global| is_list(parsed, global, &sizes)),
    };
    let uniform = |name: &str, record: &'static str| Wanted {
        name: name.to_owned(),
        space: AddressSpace::Uniform,
        suits: Box::new(move |parsed, global| {
            parsed.module.types[global.ty].name.as_deref() == Some(record)
        }),
    };
    let counters = Wanted {
        name: "counters".to_owned(),
        space: storage(kernel.writes_counters()),
        suits: Box::new(is_counters),
    };
    let mut all = vec![uniform("frame", "Frame"), counters];
    for &(buffer, access) in kernel.bindings() {
        // Whole elements, words, or four words at a time.
        let element = buffer.element_size();
        let mut sizes = vec![4, element];
        if element % 16 == 0 {
            sizes.push(16);
        }
        all.push(list(&name(buffer), access != Access::Read, sizes));
    }
    if kernel.traces() {
        all.push(list("nodes", false, vec![8]));
        all.push(list("leaf_references", false, vec![4]));
        all.push(list("triangles", false, vec![4]));
        all.push(uniform("scene", "Scene"));
    }
    all
}

/// Faults of the bindings of a kernel.
pub fn binding_faults(parsed: &Parsed, kernel: Kernel) -> Vec<String> {
    let globals = parsed.module.global_variables.iter();
    let mut bound: Vec<(u32, &GlobalVariable)> =
        globals.filter_map(|(_, global)| Some((global.binding?.binding, global))).collect();
    bound.sort_by_key(|(binding, _)| *binding);
    let wanted = wanted(kernel);
    let mut faults = Vec::new();
    for (place, want) in wanted.iter().enumerate() {
        let Some(&(binding, global)) = bound.get(place) else {
            faults.push(format!("{} is not bound", want.name));
            continue;
        };
        if binding as usize != place || name_of(global) != want.name {
            let found = name_of(global);
            faults.push(format!("{found} at {binding} in place of {} at {place}", want.name));
        } else if global.space != want.space {
            faults.push(format!("{} is {:?}", want.name, global.space));
        } else if !(want.suits)(parsed, global) {
            faults.push(format!("{} has another type", want.name));
        }
    }
    let besides = bound.iter().skip(wanted.len());
    faults.extend(besides.map(|(_, global)| format!("{} is bound besides", name_of(global))));
    faults
}

/// The records of the ray tracer.
pub fn records() -> Vec<Record> {
    vec![
        record!(Path { weight pixel sequence padding }),
        record!(Surface {
            point offset geometric_normal material normal lights scattering flags light padding
        }),
        record!(Spawned { shadow_rays next_paths }),
        record!(FirstHit { normal depth triangle u v padding }),
        record!(FirstCost { nodes triangles }),
        record!(Counters { words }),
        record!(Frame {
            eye zero corner width step_x height step_y samples zenith depth horizon area_samples
            nadir seed minimum_weight ambient headlight exposure sample_weight slice_pixels
            path_room shadow_room lights emitters materials triangles lights_at emitters_at
            textures_at srgb_at material_of_at normals_at texcoords_at texels_at culling ignore
            padding
        }),
    ]
}

/// Faults of the structs that cross. The `Scene` of traversals is between the shaders and the
/// backend.
pub fn record_faults(parsed: &Parsed) -> Vec<String> {
    let mut faults = records::faults_among(parsed, &records(), "render_layout", true);
    faults.retain(|fault| !fault.starts_with("Scene: no record"));
    faults
}

/// The constants of the core and of the ray tracer; where both have one of a name, the latter's.
pub fn known() -> Known {
    let mut known = constants::of_core();
    known.extend(constants::of("src"));
    known
}

/// Every kernel with every choice of features, each combination of parts once.
pub fn variants() -> Vec<(Kernel, Vec<Text>)> {
    let mut variants: Vec<(Kernel, Vec<Text>)> = Vec::new();
    for (kernel, shader) in Kernel::ALL.into_iter().zip(RENDER) {
        for choice in 0..32u32 {
            let has = |bit: u32| choice & (1 << bit) != 0;
            let features = RenderFeatures {
                textures: has(0),
                smooth_normals: has(1),
                area_lights: has(2),
                dielectrics: has(3),
                test: if has(4) { TriangleTest::Watertight } else { TriangleTest::MoellerTrumbore },
            };
            let parts = render_parts(shader.name, &features).expect("a kernel of the table");
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
