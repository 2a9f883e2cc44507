//! Every way to ask, on a small scene, and a smaller one under Miri, which sees reads and writes out of
//! bounds, uninitialised memory and data races where tests see hits only. It takes 40 minutes there (the
//! threads of rayon's pool never end, hence the leaks):
//! `MIRIFLAGS="-Zmiri-disable-isolation -Zmiri-tree-borrows -Zmiri-ignore-leaks" cargo +nightly miri test -p splitplane-cpu --test suite small::`.

use splitplane_core::backend::{Accelerator, BuildOptions, QueryLayout};
use splitplane_core::mesh::Mesh;
use splitplane_core::query::traverse;
use splitplane_core::query::traverse::exact;
use splitplane_core::ray::{Accuracy, Hit, QueryOptions, Ray};
use splitplane_core::triangle::Triangle;
use splitplane_cpu::{CpuBackend, InstructionSet};

/// A bumpy sheet of shared corners, seen at all angles, and a needle through it.
fn sheet(side: usize) -> Vec<Triangle> {
    let corner = |x: usize, y: usize| {
        let (x, y) = (x as f32, y as f32);
        [x, y, (x * 2.1 + y * 3.7).sin()]
    };
    let squares = (0..side * side).map(|i| (i % side, i / side));
    let mut triangles: Vec<Triangle> = squares
        .flat_map(|(x, y)| {
            let [a, b] = [corner(x, y), corner(x + 1, y)];
            let [c, d] = [corner(x, y + 1), corner(x + 1, y + 1)];
            [[a, b, c], [b, d, c]]
        })
        .collect();
    triangles.push([[1.5, 1.5, -3.0], [1.5, 1.5001, 3.0], [1.5001, 1.5, 3.0]]);
    triangles
}

/// Two packets' worth of neighbours, rays all about, some along an axis, some within the sheet, and one
/// that can hit nothing.
fn rays() -> Vec<Ray> {
    let mut rays: Vec<Ray> = (0..40)
        .map(|i| {
            let (x, y) = ((i % 8) as f32 * 0.03, (i / 8) as f32 * 0.03);
            Ray::new([1.4, 1.3, 5.0], [x, y - 0.1, -1.0])
        })
        .collect();
    rays.extend((0..30).map(|i| {
        let (a, b) = (i as f32 * 0.7, i as f32 * 1.3);
        let ray = Ray::new([1.5, 1.5, 0.1], [a.cos() * b.sin(), a.sin() * b.sin(), b.cos()]);
        if i % 3 == 0 { ray.with_limits(0.2, 1.5) } else { ray }
    }));
    rays.extend((0..6).map(|i| {
        let mut direction = [0.0; 3];
        direction[i / 2] = if i % 2 == 0 { 1.0 } else { -1.0 };
        Ray::new([1.25, 1.5, 0.0], direction)
    }));
    rays.push(Ray::new([0.0; 3], [f32::NAN; 3]));
    rays.push(Ray::new([0.0, 0.0, 1e30], [1e-30, 1e-30, -1.0]));
    rays
}

#[test]
fn every_way_gives_the_same_hits() {
    let side = if cfg!(miri) { 4 } else { 24 };
    let (triangles, rays) = (sheet(side), rays());
    let mesh = Mesh::soup(&triangles).unwrap();
    let mut found = 0;
    for set in InstructionSet::available() {
        for layout in [QueryLayout::Fast, QueryLayout::Compact] {
            let backend = CpuBackend::with_instruction_set(set);
            let options = BuildOptions { layout, ..BuildOptions::default() };
            let mut built = backend.build_accelerator(&mesh, &options).unwrap();
            // Once more in the memory that is there.
            backend.rebuild_accelerator(&mut built, &mesh, &options).unwrap();
            let (tree, scene) = (built.tree().view(), built.scene_scale());
            for accuracy in [Accuracy::Watertight, Accuracy::Fast, Accuracy::Exact] {
                let options = QueryOptions { accuracy, ..Default::default() };
                let mut hits = vec![Hit::MISS; rays.len()];
                built.closest_hits(&rays, &mut hits, &options).unwrap();
                let mut any = vec![false; rays.len()];
                built.any_hits(&rays, &mut any, &options).unwrap();
                for ((ray, hit), any) in rays.iter().zip(&hits).zip(any) {
                    let single = built.closest_hit(ray, &options).unwrap_or(Hit::MISS);
                    let context = (set, layout, accuracy, ray);
                    assert_eq!(single, *hit, "{context:?}");
                    assert_eq!((any, built.any_hit(ray, &options)), (hit.is_hit(), hit.is_hit()));
                    let expected = match accuracy {
                        Accuracy::Exact => exact::closest_hit(&tree, &mesh, ray, &options),
                        _ => traverse::closest_hit(&tree, &mesh, scene, ray, &options),
                    };
                    assert_eq!(expected.unwrap_or(Hit::MISS), *hit, "{context:?}");
                    found += usize::from(hit.is_hit());
                }
            }
        }
    }
    assert!(found >= 6 * 40, "{found}");
}
