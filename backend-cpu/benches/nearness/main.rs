//! Random closest points and overlaps against brute force, too many for a test: `cargo bench -p splitplane-cpu --bench nearness`, and behind `--` how many of
//! each (10,000,000), and a seed. Nothing is timed; printed is how many answers differ, and the program fails if any does.
//!
//! Meshes are small, so that all triangles can be asked: those of `close_calls`, three sizes of each, and pieces of the scenes in `SPLITPLANE_SCENES`.
//! Presets, layouts and instruction sets take turns.
//!
//! - Closest points: the same bits as of all triangles one after the other; the distance is what `measured.rs` finds in `f64` by formulas of its own, and for one in
//!   64 within 16 u of the reach of the rational distance.
//! - Accuracy `exact`: the nearest triangle by the distances of `measured.rs`; where several may be, by rational arithmetic.
//! - Overlaps: by `measured.rs`; where that cannot tell, by rational arithmetic.

mod measured;

use std::process::ExitCode;

use splitplane_core::aabb::Aabb;
use splitplane_core::backend::{Accelerator, BuildOptions, QueryLayout};
use splitplane_core::config::Preset;
use splitplane_core::mesh::Mesh;
use splitplane_core::query::closest_point::{ClosestPoint, ClosestPointOptions, of_triangle};
use splitplane_core::query::overlap::{OverlapOptions, Plane, Volume};
use splitplane_core::ray::Accuracy;
use splitplane_core::triangle::prepare;
use splitplane_cpu::{CpuAccelerator, CpuBackend, InstructionSet};
use splitplane_test_support::close_calls::{self, Kind, Triangle};
use splitplane_test_support::random::Random;
use splitplane_test_support::{near, overlap, rational, scenes};

/// Queries of each sort to a mesh.
const EACH: usize = 4096;
/// Queries of each sort to a mesh where rational arithmetic has most of the work.
const FEW: usize = 256;
/// Triangles of a mesh.
const TRIANGLES: usize = 24;
const SIZES: [f32; 3] = [1.0, 1e-30, 1e30];
const SCENES: [&str; 4] = ["bunny.obj", "dragon.obj", "sponza.obj", "kitchen.obj"];
/// Of so many closest points one is compared with the rational distance.
const SAMPLED: usize = 64;

#[derive(Default)]
struct Tally {
    points: u64,
    volumes: u64,
    met: u64,
    /// Answers that rational arithmetic decided.
    rational_points: u64,
    rational_pairs: u64,
    wrong: [u64; 4],
    /// The greatest error of a distance, in u of the reach.
    worst: f64,
}

const SORTS: [&str; 4] = [
    "closest points: other bits than brute force",
    "closest points: distances beyond their bound",
    "closest points of accuracy exact: another triangle",
    "overlaps: other triangles",
];

fn main() -> ExitCode {
    let mut numbers = std::env::args().skip(1).filter_map(|own| own.parse::<u64>().ok());
    let (total, seed) = (numbers.next().unwrap_or(10_000_000), numbers.next().unwrap_or(1));
    let real: Vec<Vec<Triangle>> =
        SCENES.into_iter().filter_map(scenes::real).map(|scene| scene.triangles()).collect();
    let mut tally = Tally::default();
    let mut round = 0;
    while tally.points < total {
        one_mesh(round, seed, &real, &mut tally);
        round += 1;
    }
    println!("seed {seed}: {round} meshes, {} of real scenes", round - made(round, real.len()));
    println!(
        "{} closest points, each by accuracy f64 and exact; {} had several triangles that rational arithmetic decided between",
        tally.points, tally.rational_points
    );
    println!(
        "{} overlaps with {} triangles met; rational arithmetic decided {} pairs",
        tally.volumes, tally.met, tally.rational_pairs
    );
    println!("worst error of a sampled distance: {:.1} u of the reach", tally.worst);
    for (sort, wrong) in SORTS.iter().zip(tally.wrong) {
        println!("{wrong:8} {sort}");
    }
    ExitCode::from(u8::from(tally.wrong != [0; 4]))
}

/// How many meshes of so many are made here.
fn made(rounds: u64, real: usize) -> u64 {
    (0..rounds).filter(|&round| kind_of(round, real).is_ok()).count() as u64
}

