use splitplane_core::{
    arithmetic::Strict,
    backend::{Accelerator, BuildOptions},
    config::BuildConfig,
    intersect::*,
    mesh::Mesh,
    node::NodeKind,
    ray::*,
};
fn main() {
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
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    for spec in std::env::args().skip(2) {
        let v: Vec<u32> = spec.split(':').map(|x| x.parse().unwrap()).collect();
        let c = BuildConfig {
            traversal_cost: v[0],
            intersection_cost: v[1],
            block_width: v[2],
            empty_cutoff: v[3],
            small_node_limit: v[4],
            ..Default::default()
        };
        pool.install(|| {
            let t0 = std::time::Instant::now();
            let acc = b.build_accelerator(&mesh, &BuildOptions::from(c)).unwrap();
            let build = t0.elapsed().as_secs_f64() * 1e3;
            let tree = acc.tree().view();
            let scene = acc.scene_scale();
            print!(
                "{spec}: build {build:.0} B/tri {:.0} ",
                acc.query_bytes() as f64 / mesh.len() as f64
            );
            for set in ["primary", "shadow", "bounce", "chords"] {
                let raw: Vec<[f32; 8]> = {
                    let b = read(&format!("{set}.rays"));
                    bytemuck::allocation::pod_collect_to_vec(&b)
                };
                let rays: Vec<Ray> = raw
                    .iter()
                    .map(|r| {
                        Ray::new([r[0], r[1], r[2]], [r[3], r[4], r[5]]).with_limits(r[6], r[7])
                    })
                    .collect();
                let (mut steps, mut empty, mut blocks, mut n) = (0u64, 0u64, 0u64, 0u64);
                for ray in rays.iter().step_by(37) {
                    n += 1;
                    let Some(p) = PreparedRay::new::<Strict>(ray, scene) else { continue };
                    let Some((mut enter, mut exit)) = p.enter::<Strict>(&scene.bounds) else {
                        continue;
                    };
                    let mut stack = vec![];
                    let mut node = 0u32;
                    let mut stop = f32::INFINITY;
                    let mut best = f32::INFINITY;
                    'o: loop {
                        match tree.nodes[node as usize].kind() {
                            NodeKind::Interior { axis, split, right } => {
                                steps += 1;
                                let (l, g) = p.plane_interval::<Strict>(axis.index(), split);
                                let (near, far) = if p.direction[axis.index()] < 0.0 {
                                    (right, node + 1)
                                } else {
                                    (node + 1, right)
                                };
                                if g < enter {
                                    node = far
                                } else if l > exit {
                                    node = near
                                } else {
                                    stack.push((far, l.max(enter), exit));
                                    node = near;
                                    exit = exit.min(g);
                                }
                                continue;
                            }
                            NodeKind::Leaf { first, count } => {
                                if count == 0 {
                                    empty += 1
                                } else {
                                    blocks += count.div_ceil(16) as u64;
                                }
                                for &t in tree.leaf(first, count) {
                                    let c = mesh.triangle(t as usize);
                                    if let Some(h) = watertight::<Strict>(&p, &c, Culling::None) {
                                        if h.t < best {
                                            best = h.t;
                                            stop = p.stop_after(best);
                                        }
                                    }
                                }
                            }
                        }
                        loop {
                            let Some((nn, e, x)) = stack.pop() else { break 'o };
                            if e <= stop {
                                node = nn;
                                enter = e;
                                exit = x;
                                break;
                            }
                        }
                    }
                }
                let mut hits = vec![Hit::MISS; rays.len()];
                let mut bt = f64::MAX;
                for _ in 0..3 {
                    let t = std::time::Instant::now();
                    acc.closest_hits(&rays, &mut hits, &QueryOptions::default()).unwrap();
                    bt = bt.min(t.elapsed().as_secs_f64());
                }
                print!(
                    "| {set} s{:.1} e{:.1} b{:.1} {:.2}M ",
                    steps as f64 / n as f64,
                    empty as f64 / n as f64,
                    blocks as f64 / n as f64,
                    rays.len() as f64 / bt / 1e6
                );
            }
            println!();
        });
    }
}
