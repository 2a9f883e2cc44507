use splitplane_core::{
    backend::BuildOptions, mesh::Mesh, stats::TreeStats, validate::validate_mesh,
};
use std::time::Instant;
fn main() {
    let threads: usize = std::env::args().nth(2).map_or(2, |s| s.parse().unwrap());
    let dir = std::env::args().nth(1).unwrap();
    let read = |n: &str| std::fs::read(format!("{dir}/{n}")).unwrap();
    let verts: Vec<[f32; 3]> = {
        let b = read("verts.f32");
        bytemuck::allocation::pod_collect_to_vec(&b)
    };
    let index: Vec<[u32; 3]> = {
        let b = read("index.u32");
        bytemuck::allocation::pod_collect_to_vec(&b)
    };
    let mesh = Mesh::indexed(&verts, &index).unwrap();
    let b = splitplane_cpu::CpuBackend::new();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    pool.install(|| {
        let mut ts = vec![];
        let mut last = None;
        for _ in 0..7 {
            let t = Instant::now();
            last = Some(b.build_tree(&mesh, &BuildOptions::default()).unwrap());
            ts.push(t.elapsed().as_secs_f64()*1e3);
        }
        let (tree, summary) = last.unwrap();
        ts.sort_by(f64::total_cmp);
        let t = Instant::now();
        if std::env::args().nth(3).is_some() { validate_mesh(&tree.view(), &mesh).unwrap(); }
        let s = TreeStats::of(&tree.view());
        println!("{dir}: median {:.2} ms min {:.2}; nodes {} leaves {} empty {} refs/tri {:.2} depth {} largest {} sah {:.2} blocks {:.2} levels {} roots {} drop {} digest {} validate {:.0} ms", ts[3], ts[0], s.nodes, s.leaves, s.empty_leaves, s.references as f64/mesh.len() as f64, s.max_depth, s.largest_leaf, s.sah_cost, s.block_cost, summary.large_levels, summary.small_roots, summary.dropped, tree.digest(), t.elapsed().as_secs_f64()*1e3);
    });
}
