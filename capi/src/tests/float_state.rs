//! A caller that has called `fesetround` gets the answers of everyone else, and its rounding mode
//! back.

#![cfg(all(target_arch = "x86_64", target_os = "linux"))]

use std::ptr::null;

use super::answers::*;
use crate::backend::*;
use crate::batch::Report;
use crate::handle::*;
use crate::record::*;
use crate::status::Status;
use crate::tree::*;
use crate::tree_query::*;

unsafe extern "C" {
    safe fn fesetround(mode: i32) -> i32;
    safe fn fegetround() -> i32;
}

/// Of `fenv.h`: downwards, upwards, towards zero; to nearest.
const MODES: [i32; 3] = [0x400, 0x800, 0xc00];
const NEAREST: i32 = 0;

/// The digest of a tree, and what rays hit, by C's calls alone.
#[inline(never)]
fn answers(
    mesh: &crate::mesh::Mesh,
    rays: &crate::ray::Rays,
    accuracy: i32,
    mode: i32,
) -> (u64, Vec<u32>) {
    let (backend, mut tree, mut digest) = (open(), Tree { id: 0 }, 0);
    let mut options = query_options();
    options.accuracy = accuracy as _;
    options.threads = 2;
    let mut words = vec![0u32; 4 * rays.count];
    let mut report = Report::default();
    assert_eq!(fesetround(mode), 0);
    // SAFETY: arrays and rooms are there.
    let status = unsafe {
        let hits: *mut Hit = words.as_mut_ptr().cast();
        [
            splitplane_tree_build(backend, mesh, null(), &mut tree),
            splitplane_tree_digest(tree, &mut digest),
            splitplane_tree_closest_hits(tree, rays, &options, hits, 16, &mut report),
            // Failures give the mode back too.
            splitplane_tree_digest(Tree { id: 0 }, &mut { 0 }),
        ]
    };
    let after = fegetround();
    assert_eq!(fesetround(NEAREST), 0);
    assert_eq!(after, mode);
    assert_eq!(status[..3], [Status::Ok; 3]);
    assert_ne!(status[3], Status::Ok);
    done(splitplane_tree_free(tree));
    done(splitplane_backend_free(backend));
    (digest, words)
}

#[test]
fn answers_do_not_depend_on_the_rounding_mode() {
    let ((positions, indices), given) = (arrays(), rays(9000));
    let (mesh, rays) = (mesh_of(&positions, &indices), records(&given));
    for accuracy in [0, 1, 2] {
        let expected = answers(&mesh, &rays, accuracy, NEAREST);
        for mode in MODES {
            let found = answers(&mesh, &rays, accuracy, mode);
            assert_eq!(found.0, expected.0);
            let differ = expected.1.iter().zip(&found.1).filter(|(a, b)| a != b).count();
            assert_eq!(differ, 0, "of {} words, in mode {mode:#x}", expected.1.len());
        }
    }
}
