//! Answers are those of the library, bit for bit, whatever the strides and the number of threads.

use std::ffi::c_void;
use std::ptr::{null, null_mut};

use bytemuck::{cast_slice, cast_slice_mut};
use library::objects::{
    Instance as Described, Scene as Description, SceneAllHitsOptions, SceneClosestPointOptions,
    SceneHit as HitOfScene, SceneOptions, translation,
};
use library::points::{CpuPointTree, NearestOptions, Neighbour as Near, PointOptions};
use library::{
    Accuracy, AllHitsOptions, Backend as _, BuildOptions as LibraryBuildOptions,
    ClosestPointOptions, CpuBackend, Culling, Hit as HitOfMesh, LocateOptions, Mesh as LibraryMesh,
    QueryOptions as LibraryQueryOptions, Ray,
};

use crate::backend::*;
use crate::batch::Report;
use crate::handle::*;
use crate::lists::*;
use crate::mesh::Mesh;
use crate::options::{BuildOptions, NONE, QueryOptions};
use crate::options::{splitplane_build_options_init, splitplane_query_options_init};
use crate::points::*;
use crate::ray::Rays;
use crate::record::*;
use crate::scene::*;
use crate::scene_query::*;
use crate::status::Status;
use crate::tree::*;
use crate::tree_query::*;

/// Numbers from 0 to 1 (Marsaglia 2003).
struct Random(u32);

impl Random {
    fn next(&mut self) -> f32 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 17;
        self.0 ^= self.0 << 5;
        (self.0 >> 8) as f32 / 16_777_216.0
    }
    fn point(&mut self) -> [f32; 3] {
        [self.next(), self.next(), self.next()]
    }
}

/// Small triangles anywhere, and a closed box around the middle.
pub(super) fn arrays() -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
    let mut random = Random(7);
    let (mut positions, mut indices) = (Vec::new(), Vec::new());
    for place in 0..600 {
        let middle = random.point();
        positions.extend([0; 3].map(|_| {
            let off = random.point();
            [0, 1, 2].map(|axis| middle[axis] + 0.2 * (off[axis] - 0.5))
        }));
        indices.push([3 * place, 3 * place + 1, 3 * place + 2]);
    }
    let first = positions.len() as u32;
    positions.extend(
        (0..8).map(|corner| [0, 1, 2].map(|axis| (corner >> axis & 1) as f32 * 0.5 + 0.25)),
    );
    for quad in [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
    {
        let [a, b, c, d] = quad.map(|corner: u32| first + corner);
        indices.extend([[a, b, c], [a, c, d]]);
    }
    (positions, indices)
}

pub(super) fn rays(count: usize) -> Vec<Ray> {
    let mut random = Random(11);
    let mut ray = || {
        let (from, to) = (random.point().map(|x| 3.0 * x - 1.0), random.point());
        let ray = Ray::new(from, [0, 1, 2].map(|axis| to[axis] - from[axis]));
        ray.with_limits(random.next() * 0.1, 0.5 + random.next() * 4.0)
    };
    (0..count).map(|_| ray()).collect()
}

pub(super) fn points(count: usize) -> Vec<[f32; 3]> {
    let mut random = Random(13);
    (0..count).map(|_| random.point().map(|x| 2.0 * x - 0.5)).collect()
}

pub(super) fn done(status: Status) {
    // SAFETY: the text is there until the next call.
    let text = unsafe { std::ffi::CStr::from_ptr(crate::entry::splitplane_last_message()) };
    assert_eq!(status, Status::Ok, "{text:?}");
}

pub(super) fn open() -> Backend {
    let mut backend = Backend { id: 0 };
    // SAFETY: texts and room are there, here and in all calls below.
    done(unsafe { splitplane_backend_open(c"cpu".as_ptr(), null(), &mut backend) });
    backend
}

pub(super) fn mesh_of(positions: &[[f32; 3]], indices: &[[u32; 3]]) -> Mesh {
    Mesh {
        positions: positions.as_ptr().cast(),
        position_stride: 12,
        position_count: positions.len(),
        indices: indices.as_ptr().cast(),
        index_stride: 12,
        triangle_count: indices.len(),
    }
}

