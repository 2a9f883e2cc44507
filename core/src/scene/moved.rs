//! Vertices that transforms move, one transform for each group of vertices: bodies that stay rigid, or bones of a model whose vertices
//! hang on one bone each. By guarded operations in a stated order, so that a device moves them to the same bits.

use thiserror::Error;

use crate::arithmetic::{Arithmetic, Strict, snap};
use crate::scene::transform::Transform;

/// Why vertices cannot be moved.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum MoveError {
    /// There is not one group, or not one place for the result, for each vertex.
    #[error("{found} {what} for {vertices} vertices")]
    Counts {
        /// What there are too many or too few of.
        what: &'static str,
        /// How many there are.
        found: usize,
        /// How many vertices there are.
        vertices: usize,
    },
    /// There is not one transform for each group.
    #[error("{found} transforms for {groups} groups")]
    Transforms {
        /// How many transforms there are.
        found: usize,
        /// How many groups there are.
        groups: usize,
    },
    /// A vertex names a group that has no transform.
    #[error("vertex {vertex} is of group {group}, but there are {transforms} transforms")]
    Group {
        /// The first such vertex.
        vertex: usize,
        /// Its group.
        group: u32,
        /// How many transforms there are.
        transforms: usize,
    },
    /// A coordinate at rest is infinite or no number.
    #[error("vertex {vertex} has a coordinate that is not finite")]
    NotFinite {
        /// The first such vertex.
        vertex: usize,
    },
    /// A transform has a number that is not finite, or moves a vertex of the mesh beyond 2^126: such positions would not be the
    /// same everywhere.
    #[error("transform {transform} is not finite, or moves vertices farther than 2^126")]
    Transform {
        /// The first such transform.
        transform: usize,
    },
}

/// Farthest that vertices may be moved.
const FARTHEST: f64 = (1u128 << 126) as f64;

/// Whether each vertex can be moved by one of so many transforms, whatever these are. The greatest magnitude of its coordinates.
///
/// # Errors
/// The first vertex that cannot, and why.
pub fn check_rest(rest: &[[f32; 3]], groups: &[u32], transforms: usize) -> Result<f32, MoveError> {
    let vertices = rest.len();
    if groups.len() != vertices {
        return Err(MoveError::Counts { what: "groups", found: groups.len(), vertices });
    }
    let mut greatest = 0f32;
    for (vertex, (position, &group)) in rest.iter().zip(groups).enumerate() {
        if group as usize >= transforms {
            return Err(MoveError::Group { vertex, group, transforms });
        }
        for coordinate in position {
            if !coordinate.is_finite() {
                return Err(MoveError::NotFinite { vertex });
            }
            greatest = greatest.max(coordinate.abs());
        }
    }
    Ok(greatest)
}

/// Whether these transforms may move vertices whose coordinates are at most so great.
///
/// # Errors
/// The first that may not.
pub fn check_transforms(transforms: &[Transform], greatest: f32) -> Result<(), MoveError> {
    for (transform, rows) in transforms.iter().enumerate() {
        for [x, y, z, by] in rows {
            let [x, y, z, by] = [x, y, z, by].map(|m| f64::from(m.abs()));
            // Above every partial sum, rounded or not.
            let reach = (x + y + z) * f64::from(greatest) + by;
            if !reach.is_finite() || reach > FARTHEST {
                return Err(MoveError::Transform { transform });
            }
        }
    }
    Ok(())
}

/// A transform as vertices are moved by it: numbers below 2^-126 are +0, which devices may make of them.
pub fn snapped(transform: &Transform) -> Transform {
    let mut snapped = *transform;
    for number in snapped.iter_mut().flatten() {
        *number = snap(*number);
    }
    snapped
}

/// Where a [snapped] transform moves a position: `((m_0 x + m_1 y) + m_2 z) + m_3`, row by row, each operation rounded, and numbers
/// below 2^-126 being +0.
#[inline]
pub fn moved(transform: &Transform, position: [f32; 3]) -> [f32; 3] {
    let [x, y, z] = position;
    let (x, y, z) = (snap(x), snap(y), snap(z));
    let mut moved = [0.0; 3];
    for (to, [m0, m1, m2, m3]) in moved.iter_mut().zip(transform) {
        let two =
            Strict::snapped_sum(Strict::snapped_product(*m0, x), Strict::snapped_product(*m1, y));
        *to = Strict::snapped_sum(Strict::snapped_sum(two, Strict::snapped_product(*m2, z)), *m3);
    }
    moved
}

