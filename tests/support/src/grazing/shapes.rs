//! The surfaces.

use super::{between, rotation};
use crate::random::Random;
use crate::scenes::{Scene, cos_sin};
use std::collections::HashMap;
use std::f64::consts::{PI, TAU};

/// What a surface is like.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shape {
    /// A sphere of rings, closed.
    LatLong,
    /// An icosahedron, divided, closed.
    Icosphere,
    /// A sphere whose corners lie at different distances, closed, with edges that point inwards.
    Bumpy,
    /// A sheet of squares with random heights.
    Heights,
    /// Random triangles.
    Soup,
    /// Boxes beside, in and through one another, each closed.
    City,
    /// Closed surfaces inside one another.
    Shells,
    /// Needles around a hub, in a plane or nearly.
    Fan,
    /// Needles through one point, in all directions.
    Star,
    /// A plane whose triangles were divided at the middles of edges.
    Crowd,
    /// A box, closed.
    Box,
    /// A box with its corners moved, closed, with diagonals that point inwards.
    Warped,
    /// A box of which single triangles were divided, so that corners lie on edges of others.
    Junctions,
}

impl Shape {
    /// All of them.
    pub const ALL: [Shape; 13] = [
        Shape::LatLong,
        Shape::Icosphere,
        Shape::Bumpy,
        Shape::Heights,
        Shape::Soup,
        Shape::City,
        Shape::Shells,
        Shape::Fan,
        Shape::Star,
        Shape::Crowd,
        Shape::Box,
        Shape::Warped,
        Shape::Junctions,
    ];

    /// The name in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Shape::LatLong => "lat-long",
            Shape::Icosphere => "icosphere",
            Shape::Bumpy => "bumpy",
            Shape::Heights => "heights",
            Shape::Soup => "soup",
            Shape::City => "city",
            Shape::Shells => "shells",
            Shape::Fan => "fan",
            Shape::Star => "star",
            Shape::Crowd => "crowd",
            Shape::Box => "box",
            Shape::Warped => "warped",
            Shape::Junctions => "junctions",
        }
    }

    /// Whether no edge is open: then no ray gets out.
    pub const fn is_closed(self) -> bool {
        matches!(
            self,
            Shape::LatLong
                | Shape::Icosphere
                | Shape::Bumpy
                | Shape::City
                | Shape::Shells
                | Shape::Box
                | Shape::Warped
        )
    }
}

/// A mesh of at most some 350 triangles, turned, scaled and moved; one in eight is tiny, down to 2^-50, beside a far
/// tetrahedron of usual size.
#[derive(Clone, Debug)]
pub struct Surface {
    /// What it is like.
    pub shape: Shape,
    /// The seed it was made from.
    pub seed: u64,
    /// The mesh.
    pub scene: Scene,
    /// How many of the triangles, the first ones, are not that tetrahedron's.
    pub own: usize,
    /// Its longest extent, without that tetrahedron.
    pub extent: f64,
}

impl Surface {
    /// A surface; equal shape and seed give the same.
    pub fn new(shape: Shape, seed: u64) -> Surface {
        let mut random = Random::new(seed.wrapping_mul(64).wrapping_add(shape as u64));
        let mut draft = Draft::of(shape, &mut random);
        draft.place(shape, &mut random);
        let mut positions: Vec<[f32; 3]> =
            draft.positions.iter().map(|p| p.map(|x| x as f32)).collect();
        let mut indices = draft.indices;
        let is_detail = draft.is_detail;
        match shape {
            Shape::Crowd => {
                // Middles of edges in `f32`, so that they lie on the edges but for their own rounding.
                let times = 2 + random.below(2);
                (0..times).for_each(|_| divide(&mut positions, &mut indices, middle_of_floats));
            }
            Shape::Junctions => {
                for _ in 0..12 + random.below(40) {
                    let triangle = random.below(indices.len());
                    cut(&mut positions, &mut indices, triangle, random.below(3));
                }
            }
            _ => {}
        }
        let (mut low, mut high) = ([f32::MAX; 3], [f32::MIN; 3]);
        for p in &positions {
            for k in 0..3 {
                (low[k], high[k]) = (low[k].min(p[k]), high[k].max(p[k]));
            }
        }
        let extent = (0..3).map(|k| f64::from(high[k]) - f64::from(low[k])).fold(0.0, f64::max);
        let own = indices.len();
        if is_detail {
            let first = positions.len() as u32;
            positions.extend([[1.0, 1.0, 1.0], [2.0, 1.0, 1.0], [1.0, 2.0, 1.0], [1.0, 1.0, 2.0]]);
            let faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
            indices.extend(faces.map(|face: [u32; 3]| face.map(|corner| first + corner)));
        }
        let scene = Scene::indexed(shape.name(), positions, indices);
        Surface { shape, seed, scene, own, extent }
    }

