//! Overlaps, casts and lazy scenes: answers are those of the library, whatever the strides.

use std::ffi::{c_char, c_void};
use std::ptr::{null, null_mut};

use library::core::aabb::Aabb;
use library::objects::{
    Instance as Described, Scene as Description, SceneOverlapOptions, translation,
};
use library::{
    Backend as _, BuildOptions as LibraryBuildOptions, Cast, CastOptions, CpuBackend,
    Impact as Touched, Mesh as LibraryMesh, OverlapOptions, Plane, Volume,
};

use super::answers::{arrays, done, mesh_of, open, points, query_options, rays, records};
use crate::backend::splitplane_backend_free;
use crate::casts::*;
use crate::handle::*;
use crate::lazy::*;
use crate::lists::*;
use crate::options::{NONE, splitplane_build_options_init};
use crate::record::SceneHit;
use crate::scene::*;
use crate::scene_query::splitplane_scene_closest_hits;
use crate::status::Status;
use crate::tree::{splitplane_tree_build, splitplane_tree_free};
use crate::volumes::*;

const COUNT: usize = 300;

/// Rows of numbers with a gap after each.
fn gapped(rows: impl Iterator<Item = Vec<f32>>) -> Vec<f32> {
    rows.flat_map(|row| row.into_iter().chain([f32::NAN])).collect()
}

fn volumes(kind: VolumeKind, numbers: &[f32], stride: usize, starts: *const u64) -> Volumes {
    let (kind, numbers) = (kind as u32, numbers.as_ptr());
    Volumes { kind, reserved: 0, numbers, stride, count: COUNT, starts }
}

fn overlaps(lists: Lists) -> (Vec<u64>, Vec<Overlap>) {
    let (mut count, mut total) = (0, 0);
    // SAFETY: rooms are there.
    unsafe {
        done(splitplane_lists_size(lists, &mut count, &mut total));
        let mut starts = vec![0; count + 1];
        let mut all = vec![Overlap { triangle: 0, instance: 0 }; total];
        done(splitplane_lists_starts(lists, starts.as_mut_ptr(), count + 1));
        done(splitplane_lists_overlaps(lists, all.as_mut_ptr(), 8, total));
        done(splitplane_lists_free(lists));
        (starts, all)
    }
}

/// All kinds of volumes, in C's form and in the library's.
fn kinds(planes: &[Plane], starts: &[u64]) -> Vec<(Volumes, Vec<f32>, Vec<Volume<'static>>)> {
    let (a, b) = (points(COUNT), points(2 * COUNT)[COUNT..].to_vec());
    let far = |place: usize| [0, 1, 2].map(|axis| a[place][axis] + 0.3 * b[place][axis]);
    let radius = |place: usize| 0.1 + 0.002 * (place % 50) as f32;
    // Tests may leak a little.
    let kept: &'static [Plane] = planes.to_vec().leak();
    let all = 0..COUNT;
    let rows = |row: &dyn Fn(usize) -> Vec<f32>| gapped(all.clone().map(row));
    let made = |make: &dyn Fn(usize) -> Volume<'static>| all.clone().map(make).collect();
    let boxes = rows(&|i| [a[i], far(i)].concat());
    let balls = rows(&|i| [&a[i][..], &[radius(i)]].concat());
    let capsules = rows(&|i| [&a[i][..], &far(i), &[radius(i)]].concat());
    let triangles = rows(&|i| [a[i], far(i), b[i]].concat());
    let halves = gapped(planes.iter().map(|own| [&own.normal[..], &[own.offset]].concat()));
    vec![
        (
            volumes(VolumeKind::Box, &boxes, 28, null()),
            boxes,
            made(&|i| Volume::Box(Aabb { lo: a[i], hi: far(i) })),
        ),
        (
            volumes(VolumeKind::Ball, &balls, 20, null()),
            balls,
            made(&|i| Volume::Ball { centre: a[i], radius: radius(i) }),
        ),
        (
            volumes(VolumeKind::Capsule, &capsules, 32, null()),
            capsules,
            made(&|i| Volume::Capsule { from: a[i], to: far(i), radius: radius(i) }),
        ),
        (
            volumes(VolumeKind::Triangle, &triangles, 40, null()),
            triangles,
            made(&|i| Volume::Triangle([a[i], far(i), b[i]])),
        ),
        (
            volumes(VolumeKind::Planes, &halves, 20, starts.as_ptr()),
            halves,
            made(&|i| Volume::Planes(&kept[starts[i] as usize..starts[i + 1] as usize])),
        ),
    ]
}

