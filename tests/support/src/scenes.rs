//! Scenes that builders and traversals trip over, made the same way every time, and the means to
//! read real ones.

use crate::random::Random;
use splitplane_core::mesh::Mesh;
use std::path::PathBuf;

/// A mesh that owns its arrays.
#[derive(Clone, Debug)]
pub struct Scene {
    /// What a failing test calls it.
    pub name: String,
    /// The vertices.
    pub positions: Vec<[f32; 3]>,
    /// The corners; `None` for a soup, in which every three positions are a triangle.
    pub indices: Option<Vec<[u32; 3]>>,
}

impl Scene {
    pub(crate) fn indexed(name: &str, positions: Vec<[f32; 3]>, indices: Vec<[u32; 3]>) -> Scene {
        Scene { name: name.into(), positions, indices: Some(indices) }
    }

    pub(crate) fn of_soup(name: &str, triangles: &[[[f32; 3]; 3]]) -> Scene {
        Scene { name: name.into(), positions: triangles.as_flattened().to_vec(), indices: None }
    }

    /// The scene as the library takes it.
    ///
    /// # Panics
    /// If the scene is made wrongly.
    pub fn mesh(&self) -> Mesh<'_> {
        match &self.indices {
            Some(indices) => Mesh::indexed(&self.positions, indices),
            None => Mesh::soup(self.positions.as_chunks::<3>().0),
        }
        .expect("scenes are made with indices in range")
    }

    /// The triangles, one after the other.
    pub fn triangles(&self) -> Vec<[[f32; 3]; 3]> {
        let mesh = self.mesh();
        (0..mesh.len()).map(|index| mesh.triangle(index)).collect()
    }

    /// The same scene under another name.
    #[must_use]
    pub fn named(mut self, name: &str) -> Scene {
        self.name = name.into();
        self
    }

    /// All triangles of both, this one's first.
    #[must_use]
    pub fn joined(&self, other: &Scene, name: &str) -> Scene {
        Scene::of_soup(name, &[self.triangles(), other.triangles()].concat())
    }
}

/// Cosine and sine of an angle from 0 to a whole turn, by Taylor's series: the functions of the
/// standard library differ between platforms in the last place, and snapshots hold digests of trees.
pub(crate) fn cos_sin(angle: f64) -> (f64, f64) {
    let x = angle - std::f64::consts::PI;
    let (mut cos, mut sin, mut term) = (0.0, 0.0, 1.0);
    for k in 0..40 {
        match k % 4 {
            0 => cos += term,
            1 => sin += term,
            2 => cos -= term,
            _ => sin -= term,
        }
        term *= x / f64::from(k + 1);
    }
    (-cos, -sin)
}

/// Every awkward scene that a test should go through.
pub fn awkward() -> Vec<Scene> {
    let mut all = vec![none(), one()];
    for count in [64, 65, 255, 256, 257] {
        all.push(soup(count, 0.1, count as u64).named(&format!("{count} random triangles")));
    }
    all.extend([
        identical(20_000),
        fan(20_000),
        needles(5_000),
        coplanar(0, 500),
        coplanar(1, 500),
        coplanar(2, 500),
        coplanar_oblique(500),
        grid_boxes(6),
        sphere(20, [1e7, -1e7, 1e7], 1000.0).named("sphere near 1e7"),
        scaled(&soup(600, 0.3, 31), 1e-30, "soup at 1e-30"),
        scaled(&soup(600, 0.3, 32), 1e30, "soup at 1e30"),
        scaled(&soup(300, 0.3, 33), 3e-38, "soup at the least normal numbers"),
        ratio(),
        seams(false),
        seams(true),
        collinear(),
        equal_corners(),
        bad_vertices(),
        all_bad(),
        zeros_and_subnormals(),
        spike(),
        stairs(20),
        needle_star(),
        soup(200, 0.5, 41).named("soup, sparse and large"),
        soup(2_000, 0.1, 42).named("soup, medium"),
        soup(5_000, 0.02, 43).named("soup, fine"),
        soup(3_000, 0.3, 44).named("soup, dense"),
        nested_spheres(),
    ]);
    all
}

