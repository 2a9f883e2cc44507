use splitplane_core::backend::{Accelerator, BuildOptions, QueryLayout};
use splitplane_core::mesh::Mesh;
use splitplane_core::query::traverse;
use splitplane_core::ray::{Culling, Ray, Rays};
use splitplane_core::triangle::Triangle;
use splitplane_test_support::random::Random;

use super::exact::TraceExactly;
use super::*;
use crate::CpuBackend;
use crate::cancel::UNWATCHED;
use crate::layout::scratch::{LayoutScratch, LayoutSource};
use crate::memory::Memory;
use crate::simd::{Compiled, InstructionSet};

/// A bumpy sheet whose triangles share corners, small triangles about it, flat ones, and some of all
/// twice: at equal `t` the lower index counts.
fn mesh(size: usize, random: &mut Random) -> Vec<Triangle> {
    let mut triangles = Vec::new();
    let side = size as f32;
    let mut heights = vec![[0.0; 3]; (size + 1) * (size + 1)];
    for (i, corner) in heights.iter_mut().enumerate() {
        let (x, y) = ((i % (size + 1)) as f32 / side, (i / (size + 1)) as f32 / side);
        *corner = [4.0 * x - 2.0, 4.0 * y - 2.0, 0.3 * random.signed()];
    }
    for i in 0..size * size {
        let at = i / size * (size + 1) + i % size;
        let [a, b, c, d] = [at, at + 1, at + size + 1, at + size + 2].map(|i| heights[i]);
        triangles.push([a, b, c]);
        triangles.push([b, d, c]);
    }
    for i in 0..2 * size {
        let (centre, spread) = (random.point(2.0), if i % 9 == 0 { 2.0 } else { 0.2 });
        let mut corners = [(); 3].map(|()| {
            let offset = random.point(spread);
            [0, 1, 2].map(|k| centre[k] + offset[k])
        });
        if i % 3 == 0 {
            corners.iter_mut().for_each(|corner| corner[i % 2] = centre[i % 2]);
        }
        triangles.push(corners);
    }
    for i in 0..size {
        triangles.push(triangles[i * 5 % triangles.len()]);
    }
    triangles
}

/// Rays side by side, of one origin or not, towards the mesh or a corner of it.
fn group(triangles: &[Triangle], round: usize, random: &mut Random) -> Vec<Ray> {
    let spread = [0.0, 1e-3, 0.03, 0.3][round % 4];
    let apart = [0.0, 1e-3, 0.3][round % 3];
    let origin = random.point(if round.is_multiple_of(5) { 1.0 } else { 5.0 });
    let target = random.pick(triangles)[round % 3];
    let mut direction = [0, 1, 2].map(|k| target[k] - origin[k]);
    if round.is_multiple_of(11) {
        direction = [0, 1, 2].map(|k| if k == round % 3 { direction[k] } else { 0.0 });
    }
    let scale = [1.0, 0.01, 300.0][round / 4 % 3];
    (0..CHUNK)
        .map(|i| {
            let (o, d) = (random.point(apart), random.point(spread));
            let origin = [0, 1, 2].map(|k| origin[k] + o[k]);
            let direction = [0, 1, 2].map(|k| (direction[k] + d[k]) * scale);
            let ray = Ray::new(origin, direction);
            match (round % 7, i) {
                // Whole groups without a ray.
                _ if round % 10 == 6 && (8..24).contains(&i) => Ray::new(origin, [f32::NAN; 3]),
                (1, 3 | 9) => Ray::new(origin, [f32::NAN; 3]),
                (2, 0 | 1) => Ray::new(origin.map(|x| x + 90.0), direction),
                (3, _) => ray.with_limits(0.5 / scale, (1.2 + 0.2 * random.signed()) / scale),
                (4, _) => ray.with_limits(-2.0 / scale, 2.0 / scale),
                (5, _) => ray.with_limits(0.0, 1.0 / scale),
                _ => ray,
            }
        })
        .collect()
}

/// Traces groups as packets. Returns how many packets of one group and of all rays there were, and
/// how many hits.
struct Compare(InstructionSet);

