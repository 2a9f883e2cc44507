//! After an update that failed a scene answers as it did before it, bit for bit; when the edits are mended, as one that is made anew.

use std::ffi::{c_char, c_void};
use std::ptr::{null, null_mut};

use library::objects::{IDENTITY, Transform, translation};

use super::answers::{
    arrays, build_options, done, mesh_of, open, points, query_options, rays, records,
};
use crate::backend::splitplane_backend_free;
use crate::handle::*;
use crate::lazy::splitplane_scene_create_lazy;
use crate::lists::*;
use crate::mesh::Mesh;
use crate::opacity::*;
use crate::options::BuildOptions;
use crate::record::SceneHit;
use crate::scene::*;
use crate::scene_query::*;
use crate::status::Status;
use crate::volumes::*;

const COUNT: usize = 400;

fn message() -> String {
    // SAFETY: the text is there until the next call.
    let text = unsafe { std::ffi::CStr::from_ptr(crate::entry::splitplane_last_message()) };
    text.to_string_lossy().into_owned()
}

fn instance(geometry: u32, transform: &Transform, number: u32) -> Instance {
    let transform = transform.as_flattened().try_into().unwrap();
    Instance { transform, geometry, mask: 1 << number, id: 70 + number, culling: 0 }
}

/// Five instances of a mesh, some of whose triangles rays pass.
fn made(backend: Backend, mesh: &Mesh, is_lazy: bool) -> Scene {
    let (mut scene, mut geometry) = (Scene { id: 0 }, 9);
    // SAFETY: arrays and rooms are there, here and below.
    unsafe {
        match is_lazy {
            true => done(splitplane_scene_create_lazy(backend, null(), &mut scene)),
            false => done(splitplane_scene_create(backend, &mut scene)),
        }
        done(splitplane_scene_add_geometry(scene, mesh, &mut geometry));
        for place in 0..5 {
            let own = instance(geometry, &translation([place as f32 * 0.7, 0.1, 0.0]), place);
            done(splitplane_scene_add_instance(scene, &own, &mut 0));
        }
        let mut words = vec![0x7bdf_fbde_u32; mesh.triangle_count.div_ceil(32)];
        *words.last_mut().unwrap() &= (1 << (mesh.triangle_count % 32)) - 1;
        done(splitplane_scene_set_opacity(scene, geometry, 0, words.as_ptr(), words.len()));
        done(splitplane_scene_update(scene, null(), null_mut()));
    }
    scene
}

unsafe extern "C" fn even_triangles(_user: *mut c_void, hit: *const SceneHit) -> i32 {
    // SAFETY: the hit is there.
    i32::from(unsafe { (*hit).triangle }.is_multiple_of(2))
}

/// All answers of a scene: with its instances' masks, and with a filter.
fn answers(scene: Scene) -> Vec<Vec<u64>> {
    let (given, places) = (rays(COUNT), points(COUNT));
    let asked = records(&given);
    let start: *const f32 = places.as_ptr().cast();
    let mut all = Vec::new();
    let mut keep = |words: &[u32]| all.push(words.iter().map(|&word| u64::from(word)).collect());
    let (mut masked, mut filtered) = (query_options(), query_options());
    masked.mask = 0b11101;
    filtered.filter = Some(even_triangles);
    let none = null_mut();
    // SAFETY: arrays and rooms are there.
    unsafe {
        for options in [&masked, &filtered] {
            let (mut hits, mut any) = (vec![[0u32; 6]; COUNT], vec![9u8; COUNT]);
            let room = hits.as_mut_ptr().cast();
            done(splitplane_scene_closest_hits(scene, &asked, options, room, 24, none));
            keep(hits.as_flattened());
            done(splitplane_scene_any_hits(scene, &asked, options, any.as_mut_ptr(), 1, none));
            keep(&any.iter().map(|&any| u32::from(any)).collect::<Vec<_>>());
            let (mut lists, mut count, mut total) = (Lists { id: 0 }, 0, 0);
            done(splitplane_scene_all_hits(scene, &asked, options, &mut lists, none));
            done(splitplane_lists_size(lists, &mut count, &mut total));
            let mut crossings = vec![[0u32; 7]; total];
            done(splitplane_lists_crossings(lists, crossings.as_mut_ptr().cast(), 28, total));
            done(splitplane_lists_free(lists));
            keep(crossings.as_flattened());
            let mut counts = vec![9u64; COUNT];
            done(splitplane_scene_count_hits(scene, &asked, options, counts.as_mut_ptr(), 8, none));
            keep(&counts.iter().map(|&count| count as u32).collect::<Vec<_>>());
        }
        let mut closest = vec![[0u32; 10]; COUNT];
        let mut nearest = query_options();
        nearest.mask = 0b11101;
        let room = closest.as_mut_ptr().cast();
        done(splitplane_scene_closest_points(scene, start, 12, COUNT, &nearest, room, 40, none));
        keep(closest.as_flattened());
        let mut windings = vec![9i32; COUNT];
        let room = windings.as_mut_ptr();
        done(splitplane_scene_locate(scene, start, 12, COUNT, null(), room, 4, none));
        keep(&windings.iter().map(|&winding| winding as u32).collect::<Vec<_>>());
        // Boxes from one point to the next.
        let (kind, stride, count) = (VolumeKind::Box as u32, 24, COUNT / 2);
        let volumes = Volumes { kind, reserved: 0, numbers: start, stride, count, starts: null() };
        let (mut lists, mut count, mut total) = (Lists { id: 0 }, 0, 0);
        done(splitplane_scene_overlaps(scene, &volumes, null(), &mut lists));
        done(splitplane_lists_size(lists, &mut count, &mut total));
        let mut overlaps = vec![[0u32; 2]; total];
        done(splitplane_lists_overlaps(lists, overlaps.as_mut_ptr().cast(), 8, total));
        done(splitplane_lists_free(lists));
        keep(overlaps.as_flattened());
        let mut met = vec![9u8; COUNT / 2];
        done(splitplane_scene_overlaps_any(scene, &volumes, null(), met.as_mut_ptr(), 1));
        keep(&met.iter().map(|&met| u32::from(met)).collect::<Vec<_>>());
        let (mut digest, mut needed) = (0, 0);
        done(splitplane_scene_digest(scene, &mut digest));
        all.push(vec![digest]);
        done(splitplane_scene_write(scene, null_mut(), 0, &mut needed));
        let mut bytes = vec![0u8; needed];
        done(splitplane_scene_write(scene, bytes.as_mut_ptr(), needed, &mut needed));
        all.push(bytes.into_iter().map(u64::from).collect());
    }
    all
}