pub(super) fn records(rays: &[Ray]) -> Rays {
    let first: *const f32 = rays.as_ptr().cast();
    Rays {
        origins: first,
        origin_stride: 32,
        directions: first.wrapping_add(4),
        direction_stride: 32,
        t_min: first.wrapping_add(3),
        t_min_stride: 32,
        t_max: first.wrapping_add(7),
        t_max_stride: 32,
        count: rays.len(),
    }
}

pub(super) fn query_options() -> QueryOptions {
    let mut options = std::mem::MaybeUninit::uninit();
    // SAFETY: there is room, which is then filled.
    unsafe {
        done(splitplane_query_options_init(options.as_mut_ptr(), size_of::<QueryOptions>()));
        options.assume_init()
    }
}

pub(super) fn build_options() -> BuildOptions {
    let mut options = std::mem::MaybeUninit::uninit();
    // SAFETY: there is room, which is then filled.
    unsafe {
        done(splitplane_build_options_init(options.as_mut_ptr(), size_of::<BuildOptions>()));
        options.assume_init()
    }
}

fn bits(hits: &[HitOfMesh]) -> &[u32] {
    cast_slice(hits)
}

/// Each part of the rays in an array of its own, with a gap after every item.
struct Apart {
    origins: Vec<f32>,
    directions: Vec<f32>,
    limits: Vec<f32>,
}

impl Apart {
    fn new(rays: &[Ray]) -> Apart {
        let spread = |part: fn(&Ray) -> [f32; 3]| -> Vec<f32> {
            rays.iter().flat_map(|ray| part(ray).into_iter().chain([f32::NAN; 2])).collect()
        };
        Apart {
            origins: spread(|ray| ray.origin),
            directions: spread(|ray| ray.direction),
            limits: rays.iter().flat_map(|ray| [ray.t_min, ray.t_max]).collect(),
        }
    }

    fn rays(&self) -> Rays {
        Rays {
            origins: self.origins.as_ptr(),
            origin_stride: 20,
            directions: self.directions.as_ptr(),
            direction_stride: 20,
            t_min: self.limits.as_ptr(),
            t_min_stride: 8,
            t_max: self.limits.as_ptr().wrapping_add(1),
            t_max_stride: 8,
            count: self.limits.len() / 2,
        }
    }
}

