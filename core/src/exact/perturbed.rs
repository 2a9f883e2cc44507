//! Crossings of surfaces, each counted once: the ray is shifted infinitesimally.
//!
//! A ray through a shared edge meets two closed triangles, one through a vertex many. To count the
//! surface and not the triangles, the ray is moved by (e, e^2) in the plane across it, e being
//! smaller than any number (Simulation of Simplicity: Edelsbrunner and Muecke 1990). Where an edge
//! function is zero, the first of its derivatives that is not decides. Two triangles that share an
//! edge derive the same from the same two corners, so exactly one of them has the ray where the
//! surface continues on the other side, and both or neither where it turns back. A triangle that
//! the ray meets from the side is not crossed.

use core::cmp::Ordering;

use super::ExactRay;
use super::integer::Integer;
use super::meeting::{Edges, Meeting};
use crate::ray::Culling;
use crate::triangle::Triangle;

/// Whether the line of a ray, shifted infinitesimally, crosses a triangle ([snapped corners](crate::triangle::prepare)). The
/// distance is that of the ray as it is.
#[inline]
pub fn cross(ray: &ExactRay, corners: &Triangle, culling: Culling) -> Option<Meeting> {
    let edges = Edges::new(ray, corners);
    let (mut positive, mut negative) = (false, false);
    for edge in 0..3 {
        let sign = match edges.sign(edge) {
            Ordering::Equal => sign_beside(&edges, edge),
            sign => sign,
        };
        match sign {
            Ordering::Less => negative = true,
            // An edge seen end on: the triangle is seen from its side.
            Ordering::Equal => return None,
            Ordering::Greater => positive = true,
        }
        if positive && negative {
            return None;
        }
    }
    // The three sum to the denominator of the distance, moved or not: of one sign, it is not zero.
    let front = positive;
    let culled = match culling {
        Culling::None => false,
        Culling::Back => !front,
        Culling::Front => front,
    };
    (!culled).then(|| Meeting::new(&edges, front))
}

/// The sign of an edge function that is zero, after the ray was moved.
///
/// In the plane across the ray, with p and q the ends of the edge as it sees them, the edge function is
/// p_x q_y - p_y q_x. Moving the ray by (e, e^2) adds e (p_y - q_y) + e^2 (q_x - p_x).
#[cold]
fn sign_beside(edges: &Edges<'_>, edge: usize) -> Ordering {
    let direction = &edges.ray.direction;
    let mut z = 0;
    for axis in 1..3 {
        if direction[axis].abs() > direction[z].abs() {
            z = axis;
        }
    }
    // As in the shear: x and y change places for a negative main component.
    let (mut x, mut y) = ((z + 1) % 3, (z + 2) % 3);
    if direction[z] < 0.0 {
        (x, y) = (y, x);
    }
    let [p, q] = Edges::ENDS[edge].map(|i| &edges.corners[i]);
    // d_z (p_k - q_k) - d_k (p_z - q_z), with the sign of d_z taken out.
    let across = |k: usize| {
        let d = |axis: usize| Integer::from_float(direction[axis]);
        let along = Integer::difference(p[k], q[k]).times(&d(z));
        let sheared = along.minus(&Integer::difference(p[z], q[z]).times(&d(k))).sign();
        if direction[z] < 0.0 { sheared.reverse() } else { sheared }
    };
    across(y).then_with(|| across(x).reverse())
}