unsafe extern "C" fn stops(_: *mut c_void, _: *const c_char, _: u64, _: u64) -> i32 {
    1
}

/// Refuses the next update, by a limit of memory and by cancellation.
fn failures() -> [(BuildOptions, Status); 2] {
    let (mut little, mut cancelled) = (build_options(), build_options());
    little.max_memory = 500;
    cancelled.progress = Some(stops);
    [(little, Status::OutOfMemory), (cancelled, Status::Cancelled)]
}

/// Edits of everything, some of which take names that the scene had otherwise.
fn edit(scene: Scene, mesh: &Mesh) {
    let mut geometry = 9;
    // SAFETY: arrays and rooms are there.
    unsafe {
        done(splitplane_scene_add_geometry(scene, mesh, &mut geometry));
        done(splitplane_scene_replace_geometry(scene, 0, mesh));
        let moved = translation([0.3, 0.5, -0.25]);
        done(splitplane_scene_move_instance(scene, 3, moved.as_flattened().as_ptr()));
        done(splitplane_scene_remove_instance(scene, 1));
        let mut number = 99;
        let own = instance(geometry, &IDENTITY, 2);
        done(splitplane_scene_add_instance(scene, &own, &mut number));
        assert_eq!((geometry, number), (1, 1));
    }
}

#[test]
fn a_scene_whose_update_failed_answers_as_before() {
    let (positions, indices) = arrays();
    let larger: Vec<_> = positions.iter().map(|point| point.map(|x| 1.5 * x)).collect();
    let backend = open();
    let (mesh, other) = (mesh_of(&positions, &indices), mesh_of(&larger, &indices));
    for (options, status) in failures() {
        let scene = made(backend, &mesh, false);
        let before = answers(scene);
        assert!(before.iter().all(|all| all.iter().any(|&word| word != all[0]) || all.len() == 1));
        edit(scene, &other);
        let mut blank = [[0u32; 6]; COUNT];
        let given = rays(COUNT);
        let room = blank.as_mut_ptr().cast();
        // SAFETY: arrays and rooms are there, here and below.
        unsafe {
            // Nobody tried these edits yet.
            let asked = records(&given);
            let stale = splitplane_scene_closest_hits(scene, &asked, null(), room, 24, null_mut());
            assert_eq!(stale, Status::Stale);
            assert_eq!(splitplane_scene_update(scene, &options, null_mut()), status);
        }
        assert!(message().ends_with("the scene answers as before the update"), "{}", message());
        assert!(answers(scene) == before, "{status:?}");
        // Again, and an edit that is refused itself.
        // SAFETY: as above.
        unsafe {
            assert_eq!(splitplane_scene_update(scene, &options, null_mut()), status);
            let flat = [0f32; 12];
            assert_eq!(splitplane_scene_move_instance(scene, 0, flat.as_ptr()), Status::Scene);
        }
        assert!(answers(scene) == before, "{status:?}");
        // The edits are kept.
        // SAFETY: as above.
        unsafe { done(splitplane_scene_update(scene, null(), null_mut())) };
        let fresh = made(backend, &mesh, false);
        edit(fresh, &other);
        // SAFETY: as above.
        unsafe { done(splitplane_scene_update(fresh, null(), null_mut())) };
        let after = answers(scene);
        assert!(after == answers(fresh) && after != before, "{status:?}");
        done(splitplane_scene_free(scene));
        done(splitplane_scene_free(fresh));
    }
    done(splitplane_backend_free(backend));
}

/// Vertices that are not finite are no failure: their triangles are met by nothing.
#[test]
fn vertices_that_are_not_finite_are_met_by_nothing() {
    let (positions, indices) = arrays();
    let mut broken = positions.clone();
    broken[..3].fill([f32::NAN, f32::INFINITY, 0.0]);
    let backend = open();
    for is_lazy in [false, true] {
        let scene = made(backend, &mesh_of(&positions, &indices), is_lazy);
        let before = answers(scene);
        // SAFETY: arrays are there.
        unsafe {
            let mesh = mesh_of(&broken, &indices);
            done(splitplane_scene_replace_geometry(scene, 0, &mesh));
            done(splitplane_scene_update(scene, null(), null_mut()));
        }
        let without = answers(scene);
        assert!(without != before);
        // SAFETY: arrays are there.
        unsafe {
            let mesh = mesh_of(&positions, &indices);
            done(splitplane_scene_replace_geometry(scene, 0, &mesh));
            done(splitplane_scene_update(scene, null(), null_mut()));
        }
        assert!(answers(scene) != without);
        done(splitplane_scene_free(scene));
    }
    done(splitplane_backend_free(backend));
}
