//! Impacts against exact overlaps: before the impact a body that is a little smaller meets nothing, at the impact one that is a little greater
//! meets the triangle.

use std::ops::ControlFlow;

use crate::common::lattice;
use splitplane_core::backend::{Accelerator, Backend, BuildOptions, QueryLayout};
use splitplane_core::config::Preset;
use splitplane_core::error::QueryError;
use splitplane_core::mesh::Mesh;
use splitplane_core::query::cast::{self, Cast, CastOptions, Impact};
use splitplane_core::query::overlap::{OverlapOptions, Volume};
use splitplane_core::ray::Ray;
use splitplane_core::triangle::Triangle;
use splitplane_core::watch::Progress;
use splitplane_cpu::{CpuBackend, InstructionSet};
use splitplane_test_support::random::Random;

fn soup(count: usize, size: f32, spread: f32, seed: u64) -> Vec<Triangle> {
    let mut random = Random::new(seed);
    (0..count)
        .map(|_| {
            let middle = [(); 3].map(|()| spread * random.signed());
            [(); 3].map(|()| middle.map(|x| (x + random.signed()) * size))
        })
        .collect()
}

fn casts(size: f32, on_grid: bool) -> Vec<Cast> {
    let mut random = Random::new(5);
    (0..200)
        .map(|number| {
            let mut at = |reach: i32| {
                [(); 3].map(|()| match on_grid {
                    true => (random.below(2 * reach as usize + 1) as i32 - reach) as f32 * size,
                    false => random.signed() * reach as f32 * size,
                })
            };
            let (origin, direction, axis) = (at(8), at(3).map(|x| x / size), at(1));
            let axis = if number % 2 == 0 { [0.0; 3] } else { axis };
            let radius = [0.0, 0.5, 1.0, 0.1, 2.0, 1.0 / 3.0][random.below(6)] * size;
            let t_min = [0.0, 0.0, -2.0, 0.5][random.below(4)] * size;
            let t_max = [f32::INFINITY, f32::INFINITY, 3.0 * size][random.below(3)];
            Cast { ray: Ray { origin, t_min, direction, t_max }, axis, radius }
        })
        .collect()
}

/// Where the body is at a time.
fn volume(cast: &Cast, t: f32, more: f32) -> Volume<'static> {
    let Ray { origin, direction, .. } = cast.ray;
    let from =
        [0, 1, 2].map(|k| (f64::from(origin[k]) + f64::from(t) * f64::from(direction[k])) as f32);
    let to = [0, 1, 2].map(|k| from[k] + cast.axis[k]);
    Volume::Capsule { from, to, radius: (cast.radius + more).max(0.0) }
}

/// Whether an answer is right within a radius that is off by `error`.
fn check(tree: &dyn Accelerator, cast: &Cast, found: &Impact, error: f32) -> Result<(), String> {
    let options = OverlapOptions::default();
    let Ray { t_min, t_max, direction, .. } = cast.ray;
    let met = |t: f32, more: f32| {
        let all = tree.overlaps(&[volume(cast, t, more)], &options).unwrap();
        all.of(0).to_vec()
    };
    let end = match found.is_some() {
        true => found.t,
        // Everything is nearer than that.
        false => t_max.min(t_min + 40.0 * error * 1e4),
    };
    if found.is_some() {
        if !(t_min..=t_max).contains(&found.t) {
            return Err(format!("{} is not between {t_min} and {t_max}", found.t));
        }
        if !met(found.t, error).contains(&found.triangle) {
            return Err(format!("{found:?} does not meet there"));
        }
    }
    if cast.radius <= error || direction == [0.0; 3] {
        return Ok(());
    }
    // On the way, in steps, nothing is met by less.
    for step in 0..40 {
        let t = t_min + (end - t_min) * step as f32 / 40.0;
        let early = met(t, -error);
        if !early.is_empty() && t < end {
            return Err(format!("{found:?}, but {early:?} at {t}"));
        }
    }
    // A ball's whole way is a capsule.
    if cast.axis == [0.0; 3] && end > t_min {
        let [Volume::Capsule { from, .. }, Volume::Capsule { from: to, .. }] =
            [volume(cast, t_min, 0.0), volume(cast, end, 0.0)]
        else {
            return Err("no capsule".into());
        };
        let way = Volume::Capsule { from, to, radius: cast.radius - error };
        let all = tree.overlaps(&[way], &options).unwrap();
        // What touches at the end only is met by less there too, by as much as the end is rounded.
        if !all.of(0).is_empty() {
            return Err(format!("{found:?}, but {:?} on the way", all.of(0)));
        }
    }
    Ok(())
}

#[test]
fn impacts_are_when_bodies_touch_first() {
    let options = CastOptions::default();
    let mut hits = 0;
    for (name, triangles, size, on_grid) in [
        ("soup", soup(200, 1.0, 4.0, 1), 1.0f32, false),
        ("lattice", lattice(40, 1.0, 2), 1.0, true),
        ("1e-20", soup(100, 1e-20, 4.0, 3), 1e-20, false),
        ("1e20", soup(100, 1e20, 4.0, 4), 1e20, false),
        ("none", Vec::new(), 1.0, false),
    ] {
        let mesh = Mesh::soup(&triangles).unwrap();
        let casts = casts(size, on_grid);
        let mut first: Option<Vec<Impact>> = None;
        for (preset, layout) in
            [(Preset::Fast, QueryLayout::Fast), (Preset::Best, QueryLayout::Compact)]
        {
            let build = BuildOptions { layout, ..preset.config().into() };
            for set in InstructionSet::available() {
                let tree = CpuBackend::with_instruction_set(set).build(&mesh, &build).unwrap();
                let mut found = vec![Impact::NONE; casts.len()];
                tree.impacts(&casts, &mut found, &options).unwrap();
                let mut reference = found.clone();
                let view = tree.tree().view();
                cast::one_by_one(&view, &mesh, &casts, &mut reference, &options).unwrap();
                assert_eq!(found, reference, "{name} {set:?}");
                assert_eq!(*first.get_or_insert_with(|| found.clone()), found, "{name} {set:?}");
            }
        }
        let tree = CpuBackend::new().build(&mesh, &BuildOptions::default()).unwrap();
        let found = first.unwrap();
        let error = size * 24.0 / 2f32.powi(20);
        for (cast, found) in casts.iter().zip(&found) {
            check(&*tree, cast, found, error)
                .unwrap_or_else(|why| panic!("{name}: {cast:?}: {why}"));
            hits += usize::from(found.is_some());
        }
    }
    assert!(hits > 150, "{hits}");
}

