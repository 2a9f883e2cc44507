//! Builds a tree over a height field and looks at what came out.

use splitplane::core::tree::stats::TreeStats;
use splitplane::{Backend, BuildConfig, BuildOptions, CpuBackend, Mesh};

/// Squares of the height field on a side.
const SIDE: u32 = 200;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let height = |x: u32, z: u32| f32::from((x * x + z * z) as u8) / 64.0;
    let positions: Vec<[f32; 3]> = (0..=SIDE)
        .flat_map(|z| (0..=SIDE).map(move |x| [x as f32, height(x, z), z as f32]))
        .collect();
    let triangles: Vec<[u32; 3]> = (0..SIDE * SIDE)
        .map(|i| i % SIDE + i / SIDE * (SIDE + 1))
        .flat_map(|a| [[a, a + SIDE + 1, a + 1], [a + 1, a + SIDE + 1, a + SIDE + 2]])
        .collect();
    let mesh = Mesh::indexed(&positions, &triangles)?;

    // What shapes the tree is in the configuration; a limit of memory only ever ends in an error.
    let config = BuildConfig { max_depth: 32, ..BuildConfig::default() };
    let options = BuildOptions { config, max_memory: Some(1 << 30), ..BuildOptions::default() };
    let accelerator = CpuBackend::new().build(&mesh, &options)?;

    let tree = accelerator.tree();
    let stats = TreeStats::of(&tree.view());
    println!("triangles   {}", accelerator.summary().triangles);
    println!("nodes       {} ({} leaves, {} empty)", stats.nodes, stats.leaves, stats.empty_leaves);
    println!("references  {} (at most {} in a leaf)", stats.references, stats.largest_leaf);
    println!("depth       {}", stats.max_depth);
    println!("SAH cost    {:.2}", stats.sah_cost);
    // The same on every machine and thread count: fit for a regression test.
    println!("digest      {}", tree.digest());
    Ok(())
}
