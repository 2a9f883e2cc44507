//! Small meshes of which many triangles are as near to a point, or almost, and such points.

use crate::random::Random;

/// A triangle's corners.
pub type Triangle = [[f32; 3]; 3];

/// How a mesh is made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Corners on a small grid: most distances are shared by several triangles, and some have no area.
    Lattice,
    /// Triangles that are almost in one place: corners differ by a few floats.
    AlmostTheSame,
    /// Slivers along a common edge, of all widths.
    Slivers,
    /// A half, and the same mirrored: points on the mirror are as far from both.
    Mirrored,
    /// Numbers of all magnitudes, within a triangle too.
    AllMagnitudes,
    /// Triangles anywhere.
    Soup,
}

impl Kind {
    /// All of them.
    pub const ALL: [Kind; 6] = [
        Kind::Lattice,
        Kind::AlmostTheSame,
        Kind::Slivers,
        Kind::Mirrored,
        Kind::AllMagnitudes,
        Kind::Soup,
    ];
}

/// A mesh about as large as `size`.
pub fn mesh(kind: Kind, count: usize, size: f32, random: &mut Random) -> Vec<Triangle> {
    let mut triangles = of_one(kind, count, random);
    if kind != Kind::AllMagnitudes {
        triangles.as_flattened_mut().as_flattened_mut().iter_mut().for_each(|x| *x *= size);
    }
    triangles
}

fn of_one(kind: Kind, count: usize, random: &mut Random) -> Vec<Triangle> {
    let anywhere = |random: &mut Random| [(); 3].map(|()| random.point(1.0));
    let all = 0..count;
    match kind {
        Kind::Lattice => {
            let mut number = || random.below(5) as f32 - 2.0;
            all.map(|_| [(); 3].map(|()| [(); 3].map(|()| number()))).collect()
        }
        Kind::AlmostTheSame => {
            let first = anywhere(random);
            let mut near = |x: f32| (0..random.below(3)).fold(x, |x, _| x.next_up());
            all.map(|_| first.map(|corner| corner.map(&mut near))).collect()
        }
        Kind::Slivers => {
            let (a, b) = (random.point(1.0), random.point(1.0));
            let mut third = || {
                let (part, thin) = (random.unit(), 0.5f64.powi(random.below(40) as i32));
                [0, 1, 2].map(|axis| {
                    let on = f64::from(a[axis]) + part * f64::from(b[axis] - a[axis]);
                    (on + thin * f64::from(random.signed())) as f32
                })
            };
            all.map(|_| [a, b, third()]).collect()
        }
        Kind::Mirrored => {
            let half: Vec<Triangle> = (0..count / 2).map(|_| anywhere(random)).collect();
            let other = half.iter().map(|own| own.map(|[x, y, z]| [-x, y, z])).collect();
            [half, other].concat()
        }
        Kind::AllMagnitudes => {
            let mut number = || random.signed() * 10f32.powi(random.below(60) as i32 - 30);
            all.map(|_| [(); 3].map(|()| [(); 3].map(|()| number()))).collect()
        }
        Kind::Soup => all.map(|_| anywhere(random)).collect(),
    }
}

/// A corner, a middle of an edge, a point within a triangle, of a grid, on the mirror, or anywhere; one in three is a float further along an axis.
pub fn point(triangles: &[Triangle], size: f32, random: &mut Random) -> [f32; 3] {
    let [a, b, c] = random.pick(triangles);
    let mut point = match random.below(6) {
        0 => a,
        1 => [0, 1, 2].map(|axis| 0.5 * a[axis] + 0.5 * b[axis]),
        2 => [0, 1, 2].map(|axis| 0.25 * a[axis] + 0.5 * b[axis] + 0.25 * c[axis]),
        3 => [(); 3].map(|()| (random.below(17) as f32 - 8.0) * 0.5 * size),
        4 => [0.0, random.signed() * size, random.signed() * size],
        _ => random.point(2.0).map(|x| x * size),
    };
    if random.below(3) == 0 {
        let axis = random.below(3);
        let x = point[axis];
        point[axis] = if random.below(2) == 0 { x.next_up() } else { x.next_down() };
    }
    point
}
