//! How many of many lines meet a box, against its surface area (the survey's Figure 7, after MacDonald
//! and Booth 1990): what the surface area heuristic rests on, counted by ray queries.

use super::ReportError;
use super::fit::{Fit, fit};
use glam::DVec3;
use rayon::prelude::*;
use serde::Serialize;
use splitplane_core::aabb::Aabb;
use splitplane_core::backend::{Backend, BuildOptions};
use splitplane_core::mesh::Mesh;
use splitplane_core::random::unit;
use splitplane_core::ray::{QueryOptions, Ray};
use splitplane_core::sah::half_area_of;
use splitplane_core::tree::KdTreeView;
use splitplane_core::tree::node::NodeKind;

const SEED: u64 = 1990;

/// A box and the lines that meet it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Point {
    /// Whether the box is a node's cell of the tree; else its corners are random.
    pub cell: bool,
    /// Its surface area over that of the sphere around the scene, which all lines meet.
    pub area: f64,
    /// Lines that meet it.
    pub hits: u64,
}

/// Counts for many boxes, and the line that fits them best.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Areas {
    /// Lines, distributed evenly over all that meet the scene's sphere.
    pub lines: usize,
    /// The boxes.
    pub points: Vec<Point>,
    /// Least squares: hits = slope * area + intercept.
    pub slope: f64,
    /// See `slope`.
    pub intercept: f64,
    /// Part of the variance of hits that the line explains.
    pub r_squared: f64,
}

/// Counts lines through boxes: up to half of them cells of the tree, of sizes that differ, the others
/// random ones within its bounds. Runs in the rayon pool of the caller.
///
/// # Errors
/// The backend refuses boxes or rays.
pub fn count(
    tree: &KdTreeView<'_>,
    backend: &dyn Backend,
    boxes: usize,
    lines: usize,
) -> Result<Areas, ReportError> {
    let bounds = tree.bounds;
    let rays = lines_through(&bounds, lines);
    let sphere = sphere_area(&bounds);
    let mut all: Vec<(bool, Aabb)> =
        cells(tree, boxes / 2).into_iter().map(|cell| (true, cell)).collect();
    all.extend((all.len()..boxes).map(|i| (false, random_box(&bounds, i as u64))));
    let points: Result<Vec<Point>, ReportError> = all
        .into_par_iter()
        .map(|(cell, solid)| {
            let (positions, indices) = shell(&solid);
            let mesh = Mesh::indexed(&positions, &indices)?;
            let accelerator = backend.build(&mesh, &BuildOptions::default())?;
            let mut met = vec![false; rays.len()];
            accelerator.any_hits(&rays, &mut met, &QueryOptions::default())?;
            let hits = met.iter().filter(|met| **met).count() as u64;
            Ok(Point { cell, area: 2.0 * half_area_of(&solid) / sphere, hits })
        })
        .collect();
    let points = points?;
    let at: Vec<[f64; 2]> = points.iter().map(|point| [point.area, point.hits as f64]).collect();
    let Fit { slope, intercept, r_squared, .. } = fit(&at);
    Ok(Areas { lines, points, slope, intercept, r_squared })
}

impl Areas {
    /// The slope that integral geometry gives: a line that meets a convex body meets another one
    /// inside it with the ratio of their surface areas (Crofton).
    pub fn expected_slope(&self) -> f64 {
        self.lines as f64
    }
}

/// Surface area of the sphere through the corners of a box.
fn sphere_area(bounds: &Aabb) -> f64 {
    let diagonal = bounds.diagonal();
    std::f64::consts::PI * diagonal * diagonal
}

/// Lines distributed evenly over all that meet the sphere around the bounds: of any direction, through
/// any point of the disc across it.
fn lines_through(bounds: &Aabb, lines: usize) -> Vec<Ray> {
    let [lo, hi] = [bounds.lo, bounds.hi].map(|p| DVec3::from_array(p.map(f64::from)));
    let (middle, radius) = (0.5 * (lo + hi), 0.5 * bounds.diagonal());
    (0..lines as u64)
        .map(|line| {
            let part = |number| unit(SEED, &[line, number]);
            let height = 2.0 * part(0) - 1.0;
            let across = (1.0 - height * height).sqrt();
            let (sin, cos) = (std::f64::consts::TAU * part(1)).sin_cos();
            let direction = DVec3::new(across * cos, across * sin, height);
            let (side, up) = direction.any_orthonormal_pair();
            let (sin, cos) = (std::f64::consts::TAU * part(2)).sin_cos();
            let offset = (side * cos + up * sin) * (radius * part(3).sqrt());
            let start = middle + offset - direction * radius;
            let point = |v: DVec3| v.as_vec3().to_array();
            Ray::new(point(start), point(direction))
        })
        .collect()
}

