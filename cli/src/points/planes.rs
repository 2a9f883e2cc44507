//! Planes of least squares through the neighbours of points (Hoppe et al. 1992), and how well they fit (Pauly et al. 2002).

use super::work::Work;
use crate::failure::Failure;
use splitplane::points::Neighbour;

/// The plane at a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Plane {
    /// Its normal, of length 1; 0 where there is none.
    pub(super) normal: [f32; 3],
    /// The spread of the neighbours along it over all of their spread, 0 to 1/3.
    pub(super) variation: f32,
}

impl Plane {
    pub(super) const NONE: Plane = Plane { normal: [0.0; 3], variation: 0.0 };
}

/// A direction is told from others where the spread across it is more than this part of the greatest.
const FLAT: f64 = 1e-10;

/// The plane at each point of the cloud.
pub(super) fn fit(
    work: &Work<'_>,
    k: usize,
    viewpoint: Option<[f32; 3]>,
) -> Result<Vec<Plane>, Failure> {
    work.map("normals", work.points, (k, f32::INFINITY), Plane::NONE, |index, found| {
        let at = work.points[index].map(f64::from);
        of(at, found.iter().map(|near: &Neighbour| work.point(near.point)), viewpoint)
    })
}

/// The plane of least squares through points near `at`.
fn of(
    at: [f64; 3],
    points: impl Iterator<Item = [f64; 3]> + Clone,
    viewpoint: Option<[f32; 3]>,
) -> Plane {
    // In units of the farthest neighbour, so that squares neither overflow nor vanish.
    let from = |point: [f64; 3]| [0, 1, 2].map(|axis| point[axis] - at[axis]);
    let reach = points.clone().flat_map(from).fold(0.0f64, |most, x| most.max(x.abs()));
    if reach == 0.0 || !reach.is_finite() {
        return Plane::NONE;
    }
    let points = points.map(|point| from(point).map(|x| x / reach));
    let (mut mean, mut count) = ([0.0; 3], 0.0);
    for point in points.clone() {
        count += 1.0;
        (0..3).for_each(|axis| mean[axis] += point[axis]);
    }
    let mean = mean.map(|sum: f64| sum / count);
    let mut spread = [[0.0; 3]; 3];
    for point in points {
        for row in 0..3 {
            for column in 0..3 {
                spread[row][column] += (point[row] - mean[row]) * (point[column] - mean[column]);
            }
        }
    }
    let (values, vectors) = eigen(spread);
    let mut order = [0, 1, 2];
    order.sort_by(|&a, &b| values[a].total_cmp(&values[b]));
    let [least, middle, most] = order.map(|place| values[place].max(0.0));
    if middle <= FLAT * most {
        // All on a line, or in one place.
        return Plane::NONE;
    }
    let mut normal = [0, 1, 2].map(|row| vectors[row][order[0]]);
    let side = match viewpoint {
        Some(eye) => (0..3).map(|axis| (f64::from(eye[axis]) - at[axis]) * normal[axis]).sum(),
        None => {
            normal.into_iter().fold(0.0f64, |most, x| if x.abs() > most.abs() { x } else { most })
        }
    };
    if side < 0.0 {
        normal = normal.map(|x| -x);
    }
    let variation = (least / (least + middle + most)) as f32;
    Plane { normal: normal.map(|x| x as f32), variation }
}

/// Eigenvalues, and eigenvectors as columns, of a symmetric matrix, by Jacobi's rotations.
fn eigen(mut a: [[f64; 3]; 3]) -> ([f64; 3], [[f64; 3]; 3]) {
    let mut vectors = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    // Each sweep squares what is left beside the diagonal.
    for _ in 0..12 {
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            if a[p][q] == 0.0 {
                continue;
            }
            let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
            let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
            let c = 1.0 / (t * t + 1.0).sqrt();
            let s = t * c;
            for row in &mut a {
                (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
            }
            for column in 0..3 {
                let (x, y) = (a[p][column], a[q][column]);
                (a[p][column], a[q][column]) = (c * x - s * y, s * x + c * y);
            }
            for row in &mut vectors {
                (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
            }
        }
    }
    ([a[0][0], a[1][1], a[2][2]], vectors)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fitted(points: &[[f64; 3]], viewpoint: Option<[f32; 3]>) -> Plane {
        of(points[0], points.iter().copied(), viewpoint)
    }

    #[test]
    fn a_plane_is_found_at_any_size_and_looks_to_the_viewpoint() {
        for size in [1e-30, 1.0, 1e30] {
            let plane = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0], [0.3, 0.8]]
                .map(|[x, y]| [x * size, y * size, (2.0 * x - y) * size]);
            let found = fitted(&plane, None);
            let length = 6.0f64.sqrt();
            let expected = [2.0 / length, -1.0 / length, -1.0 / length];
            for axis in 0..3 {
                assert!((f64::from(found.normal[axis]) - expected[axis]).abs() < 1e-6, "{found:?}");
            }
            assert!(found.variation < 1e-12);
            let turned = fitted(&plane, Some([0.0, 0.0, 1e35]));
            assert_eq!(turned.normal, found.normal.map(|x| -x));
        }
    }

    #[test]
    fn a_line_and_one_place_have_no_plane_and_a_ball_no_flat_one() {
        let line: Vec<[f64; 3]> =
            (0..6).map(|i| [1.0, 2.0, 3.0].map(|x| x * f64::from(i))).collect();
        assert_eq!(fitted(&line, None), Plane::NONE);
        assert_eq!(fitted(&[[1.0; 3]; 5], None), Plane::NONE);
        let corners: Vec<[f64; 3]> =
            (0..8).map(|i| [0, 1, 2].map(|bit| f64::from(i >> bit & 1))).collect();
        assert!((fitted(&corners, None).variation - 1.0 / 3.0).abs() < 1e-6);
    }

    #[test]
    fn eigenvectors_are_those() {
        let a = [[4.0, 1.0, -2.0], [1.0, 3.0, 0.5], [-2.0, 0.5, 1.0]];
        let (values, vectors) = eigen(a);
        for place in 0..3 {
            for row in 0..3 {
                let product: f64 = (0..3).map(|i| a[row][i] * vectors[i][place]).sum();
                assert!((product - values[place] * vectors[row][place]).abs() < 1e-12);
            }
        }
    }
}
