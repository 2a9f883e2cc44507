//! Sets of rays: a camera's row by row and in tiles, those to the light, those that bounce off, and chords; or from files.

use std::path::Path;

use splitplane::scene::{Light, Placement, Scene};
use splitplane::{Accelerator, Hit, QueryOptions, Ray};

use crate::Failure;

/// Rays with a name.
pub(crate) struct Set {
    pub name: &'static str,
    pub rays: Vec<Ray>,
}

const NAMES: [&str; 4] = ["primary", "shadow", "bounce", "chords"];
/// Rays of `primary` in another order, where they are made here.
pub(crate) const TILES: &str = "tiles";

/// Reads the sets that a folder has as `NAME.rays`.
pub(crate) fn from_folder(folder: &Path) -> Result<Vec<Set>, Failure> {
    let mut sets = Vec::new();
    for name in NAMES {
        let path = folder.join(format!("{name}.rays"));
        let bytes = std::fs::read(&path).map_err(|error| format!("{}: {error}", path.display()))?;
        let (records, rest) = bytes.as_chunks::<32>();
        if !rest.is_empty() {
            return Err(format!("{}: not a multiple of 32 bytes", path.display()).into());
        }
        let ray = |record: &[u8; 32]| {
            let [ox, oy, oz, dx, dy, dz, t_min, t_max]: [f32; 8] =
                bytemuck::pod_read_unaligned(record);
            Ray::new([ox, oy, oz], [dx, dy, dz]).with_limits(t_min, t_max)
        };
        sets.push(Set { name, rays: records.iter().map(ray).collect() });
    }
    Ok(sets)
}

/// Makes the sets: a ray through every pixel of a picture, row by row and in tiles; from each point it sees one to the light,
/// and one off the surface, cosine-weighted; and as many chords of the scene's sphere as pixels.
pub(crate) fn made(
    scene: &Scene,
    accelerator: &dyn Accelerator,
    placement: &Placement,
    [width, height]: [u32; 2],
) -> Result<Vec<Set>, Failure> {
    let primary = placement.camera.rays(width, height);
    let mut hits = vec![Hit::MISS; primary.len()];
    accelerator.closest_hits(&primary, &mut hits, &QueryOptions::default())?;
    let bounds = scene.bounds();
    let [lo, hi] = [bounds.lo, bounds.hi].map(wide);
    let diagonal = length(sub(hi, lo));
    let centre = add(lo, hi).map(|x| 0.5 * x);
    let light = wide(light_of(placement));
    let (mut shadow, mut bounce) = (Vec::new(), Vec::new());
    for (pixel, (ray, hit)) in primary.iter().zip(&hits).enumerate() {
        let Some((start, normal)) = surface(scene, ray, hit, 1e-4 * diagonal) else { continue };
        let to_light = sub(light, start);
        let distance = length(to_light);
        if distance > 0.0 {
            let towards = to_light.map(|x| x / distance);
            shadow.push(narrow(start, towards).with_limits(0.0, (0.9999 * distance) as f32));
        }
        let mut random = Random::new(42, pixel as u64);
        // A point of the sphere that touches the surface from outside is cosine-weighted.
        let about = add(normal, random.direction());
        if length(about) > 1e-6 {
            bounce.push(narrow(start, scaled(about, 1.0 / length(about))));
        }
    }
    let chords = (0..primary.len())
        .map(|number| {
            let mut random = Random::new(43, number as u64);
            let [a, b] = [(); 2].map(|()| add(centre, scaled(random.direction(), 0.5 * diagonal)));
            let along = sub(b, a);
            narrow(a, scaled(along, 1.0 / length(along).max(f64::MIN_POSITIVE)))
        })
        .collect();
    let tiles = Set { name: TILES, rays: in_tiles(&primary, width) };
    let sets = [primary, shadow, bounce, chords];
    let mut sets: Vec<Set> =
        NAMES.into_iter().zip(sets).map(|(name, rays)| Set { name, rays }).collect();
    sets.insert(1, tiles);
    Ok(sets)
}