    /// A surface of any mesh.
    pub fn of(scene: Scene, shape: Shape) -> Surface {
        let mesh = scene.mesh();
        let bounds = crate::oracle::finite_bounds(&mesh);
        let extent =
            (0..3).map(|k| f64::from(bounds.hi[k]) - f64::from(bounds.lo[k])).fold(0.0, f64::max);
        let own = mesh.len();
        Surface { shape, seed: 0, scene, own, extent }
    }

    /// The corners of all triangles.
    pub fn corners(&self) -> Vec<[[f64; 3]; 3]> {
        self.scene.triangles().iter().map(|t| t.map(|corner| corner.map(f64::from))).collect()
    }
}

/// A mesh before it is rounded.
#[derive(Default)]
struct Draft {
    positions: Vec<[f64; 3]>,
    indices: Vec<[u32; 3]>,
    /// It is tiny, beside a tetrahedron of usual size.
    is_detail: bool,
}

impl Draft {
    fn of(shape: Shape, random: &mut Random) -> Draft {
        let mut draft = Draft::default();
        match shape {
            Shape::LatLong => draft.lat_long(4 + random.below(6), [0.0; 3], 1.0),
            Shape::Icosphere => draft.icosphere(random.below(3).min(1), [0.0; 3], 1.0),
            Shape::Bumpy => {
                if random.below(2) == 0 {
                    draft.lat_long(4 + random.below(5), [0.0; 3], 1.0);
                } else {
                    draft.icosphere(1, [0.0; 3], 1.0);
                }
                let depth = random.pick(&[0.05, 0.2, 0.4]);
                for p in &mut draft.positions {
                    let distance = 1.0 + random.between(-depth, depth);
                    *p = p.map(|x| x * distance);
                }
            }
            Shape::Heights => draft.heights(random),
            Shape::Soup => {
                let size = random.pick(&[0.1, 0.3, 1.0]);
                for _ in 0..20 + random.below(150) {
                    let middle = [(); 3].map(|()| random.between(-1.0, 1.0));
                    let corners = [(); 3].map(|()| middle.map(|x| x + random.between(-size, size)));
                    draft.triangle(corners);
                }
            }
            Shape::City => draft.city(random),
            Shape::Shells => {
                for shell in 0..2 + random.below(2) {
                    let radius = 1.0 - 0.3 * shell as f64;
                    match random.below(3) {
                        0 => draft.lat_long(4 + random.below(2), [0.0; 3], radius),
                        1 => draft.icosphere(random.below(2), [0.0; 3], radius),
                        _ => draft.block([-0.6 * radius; 3], [0.6 * radius; 3]),
                    }
                }
            }
            Shape::Fan => {
                let count = 8 + random.below(80);
                let height = random.pick(&[0.0, 0.0, 1e-3, 0.3]);
                draft.positions.push([0.0, 0.0, height]);
                for i in 0..count {
                    let (x, y) = cos_sin(TAU * i as f64 / count as f64);
                    draft.positions.push([x, y, 0.0]);
                }
                let n = count as u32;
                draft.indices.extend((0..n).map(|i| [0, 1 + i, 1 + (i + 1) % n]));
            }
            Shape::Star => {
                for _ in 0..10 + random.below(60) {
                    let (along, across) = (random.direction(), random.direction());
                    let width = random.pick(&[1e-4, 1e-2, 0.2]);
                    let point = |s: f64, w: f64| [0, 1, 2].map(|k| s * along[k] + w * across[k]);
                    draft.triangle([point(-1.0, 0.0), point(1.0, width), point(1.0, -width)]);
                }
            }
            Shape::Crowd => {
                let low = [-1.0, -1.0, 0.0];
                let right = [random.between(0.5, 1.0), -1.0, 0.0];
                let top = [random.between(0.5, 1.0), random.between(0.5, 1.0), 0.0];
                let left = [-1.0, random.between(0.5, 1.0), 0.0];
                draft.positions.extend([low, right, top, left]);
                draft.indices.extend([[0, 1, 2], [0, 2, 3]]);
            }
            Shape::Box | Shape::Junctions => {
                let extent = [(); 3].map(|()| random.between(0.2, 1.5));
                draft.block([0.0; 3], extent);
            }
            Shape::Warped => {
                draft.block([-1.0; 3], [1.0; 3]);
                let most = random.pick(&[1e-6, 0.1, 0.5]);
                for p in &mut draft.positions {
                    *p = p.map(|x| x + random.between(-most, most));
                }
            }
        }
        draft
    }

