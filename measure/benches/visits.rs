//! What rays visit in trees of several block widths W: `cargo bench -p splitplane-measure --bench visits -- SCENE...`.
//!
//! A lane of a GPU tests one triangle at a time, so a tree for it is judged by the triangles that a ray tests and the
//! nodes that it visits, not by blocks. Both are counted in the reference traversal, for camera, shadow and bounce rays
//! and for chords of the scene; and in compressed nodes made from the same tree,
//! by least cost and by the rule for devices. Counts, not times: they are the same on every machine.

use rayon::prelude::*;
use splitplane::backend::OpenOptions;
use splitplane_core::arithmetic::Strict;
use splitplane_core::backend::Accelerator;
use splitplane_core::config::{BuildConfig, Preset};
use splitplane_core::mesh::Mesh;
use splitplane_core::query::compressed::CompressedNodes;
use splitplane_core::query::lines::scene_scale;
use splitplane_core::query::traverse::{Cost, Query, trace_observed};
use splitplane_core::ray::{QueryOptions, Ray};
use splitplane_core::tree::KdTreeView;
use splitplane_cpu::CpuBackend;
use splitplane_measure::paper::scene::{Placed, Settings};
use splitplane_measure::trade::rays::timed;
use splitplane_measure::trade::row::Sets;
use splitplane_render::Size;
use splitplane_verify::reference::Reference;
use std::error::Error;

/// Rays of a set.
const RAYS: usize = 1 << 15;

/// Nodes visited and triangles tested, on average over the rays that are traced, and the part that is not.
fn mean(rays: &[Ray], trace: impl Fn(&Ray, &mut Cost) -> bool + Sync) -> [f64; 3] {
    let [nodes, triangles, left] = rays
        .par_iter()
        .map(|ray| {
            let mut cost = Cost::default();
            match trace(ray, &mut cost) {
                true => [u64::from(cost.nodes), u64::from(cost.triangles), 0],
                false => [0, 0, 1],
            }
        })
        .reduce(|| [0; 3], |a, b| [a[0] + b[0], a[1] + b[1], a[2] + b[2]]);
    let traced = (rays.len() as u64 - left).max(1) as f64;
    [nodes as f64 / traced, triangles as f64 / traced, left as f64 / rays.len().max(1) as f64]
}

/// The same in the tree itself, which traces every ray.
fn visits(tree: &KdTreeView<'_>, mesh: &Mesh<'_>, rays: &[Ray], query: Query) -> [f64; 2] {
    let scale = scene_scale(tree, mesh);
    let options = QueryOptions::default();
    let [nodes, triangles, _] = mean(rays, |ray, cost| {
        trace_observed::<Strict, _>(tree, mesh, &scale, ray, &options, query, cost);
        true
    });
    [nodes, triangles]
}

/// The configurations: the presets, and `fast` with other block widths and intersection costs.
fn configurations() -> Vec<(String, BuildConfig)> {
    let presets = Preset::ALL.map(|preset| (preset.name().to_owned(), preset.config()));
    let knobs = [1, 2, 4, 8].into_iter().flat_map(|width| [1, 2, 4].map(|cost| (width, cost)));
    let others = knobs.map(|(block_width, intersection_cost)| {
        let config = BuildConfig { block_width, intersection_cost, ..Preset::Fast.config() };
        (format!("fast, W {block_width}, K_I {intersection_cost}"), config)
    });
    let classic = BuildConfig { block_width: 1, intersection_cost: 1, ..Preset::Balanced.config() };
    let balanced = ("balanced, W 1".to_owned(), classic);
    presets.into_iter().chain([balanced]).chain(others).collect()
}

fn measure(spec: &str, only: Option<&str>) -> Result<(), Box<dyn Error>> {
    let settings = Settings {
        size: Size::new(640, 480)?,
        repeat: 1,
        frames: 1,
        threads: std::thread::available_parallelism()?.get(),
        builders: Vec::new(),
        open: OpenOptions::default(),
        max_memory: None,
    };
    let placed = Placed::open(spec, None, &settings)?;
    let mesh = placed.scene.mesh()?;
    let backend = CpuBackend::new();
    let base = backend.build_accelerator(&mesh, &settings.build(Preset::Fast))?;
    let rays = timed(&placed, &base, &Reference::new(&mesh), RAYS)?;
    println!("{spec}, {} triangles; nodes visited and triangles tested a ray", mesh.len());
    print!("  {:<18}", "");
    for name in Sets::<()>::NAMES {
        print!("{name:>16}");
    }
    println!("{:>14}{:>14}", "nodes", "references");
    for (name, config) in configurations() {
        if only.is_some_and(|only| !name.contains(only)) {
            continue;
        }
        let built = backend.build_accelerator(&mesh, &settings.build_with(config))?;
        let tree = built.tree().view();
        print!("  {name:<18}");
        for (set, rays) in rays.each().into_iter().enumerate() {
            let query = if set == Sets::<()>::SHADOW { Query::Any } else { Query::Closest };
            let [nodes, triangles] = visits(&tree, &mesh, rays, query);
            print!("{nodes:>8.1}{triangles:>8.1}");
        }
        println!("{:>14}{:>14}", tree.nodes.len(), tree.references.len());
        let scale = scene_scale(&tree, &mesh);
        for (name, made) in [
            ("  compressed", CompressedNodes::new(&tree, &mesh, &scale)),
            ("  greedy", CompressedNodes::greedy(&tree, &mesh, &scale)),
        ] {
            let Some(nodes) = made else { continue };
            print!("  {name:<18}");
            let mut left = 0.0f64;
            for (set, rays) in rays.each().into_iter().enumerate() {
                let query = if set == Sets::<()>::SHADOW { Query::Any } else { Query::Closest };
                let trace = |ray: &Ray, cost: &mut Cost| {
                    let options = QueryOptions::default();
                    nodes.trace::<Strict, _>(&mesh, &scale, ray, &options, query, cost).is_some()
                };
                let [visited, tested, missing] = mean(rays, trace);
                print!("{visited:>8.1}{tested:>8.1}");
                left = left.max(missing);
            }
            println!(
                "{:>14}{:>14}  {:.1} MB for {:.1}; at most {:.2} % of a set left to the tree",
                nodes.nodes.len(),
                nodes.references.len(),
                nodes.bytes() as f64 * 1e-6,
                (8 * tree.nodes.len() + 4 * tree.references.len()) as f64 * 1e-6,
                100.0 * left
            );
        }
    }
    Ok(())
}

/// Scenes, and `--only PART` for configurations whose name has the part.
fn main() -> Result<(), Box<dyn Error>> {
    let mut scenes: Vec<String> =
        std::env::args().skip(1).filter(|argument| argument != "--bench").collect();
    let only = scenes.iter().position(|argument| argument == "--only").map(|place| {
        scenes.remove(place);
        if place < scenes.len() { scenes.remove(place) } else { String::new() }
    });
    if scenes.is_empty() {
        scenes = ["gallery", "city", "knot"].map(|name| format!("builtin:{name}")).into();
    }
    scenes.iter().try_for_each(|scene| measure(scene, only.as_deref()))
}
