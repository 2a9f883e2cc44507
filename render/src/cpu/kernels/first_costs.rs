//! Records the cost of the first ray of every pixel, by the reference traversal.

use crate::layout::FirstCost;
use rayon::prelude::*;
use splitplane_core::arithmetic::Strict;
use splitplane_core::backend::scene::BuiltScene;
use splitplane_core::mesh::Mesh;
use splitplane_core::query::intersect::SceneScale;
use splitplane_core::query::traverse::{Cost, Query, trace_observed};
use splitplane_core::ray::{QueryOptions, Ray};
use splitplane_core::scene::SceneOptions;
use splitplane_core::tree::KdTreeView;
use splitplane_float_state::Standard;

pub(crate) struct Input<'a> {
    pub(crate) tree: KdTreeView<'a>,
    pub(crate) mesh: Mesh<'a>,
    pub(crate) scale: SceneScale,
    pub(crate) options: QueryOptions<'a>,
    pub(crate) samples: u32,
    pub(crate) first_pixel: u32,
    pub(crate) rays: &'a [Ray],
}

/// The costs of first rays through a scene of instances.
pub(crate) fn run_scene<'a>(
    scene: &BuiltScene,
    options: &SceneOptions<'_>,
    firsts: impl IndexedParallelIterator<Item = &'a Ray>,
    first_costs: &mut [FirstCost],
) {
    first_costs.par_iter_mut().zip(firsts).with_min_len(256).for_each(|(cost, ray)| {
        let _state = Standard::set();
        let (_, Cost { nodes, triangles }) = scene.cost_of(ray, options);
        *cost = FirstCost { nodes, triangles };
    });
}

/// `first_costs` are those of the whole picture.
pub(crate) fn run(input: &Input<'_>, first_costs: &mut [FirstCost]) {
    let samples = input.samples as usize;
    let slice = &mut first_costs[input.first_pixel as usize..];
    let firsts = input.rays.par_iter().step_by(samples);
    slice.par_iter_mut().zip(firsts).with_min_len(256).for_each(|(cost, ray)| {
        let _state = Standard::set();
        let mut counted = Cost::default();
        let (tree, mesh) = (&input.tree, &input.mesh);
        trace_observed::<Strict, _>(
            tree,
            mesh,
            &input.scale,
            ray,
            &input.options,
            Query::Closest,
            &mut counted,
        );
        *cost = FirstCost { nodes: counted.nodes, triangles: counted.triangles };
    });
}