/// Moves each vertex by the transform of its group.
///
/// # Errors
/// Counts that differ, a group without a transform, numbers that are not finite or would not be; nothing is written then.
pub fn move_vertices(
    rest: &[[f32; 3]],
    groups: &[u32],
    transforms: &[Transform],
    to: &mut [[f32; 3]],
) -> Result<(), MoveError> {
    if to.len() != rest.len() {
        return Err(MoveError::Counts { what: "places", found: to.len(), vertices: rest.len() });
    }
    let greatest = check_rest(rest, groups, transforms.len())?;
    check_transforms(transforms, greatest)?;
    for ((position, &group), to) in rest.iter().zip(groups).zip(to) {
        *to = moved(&snapped(&transforms[group as usize]), *position);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::transform::{IDENTITY, translation};

    const REST: [[f32; 3]; 4] =
        [[0.5, -2.0, 3.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [7.0, 7.0, 7.0]];

    #[test]
    fn each_group_goes_its_way() {
        let turn = [[0.0, -1.0, 0.0, 10.0], [1.0, 0.0, 0.0, 20.0], [0.0, 0.0, 2.0, 30.0]];
        let transforms = [IDENTITY, translation([0.25, 0.5, -1.0]), turn];
        let mut to = [[0.0; 3]; 4];
        move_vertices(&REST, &[0, 1, 2, 2], &transforms, &mut to).unwrap();
        assert_eq!(to, [[0.5, -2.0, 3.0], [1.25, 0.5, -1.0], [9.0, 20.0, 30.0], [3.0, 27.0, 44.0]]);
    }

    /// Subnormal numbers count as zero wherever they stand.
    #[test]
    fn subnormal_numbers_are_zero() {
        let tiny = f32::MIN_POSITIVE / 2.0;
        let transform = [[tiny, 1.0, 0.0, 0.0], [0.5, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, tiny]];
        let mut to = [[9.0; 3]; 1];
        let rest = [[f32::MIN_POSITIVE, tiny, 0.0]];
        move_vertices(&rest, &[0], &[transform], &mut to).unwrap();
        assert_eq!(to[0].map(f32::to_bits), [0; 3]);
    }

    #[test]
    fn what_cannot_be_moved_is_named() {
        let mut to = [[0.0; 3]; 4];
        let mut refused = |rest: &[[f32; 3]; 4], groups: &[u32], transforms: &[Transform]| {
            let error = move_vertices(rest, groups, transforms, &mut to).unwrap_err();
            assert_eq!(to, [[0.0; 3]; 4]);
            error
        };
        let two = [IDENTITY, translation([0.0; 3])];
        assert_eq!(
            refused(&REST, &[0; 3], &two),
            MoveError::Counts { what: "groups", found: 3, vertices: 4 }
        );
        assert_eq!(
            refused(&REST, &[0, 1, 2, 0], &two),
            MoveError::Group { vertex: 2, group: 2, transforms: 2 }
        );
        for bad in [f32::NAN, f32::INFINITY] {
            let mut rest = REST;
            rest[3][1] = bad;
            assert_eq!(refused(&rest, &[0; 4], &two), MoveError::NotFinite { vertex: 3 });
            let transforms = [IDENTITY, translation([bad, 0.0, 0.0])];
            assert_eq!(refused(&REST, &[0; 4], &transforms), MoveError::Transform { transform: 1 });
        }
        // 7 * 2^124 is beyond 2^126, and 7 * 2^123 is not.
        let grown = |by: f32| [[[by, 0.0, 0.0, 0.0], IDENTITY[1], IDENTITY[2]]];
        let far = grown(2f32.powi(124));
        assert_eq!(refused(&REST, &[0; 4], &far), MoveError::Transform { transform: 0 });
        let mut to = [[0.0; 3]; 4];
        move_vertices(&REST, &[0; 4], &grown(2f32.powi(123)), &mut to).unwrap();
        assert_eq!(to[3][0], 7.0 * 2f32.powi(123));
    }
}
