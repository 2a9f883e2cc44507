//! What models ask of a mesh.

use splitplane_core::mesh::Mesh;

/// Triangles that are looked at; a prime, so that they do not fall in step with a mesh's rows.
const SAMPLE: usize = 4093;

/// What is known of a mesh before its tree is built.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeshTraits {
    /// How many triangles.
    pub triangles: u64,
    /// How unequal they are: the natural logarithm of their mean size over their median, from 0 to [`MeshTraits::MOST_SKEW`]. A size is
    /// the surface of the box about a triangle. Scans have about 0, rooms 2 to 6.
    pub size_skew: f64,
}

impl MeshTraits {
    /// More than this tells models nothing more: a few triangles have all the surface.
    pub const MOST_SKEW: f64 = 6.0;

    /// Looks at 4,093 triangles from all over the mesh, at all where there are no more.
    pub fn of(mesh: &Mesh<'_>) -> MeshTraits {
        let (count, total) = (mesh.len().min(SAMPLE), mesh.len());
        let mut areas = Vec::with_capacity(count);
        for number in 0..count {
            // In 64 bits, which hold the product.
            let place = number as u64 * total as u64 / count as u64;
            let area = box_area(&mesh.triangle(place as usize));
            if area.is_finite() {
                areas.push(area);
            }
        }
        MeshTraits { triangles: total as u64, size_skew: skew(areas) }
    }
}

fn skew(mut areas: Vec<f64>) -> f64 {
    areas.sort_by(f64::total_cmp);
    let mean = areas.iter().sum::<f64>() / areas.len().max(1) as f64;
    if mean == 0.0 {
        return 0.0;
    }
    // Of an even number the greater of the two in the middle.
    let median = areas[areas.len() / 2];
    (mean / median).ln().clamp(0.0, MeshTraits::MOST_SKEW)
}

/// Half of the surface of the box about a triangle.
fn box_area(corners: &[[f32; 3]; 3]) -> f64 {
    let mut size = [0.0; 3];
    for (axis, size) in size.iter_mut().enumerate() {
        let [a, b, c] = corners.map(|corner| f64::from(corner[axis]));
        // The greater of NaN and a number is the number.
        if (a + b + c).is_nan() {
            return f64::NAN;
        }
        *size = a.max(b).max(c) - a.min(b).min(c);
    }
    size[0] * size[1] + size[1] * size[2] + size[2] * size[0]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn triangle(size: f32) -> [[f32; 3]; 3] {
        [[0.0; 3], [size, 0.0, 0.0], [0.0, size, 0.0]]
    }

    fn of(triangles: &[[[f32; 3]; 3]]) -> MeshTraits {
        MeshTraits::of(&Mesh::soup(triangles).unwrap())
    }

    #[test]
    fn skew_is_that_of_the_mean_and_the_median() {
        // 2 of 32 triangles have 100 times the area of the others: the mean is 230 / 32 of the median.
        let mut some = vec![triangle(1.0); 30];
        some.extend([triangle(10.0); 2]);
        let traits = of(&some);
        assert_eq!(traits.triangles, 32);
        assert!((traits.size_skew - (230.0_f64 / 32.0).ln()).abs() < 1e-12, "{traits:?}");
        some.reverse();
        assert_eq!(of(&some), traits, "the order counts for nothing");
        // The scale does not either.
        let larger: Vec<_> =
            some.iter().map(|one| one.map(|corner| corner.map(|x| 8.0 * x))).collect();
        assert_eq!(of(&larger), traits);
    }

    #[test]
    fn equal_triangles_have_no_skew() {
        let many = vec![triangle(3.0); 10 * SAMPLE + 7];
        for count in [1, 2, 16, SAMPLE, SAMPLE + 1, many.len()] {
            assert_eq!(of(&many[..count]), MeshTraits { triangles: count as u64, size_skew: 0.0 });
        }
    }

    /// Large triangles are found wherever they are.
    #[test]
    fn a_large_mesh_is_looked_at_all_over() {
        for place in 0..4 {
            let mut many = vec![triangle(1.0); 16 * SAMPLE];
            let quarter = many.len() / 4;
            many[place * quarter..(place + 1) * quarter].fill(triangle(10.0));
            let skew = of(&many).size_skew;
            assert!((skew - 25.75_f64.ln()).abs() < 0.01, "{place}: {skew}");
        }
    }

    #[test]
    fn what_has_no_area_or_no_place_has_no_skew() {
        let none = MeshTraits { triangles: 0, size_skew: 0.0 };
        assert_eq!(of(&[]), none);
        assert_eq!(of(&[triangle(0.0)]), MeshTraits { triangles: 1, ..none });
        // All the surface is one triangle's.
        let flat = [triangle(0.0), triangle(0.0), triangle(1.0)];
        assert_eq!(of(&flat).size_skew, MeshTraits::MOST_SKEW);
        for bad in [f32::NAN, f32::INFINITY] {
            let mut odd = triangle(1.0);
            odd[1][1] = bad;
            assert_eq!(of(&[odd, triangle(1.0)]), MeshTraits { triangles: 2, ..none });
            assert_eq!(of(&[odd]), MeshTraits { triangles: 1, ..none });
        }
    }
}