/// Cells of interior nodes, evenly spread over the list by area. None is flat.
fn cells(tree: &KdTreeView<'_>, wanted: usize) -> Vec<Aabb> {
    let mut cells = Vec::new();
    tree.walk(|_, kind, cell, depth| {
        let solid = (0..3).all(|axis| cell.half_extent(axis) > 0.0);
        if depth <= 10 && solid && matches!(kind, NodeKind::Interior { .. }) {
            cells.push(*cell);
        }
    });
    cells.sort_by(|a, b| half_area_of(a).total_cmp(&half_area_of(b)));
    // Half of any tree's cells are tiny: take them by area, not by number.
    let largest = cells.last().map_or(0.0, half_area_of);
    let mut chosen: Vec<usize> = (1..=wanted)
        .map(|i| {
            let area = largest * i as f64 / wanted as f64;
            cells.partition_point(|cell| half_area_of(cell) < area).min(cells.len().max(1) - 1)
        })
        .collect();
    chosen.dedup();
    chosen.into_iter().filter_map(|i| cells.get(i).copied()).collect()
}

/// A box within others, each extent anything from a 20th of theirs to all.
fn random_box(bounds: &Aabb, number: u64) -> Aabb {
    let mut out = *bounds;
    for axis in 0..3 {
        let part = |which| unit(SEED + 1, &[number, axis as u64, which]);
        let [lo, hi] = [bounds.lo[axis], bounds.hi[axis]].map(f64::from);
        let extent = (hi - lo) * (0.05 + 0.95 * part(0));
        let start = lo + (hi - lo - extent) * part(1);
        (out.lo[axis], out.hi[axis]) = (start as f32, (start + extent) as f32);
    }
    out
}

/// The twelve triangles of a box.
fn shell(solid: &Aabb) -> ([[f32; 3]; 8], [[u32; 3]; 12]) {
    let corner = |i: usize| {
        [0, 1, 2].map(|axis| if i >> axis & 1 == 0 { solid.lo[axis] } else { solid.hi[axis] })
    };
    let quads: [[u32; 4]; 6] =
        [[0, 2, 6, 4], [1, 5, 7, 3], [0, 4, 5, 1], [2, 3, 7, 6], [0, 1, 3, 2], [4, 6, 7, 5]];
    let triangle = |i: usize| {
        let [a, b, c, d] = quads[i / 2];
        if i.is_multiple_of(2) { [a, b, c] } else { [a, c, d] }
    };
    (std::array::from_fn(corner), std::array::from_fn(triangle))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Cauchy: a convex body's mean shadow is a quarter of its surface. So the lines that meet a box
    /// are in the ratio of its surface to the sphere's.
    #[test]
    fn lines_meet_boxes_by_surface_area() {
        let bounds = Aabb { lo: [-1.0, -2.0, 0.5], hi: [3.0, 0.0, 1.0] };
        let lines = lines_through(&bounds, 20_000);
        let (lo, hi) = (bounds.lo.map(f64::from), bounds.hi.map(f64::from));
        let met = lines.iter().filter(|ray| {
            let (mut near, mut far) = (f64::NEG_INFINITY, f64::INFINITY);
            for axis in 0..3 {
                let inverse = 1.0 / f64::from(ray.direction[axis]);
                let a = (lo[axis] - f64::from(ray.origin[axis])) * inverse;
                let b = (hi[axis] - f64::from(ray.origin[axis])) * inverse;
                (near, far) = (near.max(a.min(b)), far.min(a.max(b)));
            }
            near <= far
        });
        let expected = 20_000.0 * 2.0 * half_area_of(&bounds) / sphere_area(&bounds);
        let met = met.count() as f64;
        assert!((met / expected - 1.0).abs() < 0.03, "{met} {expected}");
    }

    #[test]
    fn a_shell_has_the_area_of_its_box() {
        let solid = Aabb { lo: [0.0, 1.0, 2.0], hi: [1.0, 3.0, 5.0] };
        let (positions, indices) = shell(&solid);
        let area: f64 = indices
            .iter()
            .map(|corners| {
                let [a, b, c] =
                    corners.map(|i| DVec3::from_array(positions[i as usize].map(f64::from)));
                0.5 * (b - a).cross(c - a).length()
            })
            .sum();
        assert!((area - 2.0 * half_area_of(&solid)).abs() < 1e-9, "{area}");
    }
}