/// The kind and the size of a mesh, or which scene it is a piece of.
fn kind_of(round: u64, real: usize) -> Result<(Kind, f32), usize> {
    let sorts = Kind::ALL.len() * SIZES.len();
    match round as usize % (sorts + 2 * real) {
        made if made < sorts => Ok((Kind::ALL[made / SIZES.len()], SIZES[made % SIZES.len()])),
        piece => Err((piece - sorts) % real),
    }
}

fn one_mesh(round: u64, seed: u64, real: &[Vec<Triangle>], tally: &mut Tally) {
    let mut random = Random::new(seed.wrapping_mul(1 << 32) + round);
    let (triangles, size, each) = match kind_of(round, real.len()) {
        Ok((kind, size)) => {
            let each = if matches!(kind, Kind::Soup | Kind::Mirrored) { EACH } else { FEW };
            (close_calls::mesh(kind, TRIANGLES, size, &mut random), size, each)
        }
        Err(scene) => {
            let all = &real[scene];
            let first = random.below(all.len() - TRIANGLES);
            let piece = all[first..first + TRIANGLES].to_vec();
            let bounds = Aabb::of_points(piece.as_flattened());
            (piece, bounds.diagonal() as f32, EACH)
        }
    };
    let mesh = Mesh::soup(&triangles).expect("a mesh");
    let presets = [Preset::Fast, Preset::Balanced, Preset::Best];
    let sets = InstructionSet::available();
    let place = round as usize;
    let layout = [QueryLayout::Fast, QueryLayout::Compact][place / 3 % 2];
    let build = BuildOptions { layout, ..presets[place % 3].config().into() };
    let backend = CpuBackend::with_instruction_set(sets[place / 6 % sets.len()]);
    let tree = backend.build_accelerator(&mesh, &build).expect("a tree");
    let kept: Vec<(u32, Triangle)> = (0..)
        .zip(&triangles)
        .map(|(index, own)| (index, prepare(own)))
        .filter(|(_, own)| own.kept)
        .map(|(index, own)| (index, own.corners))
        .collect();
    let points: Vec<[f32; 3]> =
        (0..each).map(|_| close_calls::point(&triangles, size, &mut random)).collect();
    closest_points(&mesh, &tree, &kept, &points, tally);
    overlaps(&tree, &kept, (size, each), &mut random, tally);
}

fn report(tally: &mut Tally, sort: usize, text: impl FnOnce() -> String) {
    tally.wrong[sort] += 1;
    if tally.wrong[sort] <= 3 {
        println!("{}: {}", SORTS[sort], text());
    }
}

fn closest_points(
    mesh: &Mesh<'_>,
    tree: &CpuAccelerator,
    kept: &[(u32, Triangle)],
    points: &[[f32; 3]],
    tally: &mut Tally,
) {
    let ask = |accuracy| {
        let options = ClosestPointOptions { accuracy, ..Default::default() };
        let mut found = vec![ClosestPoint::NONE; points.len()];
        tree.closest_points(points, &mut found, &options).expect("memory");
        found
    };
    let (usual, exact) = (ask(Accuracy::Watertight), ask(Accuracy::Exact));
    for (place, (&point, (usual, exact))) in points.iter().zip(usual.iter().zip(&exact)).enumerate()
    {
        tally.points += 1;
        let expected = near::closest_point(mesh, point, &ClosestPointOptions::default());
        if *usual != expected {
            report(tally, 0, || format!("{point:?}: {usual:?}, not {expected:?}"));
        }
        let at = prepare(&[point; 3]).corners[0];
        let ranges: Vec<(f64, f64)> =
            kept.iter().map(|own| measured::distance(at, &own.1)).collect();
        let least = ranges.iter().fold(f64::INFINITY, |least, own| least.min(own.0));
        let most = ranges.iter().fold(f64::INFINITY, |most, own| most.min(own.1));
        let distance = usual.distance_squared.sqrt();
        let mut is_bound = (least..=most).contains(&distance);
        if place % SAMPLED == 0
            && let Some((_, corners)) = kept.iter().find(|own| own.0 == usual.triangle)
        {
            let reach = corners.as_flattened().iter().zip(at.iter().cycle());
            let reach = reach
                .fold(0.0f64, |most, (x, at)| most.max((f64::from(*x) - f64::from(*at)).abs()));
            let truth = rational::distance_squared(corners, at).sqrt();
            let unit = (reach * f64::EPSILON / 2.0).max(f64::MIN_POSITIVE);
            let error = (distance - truth).abs() / unit;
            tally.worst = tally.worst.max(error);
            is_bound &= error <= 16.0;
        }
        if !is_bound {
            report(tally, 1, || format!("{point:?}: {usual:?}, {least:e} to {most:e}"));
        }
        let may_be: Vec<&(u32, Triangle)> =
            kept.iter().zip(&ranges).filter(|(_, own)| own.0 <= most).map(|own| own.0).collect();
        let nearest = match may_be[..] {
            [] => None,
            [own] => Some(own),
            _ => {
                tally.rational_points += 1;
                // Of equal ones the first.
                let distances = may_be.iter().map(|own| rational::squared_distance(&own.1, at));
                let least = distances
                    .zip(&may_be)
                    .reduce(|least, own| if own.0 < least.0 { own } else { least });
                least.map(|least| *least.1)
            }
        };
        let expected = nearest.map_or(ClosestPoint::NONE, |(triangle, corners)| ClosestPoint {
            triangle: *triangle,
            ..of_triangle(at.map(f64::from), corners)
        });
        if *exact != expected {
            report(tally, 2, || format!("{point:?}: {exact:?}, not {expected:?}"));
        }
    }
}

