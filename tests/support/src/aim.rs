//! Seeded rays, aimed at where tracers go wrong.

use crate::oracle::finite_bounds;
use crate::random::Random;
use splitplane_core::aabb::Aabb;
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::Ray;
use splitplane_core::tree::KdTreeView;
use splitplane_core::tree::node::NodeKind;

/// How rays of one batch are aimed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// From around the mesh in random directions of random length.
    Random,
    /// At random points of random triangles.
    Faces,
    /// At vertices; the direction is rounded, so most pass the vertex by a hair.
    Vertices,
    /// Through vertices without any rounding.
    ExactVertices,
    /// At random points of edges, rounded.
    Edges,
    /// Through middles of edges without rounding, where the middle is a float.
    ExactMiddles,
    /// Along an axis, often within the plane of a vertex, with zeros of both signs.
    AxisParallel,
    /// At random points, from 1e3 to 1e6 times the size of the mesh away.
    Far,
}

impl Kind {
    /// All of them.
    pub const ALL: [Kind; 8] = [
        Kind::Random,
        Kind::Faces,
        Kind::Vertices,
        Kind::ExactVertices,
        Kind::Edges,
        Kind::ExactMiddles,
        Kind::AxisParallel,
        Kind::Far,
    ];
}

/// `count` rays of one kind. A mesh without finite triangles gets rays around the unit cube.
pub fn rays(mesh: &Mesh<'_>, kind: Kind, count: usize, seed: u64) -> Vec<Ray> {
    let mut aim = Aim::new(mesh, seed.wrapping_mul(31).wrapping_add(kind as u64));
    (0..count).map(|_| aim.ray(kind)).collect()
}

/// A maker of rays for one mesh.
#[derive(Clone)]
pub struct Aim<'a> {
    mesh: Mesh<'a>,
    bounds: Aabb,
    /// Bounds with outliers left out: what origins are drawn from.
    core: Aabb,
    finite: Vec<u32>,
    random: Random,
}

impl<'a> Aim<'a> {
    /// A maker; equal seeds give equal rays.
    pub fn new(mesh: &Mesh<'a>, seed: u64) -> Aim<'a> {
        let finite: Vec<u32> = (0..mesh.len())
            .filter(|&i| mesh.triangle(i).as_flattened().iter().all(|x| x.is_finite()))
            .map(|i| i as u32)
            .collect();
        let mut bounds = finite_bounds(mesh);
        let mut core = bounds;
        if finite.is_empty() {
            bounds = Aabb { lo: [0.0; 3], hi: [1.0; 3] };
            core = bounds;
        } else {
            for axis in 0..3 {
                let mut values: Vec<f32> = finite
                    .iter()
                    .flat_map(|&i| mesh.triangle(i as usize).map(|corner| corner[axis]))
                    .collect();
                values.sort_by(f32::total_cmp);
                core.lo[axis] = values[values.len() / 50];
                core.hi[axis] = values[values.len() - 1 - values.len() / 50];
            }
        }
        Aim { mesh: *mesh, bounds, core, finite, random: Random::new(seed) }
    }

    /// The same maker with another seed, without looking at the mesh again.
    #[must_use]
    pub fn with_seed(&self, seed: u64) -> Aim<'a> {
        Aim { random: Random::new(seed), ..self.clone() }
    }

    /// The random numbers the rays are made of.
    pub fn random(&mut self) -> &mut Random {
        &mut self.random
    }

    /// Bounds of all finite corners.
    pub fn bounds(&self) -> Aabb {
        self.bounds
    }

    /// A point to aim at: a vertex, a point of an edge, for other kinds a point of a face.
    pub fn target(&mut self, kind: Kind) -> [f64; 3] {
        match kind {
            Kind::Vertices | Kind::ExactVertices => self.corner().map(f64::from),
            Kind::Edges | Kind::ExactMiddles => {
                let [a, b] = self.edge();
                let s = self.random.unit();
                [0, 1, 2].map(|i| f64::from(a[i]) * (1.0 - s) + f64::from(b[i]) * s)
            }
            _ => self.face_point(),
        }
    }

