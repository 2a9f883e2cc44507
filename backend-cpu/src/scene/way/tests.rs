use splitplane_core::backend::{Backend, BuildOptions};
use splitplane_core::scene::{SceneOptions, TopTree};
use splitplane_test_support::objects::{self, Kind};
use splitplane_test_support::random::Random;

use super::*;
use crate::CpuBackend;
use crate::simd::InstructionSet;
use crate::simd::every_set::for_every_set;

for_every_set! {
    /// The instances that rays enter, each with the rays that do; `None` where they do not go the same way. A fault exchanges the ends of the
    /// origins' intervals.
    fn walked<S>(tree: &TopTree, rays: &[Ray], fault: bool) -> Option<Vec<(u32, u32)>> {
        let (mut way, mut found) = (Way::NONE, Vec::new());
        let mut stack = vec![Entry::NONE; tree.stack() + TOP_WIDTH];
        let stack = stack.as_mut_ptr();
        // SAFETY: the set is one of this processor's; the tree's nodes, and a stack for it.
        unsafe {
            let rays = rays.first_chunk().expect("as many as go together");
            if way.load::<S>(rays, tree.reach()) != u32::MAX || !way.goes_together(1e9) {
                return None;
            }
            if fault {
                (way.all.first, way.all.last) = (way.all.last, way.all.first);
            }
            let mut top = way.step::<S::Eight>(&tree.nodes()[0], 0, stack);
            while let Some(entered) = way.next::<S>(tree.nodes(), stack, &mut top) {
                found.push(entered);
            }
        }
        Some(found)
    }
}

/// Rays from about one object of a scene to about another.
fn bundle(random: &mut Random, places: &[[f64; 3]]) -> Vec<Ray> {
    let mut place = || places[random.below(places.len())];
    let (from, to) = (place(), place());
    let size = 0.01 * (0..3).map(|k| (to[k] - from[k]).abs()).fold(0.0, f64::max);
    let ray = |_| {
        let mut near = |at: [f64; 3]| at.map(|x| (x + size * random.between(-1.0, 1.0)) as f32);
        let (origin, to) = (near(from), near(to));
        Ray::new(origin, [0, 1, 2].map(|k| to[k] - origin[k]))
    };
    (0..CHUNK).map(ray).collect()
}

/// Each ray enters the instance of its closest hit, on every instruction set; with intervals from the wrong ends some do not.
#[test]
fn rays_enter_what_they_hit() {
    let (scene, _) = objects::scene(Kind::Ordinary, 70, 5);
    let built = CpuBackend::new().build_scene(&scene, &BuildOptions::default()).expect("a scene");
    let (built, mut random) = (built.scene(), Random::new(6));
    let places: Vec<[f64; 3]> = (0..70)
        .filter_map(|name| built.placement(InstanceId(name)))
        .map(|placement| placement.instance.transform.map(|row| f64::from(row[3])))
        .collect();
    let (mut together, mut hits, mut lost) = (0, 0, 0);
    for _ in 0..300 {
        let rays = bundle(&mut random, &places);
        for set in InstructionSet::available() {
            for fault in [false, true] {
                let Some(found) = walked(set, built.top_tree(), &rays, fault) else { continue };
                together += usize::from(!fault);
                for (lane, ray) in rays.iter().enumerate() {
                    let hit: SceneHit = built.answer_by_all(ray, &SceneOptions::default());
                    let is_in =
                        |&(name, met): &(u32, u32)| name == hit.instance && met >> lane & 1 != 0;
                    let enters = !hit.is_hit() || found.iter().any(is_in);
                    assert!(enters || fault, "{set:?} {ray:?} {hit:?}");
                    hits += usize::from(hit.is_hit());
                    lost += usize::from(!enters);
                }
            }
        }
    }
    assert!(together > 60 && hits > 1000 && lost > 8, "{together} {hits} {lost}");
}

/// What is unusual about a ray, or where one goes elsewhere, is told.
#[test]
fn rays_that_go_elsewhere_are_told() {
    let (scene, _) = objects::scene(Kind::Ordinary, 70, 5);
    let built = CpuBackend::new().build_scene(&scene, &BuildOptions::default()).expect("a scene");
    let tree = built.scene().top_tree();
    let usual = [Ray::new([0.5, 0.25, -3.0], [0.25, 0.5, 1.0]); CHUNK];
    let odd = [
        Ray::new([0.5, 0.25, -3.0], [0.25, 0.5, -1.0]),
        Ray::new([0.5, 0.25, -3.0], [0.0; 3]),
        Ray::new([f32::NAN, 0.25, -3.0], [0.25, 0.5, 1.0]),
        Ray::new([1e30, 0.25, -3.0], [0.25, 0.5, 1.0]),
        Ray::new([1e-20, 0.25, -3.0], [0.25, 0.5, 1.0]),
        Ray::new([0.5, 0.25, -3.0], [0.25, 0.5, f32::INFINITY]),
        Ray::new([0.5, 0.25, -3.0], [5e-13, 5e-13, 5e-13]),
        Ray::new([0.5, 0.25, -3.0], [0.5, 0.25, 0.01]),
        usual[0].with_limits(2.0, 1.0),
    ];
    for set in InstructionSet::available() {
        assert!(walked(set, tree, &usual, false).is_some(), "{set:?}");
        for ray in odd {
            for lane in [0, 1, 17, CHUNK - 1] {
                let mut rays = usual;
                rays[lane] = ray;
                assert!(walked(set, tree, &rays, false).is_none(), "{set:?} {lane} {ray:?}");
            }
        }
    }
}