/// Sets of none to four planes.
fn planes() -> (Vec<Plane>, Vec<u64>) {
    let mut starts = vec![0];
    for place in 0..COUNT {
        starts.push(starts[place] + place as u64 % 5);
    }
    let normals = points(starts[COUNT] as usize);
    let made = |normal: [f32; 3]| Plane { normal: normal.map(|x| x - 0.5), offset: -0.05 };
    (normals.into_iter().map(made).collect(), starts)
}

#[test]
fn triangles_that_volumes_meet_are_the_library_s() {
    let (positions, indices) = arrays();
    let library_mesh = LibraryMesh::indexed(&positions, &indices).unwrap();
    let backend = CpuBackend::new();
    let own = backend.build(&library_mesh, &LibraryBuildOptions::default()).unwrap();
    let mut description = Description::new();
    let geometry = description.add_mesh(&library_mesh).unwrap();
    for x in [0.0, 0.75] {
        let place = translation([x, 0.25 * x, 0.0]);
        description.add_instance(Described::new(geometry, place)).unwrap();
    }
    let own_scene = backend.build_scene(&description, &LibraryBuildOptions::default()).unwrap();
    let (opened, mut tree, mut scene, mut name) = (open(), Tree { id: 0 }, Scene { id: 0 }, 0);
    let mesh = mesh_of(&positions, &indices);
    // SAFETY: arrays and rooms are there, here and below.
    unsafe {
        done(splitplane_tree_build(opened, &mesh, null(), &mut tree));
        done(splitplane_scene_create(opened, &mut scene));
        done(splitplane_scene_add_geometry(scene, &mesh, &mut name));
        for x in [0.0, 0.75] {
            let transform = [1.0, 0.0, 0.0, x, 0.0, 1.0, 0.0, 0.25 * x, 0.0, 0.0, 1.0, 0.0];
            let placed = Instance { transform, geometry: 0, mask: u32::MAX, id: 0, culling: 0 };
            done(splitplane_scene_add_instance(scene, &placed, &mut name));
        }
        done(splitplane_scene_update(scene, null(), null_mut()));
    }
    let (planes, starts) = planes();
    let mut ignoring = query_options();
    ignoring.ignore_triangle = 7;
    let mut of_scene = query_options();
    (of_scene.ignore_triangle, of_scene.ignore_instance, of_scene.mask) = (7, 1, 3);
    for (given, numbers, volumes) in kinds(&planes, &starts) {
        let mut lists = Lists { id: 0 };
        // SAFETY: as above.
        unsafe { done(splitplane_tree_overlaps(tree, &given, &ignoring, &mut lists, null_mut())) };
        let options = OverlapOptions { ignore: Some(7), ..OverlapOptions::default() };
        let (right, (begins, met)) = (own.overlaps(&volumes, &options).unwrap(), overlaps(lists));
        assert_eq!(begins, right.starts.iter().map(|&start| start as u64).collect::<Vec<_>>());
        let of_tree = |&triangle: &u32| Overlap { triangle, instance: NONE };
        assert_eq!(met, right.triangles.iter().map(of_tree).collect::<Vec<_>>());
        assert!(met.len() > 100, "{} of {numbers:?}", met.len());
        let any: Vec<u8> = begins.windows(2).map(|ends| u8::from(ends[0] < ends[1])).collect();
        let mut found = vec![[9_u8; 3]; COUNT];
        let first = found.as_mut_ptr().cast();
        // SAFETY: as above.
        unsafe {
            done(splitplane_tree_overlaps_any(tree, &given, &ignoring, first, 3, null_mut()));
        }
        assert_eq!(found.iter().map(|own| own[0]).collect::<Vec<_>>(), any);
        assert!(found.iter().all(|own| own[1..] == [9; 2]), "gaps are not written");
        // SAFETY: as above.
        unsafe { done(splitplane_scene_overlaps(scene, &given, &of_scene, &mut lists)) };
        let ignore = library::objects::IgnoredTriangle {
            instance: library::objects::InstanceId(1),
            triangle: 7,
        };
        let options = SceneOverlapOptions { mask: 3, ignore: Some(ignore), ..Default::default() };
        let right = own_scene.overlaps(&volumes, &options).unwrap();
        let (begins, met) = overlaps(lists);
        assert_eq!(begins, right.starts.iter().map(|&start| start as u64).collect::<Vec<_>>());
        let same = right
            .triangles
            .iter()
            .map(|own| Overlap { triangle: own.triangle, instance: own.instance });
        assert_eq!(met, same.collect::<Vec<_>>());
        let any: Vec<u8> = begins.windows(2).map(|ends| u8::from(ends[0] < ends[1])).collect();
        let mut found = vec![9_u8; COUNT];
        let first = found.as_mut_ptr();
        // SAFETY: as above.
        unsafe { done(splitplane_scene_overlaps_any(scene, &given, &of_scene, first, 1)) };
        assert_eq!(found, any);
        // Lists know what they are of, and limits are kept.
        let mut less = of_scene;
        less.max_memory = 64;
        // SAFETY: as above.
        unsafe {
            assert_eq!(
                splitplane_scene_overlaps(scene, &given, &less, &mut lists),
                Status::OutOfMemory
            );
        }
    }
    done(splitplane_scene_free(scene));
    done(splitplane_tree_free(tree));
    done(splitplane_backend_free(opened));
}