    fn triangle(&mut self, corners: [[f64; 3]; 3]) {
        let first = self.positions.len() as u32;
        self.positions.extend(corners);
        self.indices.push([first, first + 1, first + 2]);
    }

    /// Rings of twice as many quads, the poles as fans.
    fn lat_long(&mut self, rings: usize, centre: [f64; 3], radius: f64) {
        let (first, around) = (self.positions.len(), 2 * rings);
        let pole = |side: f64| [centre[0], centre[1], centre[2] + side * radius];
        self.positions.push(pole(1.0));
        for i in 1..rings {
            let (height, width) = cos_sin(PI * i as f64 / rings as f64);
            self.positions.extend((0..around).map(|j| {
                let (x, y) = cos_sin(TAU * j as f64 / around as f64);
                let unit = [width * x, width * y, height];
                [0, 1, 2].map(|k| centre[k] + radius * unit[k])
            }));
        }
        self.positions.push(pole(-1.0));
        let last = self.positions.len() - 1;
        let vertex = |i: usize, j: usize| match i {
            0 => first as u32,
            i if i == rings => last as u32,
            i => (first + 1 + (i - 1) * around + j % around) as u32,
        };
        for i in 0..rings {
            for j in 0..around {
                let [a, b] = [vertex(i, j), vertex(i, j + 1)];
                let [c, d] = [vertex(i + 1, j), vertex(i + 1, j + 1)];
                if i > 0 {
                    self.indices.push([a, d, b]);
                }
                if i + 1 < rings {
                    self.indices.push([a, c, d]);
                }
            }
        }
    }

    /// An icosahedron, each triangle in four so many times.
    fn icosphere(&mut self, times: usize, centre: [f64; 3], radius: f64) {
        let golden = (1.0 + 5f64.sqrt()) / 2.0;
        let mut positions = Vec::new();
        for k in 0..3 {
            for (s, t) in [(1.0, golden), (1.0, -golden), (-1.0, golden), (-1.0, -golden)] {
                let mut p = [0.0; 3];
                (p[(k + 1) % 3], p[(k + 2) % 3]) = (s, t);
                positions.push(p);
            }
        }
        // Corners at the least distance are the ends of an edge.
        let near = |i: usize, j: usize| {
            let apart = super::minus(positions[i], positions[j]);
            super::dot(apart, apart) < 4.1
        };
        let mut indices = Vec::new();
        for i in 0..12 {
            for j in i + 1..12 {
                for k in j + 1..12 {
                    if near(i, j) && near(j, k) && near(k, i) {
                        let normal = super::cross(
                            super::minus(positions[j], positions[i]),
                            super::minus(positions[k], positions[i]),
                        );
                        let outward = super::dot(normal, positions[i]) > 0.0;
                        let (j, k) = if outward { (j, k) } else { (k, j) };
                        indices.push([i as u32, j as u32, k as u32]);
                    }
                }
            }
        }
        (0..times).for_each(|_| divide(&mut positions, &mut indices, |p, q| between(p, q, 0.5)));
        let first = self.positions.len() as u32;
        self.positions.extend(positions.iter().map(|&p| {
            let distance = super::length(p);
            [0, 1, 2].map(|k| centre[k] + radius * p[k] / distance)
        }));
        self.indices.extend(indices.iter().map(|corners| corners.map(|corner| first + corner)));
    }

    fn heights(&mut self, random: &mut Random) {
        let side = 3 + random.below(8);
        let height = random.pick(&[0.0, 1e-3, 0.1, 0.3]);
        for i in 0..=side {
            for j in 0..=side {
                let [x, y] = [i, j].map(|k| k as f64 / side as f64);
                self.positions.push([x, y, random.between(0.0, height + 1e-9)]);
            }
        }
        let vertex = |i: usize, j: usize| (i * (side + 1) + j) as u32;
        for i in 0..side {
            for j in 0..side {
                let [a, b] = [vertex(i, j), vertex(i + 1, j)];
                let [c, d] = [vertex(i + 1, j + 1), vertex(i, j + 1)];
                self.indices.extend([[a, b, c], [a, c, d]]);
            }
        }
    }

    /// Boxes, on a grid that they share planes on or anywhere.
    fn city(&mut self, random: &mut Random) {
        let on_grid = random.below(2) == 0;
        for _ in 0..3 + random.below(14) {
            let mut span = |least: f64, most: f64| {
                let x = random.between(least, most);
                if on_grid { (x * 8.0).floor() / 8.0 } else { x }
            };
            let low = [span(0.0, 1.0), span(0.0, 1.0), span(0.0, 0.25)];
            let high =
                [low[0] + span(0.125, 0.6), low[1] + span(0.125, 0.6), low[2] + span(0.125, 1.2)];
            let first = self.positions.len();
            self.block(low, high);
            if !on_grid && random.below(2) == 0 {
                // Turned about the vertical.
                let (cos, sin) = cos_sin(TAU * random.unit());
                for p in &mut self.positions[first..] {
                    let [x, y] = [p[0] - low[0], p[1] - low[1]];
                    (p[0], p[1]) = (low[0] + cos * x - sin * y, low[1] + sin * x + cos * y);
                }
            }
        }
    }

