use splitplane_core::{
    backend::{Accelerator, BuildOptions},
    mesh::Mesh,
    ray::*,
};
fn main() {
    let dir = std::env::args().nth(1).unwrap();
    let set = std::env::args().nth(2).unwrap();
    let reps: usize = std::env::args().nth(3).unwrap().parse().unwrap();
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
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    pool.install(|| {
        let b = splitplane_cpu::CpuBackend::new();
        let acc = b.build_accelerator(&mesh, &BuildOptions::default()).unwrap();
        let raw: Vec<[f32; 8]> = {
            let b = read(&format!("{set}.rays"));
            bytemuck::allocation::pod_collect_to_vec(&b)
        };
        let rays: Vec<Ray> = raw
            .iter()
            .map(|r| Ray::new([r[0], r[1], r[2]], [r[3], r[4], r[5]]).with_limits(r[6], r[7]))
            .collect();
        let mut hits = vec![Hit::MISS; rays.len()];
        for single in [false, true] {
            let mut best = f64::MAX;
            for _ in 0..reps {
                let t = std::time::Instant::now();
                if single {
                    acc.closest_hits_singly(&rays, &mut hits, &QueryOptions::default()).unwrap()
                } else {
                    acc.closest_hits(&rays, &mut hits, &QueryOptions::default()).unwrap()
                }
                best = best.min(t.elapsed().as_secs_f64());
            }
            println!(
                "{set} single {single}: {:.2} Mrays/s (best of {reps})",
                rays.len() as f64 / best / 1e6
            );
            if std::env::args().nth(4).is_some() {
                break;
            }
        }
    });
}
