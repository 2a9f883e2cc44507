//! Scenes and rays at the ends of what floats can say: magnitudes from 1e-38 to 1e38, alone and in
//! one scene, far from the origin, next to flat, next to coincident; rays in planes and along edges,
//! with components of every size, and limits at the very distance of a hit.

use crate::aim::{self, Aim, Kind};
use crate::random::Random;
use crate::scenes::{self, Scene};
use crate::stability::Subject;
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::{Hit, Ray};

/// Every scene that is small enough to be gone through by all presets, instruction sets and
/// accuracies.
pub fn scenes() -> Vec<Scene> {
    let mut all = vec![
        shells(),
        mixed_soup(200),
        scenes::scaled(&centred(200), 1e-37, "all near 1e-37"),
        scenes::scaled(&centred(200), 2e-38, "all next to the least normal number"),
        scenes::scaled(&centred(200), 1e-40, "all subnormal"),
        scenes::scaled(&centred(200), 1e-19, "all near 1e-19"),
        scenes::scaled(&centred(200), 1e19, "all near 1e19"),
        scenes::scaled(&centred(200), 1e37, "all near 1e37"),
        scenes::scaled(&centred(200), 2.5e38, "all next to the greatest number"),
        negative_zeros(),
        slivers(200),
        slab(),
        stack(200, false),
        stack(200, true),
        staircase(),
        corner_cubes(),
        scenes::identical(3_000),
    ];
    for power in 3..=7 {
        let sizes = f64::powi(10.0, power);
        let subject = Subject::new(scenes::sphere(8, [0.0; 3], 1.0), None);
        all.push(subject.moved(sizes).scene.named(&format!("sphere 1e{power} sizes away")));
    }
    all
}

/// Triangles about the origin, of all octants.
fn centred(count: usize) -> Scene {
    let mut scene = scenes::soup(count, 0.3, 81);
    for position in &mut scene.positions {
        *position = position.map(|x| 2.0 * x - 1.0);
    }
    scene
}

/// Closed spheres about one centre, from a radius of 1e-37 to one of 1e38: a ray that starts inside
/// one must hit it, and each ray from the middle crosses all.
pub fn shells() -> Scene {
    let mut whole = scenes::sphere(4, [0.0; 3], 1e-37);
    for power in (-33..=38).step_by(5) {
        let sphere = scenes::sphere(4, [0.0; 3], 10f64.powi(power));
        whole = whole.joined(&sphere, "shells from 1e-37 to 1e38");
    }
    whole
}

/// Triangles each of whose coordinates has a magnitude of its own, from 1e-40 to 3e38.
pub fn mixed_soup(count: usize) -> Scene {
    let mut random = Random::new(82);
    let positions = (0..3 * count)
        .map(|_| {
            [(); 3].map(|()| {
                let magnitude = 10f64.powf(random.between(-40.0, 38.5)) as f32;
                if random.below(2) == 0 { magnitude } else { -magnitude }
            })
        })
        .collect();
    Scene { name: "magnitudes mixed in each triangle".into(), positions, indices: None }
}

/// A sphere on a coarse grid whose zeros are negative or subnormal at random.
pub fn negative_zeros() -> Scene {
    let mut random = Random::new(83);
    let mut scene = scenes::sphere(8, [0.0; 3], 1.0);
    for x in scene.positions.as_flattened_mut() {
        *x = (*x * 4.0).round() / 4.0;
        if *x == 0.0 {
            *x = random.pick(&[0.0, -0.0, 1e-45, -1e-39]);
        }
    }
    scene.named("zeros of both signs, and subnormals")
}

/// Triangles of aspect 1e12, along the axes and askew, that share their ends.
pub fn slivers(count: usize) -> Scene {
    let mut random = Random::new(84);
    let mut positions = Vec::new();
    for k in 0..count {
        let axis = k % 3;
        // Near zero on the two other axes, where floats lie dense enough for a width of 1e-12.
        let point = |along: f32, across: [f32; 2]| {
            let mut p = [0.0; 3];
            p[axis] = along;
            p[(axis + 1) % 3] = across[0];
            p[(axis + 2) % 3] = across[1];
            p
        };
        let at = [(); 2].map(|()| (random.between(-1.0, 1.0) * 1e-6) as f32);
        let beside = if k % 2 == 0 { [at[0] + 1e-12, at[1]] } else { [at[0], at[1] - 1e-12] };
        positions.extend([point(-1.0, at), point(1.0, at), point(1.0, beside)]);
    }
    Scene { name: "slivers of aspect 1e12".into(), positions, indices: None }
}

/// A closed box a unit wide and 1e-12 thick.
pub fn slab() -> Scene {
    let mut scene = scenes::grid_boxes(1);
    for position in &mut scene.positions {
        position[2] *= 1e-12;
    }
    scene.named("slab 1e-12 thick")
}

/// Squares one above the other, each one unit in the last place further; level, or each askew by a
/// few such units, so that they pass through one another.
pub fn stack(count: usize, askew: bool) -> Scene {
    let mut random = Random::new(85);
    let mut positions = Vec::new();
    for k in 0..count {
        let mut height = || {
            let off = if askew { random.below(5) as u32 } else { 0 };
            f32::from_bits(1.0f32.to_bits() + k as u32 + off)
        };
        let [a, b, c, d] =
            [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].map(|[x, y]| [x, y, height()]);
        positions.extend([a, b, c, a, c, d]);
    }
    let name =
        if askew { "stack of one unit, askew" } else { "stack of one unit in the last place" };
    Scene { name: name.into(), positions, indices: None }
}