    /// One more ray.
    pub fn ray(&mut self, kind: Kind) -> Ray {
        match kind {
            Kind::Random => self.random_ray(),
            Kind::Faces => {
                let origin = self.origin();
                let target = self.face_point();
                aimed(origin, target)
            }
            Kind::Vertices => {
                let origin = self.origin();
                let target = self.corner().map(f64::from);
                aimed(origin, target)
            }
            Kind::ExactVertices => {
                let target = self.corner();
                self.exactly_through(target)
            }
            Kind::Edges => {
                let origin = self.origin();
                let [a, b] = self.edge();
                let s = self.random.unit();
                let target =
                    [0, 1, 2].map(|i| f64::from(a[i]) + s * (f64::from(b[i]) - f64::from(a[i])));
                aimed(origin, target)
            }
            Kind::ExactMiddles => {
                for _ in 0..16 {
                    let [a, b] = self.edge();
                    let middle = [0, 1, 2].map(|i| (f64::from(a[i]) + f64::from(b[i])) / 2.0);
                    let rounded = middle.map(|x| x as f32);
                    if rounded.map(f64::from) == middle {
                        return self.exactly_through(rounded);
                    }
                }
                self.ray(Kind::Edges)
            }
            Kind::AxisParallel => self.axis_parallel(),
            Kind::Far => {
                let target = self.face_point();
                let size = self.bounds.diagonal().max(1e-37);
                let distance = size * 10f64.powf(self.random.between(3.0, 6.0));
                let away = self.random.direction();
                let origin = [0, 1, 2].map(|i| clamp_finite(target[i] + distance * away[i]));
                aimed(origin, target)
            }
        }
    }

    /// A ray that lies in a split plane of the tree, or starts or ends on one.
    pub fn in_split_plane(&mut self, tree: &KdTreeView<'_>) -> Ray {
        let start = self.random.below(tree.nodes.len());
        let found = tree.nodes[start..].iter().chain(&tree.nodes[..start]).find(|n| !n.is_leaf());
        let origin = self.origin();
        let target = self.face_point();
        let Some(NodeKind::Interior { axis, split, .. }) = found.map(|node| node.kind()) else {
            return aimed(origin, target);
        };
        let mut ray = aimed(origin, target);
        ray.origin[axis.index()] = split;
        if self.random.below(3) > 0 {
            ray.direction[axis.index()] = self.random.pick(&[0.0, -0.0]);
        }
        if ray.direction == [0.0; 3] {
            ray.direction[(axis.index() + 1) % 3] = 1.0;
        }
        ray
    }

    /// Any point the origins are drawn from: half a size around the mesh.
    pub fn origin(&mut self) -> [f32; 3] {
        [0, 1, 2].map(|axis| {
            let (lo, hi) = (f64::from(self.core.lo[axis]), f64::from(self.core.hi[axis]));
            let pad = 0.5 * (hi - lo) + 0.25 * self.core.diagonal();
            clamp_finite(self.random.between(lo - pad, hi + pad))
        })
    }

    fn random_ray(&mut self) -> Ray {
        let origin = self.origin();
        let length = 10f64.powf(self.random.between(-3.0, 3.0));
        let direction = self.random.direction().map(|x| (x * length) as f32);
        Ray::new(origin, direction)
    }

