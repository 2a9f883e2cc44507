//! SAH kd-trees for ray tracing: built fast enough to rebuild them every frame, the same bytes on
//! every backend and thread count, and no ray lost between two triangles.
//!
#![cfg_attr(feature = "cpu", doc = "```")]
#![cfg_attr(not(feature = "cpu"), doc = "```ignore")]
//! use splitplane::{BackendKind, BuildOptions, Mesh, QueryOptions, Ray};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let positions = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
//! let mesh = Mesh::indexed(&positions, &[[0, 1, 2]])?;
//! let backend = BackendKind::Auto.open()?.backend;
//! let tree = backend.build(&mesh, &BuildOptions::default())?;
//! let ray = Ray::new([0.25, 0.25, 5.0], [0.0, 0.0, -1.0]);
//! let hit = tree.closest_hit(&ray, &QueryOptions::default()).expect("it hits");
//! assert_eq!((hit.t, hit.triangle), (5.0, 0));
//! # Ok(())
//! # }
//! ```
//!
//! # A tour
//!
//! - **Geometry** stays in your arrays: [`Mesh`] borrows positions and indices (or a soup of
//!   triangles) and never reorders them, so [`Hit::triangle`] is an index of yours.
//! - **Backends** are chosen at run time: [`BackendKind::open`] gives a `Box<dyn Backend>` and the
//!   reason for the choice; [`OpenOptions`] names a device. With `CpuBackend::new()` import the trait
//!   [`Backend`] too, which has its methods. The trait is public; you can write your own backend.
//! - **Building** gives an [`Accelerator`]: it owns the tree and answers rays. What shapes the tree
//!   is in [`BuildConfig`], which a [`Preset`] gives; limits of memory are in [`BuildOptions`] and only ever end in errors.
//! - **Scenes** of many objects have geometries and instances: [`Backend::build_scene`] makes a [`SceneAccelerator`](objects::SceneAccelerator), and
//!   [`Backend::update_scene`] remakes only what changed.
//! - **Rays** go in batches ([`Accelerator::closest_hits`], [`Accelerator::any_hits`]) or one at a
//!   time. A closest hit is the one of least (`t`, triangle index), whatever the backend.
//! - **[`Accuracy`]** is a knob: watertight by default, exact on request. A faster test that may
//!   leak is available on request.
//! - **GPUs** give the CPU's trees and watertight hits bit for bit, or say that they do not:
//!   opening one runs a self-test. `Auto` takes only an adapter that is hardware and passes it;
//!   [`BackendKind::Wgpu`] takes software too, and with [`OpenOptions::allow_structural`] also one
//!   that differs in some bits.
//!   Engines that have their own device use the types in `gpu`.
//! - **The tree itself** is an array of 8-byte nodes and one of references, [`KdTree`], named by a
//!   [`Digest`]: equal input gives an equal digest on any machine.
//! - **Pictures** come from `tracer::Tracer` (feature `render`): it is loaded with a mesh and its
//!   appearance, and makes frames of still and animated scenes that are equal on every backend; `render` has the
//!   kernels, `picture` the files.
//!
//! # Features
//!
//! `cpu` (default) is the rayon backend, `wgpu` the GPU backend. `scene` has scenes, cameras and the built-in
//! scenes; `obj`, `ply`, `stl`, `gltf`, `textures` and `animation` read files of them. `render` adds the ray tracer and `picture`
//! the files that it gives. `verify` checks answers against a reference; `parity` compares CPU and GPU.
//! Only the features you enable are compiled.
//!
//! # Where to go next
//!
//! | to | see |
//! |---|---|
//! | have a preset chosen for a mesh and its rays | `auto_preset` |
//! | rebuild a tree for each frame | [`Backend::rebuild`], [rebuild each frame] |
//! | place one mesh many times, move objects | [`Scene`](objects::Scene), [`Backend::build_scene`], [many objects] |
//! | limit memory, follow progress, cancel | [`BuildOptions`], [`Watch`], [cancel] |
//! | get all hits of a ray, or count them | [`Accelerator::all_hits`] |
//! | find out whether points are inside a mesh | [`Accelerator::locate`] |
//! | find the closest point of a mesh, or its signed distance | [`Accelerator::closest_points`], [closest points] |
//! | find what meets a box, a ball, a capsule, a frustum, another mesh | [`Accelerator::overlaps`], [overlaps] |
//! | find the nearest of a cloud of points | [`points`] |
//! | trace shadow rays and reflections | [shadows], [choose an accuracy] |
//! | make pictures with light by paths and photons | [light by paths and photons] |
//! | save and load a tree, pin it in a test | [`core::tree::file`], [`Backend::load`], [`Digest`], [keep a tree] |
//! | filter triangles, write your own query | [`KdTree::visit_along`], [`KdTree::find_best`], [custom queries] |
//! | write your own backend or executor | [`Backend`], [custom backends], [custom executors] |
//! | trace rays from your own shader | [custom shaders] |
//! | trace without `std` | [embed the core] |
//!
//! The [guide] has a page for each task.
//!
//! The core is re-exported as [`core`](splitplane_core). A glob import, `use splitplane::*`, therefore shadows Rust's own
//! `core`; import names instead.
//!
//! [guide]: https://github.com/splitplane/splitplane/blob/main/docs/guide/src/SUMMARY.md
//! [rebuild each frame]: https://github.com/splitplane/splitplane/blob/main/docs/guide/src/rebuild.md
//! [many objects]: https://github.com/splitplane/splitplane/blob/main/docs/guide/src/scenes.md
//! [cancel]: https://github.com/splitplane/splitplane/blob/main/docs/guide/src/cancel.md
//! [shadows]: https://github.com/splitplane/splitplane/blob/main/docs/guide/src/start.md#shadows
//! [choose an accuracy]: https://github.com/splitplane/splitplane/blob/main/docs/guide/src/accuracy.md
//! [keep a tree]: https://github.com/splitplane/splitplane/blob/main/docs/guide/src/keep.md
//! [closest points]: https://github.com/splitplane/splitplane/blob/main/docs/guide/src/near.md
//! [light by paths and photons]: https://github.com/splitplane/splitplane/blob/main/docs/guide/src/light.md
//! [overlaps]: https://github.com/splitplane/splitplane/blob/main/docs/guide/src/overlaps.md
//! [custom queries]: https://github.com/splitplane/splitplane/blob/main/docs/guide/src/query.md
//! [custom backends]: https://github.com/splitplane/splitplane/blob/main/docs/guide/src/own_backend.md
//! [custom executors]: https://github.com/splitplane/splitplane/blob/main/docs/guide/src/executor.md
//! [custom shaders]: https://github.com/splitplane/splitplane/blob/main/docs/guide/src/shader.md
//! [embed the core]: https://github.com/splitplane/splitplane/blob/main/docs/guide/src/no_std.md