#[test]
fn trees_answer_as_the_library_does() {
    let (positions, indices) = arrays();
    let library_mesh = LibraryMesh::indexed(&positions, &indices).unwrap();
    let own = CpuBackend::new().build(&library_mesh, &LibraryBuildOptions::default()).unwrap();
    let (backend, mut tree) = (open(), Tree { id: 0 });
    // Positions with a gap after each.
    let gapped: Vec<[f32; 5]> =
        positions.iter().map(|&[x, y, z]| [x, y, z, 9.0, f32::NAN]).collect();
    let mesh = Mesh {
        positions: gapped.as_ptr().cast(),
        position_stride: 20,
        ..mesh_of(&positions, &indices)
    };
    // SAFETY: arrays and rooms are there, here and below.
    unsafe { done(splitplane_tree_build(backend, &mesh, null(), &mut tree)) };
    done(splitplane_backend_free(backend));
    let mut digest = 0;
    // SAFETY: as above.
    unsafe { done(splitplane_tree_digest(tree, &mut digest)) };
    assert_eq!(digest, own.tree().digest().0);

    // More than one part, and few.
    for count in [(1 << 18) + 1000, 700, 5, 0] {
        let given = rays(count);
        let apart = Apart::new(&given);
        for accuracy in [Accuracy::Watertight, Accuracy::Fast, Accuracy::Exact] {
            if count > 1000 && accuracy == Accuracy::Exact {
                continue;
            }
            let mut options = query_options();
            options.accuracy = match accuracy {
                Accuracy::Watertight => 0,
                Accuracy::Fast => 1,
                _ => 2,
            };
            options.culling = 1;
            options.ignore_triangle = 3;
            let library_options = LibraryQueryOptions {
                accuracy,
                culling: Culling::Back,
                ignore: Some(3),
                ..LibraryQueryOptions::default()
            };
            let (mut expected, mut any) = (vec![HitOfMesh::MISS; count], vec![false; count]);
            own.closest_hits(&given, &mut expected, &library_options).unwrap();
            own.any_hits(&given, &mut any, &library_options).unwrap();
            for (rays, threads) in [(records(&given), 0), (apart.rays(), 2)] {
                options.threads = threads;
                let mut hits = vec![HitOfMesh { t: f32::NAN, ..HitOfMesh::MISS }; count];
                let mut report = Report { undecided: 9, ..Report::default() };
                let first = hits.as_mut_ptr().cast();
                // SAFETY: as above.
                unsafe {
                    done(splitplane_tree_closest_hits(
                        tree,
                        &rays,
                        &options,
                        first,
                        16,
                        &mut report,
                    ));
                }
                assert_eq!(bits(&hits), bits(&expected));
                assert_eq!(report, Report::default());
                let mut gaps = vec![[7.5_f32; 6]; count];
                let first = gaps.as_mut_ptr().cast();
                // SAFETY: as above.
                unsafe {
                    done(splitplane_tree_closest_hits(
                        tree,
                        &rays,
                        &options,
                        first,
                        24,
                        null_mut(),
                    ));
                }
                for (gap, hit) in gaps.iter().zip(&expected) {
                    assert_eq!(cast_slice::<f32, u32>(&gap[..4]), bits(&[*hit]));
                    assert_eq!(gap[4..], [7.5, 7.5]);
                }
                let mut occluded = vec![7_u8; count];
                let first = occluded.as_mut_ptr();
                // SAFETY: as above.
                unsafe {
                    done(splitplane_tree_any_hits(tree, &rays, &options, first, 1, null_mut()));
                }
                assert!(occluded.iter().zip(&any).all(|(own, any)| *own == u8::from(*any)));
            }
        }
    }
    done(splitplane_tree_free(tree));
}

/// Rows of six floats, with limits that all have, in both orders of their halves, and results with gaps.
#[test]
fn rows_of_six_floats_give_what_records_give() {
    let (positions, indices) = arrays();
    let (backend, mut tree) = (open(), Tree { id: 0 });
    // SAFETY: arrays and rooms are there, here and below.
    unsafe {
        done(splitplane_tree_build(backend, &mesh_of(&positions, &indices), null(), &mut tree));
    }
    done(splitplane_backend_free(backend));
    let limits = [0.5_f32, 2.5];
    for (count, limited) in [(9001, false), (700, true), (33, true), (5, true), (0, false)] {
        let mut given = rays(count);
        for ray in &mut given {
            (ray.t_min, ray.t_max) = if limited { (0.5, 2.5) } else { (0.0, f32::INFINITY) };
        }
        let limits =
            if limited { [&raw const limits[0], &raw const limits[1]] } else { [null(); 2] };
        let record = records(&given);
        let (mut expected, mut any) = (vec![HitOfMesh::MISS; count], vec![7_u8; count]);
        // SAFETY: as above.
        unsafe {
            let hits = expected.as_mut_ptr().cast();
            done(splitplane_tree_closest_hits(tree, &record, null(), hits, 16, null_mut()));
            done(splitplane_tree_any_hits(tree, &record, null(), any.as_mut_ptr(), 1, null_mut()));
        }
        for origin in [0, 3] {
            let rows: Vec<f32> = given
                .iter()
                .flat_map(|ray| {
                    let halves = [ray.origin, ray.direction];
                    [halves[origin / 3], halves[1 - origin / 3]].into_iter().flatten()
                })
                .collect();
            let first = rows.as_ptr();
            let rays = Rays {
                origins: first.wrapping_add(origin),
                origin_stride: 24,
                directions: first.wrapping_add(3 - origin),
                direction_stride: 24,
                t_min: limits[0],
                t_min_stride: 0,
                t_max: limits[1],
                t_max_stride: 0,
                count,
            };
            let (mut hits, mut occluded) = (vec![HitOfMesh::MISS; count], vec![7_u8; count]);
            let mut gaps = vec![[7.5_f32; 6]; count];
            // SAFETY: as above.
            unsafe {
                let first = hits.as_mut_ptr().cast();
                done(splitplane_tree_closest_hits(tree, &rays, null(), first, 16, null_mut()));
                let first = gaps.as_mut_ptr().cast();
                done(splitplane_tree_closest_hits(tree, &rays, null(), first, 24, null_mut()));
                let first = occluded.as_mut_ptr();
                done(splitplane_tree_any_hits(tree, &rays, null(), first, 1, null_mut()));
            }
            assert_eq!(bits(&hits), bits(&expected));
            assert_eq!(occluded, any);
            for (gap, hit) in gaps.iter().zip(&expected) {
                assert_eq!(cast_slice::<f32, u32>(&gap[..4]), bits(&[*hit]));
                assert_eq!(gap[4..], [7.5, 7.5]);
            }
        }
        assert!(count < 700 || any.contains(&1) && any.contains(&0));
    }
    done(splitplane_tree_free(tree));
}

