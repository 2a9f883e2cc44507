//! How many surfaces a ray crosses, where a device can be certain of each: what a device counts, and what it leaves to the CPU.

use core::ops::ControlFlow;

use super::screen::{Screened, is_as_given, screen};
use super::{Verdict, distance_of, signs_of_edges};
use crate::arithmetic::Arithmetic;
use crate::query::intersect::{PreparedRay, SceneScale};
use crate::query::traverse::{InnerRay, Triangles};
use crate::query::walk::{Leaf, walk};
use crate::ray::{Culling, QueryOptions, Ray};
use crate::tree::KdTreeView;
use crate::triangle::Triangle;

/// Most crossings of a ray that are counted. A triangle lies in several leaves, so those that were counted must be known.
pub const MOST_COUNTED: usize = 32;

/// The crossings of a ray.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Counted {
    /// So many from the front and so many from the back of triangles, all of them strictly between the ray's limits.
    Crossed([u32; 2]),
    /// There are more than [`MOST_COUNTED`], or perhaps another, or nothing can be told of the ray.
    Undecided,
}

/// Whether a ray crosses a triangle.
enum Crosses {
    /// Not between its limits, or from a side that does not count.
    Not,
    /// Away from edges, strictly between the limits.
    From { front: bool },
    /// Perhaps, or at an edge, where a rule of the CPU says which of two triangles is crossed, or at a limit.
    InDoubt,
}

/// Counts the triangles that a ray [crosses](crate::exact::cross) from a side that counts: as many as
/// [`all_hits`](crate::query::all_hits::all_hits) has, and where none is undecided, no triangle holds the origin of a ray that
/// begins there.
///
/// `tree` must be valid (see [`tree::validate`](crate::tree::validate)).
pub fn count<A: Arithmetic>(
    tree: &KdTreeView<'_>,
    triangles: &(impl Triangles + ?Sized),
    scene: &SceneScale,
    ray: &Ray,
    options: &QueryOptions<'_>,
) -> Counted {
    let nothing = Counted::Crossed([0; 2]);
    let Some(prepared) = PreparedRay::new::<A>(ray, scene) else { return nothing };
    if !is_as_given(ray, &prepared) {
        return Counted::Undecided;
    }
    let Some(interval) = prepared.enter::<A>(&scene.bounds) else { return nothing };
    let mut counted = [0; MOST_COUNTED];
    let mut sides = [0u32; 2];
    let mut undecided = false;
    let visit = |Leaf { first, count, .. }: Leaf<f32>| {
        for &triangle in tree.leaf(first, count) {
            if options.ignore == Some(triangle) {
                continue;
            }
            let front = match crosses::<A>(&prepared, &triangles.corners(triangle), options.culling)
            {
                Crosses::Not => continue,
                Crosses::From { front } => front,
                Crosses::InDoubt => {
                    undecided = true;
                    return ControlFlow::Break(());
                }
            };
            let length = (sides[0] + sides[1]) as usize;
            if counted[..length].contains(&triangle) {
                continue;
            }
            let Some(place) = counted.get_mut(length) else {
                undecided = true;
                return ControlFlow::Break(());
            };
            *place = triangle;
            sides[usize::from(!front)] += 1;
        }
        ControlFlow::Continue(f32::INFINITY)
    };
    walk(tree.nodes, &InnerRay::<A>::new(&prepared), interval, &mut { visit });
    if undecided { Counted::Undecided } else { Counted::Crossed(sides) }
}

fn crosses<A: Arithmetic>(ray: &PreparedRay, triangle: &Triangle, culling: Culling) -> Crosses {
    let Some(screened) = screen::<A>(ray, triangle, culling, f32::INFINITY) else {
        return Crosses::Not;
    };
    let Screened { flat, mut edges, margin, nearest } = screened;
    let signs = signs_of_edges::<A>(ray, triangle, &flat, &mut edges, margin);
    if signs.positive && signs.negative {
        return Crosses::Not;
    }
    if signs.open || edges.contains(&0.0) {
        return Crosses::InDoubt;
    }
    if signs.is_culled(culling) {
        return Crosses::Not;
    }
    match distance_of::<A>(ray, triangle, f32::INFINITY, edges, nearest, false) {
        Verdict::Not => Crosses::Not,
        // A distance without error is zero: at the origin.
        Verdict::Met(met) if met.error != 0.0 => Crosses::From { front: signs.positive },
        Verdict::Met(_) | Verdict::InDoubt(_) => Crosses::InDoubt,
    }
}
