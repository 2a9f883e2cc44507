//! One ray with care: the reference loop over the tree's own nodes, triangle by triangle. For the few
//! rays that vectors are not made for: moved ones, and extreme exponents.

use splitplane_core::arithmetic::Strict;
use splitplane_core::config::MAX_DEPTH;
use splitplane_core::intersect::{PreparedRay, SceneScale};
use splitplane_core::ray::{Hit, QueryOptions, Ray};
use splitplane_core::traverse::Query;

use super::blocks::{Blocks, WalkNode};
use super::leaf::{Best, test_one};

/// Traces one ray from the root.
#[cold]
pub(crate) fn trace(
    blocks: &Blocks,
    scene: &SceneScale,
    ray: &Ray,
    options: &QueryOptions,
    query: Query,
) -> Hit {
    let mut best = Best::NONE;
    let Some(ray) = PreparedRay::new::<Strict>(ray, scene) else { return best.hit };
    let Some((mut enter, mut exit)) = ray.enter::<Strict>(&scene.bounds) else { return best.hit };
    let mut stack = [(0u32, 0.0f32, 0.0f32); MAX_DEPTH as usize + 1];
    let mut top = 0;
    let mut node = 0u32;
    let nodes = blocks.walk_nodes();
    loop {
        let walk = &nodes[node as usize];
        let WalkNode { word, tagged } = *walk;
        let axis = (tagged & 3) as usize;
        if axis < 3 {
            let (least, greatest) = ray.plane_interval::<Strict>(axis, f32::from_bits(word));
            let (left, right) = (node + 1, tagged >> WalkNode::SHIFT);
            let backwards = ray.direction[axis] < 0.0;
            let (near, far) = if backwards { (right, left) } else { (left, right) };
            if greatest < enter {
                node = far;
            } else if least > exit {
                node = near;
            } else {
                stack[top] = (far, enter.max(least), exit);
                top += 1;
                (node, exit) = (near, exit.min(greatest));
            }
            continue;
        }
        let answered = blocks.any_triangle(walk, |triangle, corners| {
            test_one(&ray, corners, triangle, options, &mut best) && query == Query::Any
        });
        if answered {
            return best.hit;
        }
        loop {
            if top == 0 {
                return best.hit;
            }
            top -= 1;
            (node, enter, exit) = stack[top];
            if enter <= best.stop {
                break;
            }
        }
    }
}