/// No triangles.
pub fn none() -> Scene {
    Scene::indexed("none", Vec::new(), Vec::new())
}

/// One triangle.
pub fn one() -> Scene {
    Scene::of_soup("one", &[[[0.0, 0.0, 0.0], [1.0, 0.25, 0.0], [0.25, 1.0, 0.5]]])
}

/// Random triangles in the unit cube; `size` is how far corners lie from their middle.
pub fn soup(count: usize, size: f64, seed: u64) -> Scene {
    let mut random = Random::new(seed);
    let triangles: Vec<_> = (0..count)
        .map(|_| {
            let middle = [(); 3].map(|()| random.unit());
            [(); 3].map(|()| middle.map(|x| (x + random.between(-size, size)) as f32))
        })
        .collect();
    Scene::of_soup("soup", &triangles)
}

/// A soup under a sky of twelve triangles and over a ground of two, a million times as large, and some large
/// triangles that share no corner: as many in all as have a place of their own in query layouts.
pub fn giants() -> Scene {
    let corner = |i: usize| [0, 1, 2].map(|k| if i >> k & 1 == 0 { -1e6 } else { 1e6 });
    let faces =
        [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]];
    let mut large: Vec<_> = faces
        .iter()
        .flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]])
        .map(|t| t.map(corner))
        .collect();
    let [a, b, c, d] = [[-9e5, 0.5, -9e5], [9e5, 0.5, -9e5], [9e5, 0.5, 9e5], [-9e5, 0.5, 9e5]];
    large.extend([[a, b, c], [a, c, d]]);
    large.extend((0..50).map(|i| {
        let (x, size) = (i as f32 * 1e3, 4e5 + i as f32);
        [[x, -size, 0.1], [size, x, 0.2], [-x, size, -size]]
    }));
    Scene::of_soup("soup", &large).joined(&soup(1_500, 0.02, 8), "giants")
}

/// Random triangles in the unit cube, most of them small, some large, and the first `coincident` times more.
pub fn sizes(count: usize, coincident: usize, seed: u64) -> Scene {
    let mut random = Random::new(seed);
    let mut triangles: Vec<_> = (0..count)
        .map(|i| {
            let (middle, size) = (random.point(0.5), if i % 40 == 0 { 0.2 } else { 0.01 });
            [(); 3].map(|()| middle.map(|x| x + 0.5 + size * random.signed()))
        })
        .collect();
    triangles.extend(vec![triangles[0]; coincident]);
    Scene::of_soup("sizes", &triangles)
}

/// Random triangles about the origin, up to 5 away: most of this size, some twenty times as large, some flat
/// along an axis and some of these in one plane, and some twice.
pub fn medley(count: usize, size: f32, seed: u64) -> Scene {
    let mut random = Random::new(seed);
    let mut triangles: Vec<_> = (0..count)
        .map(|i| {
            let middle = random.point(5.0);
            let size = if i % 50 == 0 { 20.0 * size } else { size };
            let mut corners = [(); 3].map(|()| {
                let offset = random.point(size);
                [0, 1, 2].map(|k| middle[k] + offset[k])
            });
            if i % 7 == 0 {
                let plane = if i % 14 == 0 { 0.5 } else { middle[i % 3] };
                corners.iter_mut().for_each(|corner| corner[i % 3] = plane);
            }
            corners
        })
        .collect();
    for i in 0..count / 20 {
        triangles.push(triangles[i * 3]);
    }
    Scene::of_soup("medley", &triangles)
}

/// Random triangles of `octaves` sizes, each half the one before and half as far from the origin: every
/// plane separates few of them from the others, so that trees are about as deep.
pub fn converging(count: usize, octaves: usize, seed: u64) -> Scene {
    let mut scene = soup(count, 0.2, seed);
    for (i, corners) in scene.positions.as_chunks_mut::<3>().0.iter_mut().enumerate() {
        let scale = 0.5f32.powi((i % octaves) as i32);
        corners.as_flattened_mut().iter_mut().for_each(|x| *x *= scale);
    }
    scene.named("converging")
}

