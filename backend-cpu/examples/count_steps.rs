use splitplane_core::{
    arithmetic::Strict,
    backend::{Accelerator, BuildOptions},
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
    let acc = b.build_accelerator(&mesh, &BuildOptions::default()).unwrap();
    let tree = acc.tree().view();
    let scene = acc.scene_scale();
    println!("slack {} extent {:?}", scene.slack, scene.bounds);
    for set in ["primary", "shadow", "bounce", "chords"] {
        let raw: Vec<[f32; 8]> = {
            let b = read(&format!("{set}.rays"));
            bytemuck::allocation::pod_collect_to_vec(&b)
        };
        let (mut steps, mut empty, mut full, mut blocks, mut tris, mut pass, mut pushes, mut n) =
            (0u64, 0u64, 0u64, 0u64, 0u64, 0u64, 0u64, 0u64);
        for r in raw.iter().step_by(7) {
            n += 1;
            let ray = Ray::new([r[0], r[1], r[2]], [r[3], r[4], r[5]]).with_limits(r[6], r[7]);
            let Some(p) = PreparedRay::new::<Strict>(&ray, scene) else { continue };
            let Some((mut enter, mut exit)) = p.enter::<Strict>(&scene.bounds) else { continue };
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
                            pushes += 1;
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
                            full += 1;
                            blocks += count.div_ceil(16) as u64;
                            tris += count as u64;
                        }
                        for &t in tree.leaf(first, count) {
                            let c = mesh.triangle(t as usize);
                            if let Some(h) = watertight::<Strict>(&p, &c, Culling::None) {
                                pass += 1;
                                if h.t < best {
                                    best = h.t;
                                    stop = stop_after(best);
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
        let f = |x: u64| x as f64 / n as f64;
        println!(
            "{set}: steps {:.1} pushes {:.1} empty {:.1} full {:.1} blocks {:.1} tris {:.1} pass {:.2}",
            f(steps),
            f(pushes),
            f(empty),
            f(full),
            f(blocks),
            f(tris),
            f(pass)
        );
    }
}