impl Compiled for Compare {
    type Output = ([usize; 2], usize);

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) -> ([usize; 2], usize) {
        let Compare(set) = self;
        let mut random = Random::new(77);
        let (mut packets, mut hits) = ([0; 2], 0);
        let mut packet = Packet::new();
        let mut ray_states = [RayState::none(); CHUNK];
        for size in [1, 40, 6, 100] {
            let triangles = mesh(size, &mut random);
            let soup = Mesh::soup(&triangles).unwrap();
            let backend = CpuBackend::with_instruction_set(set);
            let built = backend.build_accelerator(&soup, &BuildOptions::default()).unwrap();
            let (tree, scene) = (built.tree().view(), built.scene_scale());
            let source =
                LayoutSource { mesh: &soup, triangles: &triangles, layout: QueryLayout::Fast };
            let mut scratch = LayoutScratch::default();
            let (copy, mut memory) = (built.tree().clone(), Memory::default());
            let layout =
                TreeLayout::new(copy, source, set, &UNWATCHED, &mut memory, &mut scratch).unwrap();
            for round in 0..120 {
                let rays = group(&triangles, round, &mut random);
                packet.make_room(layout.wide.stack()).expect("memory");
                let (accuracy, culling, ignore) = match round % 12 {
                    6 => (Accuracy::Exact, Culling::Back, None),
                    7 => (Accuracy::Exact, Culling::Front, Some(5)),
                    8..12 => (Accuracy::Exact, Culling::None, None),
                    0 => (Accuracy::Fast, Culling::None, None),
                    1 => (Accuracy::Watertight, Culling::Back, None),
                    2 => (Accuracy::Watertight, Culling::Front, Some(5)),
                    _ => (Accuracy::Watertight, Culling::None, None),
                };
                let options = QueryOptions { accuracy, culling, ignore, ..Default::default() };
                for query in [Query::Closest, Query::Any] {
                    let mut ready = PreparedRays::NONE;
                    // SAFETY: the caller ensures that the processor has the set.
                    unsafe { ready.fill::<S>(Rays::Records(&rays), scene, 0, query) };
                    // Taking a packet writes over the places that have no ray of it.
                    let alive = (0..CHUNK).filter(|&lane| {
                        let within = ready.enter[lane] <= ready.exit[lane];
                        let is_shifted = ready.shifted[lane] != 0 && accuracy == Accuracy::Exact;
                        let usual = ready.special[lane] == 0 && !is_shifted;
                        ready.alive[lane] != 0 && usual && within
                    });
                    let alive = alive.fold(0u32, |bits, lane| bits | 1 << lane);
                    // All rays in one packet, then each group by itself.
                    let parts = |size: usize| (0..CHUNK).step_by(size).map(move |at| (at, size));
                    for (first, size) in [CHUNK, S::N].into_iter().flat_map(parts) {
                        let alive = alive & (u32::MAX >> (CHUNK - size)) << first;
                        let groups = first / S::N..(first + size) / S::N;
                        // SAFETY: as above; the rays are those taken.
                        unsafe {
                            if alive == 0 || !packet.take::<S>(&mut ready, groups, alive, scene) {
                                continue;
                            }
                            if accuracy == Accuracy::Exact {
                                S::call(TraceExactly {
                                    packet: &mut packet,
                                    layout: &layout,
                                    ready: &ready,
                                    ray_states: &mut ray_states,
                                    given: Rays::Records(&rays),
                                    groups: size / S::N,
                                    bounds: [scene.bounds, layout.large.others],
                                    options: &options,
                                    query,
                                });
                            }
                            let ready = (&ready, &mut ray_states);
                            match size / S::N {
                                _ if accuracy == Accuracy::Exact => {}
                                1 => packet.trace::<S, 1>(&layout, ready, &options, query),
                                2 => packet.trace::<S, 2>(&layout, ready, &options, query),
                                _ => packet.trace::<S, 4>(&layout, ready, &options, query),
                            }
                        }
                        packets[usize::from(size == CHUNK)] += 1;
                        for lane in (0..CHUNK).filter(|lane| alive >> lane & 1 != 0) {
                            let ray = &rays[lane];
                            let expected =
                                traverse::closest_hit(&tree, &soup, scene, ray, &options);
                            // SAFETY: as above.
                            let found =
                                unsafe { packet.hits::<S>(lane / S::N, accuracy)[lane % S::N] };
                            let context = (set, size, round, lane, ray);
                            assert_eq!(found.is_hit(), expected.is_some(), "{context:?}");
                            if query == Query::Closest {
                                let expected = expected.unwrap_or(Hit::MISS);
                                let bits: [[u32; 4]; 2] = bytemuck::cast([found, expected]);
                                assert_eq!(bits[0], bits[1], "{context:?} {found:?} {expected:?}");
                                hits += usize::from(found.is_hit());
                            }
                        }
                    }
                }
            }
        }
        (packets, hits)
    }
}

/// Packets of whatever rays give the hits of the reference loop bit for bit, on every instruction set.
#[test]
fn packets_equal_the_reference() {
    for set in InstructionSet::available() {
        // SAFETY: the processor has it.
        let (packets, hits) = unsafe { set.run(Compare(set)) };
        assert!(packets[0] > 800 && packets[1] > 400, "{set:?}: {packets:?}");
        assert!(hits > 8000, "{set:?}: {hits} hits");
    }
}

/// Ranges of some rows against those found lane by lane.
struct CompareRanges;

impl Compiled for CompareRanges {
    type Output = ();

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) {
        let mut random = Random::new(5);
        for _ in 0..50 {
            let mut rows = || [(); 11].map(|()| [(); MOST_LANES].map(|()| random.signed()));
            let (lo, hi) = (rows(), rows());
            // SAFETY: the caller ensures that the processor has the set.
            let [least, most] = unsafe {
                let (mut low, mut high) = ([S::splat(0.0); 11], [S::splat(0.0); 11]);
                for row in 0..11 {
                    (low[row], high[row]) = (S::load(lo[row].as_ptr()), S::load(hi[row].as_ptr()));
                }
                bounds::ranges::<S, 11>(low, high)
            };
            for row in 0..11 {
                let (lo, hi) = (lo[row][..S::N].iter(), hi[row][..S::N].iter());
                assert_eq!(least.0[row], lo.copied().fold(f32::INFINITY, f32::min));
                assert_eq!(most.0[row], hi.copied().fold(f32::NEG_INFINITY, f32::max));
            }
        }
    }
}

/// The ranges of rows are those of their lanes, on every instruction set.
#[test]
fn ranges_are_least_and_greatest() {
    for set in InstructionSet::available() {
        // SAFETY: the processor has it.
        unsafe { set.run(CompareRanges) };
    }
}