/// The same triangle many times: no plane separates anything.
pub fn identical(count: usize) -> Scene {
    let positions = vec![[0.1, 0.2, 0.3], [0.9, 0.1, 0.4], [0.4, 0.8, 0.7]];
    Scene::indexed("identical triangles", positions, vec![[0, 1, 2]; count])
}

/// Triangles around one vertex, a flat cone: every plane near the hub cuts thousands.
pub fn fan(count: usize) -> Scene {
    let mut positions = vec![[0.0, 0.0, 0.25]];
    positions.extend((0..count).map(|i| {
        let (cos, sin) = cos_sin(std::f64::consts::TAU * i as f64 / count as f64);
        [cos as f32, sin as f32, 0.0]
    }));
    let n = count as u32;
    let indices = (0..n).map(|i| [0, 1 + i, 1 + (i + 1) % n]).collect();
    Scene::indexed("fan", positions, indices)
}

/// Long thin triangles across the whole scene, in all directions.
pub fn needles(count: usize) -> Scene {
    let mut random = Random::new(7);
    let triangles: Vec<_> = (0..count)
        .map(|_| {
            let from = [(); 3].map(|()| random.unit());
            let along = random.direction();
            let across = random.direction();
            let point = |s: f64, w: f64| {
                [0, 1, 2].map(|axis| (from[axis] + s * along[axis] + w * across[axis]) as f32)
            };
            [point(-1.0, 0.0), point(1.0, 0.0), point(1.0, 1e-3)]
        })
        .collect();
    Scene::of_soup("needles", &triangles)
}

/// Overlapping triangles in one plane across `axis`: no extent on that axis.
pub fn coplanar(axis: usize, count: usize) -> Scene {
    let mut random = Random::new(50 + axis as u64);
    let triangles: Vec<_> = (0..count)
        .map(|_| {
            let middle = [(); 3].map(|()| random.unit());
            [(); 3].map(|()| {
                let mut corner = middle.map(|x| (x + random.between(-0.1, 0.1)) as f32);
                corner[axis] = 0.5;
                corner
            })
        })
        .collect();
    Scene::of_soup(["coplanar x", "coplanar y", "coplanar z"][axis], &triangles)
}

/// Triangles in one oblique plane, exactly: z = x + y on a grid that sums without rounding.
pub fn coplanar_oblique(count: usize) -> Scene {
    let mut random = Random::new(60);
    let triangles: Vec<_> = (0..count)
        .map(|_| {
            let (i, j) = (random.below(900), random.below(900));
            [(); 3].map(|()| {
                let x = (i + random.below(100)) as f32 / 1024.0;
                let y = (j + random.below(100)) as f32 / 1024.0;
                [x, y, x + y]
            })
        })
        .collect();
    Scene::of_soup("coplanar oblique", &triangles)
}

/// Unit boxes side by side: every plane is shared, and inner faces stand twice.
pub fn grid_boxes(n: usize) -> Scene {
    let mut positions = Vec::new();
    let mut indices = Vec::new();
    for cell in 0..n * n * n {
        let corner = [cell % n, cell / n % n, cell / n / n];
        add_box(&mut positions, &mut indices, corner.map(|x| x as f32), [1.0; 3]);
    }
    Scene::indexed("grid of boxes", positions, indices)
}