#[test]
fn lists_and_points_of_trees_are_the_library_s() {
    let (positions, indices) = arrays();
    let library_mesh = LibraryMesh::indexed(&positions, &indices).unwrap();
    let own = CpuBackend::new().build(&library_mesh, &LibraryBuildOptions::default()).unwrap();
    let (backend, mut tree, mesh) = (open(), Tree { id: 0 }, mesh_of(&positions, &indices));
    // SAFETY: arrays and rooms are there, here and below.
    unsafe { done(splitplane_tree_build(backend, &mesh, null(), &mut tree)) };
    let given = rays(900);
    let (asked, mut lists) = (records(&given), Lists { id: 0 });
    // SAFETY: as above.
    unsafe { done(splitplane_tree_all_hits(tree, &asked, null(), &mut lists, null_mut())) };
    let expected = own.all_hits(&given, &AllHitsOptions::default()).unwrap();
    let (mut count, mut total) = (0, 0);
    // SAFETY: as above.
    unsafe { done(splitplane_lists_size(lists, &mut count, &mut total)) };
    assert_eq!((count, total), (900, expected.crossings.len()));
    let (mut starts, mut counts) = (vec![0_u64; count + 1], vec![0_u64; count]);
    let blank =
        Crossing { t: 0.0, triangle: 0, u: 0.0, v: 0.0, geometry: 0, instance: 0, front: 9 };
    let mut crossings = vec![blank; total];
    // SAFETY: as above.
    unsafe {
        done(splitplane_lists_starts(lists, starts.as_mut_ptr(), count + 1));
        done(splitplane_lists_crossings(lists, crossings.as_mut_ptr(), 28, total));
        done(splitplane_tree_count_hits(tree, &asked, null(), counts.as_mut_ptr(), 8, null_mut()));
    }
    for ray in 0..900 {
        assert_eq!(starts[ray], expected.starts[ray] as u64);
        assert_eq!(counts[ray], expected.of(ray).len() as u64);
    }
    for (own, expected) in crossings.iter().zip(&expected.crossings) {
        let hit = [own.t.to_bits(), own.triangle, own.u.to_bits(), own.v.to_bits()];
        assert_eq!(hit, *bits(&[expected.hit]));
        let rest = (u32::from(expected.front), NONE, NONE);
        assert_eq!((own.front, own.geometry, own.instance), rest);
    }
    done(splitplane_lists_free(lists));

    let given = points(2000);
    let (first, stride): (*const f32, _) = (given.as_ptr().cast(), 12);
    let mut closest = vec![library::ClosestPoint::NONE; 2000];
    own.closest_points(&given, &mut closest, &ClosestPointOptions::default()).unwrap();
    let located = own.locate(&given, &LocateOptions::default()).unwrap();
    let blank =
        ClosestPoint { distance_squared: 0.0, point: [0.0; 3], triangle: 0, u: 0.0, v: 0.0 };
    let (mut found, mut windings, mut signed) = (vec![blank; 2000], vec![9; 2000], vec![0.0; 2000]);
    let (closest_room, winding_room) = (found.as_mut_ptr(), windings.as_mut_ptr());
    let (signed_room, options, none) = (signed.as_mut_ptr(), null(), null_mut());
    // SAFETY: as above.
    unsafe {
        done(splitplane_tree_closest_points(
            tree,
            first,
            stride,
            2000,
            options,
            closest_room,
            32,
            none,
        ));
        done(splitplane_tree_locate(tree, first, stride, 2000, options, winding_room, 4, none));
        done(splitplane_tree_signed_distances(
            tree,
            first,
            stride,
            2000,
            options,
            signed_room,
            8,
            none,
        ));
    }
    let mut inside = 0;
    for place in 0..2000 {
        let (own, expected) = (found[place], closest[place]);
        assert_eq!(own.distance_squared.to_bits(), expected.distance_squared.to_bits());
        assert_eq!(own.point.map(f32::to_bits), expected.point.map(f32::to_bits));
        assert_eq!((own.triangle, own.u, own.v), (expected.triangle, expected.u, expected.v));
        assert_eq!(windings[place], located.windings[place].unwrap_or(BOUNDARY));
        let sign = if matches!(located.windings[place], Some(0)) { 1.0 } else { -1.0 };
        assert_eq!(signed[place], sign * expected.distance_squared.sqrt());
        inside += u32::from(sign < 0.0);
    }
    assert!(inside > 50, "{inside}");
    done(splitplane_tree_free(tree));
    done(splitplane_backend_free(backend));
}