#[test]
fn impacts_by_hand() {
    // A square in the plane z = 0.
    let triangles = [
        [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [4.0, 4.0, 0.0]],
        [[0.0, 0.0, 0.0], [4.0, 4.0, 0.0], [0.0, 4.0, 0.0]],
    ];
    let mesh = Mesh::soup(&triangles).unwrap();
    let tree = CpuBackend::new().build(&mesh, &BuildOptions::default()).unwrap();
    let down = |origin: [f32; 3]| Ray::new(origin, [0.0, 0.0, -2.0]);
    let casts = [
        // On the face, on an edge, on a corner, beside it, from within, a standing capsule, a lying one, behind.
        Cast::ball(down([3.0, 1.0, 9.0]), 1.0),
        Cast::ball(down([-3.0, 2.0, 9.0]), 5.0),
        Cast::ball(down([-2.0, -1.0, 9.0]), 3.0),
        Cast::ball(down([-2.0, 2.0, 9.0]), 1.0),
        Cast::ball(down([1.0, 3.0, 0.5]), 1.0),
        Cast { axis: [0.0, 0.0, -4.0], ..Cast::ball(down([3.0, 1.0, 9.0]), 1.0) },
        Cast { axis: [4.0, 0.0, 0.0], ..Cast::ball(down([-3.0, 1.0, 9.0]), 1.0) },
        Cast::ball(Ray::new([3.0, 1.0, 9.0], [0.0, 0.0, 1.0]), 1.0),
        Cast { axis: [0.0, 0.0, 3.0], ..Cast::ball(down([3.0, 1.0, -1.0]), 0.5) },
    ];
    let mut found = [Impact::NONE; 9];
    tree.impacts(&casts, &mut found, &CastOptions::default()).unwrap();
    let times = [4.0, 2.5, 3.5, f32::INFINITY, 0.0, 2.0, 4.0, f32::INFINITY, 0.0];
    for ((found, t), cast) in found.iter().zip(times).zip(&casts) {
        assert!(found.t == t || (found.t - t).abs() < 1e-6, "{cast:?}: {found:?} {t}");
    }
    assert_eq!([found[0].triangle, found[4].triangle], [0, 1]);
    let ignored = CastOptions { ignore: Some(0), ..CastOptions::default() };
    tree.impacts(&casts, &mut found, &ignored).unwrap();
    assert!(found.iter().all(|found| found.triangle != 0));
    let bad = [
        Cast::ball(down([f32::NAN; 3]), 1.0),
        Cast::ball(down([0.0; 3]), -1.0),
        Cast::ball(down([0.0; 3]), f32::INFINITY),
        Cast { axis: [f32::INFINITY; 3], ..Cast::ball(down([0.0; 3]), 1.0) },
    ];
    let mut found = [Impact { t: 0.0, triangle: 0 }; 4];
    tree.impacts(&bad, &mut found, &CastOptions::default()).unwrap();
    assert_eq!(found, [Impact::NONE; 4]);
    let still = [Cast::ball(Ray::new([1.0, 1.0, 0.5], [0.0; 3]), 1.0)];
    tree.impacts(&still, &mut found[..1], &CastOptions::default()).unwrap();
    assert_eq!(found[0].t, 0.0);
    let mismatch = tree.impacts(&casts, &mut found, &CastOptions::default());
    assert!(matches!(mismatch, Err(QueryError::LengthMismatch { .. })));
    let stop = |_: &Progress| ControlFlow::Break(());
    let stopped = CastOptions { watch: Some(&stop), ..CastOptions::default() };
    let cancelled = tree.impacts(&bad, &mut found, &stopped);
    assert!(matches!(cancelled, Err(QueryError::Cancelled { .. })));
}

/// What is late, early, or another triangle is found.
#[test]
fn faults_are_found() {
    let triangles = soup(200, 1.0, 4.0, 1);
    let mesh = Mesh::soup(&triangles).unwrap();
    let tree = CpuBackend::new().build(&mesh, &BuildOptions::default()).unwrap();
    let casts = casts(1.0, false);
    let mut found = vec![Impact::NONE; casts.len()];
    tree.impacts(&casts, &mut found, &CastOptions::default()).unwrap();
    let error = 24.0 / 2f32.powi(20);
    let faults: [fn(Impact) -> Impact; 4] = [
        |own| Impact { t: own.t + 0.01, ..own },
        |own| Impact { t: own.t - 0.01, ..own },
        |own| Impact { triangle: (own.triangle + 1) % 200, ..own },
        |_| Impact::NONE,
    ];
    for (number, fault) in faults.iter().enumerate() {
        let wrong = casts.iter().zip(&found).filter(|(_, own)| own.is_some());
        let wrong = wrong.filter(|(cast, own)| check(&*tree, cast, &fault(**own), error).is_err());
        assert!(wrong.count() > 20, "fault {number}");
    }
}