fn add_box(
    positions: &mut Vec<[f32; 3]>,
    indices: &mut Vec<[u32; 3]>,
    low: [f32; 3],
    extent: [f32; 3],
) {
    let first = positions.len() as u32;
    for corner in 0..8 {
        positions.push([0, 1, 2].map(|axis| {
            if corner >> axis & 1 == 1 { low[axis] + extent[axis] } else { low[axis] }
        }));
    }
    let quads =
        [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    for [a, b, c, d] in quads {
        indices.push([first + a, first + b, first + c]);
        indices.push([first + a, first + c, first + d]);
    }
}

/// A closed sphere of triangles with shared vertices: `rings` bands of 2 `rings` quads, the poles
/// as fans, 4 `rings` (`rings` - 1) triangles, outward front.
pub fn sphere(rings: usize, centre: [f64; 3], radius: f64) -> Scene {
    let around = 2 * rings;
    let mut positions = Vec::new();
    let at = |i: usize, j: usize| {
        let (height, width) = cos_sin(std::f64::consts::PI * i as f64 / rings as f64);
        let (x, z) = cos_sin(std::f64::consts::TAU * j as f64 / around as f64);
        [
            (centre[0] + radius * width * x) as f32,
            (centre[1] + radius * height) as f32,
            (centre[2] + radius * width * z) as f32,
        ]
    };
    positions.push(at(0, 0));
    for i in 1..rings {
        positions.extend((0..around).map(|j| at(i, j)));
    }
    positions.push([centre[0] as f32, (centre[1] - radius) as f32, centre[2] as f32]);
    let last = positions.len() as u32 - 1;
    let vertex = |i: usize, j: usize| match i {
        0 => 0,
        i if i == rings => last,
        i => (1 + (i - 1) * around + j % around) as u32,
    };
    let mut indices = Vec::new();
    for i in 0..rings {
        for j in 0..around {
            let [a, b] = [vertex(i, j), vertex(i, j + 1)];
            let [c, d] = [vertex(i + 1, j), vertex(i + 1, j + 1)];
            if i > 0 {
                indices.push([a, b, d]);
            }
            if i + 1 < rings {
                indices.push([a, d, c]);
            }
        }
    }
    Scene::indexed("sphere", positions, indices)
}

/// Rings for a [`sphere`] of about 80,000 triangles.
pub const LARGE_SPHERE: usize = 142;

/// The scene with every coordinate multiplied.
pub fn scaled(scene: &Scene, factor: f32, name: &str) -> Scene {
    let positions = scene.positions.iter().map(|p| p.map(|x| x * factor)).collect();
    Scene { name: name.into(), positions, indices: scene.indices.clone() }
}

/// Small triangles around (2^i, 0, 0) for i from 0 to 20, as wide as far apart. A ray along x meets few of them, but
/// cells of all sizes, the small ones first: it leaves one after the other for later.
pub fn octaves() -> Scene {
    let mut random = Random::new(77);
    let mut triangles = Vec::new();
    for octave in 0..=20 {
        let size = f64::from(1 << octave);
        for _ in 0..48 {
            let middle = [size, 0.0, 0.0].map(|x| x + 0.3 * size * random.between(-1.0, 1.0));
            triangles
                .push([(); 3].map(|()| {
                    middle.map(|x| (x + 0.02 * size * random.between(-1.0, 1.0)) as f32)
                }));
        }
    }
    Scene::of_soup("octaves", &triangles)
}

/// A floor of two triangles a million units wide under a small sphere.
pub fn ratio() -> Scene {
    let w = 1e6;
    let floor = [
        [[-w, -1.5, -w], [w, -1.5, -w], [w, -1.5, w]],
        [[-w, -1.5, -w], [w, -1.5, w], [-w, -1.5, w]],
    ];
    sphere(16, [0.0; 3], 1.0).joined(&Scene::of_soup("floor", &floor), "size ratio 1e6")
}

/// The seams of [`seams`]: ends of the twelve edges where its T-junctions lie.
pub fn seam_edges(oblique: bool) -> Vec<[[f32; 3]; 2]> {
    box_edges().iter().map(|&[a, b]| [seam_point(a, oblique), seam_point(b, oblique)]).collect()
}

fn box_edges() -> Vec<[[f64; 3]; 2]> {
    let corner = |bits: usize| [0, 1, 2].map(|axis| f64::from(2 * (bits >> axis & 1) as i32 - 1));
    let mut edges = Vec::new();
    for axis in 0..3 {
        for bits in (0..8).filter(|bits| bits >> axis & 1 == 0) {
            edges.push([corner(bits), corner(bits | 1 << axis)]);
        }
    }
    edges
}

/// Turns and shifts a point of the cube; oblique points are rounded, so that inner points of an
/// edge leave the straight line by some units in the last place.
fn seam_point(p: [f64; 3], oblique: bool) -> [f32; 3] {
    if !oblique {
        return p.map(|x| x as f32);
    }
    let (c, s) = cos_sin(0.7);
    let q = [c * p[0] - s * p[1], s * p[0] + c * p[1], p[2]];
    let (c, s) = cos_sin(1.1);
    let r = [q[0], c * q[1] - s * q[2], s * q[1] + c * q[2]];
    [(r[0] + 3.3) as f32, (r[1] - 1.7) as f32, (r[2] + 0.9) as f32]
}

/// A closed box whose faces meet at T-junctions: on each edge one face has the whole edge, the
/// other has it in pieces, and collinear slivers between the two close the seam. Dropping those
/// slivers, or testing them carelessly, opens it.
pub fn seams(oblique: bool) -> Scene {
    const PIECES: usize = 7;
    let mut triangles: Vec<[[f32; 3]; 3]> = Vec::new();
    let point = |p: [f64; 3]| seam_point(p, oblique);
    for axis in 0..3 {
        for side in [-1.0, 1.0] {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            let place = |a: f64, b: f64| {
                let mut p = [0.0; 3];
                p[axis] = side;
                p[u] = a;
                p[v] = b;
                p
            };
            let rim = [place(-1.0, -1.0), place(1.0, -1.0), place(1.0, 1.0), place(-1.0, 1.0)];
            for i in 0..4 {
                let (from, to) = (rim[i], rim[(i + 1) % 4]);
                // An edge along w lies on two faces, across the two other axes; the one across the
                // axis after w has it whole.
                let along = (0..3).find(|&w| from[w] != to[w]).unwrap_or(0);
                let whole = axis == (along + 1) % 3;
                let steps: Vec<[f32; 3]> = if whole {
                    vec![point(from), point(to)]
                } else {
                    (0..=PIECES).map(|k| point(mix(from, to, k, PIECES))).collect()
                };
                let centre = point(place(0.0, 0.0));
                for pair in steps.windows(2) {
                    let triangle = [centre, pair[0], pair[1]];
                    triangles.push(if side > 0.0 {
                        triangle
                    } else {
                        [triangle[0], triangle[2], triangle[1]]
                    });
                }
            }
        }
    }
    for [from, to] in box_edges() {
        for k in 1..PIECES {
            triangles.push([
                point(from),
                point(mix(from, to, k, PIECES)),
                point(mix(from, to, k + 1, PIECES)),
            ]);
        }
    }
    Scene::of_soup(if oblique { "seams, oblique" } else { "seams, along axes" }, &triangles)
}

/// A point of the edge, the same whichever end it is reached from.
fn mix(from: [f64; 3], to: [f64; 3], k: usize, pieces: usize) -> [f64; 3] {
    let (low, high, k) = if from < to { (from, to, k) } else { (to, from, pieces - k) };
    let s = k as f64 / pieces as f64;
    [0, 1, 2].map(|axis| {
        if low[axis] == high[axis] { low[axis] } else { low[axis] + s * (high[axis] - low[axis]) }
    })
}

/// Nothing but collinear triangles with three distinct corners: kept, met nowhere in exact terms.
pub fn collinear() -> Scene {
    let mut random = Random::new(70);
    let triangles: Vec<_> = (0..300)
        .map(|_| {
            let from = [(); 3].map(|()| random.below(64) as f32 / 64.0);
            let step = [(); 3].map(|()| (random.below(9) as f32 - 4.0) / 64.0 + 1.0 / 128.0);
            [0, 1, 3].map(|k| [0, 1, 2].map(|axis| from[axis] + k as f32 * step[axis]))
        })
        .collect();
    Scene::of_soup("collinear", &triangles)
}

/// A soup in which every third triangle has two or three equal corners.
pub fn equal_corners() -> Scene {
    let mut scene = soup(300, 0.2, 71);
    for (i, corners) in scene.positions.as_chunks_mut::<3>().0.iter_mut().enumerate() {
        match i % 12 {
            0 => corners[1] = corners[0],
            3 => corners[2] = corners[0],
            6 => corners[2] = corners[1],
            9 => *corners = [corners[0]; 3],
            _ => {}
        }
    }
    scene.named("equal corners")
}

/// A good sphere with NaN and infinite vertices mixed in.
pub fn bad_vertices() -> Scene {
    let mut scene = sphere(24, [0.5; 3], 1.0);
    let bad = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY];
    for (i, position) in scene.positions.iter_mut().enumerate().filter(|(i, _)| i % 37 == 5) {
        position[i % 3] = bad[i / 37 % 3];
    }
    scene.named("NaN and infinite vertices")
}

