//! Triangles cut by boxes and planes, in `f64`: for what is drawn, not for trees.

use splitplane_core::aabb::Aabb;

/// A corner of a polygon.
pub(super) type Corner = [f64; 3];

/// The part of a triangle inside a box, as a convex polygon; empty where there is none (Sutherland and
/// Hodgman 1974).
pub(super) fn clip(corners: [[f32; 3]; 3], cell: &Aabb) -> Vec<Corner> {
    let mut polygon: Vec<Corner> = corners.map(|corner| corner.map(f64::from)).to_vec();
    for side in 0..6 {
        let axis = side / 2;
        let (plane, sign) = match side % 2 {
            0 => (f64::from(cell.lo[axis]), 1.0),
            _ => (f64::from(cell.hi[axis]), -1.0),
        };
        let inside = |corner: &Corner| sign * (corner[axis] - plane);
        let mut out = Vec::with_capacity(polygon.len() + 1);
        for i in 0..polygon.len() {
            let (a, b) = (polygon[i], polygon[(i + 1) % polygon.len()]);
            let (da, db) = (inside(&a), inside(&b));
            if da >= 0.0 {
                out.push(a);
            }
            if (da > 0.0 && db < 0.0) || (da < 0.0 && db > 0.0) {
                out.push(between(a, b, da / (da - db)));
            }
        }
        polygon = out;
    }
    polygon
}

/// Where a triangle meets the plane at `position` across an axis; `None` where it does not.
pub(super) fn section(corners: [[f32; 3]; 3], axis: usize, position: f64) -> Option<[Corner; 2]> {
    let corners = corners.map(|corner| corner.map(f64::from));
    let mut ends = Vec::new();
    for i in 0..3 {
        let (a, b) = (corners[i], corners[(i + 1) % 3]);
        let (da, db) = (a[axis] - position, b[axis] - position);
        if (da < 0.0) != (db < 0.0) {
            ends.push(between(a, b, da / (da - db)));
        }
    }
    <[Corner; 2]>::try_from(ends).ok()
}

fn between(a: Corner, b: Corner, part: f64) -> Corner {
    [0, 1, 2].map(|axis| a[axis] + (b[axis] - a[axis]) * part)
}

#[cfg(test)]
mod tests {
    use super::*;

    const UNIT: Aabb = Aabb { lo: [0.0; 3], hi: [1.0; 3] };

    #[test]
    fn a_triangle_is_cut_to_the_box() {
        let inside = [[0.1, 0.1, 0.5], [0.9, 0.1, 0.5], [0.1, 0.9, 0.5]];
        assert_eq!(clip(inside, &UNIT), inside.map(|corner| corner.map(f64::from)));
        let across = [[-1.0, 0.5, 0.5], [3.0, 0.5, 0.5], [-1.0, 0.6, 0.5]];
        let polygon = clip(across, &UNIT);
        let xs = polygon.iter().map(|corner| corner[0]);
        assert_eq!((xs.clone().fold(9.0, f64::min), xs.fold(-9.0, f64::max)), (0.0, 1.0));
        assert!(clip(across.map(|[x, y, z]| [x, y + 2.0, z]), &UNIT).is_empty());
    }

    #[test]
    fn a_plane_meets_a_triangle_in_a_line() {
        let corners = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 4.0]];
        let [a, b] = section(corners, 2, 2.0).unwrap();
        assert_eq!([a, b].map(|end| end[2]), [2.0; 2]);
        assert_eq!((a[0] - b[0]).abs(), 1.0);
        assert_eq!(section(corners, 2, 5.0), None);
    }
}