/// The rays of a picture, given row by row, in tiles of 8 by 4 pixels from the top left: the rays of a warp are then near
/// one another. Tiles at the right and lower edge are cut.
pub(crate) fn in_tiles(rays: &[Ray], width: u32) -> Vec<Ray> {
    let mut order: Vec<usize> = (0..rays.len()).collect();
    let width = width as usize;
    order.sort_by_key(|pixel| {
        let (row, column) = (pixel / width, pixel % width);
        (row / 4, column / 8, row % 4, column % 8)
    });
    order.into_iter().map(|pixel| rays[pixel]).collect()
}

/// Where a ray meets a surface, moved off it towards the ray, and the normal on that side.
/// Where shadow rays end: at the first point light, else at the eye.
fn light_of(placement: &Placement) -> [f32; 3] {
    let point = placement.lights.iter().find_map(|light| match *light {
        Light::Point { position, .. } => Some(position),
        _ => None,
    });
    point.unwrap_or(placement.camera.eye())
}

fn surface(scene: &Scene, ray: &Ray, hit: &Hit, offset: f64) -> Option<([f64; 3], [f64; 3])> {
    let corners = scene.indices.get(hit.triangle as usize)?;
    let [a, b, c] = corners.map(|corner| wide(scene.positions[corner as usize]));
    let (u, v) = (f64::from(hit.u), f64::from(hit.v));
    let point = add(a, add(scaled(sub(b, a), u), scaled(sub(c, a), v)));
    let normal = cross(sub(b, a), sub(c, a));
    let long = length(normal);
    let against = dot(normal, wide(ray.direction)) > 0.0;
    let normal = scaled(normal, if against { -1.0 } else { 1.0 } / long);
    (long > 0.0).then(|| (add(point, scaled(normal, offset)), normal))
}

/// Numbers that look random, a sequence of their own for each ray (SplitMix64).
struct Random(u64);

impl Random {
    fn new(seed: u64, stream: u64) -> Random {
        let mut random = Random(seed);
        random.0 = random.next() ^ stream.wrapping_mul(0xd134_2543_de82_ef95);
        random.next();
        random
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// From -1 to 1.
    fn signed(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    /// A direction, evenly spread over the sphere.
    fn direction(&mut self) -> [f64; 3] {
        loop {
            let v = [(); 3].map(|()| self.signed());
            let long = length(v);
            if (1e-3..=1.0).contains(&long) {
                return scaled(v, 1.0 / long);
            }
        }
    }
}

type Vector = [f64; 3];

fn narrow(origin: Vector, direction: Vector) -> Ray {
    Ray::new(origin.map(|x| x as f32), direction.map(|x| x as f32))
}

fn wide(v: [f32; 3]) -> Vector {
    v.map(f64::from)
}

fn add(a: Vector, b: Vector) -> Vector {
    std::array::from_fn(|i| a[i] + b[i])
}

fn sub(a: Vector, b: Vector) -> Vector {
    std::array::from_fn(|i| a[i] - b[i])
}

fn scaled(v: Vector, by: f64) -> Vector {
    v.map(|x| x * by)
}

fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: Vector, b: Vector) -> Vector {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn length(v: Vector) -> f64 {
    dot(v, v).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tile_is_eight_by_four_neighbours() {
        let rays: Vec<Ray> =
            (0..20 * 6u16).map(|i| Ray::new([f32::from(i); 3], [1.0; 3])).collect();
        let tiled = in_tiles(&rays, 20);
        let pixel = |at: usize| tiled[at].origin[0] as usize;
        assert_eq!([pixel(0), pixel(7), pixel(8), pixel(31), pixel(32)], [0, 7, 20, 67, 8]);
        // The third tile of a row is cut at 20 pixels.
        assert_eq!([pixel(64), pixel(67), pixel(68), pixel(80)], [16, 19, 36, 80]);
        let mut all: Vec<usize> = (0..tiled.len()).map(pixel).collect();
        all.sort_unstable();
        assert!(all.into_iter().eq(0..120));
    }
}