#[test]
fn trees_are_rebuilt_and_come_back_from_files() {
    let (positions, indices) = arrays();
    let library_mesh = LibraryMesh::indexed(&positions, &indices).unwrap();
    let (backend, mut tree, mesh) = (open(), Tree { id: 0 }, mesh_of(&positions, &indices));
    let mut options = build_options();
    options.preset = 3;
    options.layout = 1;
    let knob = crate::options::Knob { name: c"bad_splits".as_ptr(), value: 1 };
    (options.knobs, options.knob_count) = (&knob, 1);
    // SAFETY: arrays and rooms are there, here and below.
    unsafe { done(splitplane_tree_build(backend, &mesh, null(), &mut tree)) };
    // SAFETY: as above.
    unsafe { done(splitplane_tree_rebuild(tree, &mesh, &options)) };
    let config = library::Preset::Best.config().with_sweep(|sweep| sweep.bad_splits = 1);
    let own = CpuBackend::new().build(&library_mesh, &config.into()).unwrap();
    let mut digest = 0;
    // SAFETY: as above.
    unsafe { done(splitplane_tree_digest(tree, &mut digest)) };
    assert_eq!(digest, own.tree().digest().0);

    let mut needed = 0;
    // SAFETY: as above.
    unsafe { done(splitplane_tree_write(tree, &mesh, null_mut(), 0, &mut needed)) };
    let mut words = vec![0_u64; needed.div_ceil(8)];
    let bytes: &mut [u8] = cast_slice_mut(&mut words);
    // SAFETY: as above.
    unsafe { done(splitplane_tree_write(tree, &mesh, bytes.as_mut_ptr(), needed, null_mut())) };
    let expected = library::core::tree::file::write(&own.tree().view(), &library_mesh).unwrap();
    assert_eq!(&bytes[..needed], expected);
    let mut loaded = Tree { id: 0 };
    let (first, at) = (bytes.as_ptr(), &mut loaded);
    // SAFETY: as above.
    unsafe { done(splitplane_tree_load_memory(backend, &mesh, first, needed, null(), at)) };
    let mut again = 0;
    // SAFETY: as above.
    unsafe { done(splitplane_tree_digest(loaded, &mut again)) };
    assert_eq!(again, digest);
    let mut summary = std::mem::MaybeUninit::<TreeSummary>::uninit();
    // SAFETY: as above.
    let summary = unsafe {
        done(splitplane_tree_get_summary(tree, summary.as_mut_ptr()));
        summary.assume_init()
    };
    assert_eq!((summary.triangles, summary.nodes), (612, own.tree().nodes.len() as u64));
    for tree in [tree, loaded] {
        done(splitplane_tree_free(tree));
    }
    done(splitplane_backend_free(backend));
}

