//! Scenes that move: every frame's tree is the tree of a fresh build, and a thousand frames hold no more
//! memory than the first ones.

use crate::counting::{alone, bytes_held};
use splitplane::render::{RenderSettings, Size};
use splitplane::scene::{Animation, Change, Placement, SceneOptions};
use splitplane::tracer::{FrameRequest, Tracer};
use splitplane::{BuildOptions, CpuBackend};

/// What thread pools and the like may add on the way; a leak of one buffer a frame would be far more.
const SLACK: usize = 128 << 10;

#[test]
fn a_thousand_frames_hold_no_more_than_the_first_and_have_the_trees_of_fresh_builds() {
    let _alone = alone();
    let options = SceneOptions::default();
    let (mut scene, mut animation) =
        Animation::open("builtin:carousel:4000", None, &options).unwrap();
    let build = BuildOptions::default();
    let (mesh, appearance) = (scene.mesh().unwrap(), scene.appearance());
    let mut tracer = Tracer::load(CpuBackend::new(), &mesh, &appearance, &build).unwrap();
    let size = Size::new(40, 24).unwrap();
    let placement = Placement::of(&scene, tracer.accelerator().unwrap(), size.aspect()).unwrap();
    scene.lights = placement.lights;
    tracer.update_appearance(&scene.mesh().unwrap(), &scene.appearance()).unwrap();
    let settings = RenderSettings { depth: 3, ..RenderSettings::default() };
    let request =
        FrameRequest { settings, ..FrameRequest::new(placement.camera.pinhole(size), size) };

    let frames = animation.frames();
    let mut held = Vec::new();
    let mut digests = Vec::new();
    let mut pictures = Vec::new();
    for number in 0..1000 {
        let change = animation.set(number % frames, &mut scene).unwrap();
        assert_ne!(change, Change::Everything, "the carousel's topology is constant");
        let mesh = scene.mesh().unwrap();
        tracer.update_normals(&mesh, &scene.appearance());
        tracer.rebuild(&mesh, &build).unwrap();
        let digest = tracer.digest().unwrap();
        let made = tracer.frame(&mesh, &request).unwrap();
        let picture: u64 = made.pixels().unwrap().iter().fold(0, |sum: u64, &pixel| {
            sum.wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(u64::from(pixel))
        });
        if number < frames {
            let fresh = CpuBackend::new().build_tree(&mesh, &build).unwrap().0;
            assert_eq!(digest, fresh.digest(), "frame {number}");
            digests.push(digest);
            pictures.push(picture);
        } else {
            assert_eq!(digest, digests[number % frames], "frame {number}");
            assert_eq!(picture, pictures[number % frames], "frame {number}");
        }
        held.push(bytes_held());
    }
    digests.sort_unstable_by_key(ToString::to_string);
    digests.dedup();
    assert!(digests.len() > frames * 9 / 10, "{} trees of {frames} frames", digests.len());
    let first_loop = held[..2 * frames].iter().max().unwrap();
    let rest = held[2 * frames..].iter().max().unwrap();
    assert!(*rest <= first_loop + SLACK, "{rest} bytes after {first_loop}");
}