    /// A closed box of 12 triangles, outward front.
    fn block(&mut self, low: [f64; 3], high: [f64; 3]) {
        let first = self.positions.len() as u32;
        for corner in 0..8 {
            self.positions
                .push([0, 1, 2].map(|k| if corner >> k & 1 == 1 { high[k] } else { low[k] }));
        }
        let quads =
            [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
        for [a, b, c, d] in quads.map(|quad| quad.map(|corner: u32| first + corner)) {
            self.indices.extend([[a, b, c], [a, c, d]]);
        }
    }

    /// Turns, moves and scales. What stays as it is has planes along the axes.
    fn place(&mut self, shape: Shape, random: &mut Random) {
        let turned = random.below(3) > 0 || (shape == Shape::Box && random.below(2) == 0);
        let turn = rotation(random);
        let extents = random.pick(&[0.0, 0.0, 1.0, 30.0, 1e3]);
        let offset = random.direction().map(|x| x * random.unit() * extents);
        let scale = match random.below(8) {
            0..4 => 1.0,
            4..7 => f64::from(random.below(41) as i32 - 20).exp2(),
            _ => {
                // As small as products of floats bear, and smaller.
                self.is_detail = true;
                let size = offset.iter().fold(2.0f64, |most, x| most.max(x.abs()));
                (f64::from(-(28 + random.below(23) as i32))).exp2() / size
            }
        };
        for p in &mut self.positions {
            let q = if turned { turn.map(|row| super::dot(row, *p)) } else { *p };
            *p = [0, 1, 2].map(|k| (q[k] + offset[k]) * scale);
        }
    }
}

fn middle_of_floats(p: [f32; 3], q: [f32; 3]) -> [f32; 3] {
    [0, 1, 2].map(|k| ((f64::from(p[k]) + f64::from(q[k])) / 2.0) as f32)
}

/// Each triangle in four; neighbours share the new corners.
fn divide<T: Copy>(positions: &mut Vec<T>, indices: &mut Vec<[u32; 3]>, middle: fn(T, T) -> T) {
    let mut middles: HashMap<[u32; 2], u32> = HashMap::new();
    let mut divided = Vec::with_capacity(4 * indices.len());
    for &[a, b, c] in indices.iter() {
        let [ab, bc, ca] = [[a, b], [b, c], [c, a]].map(|[p, q]| {
            *middles.entry([p.min(q), p.max(q)]).or_insert_with(|| {
                positions.push(middle(positions[p as usize], positions[q as usize]));
                positions.len() as u32 - 1
            })
        });
        divided.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
    }
    *indices = divided;
}

/// One triangle in two, at the middle of an edge; the neighbour keeps the whole edge.
fn cut(positions: &mut Vec<[f32; 3]>, indices: &mut Vec<[u32; 3]>, triangle: usize, edge: usize) {
    let corners = indices[triangle];
    let [a, b, c] = [0, 1, 2].map(|k| corners[(edge + k) % 3]);
    let new = positions.len() as u32;
    positions.push(middle_of_floats(positions[a as usize], positions[b as usize]));
    indices[triangle] = [a, new, c];
    indices.push([new, b, c]);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn closed_surfaces_are_closed_and_others_are_not() {
        for shape in Shape::ALL {
            for seed in 0..20 {
                let surface = Surface::new(shape, seed);
                let mut edges: HashMap<[u32; 2], i32> = HashMap::new();
                for corners in surface.scene.indices.as_ref().unwrap() {
                    for i in 0..3 {
                        let (p, q) = (corners[i], corners[(i + 1) % 3]);
                        *edges.entry([p.min(q), p.max(q)]).or_default() +=
                            if p < q { 1 } else { -1 };
                    }
                }
                let open = edges.values().filter(|&&sum| sum != 0).count();
                assert_eq!(open == 0, shape.is_closed(), "{shape:?} {seed}: {open} open edges");
                let count = surface.scene.mesh().len();
                assert!((8..=400).contains(&count), "{shape:?}: {count}");
            }
        }
    }

    #[test]
    fn seeds_give_the_same_again() {
        for shape in Shape::ALL {
            let [a, b] = [3, 3].map(|seed| Surface::new(shape, seed).scene.positions);
            assert_eq!(a, b);
            assert_ne!(a, Surface::new(shape, 4).scene.positions);
        }
    }
}