/// Stairs whose steps halve from 2^60 to 2^-100.
pub fn staircase() -> Scene {
    let mut positions = Vec::new();
    for k in -60..100 {
        let [a, b] = [k, k + 1].map(|k| 2f32.powi(-k));
        let mut quad = |p: [[f32; 3]; 4]| positions.extend([p[0], p[1], p[2], p[0], p[2], p[3]]);
        quad([[a, a, -a], [a, a, a], [b, a, a], [b, a, -a]]);
        quad([[b, a, -a], [b, a, a], [b, b, a], [b, b, -a]]);
    }
    Scene { name: "geometric staircase".into(), positions, indices: None }
}

/// Closed cubes that halve towards a corner away from the origin, each in the next one's octant:
/// planes accumulate at a point.
pub fn corner_cubes() -> Scene {
    let cube = scenes::grid_boxes(1);
    let mut all: Option<Scene> = None;
    for k in 0..24 {
        let size = 2f32.powi(-k);
        let mut one = cube.clone();
        for p in &mut one.positions {
            *p = p.map(|x| 2.0 - size + x * size * 0.5);
        }
        all = Some(match all {
            None => one,
            Some(before) => before.joined(&one, "cubes that halve towards a corner"),
        });
    }
    all.unwrap_or(cube)
}

/// Rays of every kind at a mesh, with odd components, along its edges and in its planes, and some
/// that hit nothing by definition.
pub fn rays(mesh: &Mesh<'_>, each: usize, seed: u64) -> Vec<Ray> {
    let mut rays = Vec::new();
    for kind in Kind::ALL {
        let good = aim::rays(mesh, kind, each, seed);
        rays.extend(aim::odd(&good, seed + 1));
        rays.extend(with_components(&good, seed + 2));
        rays.extend(aim::invalid(&good[..each.div_ceil(4)], seed + 3));
        rays.extend(good);
    }
    rays.extend(along(mesh, 3 * each, seed + 4));
    rays
}

/// Rays along edges, through vertices on the way, and within the planes of triangles, mostly without
/// rounding.
pub fn along(mesh: &Mesh<'_>, count: usize, seed: u64) -> Vec<Ray> {
    let mut aim = Aim::new(mesh, seed);
    (0..count)
        .map(|number| {
            let [a, b] = aim.edge();
            let way = [0, 1, 2].map(|i| b[i] - a[i]);
            let back = aim.random().pick(&[0.0f32, 0.5, 1.0, 2.0]);
            let origin = [0, 1, 2].map(|i| a[i] - back * way[i]);
            let other = aim.corner();
            let direction = match number % 4 {
                // Along the edge, either way.
                0 => way,
                1 => way.map(|x| -x),
                // From a point of the edge's line to a corner: in a plane now and then.
                2 => [0, 1, 2].map(|i| other[i] - origin[i]),
                // Along the edge except for one component.
                _ => {
                    let mut direction = way;
                    direction[aim.random().below(3)] = 0.0;
                    direction
                }
            };
            let finite = |p: [f32; 3]| p.map(|x| x.clamp(-f32::MAX, f32::MAX));
            let (origin, mut direction) = (finite(origin), finite(direction));
            if direction.iter().all(|x| x.abs() < f32::MIN_POSITIVE) {
                direction = [1.0, 0.0, 0.0];
            }
            Ray::new(origin, direction)
        })
        .collect()
}

/// Rays made from good ones with one component of origin or direction that is 1e38, subnormal, or a
/// zero of either sign.
fn with_components(rays: &[Ray], seed: u64) -> Vec<Ray> {
    let mut random = Random::new(seed);
    let values = [1e38, -1e38, f32::MAX, 1e-38, 1e-45, -1e-40, 0.0, -0.0, 1e-20, 1e20];
    rays.iter()
        .map(|good| {
            let mut ray = *good;
            let (axis, value) = (random.below(3), random.pick(&values));
            match random.below(3) {
                0 => ray.origin[axis] = value,
                1 => ray.direction[axis] = value,
                // All of that size, so that the direction is kept, or all but.
                _ => {
                    let largest =
                        ray.direction.iter().fold(0.0f64, |m, x| m.max(f64::from(*x).abs()));
                    let factor = 1e38 / largest;
                    ray.direction = ray.direction.map(|x| (f64::from(x) * factor) as f32);
                }
            }
            if ray.direction.iter().all(|x| x.abs() < f32::MIN_POSITIVE) {
                ray.direction[(axis + 1) % 3] = 1.0;
            }
            ray
        })
        .collect()
}

/// The rays that hit, with limits at the distance of the hit and one float to either side of it.
pub fn with_limits_at(rays: &[Ray], hits: &[Hit]) -> Vec<Ray> {
    let mut limited = Vec::new();
    for (ray, hit) in rays.iter().zip(hits).filter(|(_, hit)| hit.is_hit()) {
        let t = hit.t;
        for (low, high) in [
            (t, t),
            (t, f32::INFINITY),
            (f32::NEG_INFINITY, t),
            (t.next_up(), f32::INFINITY),
            (f32::NEG_INFINITY, t.next_down()),
            (t.next_down(), t.next_up()),
        ] {
            limited.push(ray.with_limits(low, high));
        }
    }
    limited
}