#![forbid(unsafe_code)]
#![cfg_attr(docsrs, feature(doc_cfg))]

pub mod backend;
mod lazy;
pub mod points;

pub use backend::{BackendKind, OpenError, OpenOptions, Opened};
pub use splitplane_core as core;
pub use splitplane_core::aabb::Aabb;
pub use splitplane_core::backend::{Accelerator, Backend, BuildOptions, LoadOptions, QueryLayout};
pub use splitplane_core::config::{BuildConfig, Builder, ConfigError, Preset, Stages, Sweep};
pub use splitplane_core::error::{BuildError, DeviceError, QueryError};
pub use splitplane_core::mesh::{Mesh, MeshError};
pub use splitplane_core::query::all_hits::{AllHits, AllHitsOptions, Crossing};
pub use splitplane_core::query::along::LeafAlong;
pub use splitplane_core::query::best_first::LeafCell;
pub use splitplane_core::query::cast::{Cast, CastOptions, Impact};
pub use splitplane_core::query::closest_point::{ClosestPoint, ClosestPointOptions};
pub use splitplane_core::query::inside::{LocateOptions, Located, Location, Rule};
pub use splitplane_core::query::overlap::{OverlapOptions, Overlaps, Plane, Volume};
pub use splitplane_core::ray::{Accuracy, Culling, Hit, QueryOptions, Ray, Rays, Undecided};
pub use splitplane_core::report::{BackendInfo, BuildSummary, QueryReport};
pub use splitplane_core::tree::digest::Digest;
pub use splitplane_core::tree::node::{Axis, KdNode, NodeKind};
pub use splitplane_core::tree::{KdTree, KdTreeView};
pub use splitplane_core::watch::{Progress, Stage, Watch};
#[cfg(feature = "cpu")]
pub use splitplane_cpu::auto_preset;
#[cfg(feature = "cpu")]
pub use splitplane_cpu::{CpuAccelerator, CpuBackend, CpuScene, InstructionSet};
#[cfg(feature = "render")]
pub use splitplane_render as render;
#[cfg(feature = "picture")]
pub use splitplane_render::picture;
#[cfg(all(feature = "render", any(feature = "cpu", feature = "wgpu")))]
pub use splitplane_render::tracer;
#[cfg(feature = "scene")]
pub use splitplane_scene as scene;
#[cfg(feature = "verify")]
pub use splitplane_verify as verify;
#[cfg(feature = "parity")]
pub use splitplane_verify::parity;
#[cfg(feature = "wgpu")]
pub use splitplane_wgpu as gpu;

/// Scenes of many objects: a description, and what answers rays through it. (Scenes from files, with materials and
/// lights, are in the module `scene`.)
pub mod objects {
    pub use crate::lazy::{LazyError, LazyScene};
    pub use splitplane_core::backend::scene::*;
    pub use splitplane_core::scene::*;
}

/// The pages of the guide, whose code is tested.
#[cfg(all(doctest, feature = "cpu"))]
mod guide {
    macro_rules! pages {
        ($($page:ident),*) => {
            $(
                #[doc = include_str!(concat!("../docs/guide/src/", stringify!($page), ".md"))]
                mod $page {}
            )*
        };
    }
    pages!(
        accuracy,
        backend,
        cancel,
        executor,
        first,
        keep,
        near,
        no_std,
        overlaps,
        own_backend,
        query,
        rebuild,
        scenes,
        start
    );

    #[cfg(all(feature = "render", feature = "scene"))]
    pages!(light);

    #[cfg(feature = "wgpu")]
    pages!(shader);
}