#[test]
fn scenes_answer_as_the_library_does() {
    let (positions, indices) = arrays();
    let library_mesh = LibraryMesh::indexed(&positions, &indices).unwrap();
    let mut description = Description::new();
    let own_geometry = description.add_mesh(&library_mesh).unwrap();
    let (backend, mut scene, mesh) = (open(), Scene { id: 0 }, mesh_of(&positions, &indices));
    let mut geometry = 9;
    // SAFETY: arrays and rooms are there, here and below.
    unsafe {
        done(splitplane_scene_create(backend, &mut scene));
        done(splitplane_scene_add_geometry(scene, &mesh, &mut geometry));
    }
    assert_eq!(geometry, own_geometry.0);
    for place in 0..5_u32 {
        let transform = translation([place as f32 * 0.7, 0.1, 0.0]);
        let described = Described {
            mask: 1 << place,
            id: 70 + place,
            ..Described::new(own_geometry, transform)
        };
        description.add_instance(described).unwrap();
        let instance = Instance {
            transform: transform.as_flattened().try_into().unwrap(),
            geometry,
            mask: 1 << place,
            id: 70 + place,
            culling: 0,
        };
        let mut number = 99;
        // SAFETY: as above.
        unsafe { done(splitplane_scene_add_instance(scene, &instance, &mut number)) };
        assert_eq!(number, place);
    }
    let given = rays(3000);
    let asked = records(&given);
    let blank = SceneHit { t: 0.0, u: 0.0, v: 0.0, triangle: 0, geometry: 0, instance: 0 };
    let mut hits = vec![blank; 3000];
    let first = hits.as_mut_ptr();
    // SAFETY: as above.
    let stale =
        unsafe { splitplane_scene_closest_hits(scene, &asked, null(), first, 24, null_mut()) };
    assert_eq!(stale, Status::Stale);
    let mut update = UpdateReport {
        geometries_built: 0,
        geometries_dropped: 0,
        instances_changed: 0,
        top_rebuilt: 0,
        top_nodes_changed: 0,
    };
    // SAFETY: as above.
    unsafe { done(splitplane_scene_update(scene, null(), &mut update)) };
    assert_eq!((update.geometries_built, update.instances_changed), (1, 5));
    let own = CpuBackend::new().build_scene(&description, &LibraryBuildOptions::default()).unwrap();
    let mut digest = 0;
    // SAFETY: as above.
    unsafe { done(splitplane_scene_digest(scene, &mut digest)) };
    assert_eq!(digest, own.scene().digest().0);

    let mut options = query_options();
    options.mask = 0b11101;
    let library_options = SceneOptions { mask: 0b11101, ..SceneOptions::default() };
    let (mut expected, mut any) = (vec![HitOfScene::MISS; 3000], vec![false; 3000]);
    own.closest_hits(&given, &mut expected, &library_options).unwrap();
    own.any_hits(&given, &mut any, &library_options).unwrap();
    let (mut occluded, mut lists) = (vec![7_u8; 3000], Lists { id: 0 });
    let flags = occluded.as_mut_ptr();
    // SAFETY: as above.
    unsafe {
        done(splitplane_scene_closest_hits(scene, &asked, &options, first, 24, null_mut()));
        done(splitplane_scene_any_hits(scene, &asked, &options, flags, 1, null_mut()));
        done(splitplane_scene_all_hits(scene, &asked, &options, &mut lists, null_mut()));
    }
    for ((own, expected), any) in hits.iter().zip(&expected).zip(any.iter().zip(&occluded)) {
        let hit = [own.t, own.u, own.v].map(f32::to_bits);
        assert_eq!(hit, [expected.t, expected.u, expected.v].map(f32::to_bits));
        let names = (expected.triangle, expected.geometry, expected.instance);
        assert_eq!((own.triangle, own.geometry, own.instance), names);
        assert_eq!(*any.1, u8::from(*any.0));
    }
    let all = SceneAllHitsOptions { query: library_options, max_memory: None };
    let all = own.all_hits(&given, &all).unwrap();
    let (mut count, mut total) = (0, 0);
    // SAFETY: as above.
    unsafe { done(splitplane_lists_size(lists, &mut count, &mut total)) };
    assert_eq!((count, total), (3000, all.crossings.len()));
    let blank =
        Crossing { t: 0.0, triangle: 0, u: 0.0, v: 0.0, geometry: 0, instance: 0, front: 9 };
    let mut crossings = vec![blank; total];
    let mut counts = vec![9_u64; 3000];
    // SAFETY: as above.
    unsafe {
        done(splitplane_lists_crossings(lists, crossings.as_mut_ptr(), 28, total));
        let room = counts.as_mut_ptr();
        done(splitplane_scene_count_hits(scene, &asked, &options, room, 8, null_mut()));
    }
    for (count, ends) in counts.iter().zip(all.starts.windows(2)) {
        assert_eq!(*count, (ends[1] - ends[0]) as u64);
    }
    for (own, expected) in crossings.iter().zip(&all.crossings) {
        let hit = expected.hit;
        let names = (hit.t, hit.triangle, hit.geometry, hit.instance, u32::from(expected.front));
        assert_eq!((own.t, own.triangle, own.geometry, own.instance, own.front), names);
    }

    let given = points(700);
    let start: *const f32 = given.as_ptr().cast();
    let mut closest = vec![library::objects::SceneClosestPoint::NONE; 700];
    let nearest = SceneClosestPointOptions { mask: 0b11101, ..SceneClosestPointOptions::default() };
    own.closest_points(&given, &mut closest, &nearest).unwrap();
    let located = own.locate(&given, &LocateOptions::default()).unwrap();
    let mut found = vec![library::objects::SceneClosestPoint::NONE; 700];
    let (room, mut windings) = (found.as_mut_ptr().cast(), vec![9; 700]);
    let (none, numbers) = (null_mut(), windings.as_mut_ptr());
    // SAFETY: as above.
    unsafe {
        done(splitplane_scene_closest_points(scene, start, 12, 700, &options, room, 40, none));
        done(splitplane_scene_locate(scene, start, 12, 700, null(), numbers, 4, none));
    }
    assert_eq!(found, closest);
    let nearest = SceneClosestPointOptions { accuracy: Accuracy::Exact, ..nearest };
    own.closest_points(&given, &mut closest, &nearest).unwrap();
    let mut exact = options;
    exact.accuracy = 2;
    // SAFETY: as above.
    done(unsafe { splitplane_scene_closest_points(scene, start, 12, 700, &exact, room, 40, none) });
    assert_eq!(found, closest);
    for (own, expected) in windings.iter().zip(&located.windings) {
        assert_eq!(*own, expected.unwrap_or(BOUNDARY));
    }

    // A file, and edits of what it gives.
    let mut needed = 0;
    // SAFETY: as above.
    unsafe { done(splitplane_scene_write(scene, null_mut(), 0, &mut needed)) };
    let (mut words, mut loaded) = (vec![0_u64; needed.div_ceil(8)], Scene { id: 0 });
    let bytes: *mut u8 = words.as_mut_ptr().cast();
    let moved = translation([0.0, 50.0, 0.0]);
    let mut instance = Instance { transform: [0.0; 12], geometry: 9, mask: 0, id: 0, culling: 9 };
    // SAFETY: as above.
    unsafe {
        done(splitplane_scene_write(scene, bytes, needed, null_mut()));
        done(splitplane_scene_load_memory(backend, bytes, needed, null(), &mut loaded));
        done(splitplane_scene_digest(loaded, &mut digest));
        assert_eq!(digest, own.scene().digest().0);
        done(splitplane_scene_move_instance(loaded, 2, moved.as_ptr().cast()));
        done(splitplane_scene_update(loaded, null(), &mut update));
        done(splitplane_scene_instance(loaded, 2, &mut instance));
    }
    assert_eq!((update.geometries_built, update.instances_changed), (0, 1));
    assert_eq!((instance.transform[7], instance.mask, instance.id), (50.0, 4, 72));
    done(splitplane_lists_free(lists));
    for scene in [scene, loaded] {
        done(splitplane_scene_free(scene));
    }
    done(splitplane_backend_free(backend));
}