#[test]
fn bodies_stop_where_the_library_says() {
    let (positions, indices) = arrays();
    let library_mesh = LibraryMesh::indexed(&positions, &indices).unwrap();
    let own = CpuBackend::new().build(&library_mesh, &LibraryBuildOptions::default()).unwrap();
    let (backend, mut tree, mesh) = (open(), Tree { id: 0 }, mesh_of(&positions, &indices));
    // SAFETY: arrays and rooms are there, here and below.
    unsafe { done(splitplane_tree_build(backend, &mesh, null(), &mut tree)) };
    let (given, axes) = (rays(COUNT), points(COUNT));
    let radii: Vec<f32> = (0..COUNT).map(|place| 0.01 + 0.001 * (place % 60) as f32).collect();
    let apart: Vec<[f32; 4]> = axes.iter().map(|&[x, y, z]| [x, y, z, f32::NAN]).collect();
    let asked = records(&given);
    let balls = Bodies { radii: radii.as_ptr(), radius_stride: 4, axes: null(), axis_stride: 0 };
    let capsules = Bodies { axes: apart.as_ptr().cast(), axis_stride: 16, ..balls };
    let alike = Bodies { radius_stride: 0, axis_stride: 0, ..capsules };
    let mut options = query_options();
    options.ignore_triangle = 3;
    for (bodies, radius, axis) in [
        (balls, None, Some([0.0; 3])),
        (capsules, None, None),
        (alike, Some(radii[0]), Some(axes[0])),
    ] {
        let cast = |place: usize| Cast {
            ray: given[place],
            axis: axis.unwrap_or(axes[place]),
            radius: radius.unwrap_or(radii[place]),
        };
        let casts: Vec<Cast> = (0..COUNT).map(cast).collect();
        let mut right = vec![Touched::NONE; COUNT];
        let with = CastOptions { ignore: Some(3), watch: None };
        own.impacts(&casts, &mut right, &with).unwrap();
        for stride in [8, 20] {
            let mut room = vec![7_u32; COUNT * stride / 4];
            let first = room.as_mut_ptr().cast();
            // SAFETY: as above.
            unsafe {
                done(splitplane_tree_impacts(
                    tree,
                    &asked,
                    &bodies,
                    &options,
                    first,
                    stride,
                    null_mut(),
                ));
            }
            for (own, right) in room.chunks(stride / 4).zip(&right) {
                assert_eq!(own[..2], [right.t.to_bits(), right.triangle]);
                assert!(own[2..].iter().all(|&gap| gap == 7), "gaps are not written");
            }
        }
        assert!(right.iter().filter(|own| own.is_some()).count() > COUNT / 2);
    }
    done(splitplane_tree_free(tree));
    done(splitplane_backend_free(backend));
}