/// No triangle that could be kept.
pub fn all_bad() -> Scene {
    let nan = f32::NAN;
    let triangles = [
        [[nan; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
        [[0.0; 3], [1.0, f32::INFINITY, 0.0], [0.0, 1.0, 0.0]],
        [[0.5; 3], [0.5; 3], [0.0, 1.0, 0.0]],
    ];
    Scene::of_soup("nothing to keep", &triangles)
}

/// A soup on a coarse grid whose zeros are -0 or subnormal here and there.
pub fn zeros_and_subnormals() -> Scene {
    let mut random = Random::new(72);
    let mut scene = soup(400, 0.3, 73);
    for position in &mut scene.positions {
        for x in position {
            *x = (*x * 4.0 - 2.0).round() / 2.0;
            if *x == 0.0 {
                *x = random.pick(&[0.0, -0.0, 1e-40, -1e-40, f32::MIN_POSITIVE]);
            }
        }
    }
    scene.named("zeros and subnormals")
}

/// A sphere with one vertex pulled out to almost the greatest float.
pub fn spike() -> Scene {
    let mut scene = sphere(12, [0.0; 3], 1.0);
    scene.positions[40] = [3e38, -3e38, 1e38];
    scene.named("spike")
}

/// Stairs: treads and risers share their coordinates, and rays along the axes meet the edges.
pub fn stairs(steps: usize) -> Scene {
    let mut triangles = Vec::new();
    let n = steps as f32;
    for i in 0..steps {
        let [a, b] = [i, i + 1].map(|k| k as f32 / n);
        let mut quad = |p: [[f32; 3]; 4]| {
            triangles.push([p[0], p[1], p[2]]);
            triangles.push([p[0], p[2], p[3]]);
        };
        quad([[a, a, 0.0], [a, a, 1.0], [a, b, 1.0], [a, b, 0.0]]);
        quad([[a, b, 0.0], [a, b, 1.0], [b, b, 1.0], [b, b, 0.0]]);
    }
    Scene::of_soup("stairs", &triangles)
}

/// Needles that all pass through one point.
pub fn needle_star() -> Scene {
    let mut random = Random::new(74);
    let triangles: Vec<_> = (0..400)
        .map(|_| {
            let d = random.direction();
            let across = random.direction();
            let point = |s: f64, w: f64| [0, 1, 2].map(|i| (s * d[i] + w * across[i]) as f32);
            [point(-1.0, 0.0), point(1.0, 1e-4), point(1.0, -1e-4)]
        })
        .collect();
    Scene::of_soup("star of needles", &triangles)
}

/// Two closed spheres, one in the other.
pub fn nested_spheres() -> Scene {
    let outer = sphere(24, [0.25, -0.5, 0.125], 2.0);
    sphere(16, [0.25, -0.5, 0.125], 1.5).joined(&outer, "nested spheres")
}

/// The folder of real scenes: the one that the environment variable `SPLITPLANE_SCENES` names, else
/// `../shared/scenes` beside the workspace. `None`, with a note, when it is not there.
pub fn folder() -> Option<PathBuf> {
    let folder = std::env::var_os("SPLITPLANE_SCENES").map_or_else(
        || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared/scenes"),
        PathBuf::from,
    );
    if !folder.is_dir() {
        println!("note: real scenes are not used: there is no {}", folder.display());
        return None;
    }
    Some(folder)
}

/// A real scene by file name without extension, from [`folder`]. `None`, with a note, when it is not
/// there.
///
/// # Panics
/// If the file is there and is no OBJ.
pub fn real(name: &str) -> Option<Scene> {
    let path = folder()?.join(name).with_extension("obj");
    match std::fs::read_to_string(&path) {
        Ok(text) => Some(parse_obj(name, &text)),
        Err(error) => {
            println!("note: scene {name} is not used: {}: {error}", path.display());
            None
        }
    }
}

/// Reads `v` and `f` lines; polygons become fans. Enough for the test scenes, and independent of
/// the library's own reader.
///
/// # Panics
/// If a line is not a vertex or face that it knows.
pub fn parse_obj(name: &str, text: &str) -> Scene {
    let mut positions: Vec<[f32; 3]> = Vec::new();
    let mut indices = Vec::new();
    for line in text.lines() {
        let mut words = line.split_ascii_whitespace();
        match words.next() {
            Some("v") => {
                let mut next = || words.next().and_then(|w| w.parse().ok()).expect("a coordinate");
                positions.push([next(), next(), next()]);
            }
            Some("f") => {
                let corners: Vec<u32> = words
                    .map(|word| {
                        let word = word.split('/').next().unwrap_or_default();
                        let index: i64 = word.parse().expect("a vertex index");
                        let index =
                            if index < 0 { positions.len() as i64 + index } else { index - 1 };
                        u32::try_from(index).expect("a vertex that exists")
                    })
                    .collect();
                for pair in corners[1..].windows(2) {
                    indices.push([corners[0], pair[0], pair[1]]);
                }
            }
            _ => {}
        }
    }
    Scene::indexed(name, positions, indices)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashMap;

    /// Every edge, by position, is walked as often one way as the other, or at least an even number
    /// of times: what closed means here.
    fn assert_closed(scene: &Scene) {
        let mut edges: HashMap<[[u32; 3]; 2], u32> = HashMap::new();
        let mesh = scene.mesh();
        for index in 0..mesh.len() {
            let corners = mesh.triangle(index).map(|corner| corner.map(|x| (x + 0.0).to_bits()));
            for i in 0..3 {
                let mut edge = [corners[i], corners[(i + 1) % 3]];
                edge.sort_unstable();
                if edge[0] != edge[1] {
                    *edges.entry(edge).or_default() += 1;
                }
            }
        }
        let open = edges.values().filter(|&&count| count % 2 == 1).count();
        assert_eq!(open, 0, "{} has {open} open edges", scene.name);
    }

    #[test]
    fn closed_scenes_are_closed() {
        for centre in [[0.0; 3], [1e3; 3], [148_376.0, 1234.0, -223_423.0]] {
            let scene = sphere(LARGE_SPHERE, centre, 2.0);
            assert_eq!(scene.mesh().len(), 80_088);
            assert_closed(&scene);
        }
        assert_closed(&seams(false));
        assert_closed(&seams(true));
        assert_closed(&nested_spheres());
        assert_closed(&grid_boxes(3));
    }

    #[test]
    fn spheres_show_their_front_outwards() {
        let scene = sphere(12, [0.0; 3], 1.0);
        let mesh = scene.mesh();
        for index in 0..mesh.len() {
            let [a, b, c] = mesh.triangle(index).map(|p| p.map(f64::from));
            let [e, f] = [b, c].map(|p| [0, 1, 2].map(|i| p[i] - a[i]));
            let n = [0, 1, 2].map(|i| {
                let (j, k) = ((i + 1) % 3, (i + 2) % 3);
                e[j] * f[k] - e[k] * f[j]
            });
            assert!((0..3).map(|i| n[i] * a[i]).sum::<f64>() > 0.0, "triangle {index}");
        }
    }

    #[test]
    fn obj_polygons_become_fans() {
        let scene = parse_obj("x", "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1/1 2/2 3//3 -1\n");
        assert_eq!(scene.indices, Some(vec![[0, 1, 2], [0, 2, 3]]));
    }
}