#[test]
fn point_trees_answer_as_the_library_does() {
    let (cloud, queries) = (points(3000), points(500));
    let own = CpuPointTree::build(&cloud, &PointOptions::default()).unwrap();
    let (mut tree, mut digest, mut lists) = (PointTree { id: 0 }, 0, Lists { id: 0 });
    let (first, asked): (*const f32, *const f32) = (cloud.as_ptr().cast(), queries.as_ptr().cast());
    let blank = Neighbour { distance_squared: 0.0, point: 0, reserved: 9 };
    let (mut found, mut options) = (vec![blank; 2000], query_options());
    options.max_distance = 0.2;
    let (room, backend) = (found.as_mut_ptr(), open());
    // SAFETY: arrays and rooms are there.
    unsafe {
        done(splitplane_point_tree_build(backend, first, 12, 3000, 3, 0, null(), &mut tree));
        done(splitplane_point_tree_digest(tree, &mut digest));
        done(splitplane_point_tree_nearest(tree, asked, 12, 500, 4, &options, room, 16));
        done(splitplane_point_tree_within(tree, asked, 12, 500, &options, &mut lists));
    }
    assert_eq!(digest, own.tree().digest().0);
    let mut expected = vec![Near::NONE; 2000];
    let limits = NearestOptions { k: 4, max_distance: 0.2, ..NearestOptions::default() };
    own.nearest(&queries, &mut expected, &limits).unwrap();
    let same = |own: &Neighbour, expected: &Near| {
        assert_eq!(own.distance_squared.to_bits(), expected.distance_squared.to_bits());
        assert_eq!(own.point, expected.point);
    };
    found.iter().zip(&expected).for_each(|(own, expected)| same(own, expected));
    let expected: Vec<Vec<Near>> =
        queries.iter().map(|&query| own.within(query, &limits).unwrap()).collect();
    let (mut count, mut total) = (0, 0);
    // SAFETY: as above.
    unsafe { done(splitplane_lists_size(lists, &mut count, &mut total)) };
    assert_eq!((count, total), (500, expected.iter().map(Vec::len).sum()));
    let mut found = vec![blank; total];
    // SAFETY: as above.
    unsafe { done(splitplane_lists_neighbours(lists, found.as_mut_ptr(), 16, total)) };
    found.iter().zip(expected.iter().flatten()).for_each(|(own, expected)| same(own, expected));
    done(splitplane_lists_free(lists));

    // Points that a function rejects are not there.
    unsafe extern "C" fn odd(user: *mut c_void, point: u32) -> i32 {
        // SAFETY: it is what the options say.
        i32::from(point % 2 == unsafe { user.cast::<u32>().read() })
    }
    let mut rest = 1_u32;
    options.point_filter = Some(odd);
    options.filter_user = (&raw mut rest).cast();
    let mut found = vec![blank; 2000];
    // SAFETY: as above.
    unsafe {
        let room = found.as_mut_ptr();
        done(splitplane_point_tree_nearest(tree, asked, 12, 500, 4, &options, room, 16));
        done(splitplane_point_tree_within(tree, asked, 12, 500, &options, &mut lists));
        done(splitplane_lists_size(lists, &mut count, &mut total));
    }
    let kept: Vec<Vec<Near>> = expected
        .iter()
        .map(|list| list.iter().filter(|near| near.point % 2 == 1).copied().collect())
        .collect();
    assert_eq!(total, kept.iter().map(Vec::len).sum::<usize>());
    for (found, kept) in found.chunks(4).zip(&kept) {
        let some = found.iter().take_while(|own| own.point != NONE).count();
        assert_eq!(some, kept.len().min(4));
        found.iter().zip(kept).for_each(|(own, expected)| same(own, expected));
    }
    done(splitplane_lists_free(lists));
    done(splitplane_point_tree_free(tree));
    done(splitplane_backend_free(backend));
}