unsafe extern "C" fn stop(user: *mut c_void, _: *const c_char, _: u64, _: u64) -> i32 {
    // SAFETY: it is what the options say.
    unsafe { *user.cast::<u32>() += 1 };
    1
}

#[test]
fn lazy_scenes_answer_as_others_do() {
    let (positions, indices) = arrays();
    let (backend, mesh, given) = (open(), mesh_of(&positions, &indices), rays(500));
    let (mut lazy, mut whole, mut name, mut waiting) =
        (Scene { id: 0 }, Scene { id: 0 }, 0, 9_usize);
    // SAFETY: arrays and rooms are there, here and below.
    unsafe {
        done(splitplane_scene_create_lazy(backend, null(), &mut lazy));
        done(splitplane_scene_create(backend, &mut whole));
        for scene in [lazy, whole] {
            for x in [0.0, 40.0, 80.0] {
                done(splitplane_scene_add_geometry(scene, &mesh, &mut name));
                let transform = [1.0, 0.0, 0.0, x, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];
                let geometry = name;
                let placed = Instance { transform, geometry, mask: u32::MAX, id: 0, culling: 0 };
                done(splitplane_scene_add_instance(scene, &placed, &mut name));
            }
            done(splitplane_scene_update(scene, null(), null_mut()));
        }
        done(splitplane_scene_waiting(lazy, &mut waiting));
        assert_eq!(waiting, 3);
        done(splitplane_scene_waiting(whole, &mut waiting));
        assert_eq!(waiting, 0);
        let asked = records(&given);
        let blank = SceneHit { t: 0.0, u: 0.0, v: 0.0, triangle: 0, geometry: 0, instance: 0 };
        let mut hits = [vec![blank; 500], vec![blank; 500]];
        for (scene, hits) in [lazy, whole].into_iter().zip(&mut hits) {
            let first = hits.as_mut_ptr();
            done(splitplane_scene_closest_hits(scene, &asked, null(), first, 24, null_mut()));
        }
        assert_eq!(hits[0], hits[1]);
        assert!(hits[0].iter().filter(|own| own.triangle != NONE).count() > 100);
        done(splitplane_scene_waiting(lazy, &mut waiting));
        assert_eq!(waiting, 2, "no ray goes there");
        // Settings are those of the creation.
        let mut build = std::mem::MaybeUninit::uninit();
        done(splitplane_build_options_init(build.as_mut_ptr(), size_of_val(&build)));
        let build = build.assume_init();
        assert_eq!(splitplane_scene_update(lazy, &build, null_mut()), Status::Option);
        // A build that is cancelled leaves what waits.
        let (mut calls, mut options) = (0_u32, query_options());
        options.progress = Some(stop);
        options.user = (&raw mut calls).cast();
        options.threads = 1;
        assert_eq!(splitplane_scene_complete(lazy, &options), Status::Cancelled);
        assert!(calls > 0);
        done(splitplane_scene_waiting(lazy, &mut waiting));
        assert_eq!(waiting, 2);
        done(splitplane_scene_complete(lazy, null()));
        done(splitplane_scene_waiting(lazy, &mut waiting));
        assert_eq!(waiting, 0);
        let mut digests = [0, 1];
        for (scene, digest) in [lazy, whole].into_iter().zip(&mut digests) {
            done(splitplane_scene_digest(scene, digest));
        }
        assert_eq!(digests[0], digests[1]);
        // A limit that holds when rays arrive.
        let mut small = Scene { id: 0 };
        let limited = crate::options::BuildOptions { max_memory: 150_000, ..build };
        done(splitplane_scene_create_lazy(backend, &limited, &mut small));
        done(splitplane_scene_add_geometry(small, &mesh, &mut name));
        let transform = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];
        let placed = Instance { transform, geometry: 0, mask: u32::MAX, id: 0, culling: 0 };
        done(splitplane_scene_add_instance(small, &placed, &mut name));
        done(splitplane_scene_update(small, null(), null_mut()));
        let first = hits[0].as_mut_ptr();
        assert_eq!(
            splitplane_scene_closest_hits(small, &asked, null(), first, 24, null_mut()),
            Status::OutOfMemory
        );
        for scene in [lazy, whole, small] {
            done(splitplane_scene_free(scene));
        }
    }
    done(splitplane_backend_free(backend));
}