    fn triangle(&mut self) -> [[f32; 3]; 3] {
        if self.finite.is_empty() {
            return [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        }
        let index = self.random.pick(&self.finite);
        self.mesh.triangle(index as usize)
    }

    fn face_point(&mut self) -> [f64; 3] {
        let corners = self.triangle();
        let weights = self.random.barycentric();
        [0, 1, 2].map(|i| (0..3).map(|k| weights[k] * f64::from(corners[k][i])).sum())
    }

    /// A corner of a random triangle, or for an indexed mesh now and then a random vertex: the two
    /// weigh the hub of a fan differently.
    pub fn corner(&mut self) -> [f32; 3] {
        let corners = self.triangle();
        // The first corner is the hub in the scenes that have one: keep it rare.
        let k = if self.random.below(32) == 0 { 0 } else { 1 + self.random.below(2) };
        corners[k]
    }

    /// A random edge of a random triangle.
    pub fn edge(&mut self) -> [[f32; 3]; 2] {
        let corners = self.triangle();
        let k = self.random.below(3);
        [corners[k], corners[(k + 1) % 3]]
    }

    /// A ray whose line holds the target without rounding: the direction is a multiple of a power
    /// of two that the subtraction keeps.
    fn exactly_through(&mut self, target: [f32; 3]) -> Ray {
        let largest = target.iter().fold(0.0f64, |m, &x| m.max(f64::from(x).abs()));
        let size = self.core.diagonal().max(largest).max(1e-37);
        for attempt in 0..24 {
            // Coarser steps on each attempt: about 2^-9, then 2^-8 ... of the size.
            let unit = (size.log2().floor() - 9.0 + f64::from(attempt / 3)).exp2();
            let direction = [(); 3].map(|()| {
                let steps = self.random.below(2001) as f64 - 1000.0;
                (steps * unit) as f32
            });
            let origin = [0, 1, 2].map(|i| target[i] - direction[i]);
            let exact = (0..3)
                .all(|i| f64::from(target[i]) - f64::from(origin[i]) == f64::from(direction[i]));
            if exact && direction.iter().any(|&x| x.abs() >= f32::MIN_POSITIVE) {
                return Ray::new(origin, direction);
            }
        }
        aimed(self.origin(), target.map(f64::from))
    }

    fn axis_parallel(&mut self) -> Ray {
        let axis = self.random.below(3);
        let mut origin = self.origin();
        let corner = self.corner();
        for i in 0..3 {
            if self.random.below(3) > 0 {
                origin[i] = corner[i];
            }
        }
        let size = self.core.diagonal().max(1e-30);
        let length = clamp_finite(self.random.between(0.25, 2.0) * size);
        let mut direction = [(); 3].map(|()| self.random.pick(&[0.0, -0.0]));
        direction[axis] = self.random.pick(&[length, -length]);
        // Some start on the other side, so that the line through the corner is seen from both ends.
        if self.random.below(2) == 0 {
            origin[axis] = clamp_finite(f64::from(corner[axis]) - f64::from(direction[axis]));
        }
        Ray::new(origin, direction)
    }
}

fn clamp_finite(x: f64) -> f32 {
    x.clamp(-f64::from(f32::MAX), f64::from(f32::MAX)) as f32
}

/// A ray that starts near `origin` and whose line holds the target without rounding, where a few
/// attempts find one: the way there is rounded to coarser and coarser steps until the subtraction
/// keeps it.
pub fn exactly_from(origin: [f64; 3], target: [f32; 3]) -> Option<Ray> {
    let way = [0, 1, 2].map(|i| f64::from(target[i]) - origin[i]);
    let longest = way.iter().fold(0.0f64, |m, x| m.max(x.abs()));
    for bits in [12, 10, 8, 6] {
        let unit = (longest.log2().floor() - f64::from(bits)).exp2();
        let direction = way.map(|x| ((x / unit).round() * unit) as f32);
        let start = [0, 1, 2].map(|i| target[i] - direction[i]);
        let exact =
            (0..3).all(|i| f64::from(target[i]) - f64::from(start[i]) == f64::from(direction[i]));
        if exact && direction.iter().any(|&x| x.abs() >= f32::MIN_POSITIVE) {
            return Some(Ray::new(start, direction));
        }
    }
    None
}

/// A ray from the origin towards the target, `t` about 1 there.
pub fn aimed(origin: [f32; 3], target: [f64; 3]) -> Ray {
    let mut scale = 1.0;
    loop {
        let direction = [0, 1, 2].map(|i| ((target[i] - f64::from(origin[i])) * scale) as f32);
        if direction.iter().any(|x| x.is_infinite()) {
            scale *= 0.25;
        } else if direction.iter().all(|x| x.abs() < f32::MIN_POSITIVE) {
            return Ray::new(origin, [1.0, 0.5, 0.25]);
        } else {
            return Ray::new(origin, direction);
        }
    }
}

/// Rays with one odd trait each, made from good ones: components that are zero of either sign,
/// subnormal, tiny or huge, and limits in every order, negative, equal or infinite. All are valid.
pub fn odd(rays: &[Ray], seed: u64) -> Vec<Ray> {
    let mut random = Random::new(seed);
    let odd_values = [0.0, -0.0, 1e-40, -1e-44, f32::MIN_POSITIVE, -1.2e-38, 1e-30, -1e-25, 1e-10];
    rays.iter()
        .map(|good| {
            let mut ray = *good;
            let axis = random.below(3);
            match random.below(10) {
                0 | 1 => ray.direction[axis] = random.pick(&odd_values),
                2 => ray.direction = ray.direction.map(|x| x * 1e-30),
                3 => ray.direction = ray.direction.map(|x| (x * 1e30).clamp(-3e38, 3e38)),
                4 => ray.origin[axis] = random.pick(&odd_values),
                5 => ray = ray.with_limits(f32::NEG_INFINITY, f32::INFINITY),
                6 => ray = ray.with_limits(-1.5, 0.5),
                7 => ray = ray.with_limits(1.0, 0.5),
                8 => ray = ray.with_limits(-0.0, 0.0),
                _ => ray = ray.with_limits(1.0, f32::MAX),
            }
            let largest = ray.direction.iter().fold(0.0f32, |m, x| m.max(x.abs()));
            if largest < f32::MIN_POSITIVE {
                ray.direction[(axis + 1) % 3] = 1.0;
            }
            ray
        })
        .collect()
}

/// Rays that hit nothing by definition, made from good ones.
pub fn invalid(rays: &[Ray], seed: u64) -> Vec<Ray> {
    let mut random = Random::new(seed);
    rays.iter()
        .map(|good| {
            let mut ray = *good;
            let bad = random.pick(&[f32::NAN, f32::INFINITY, f32::NEG_INFINITY]);
            let axis = random.below(3);
            match random.below(6) {
                0 => ray.origin[axis] = bad,
                1 => ray.direction[axis] = bad,
                2 => ray.direction = [0.0, -0.0, 0.0],
                3 => ray.direction = [1e-40, -1e-39, 0.0],
                4 => ray.t_min = f32::NAN,
                _ => ray.t_max = f32::NAN,
            }
            ray
        })
        .collect()
}

/// Rays through the pixels of pictures of a mesh from around it, those of every third within limits, and from
/// where these are as far as a point of the mesh to a light: neighbours go together, so that they are traced as
/// packets.
pub fn pictures(
    mesh: &Mesh<'_>,
    pictures: usize,
    [width, height]: [usize; 2],
    seed: u64,
) -> Vec<Ray> {
    let mut aim = Aim::new(mesh, seed);
    let mut rays = Vec::new();
    for picture in 0..pictures {
        let (eye, middle, light) = (aim.origin(), aim.face_point(), aim.origin());
        let view = aimed(eye, middle);
        let length = view.direction.iter().map(|x| x.abs()).fold(0.0, f32::max);
        let pixels = (0..width * height).map(|pixel| {
            let (x, y) = (pixel % width, pixel / width);
            let mut direction = view.direction;
            direction[picture % 3] += length * 0.4 * (x as f32 / width as f32 - 0.5);
            direction[(picture + 1) % 3] += length * 0.4 * (y as f32 / height as f32 - 0.5);
            let ray = Ray::new(eye, direction);
            if picture % 3 == 2 { ray.with_limits(0.3, 1.2) } else { ray }
        });
        let pixels: Vec<Ray> = pixels.collect();
        let start = |ray: &Ray| [0, 1, 2].map(|k| ray.origin[k] + ray.direction[k]);
        rays.extend_from_slice(&pixels);
        rays.extend(pixels.iter().map(|ray| Ray::segment(start(ray), light)));
    }
    rays
}

/// Rays from random points within a ball around the centre of a closed mesh, aimed at the mesh.
pub fn from_inside(
    mesh: &Mesh<'_>,
    centre: [f64; 3],
    radius: f64,
    kind: Kind,
    count: usize,
    seed: u64,
) -> Vec<Ray> {
    let mut aim = Aim::new(mesh, seed);
    (0..count)
        .map(|_| {
            let d = aim.random.direction();
            let r = radius * aim.random.unit().cbrt();
            let origin = [0, 1, 2].map(|i| (centre[i] + r * d[i]) as f32);
            let target = match kind {
                Kind::Vertices | Kind::Edges => aim.target(kind),
                _ => {
                    let away = aim.random.direction();
                    [0, 1, 2].map(|i| f64::from(origin[i]) + away[i])
                }
            };
            aimed(origin, target)
        })
        .collect()
}