fn volume<'a>(
    triangles: &[(u32, Triangle)],
    size: f32,
    planes: &'a [Plane],
    random: &mut Random,
) -> Volume<'a> {
    let corners = random.pick(triangles).1;
    let near = |random: &mut Random| {
        let (corner, part) = (random.pick(&corners), random.unit() as f32 * size);
        random
            .point(1.0)
            .map(|x| x * part)
            .iter()
            .zip(corner)
            .map(|(x, y)| x + y)
            .collect::<Vec<_>>()
    };
    let point = |random: &mut Random| {
        let point = near(random);
        [point[0], point[1], point[2]]
    };
    let radius = random.unit() as f32 * 0.5 * size;
    let [a, b, c] = [(); 3].map(|()| point(random));
    match random.below(5) {
        0 => Volume::Box(Aabb::of_points(&[a, b])),
        1 => Volume::Ball { centre: a, radius },
        2 => Volume::Capsule { from: a, to: b, radius },
        3 => Volume::Triangle([a, b, c]),
        _ => {
            let first = random.below(planes.len() - 4);
            Volume::Planes(&planes[first..first + 1 + random.below(4)])
        }
    }
}

fn overlaps(
    tree: &CpuAccelerator,
    kept: &[(u32, Triangle)],
    (size, each): (f32, usize),
    random: &mut Random,
    tally: &mut Tally,
) {
    if kept.is_empty() {
        return;
    }
    let planes: Vec<Plane> = (0..64)
        .map(|_| {
            let normal = random.direction().map(|x| x as f32);
            let corners = random.pick(kept).1;
            let corner = random.pick(&corners);
            let offset = (0..3).map(|axis| normal[axis] * corner[axis]).sum::<f32>();
            Plane { normal, offset: offset + 0.5 * size * random.signed() }
        })
        .collect();
    let volumes: Vec<Volume<'_>> = (0..each).map(|_| volume(kept, size, &planes, random)).collect();
    let found = tree.overlaps(&volumes, &OverlapOptions::default()).expect("memory");
    let mut any = vec![false; volumes.len()];
    tree.overlaps_any(&volumes, &mut any, &OverlapOptions::default()).expect("memory");
    for (place, volume) in volumes.iter().enumerate() {
        tally.volumes += 1;
        let mut expected = Vec::new();
        for (index, corners) in kept {
            let meets = measured::meets(volume, corners).unwrap_or_else(|| {
                tally.rational_pairs += 1;
                overlap::meets(volume, corners)
            });
            expected.extend(meets.then_some(*index));
        }
        tally.met += expected.len() as u64;
        let own = found.of(place);
        if own != expected || any[place] == expected.is_empty() {
            report(tally, 3, || {
                format!("{volume:?}: {own:?}, not {expected:?}, any: {}", any[place])
            });
        }
    }
}
