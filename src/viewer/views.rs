//! Debug pictures: what hits say, as colours.

use crate::scene::Scene;
use crate::surface::Surface;
use rayon::prelude::*;
use splitplane_core::ray::{Hit, Ray};

/// What is behind everything.
const NOTHING: u32 = word([24, 26, 30]);

/// A pixel as the window takes it.
pub(super) const fn word(colour: [u8; 3]) -> u32 {
    u32::from_le_bytes([colour[0], colour[1], colour[2], 255])
}

fn byte(part: f64) -> u8 {
    (part.clamp(0.0, 1.0) * 255.0 + 0.5) as u8
}

/// Distances as shades of grey between the nearest and the farthest, and what they mean.
pub(super) fn depth(hits: &[Hit]) -> (Vec<u32>, Option<String>) {
    let seen = || hits.par_iter().filter(|hit| hit.is_hit()).map(|hit| hit.t);
    let near = seen().reduce(|| f32::INFINITY, f32::min);
    let far = seen().reduce(|| 0.0, f32::max);
    if near > far {
        return (vec![NOTHING; hits.len()], None);
    }
    let (lo, range) = (f64::from(near), f64::from(far) - f64::from(near));
    let shade = |hit: &Hit| {
        if !hit.is_hit() {
            return NOTHING;
        }
        let part = if range > 0.0 { (f64::from(hit.t) - lo) / range } else { 0.0 };
        // The farthest is still told from nothing.
        word([byte(1.0 - 0.85 * part); 3])
    };
    let legend = format!("bright {} to dark {}", short(lo), short(f64::from(far)));
    (hits.par_iter().map(shade).collect(), Some(legend))
}

/// Normals towards the eye, each coordinate from -1..1 to 0..1.
pub(super) fn normals(scene: &Scene, rays: &[Ray], hits: &[Hit]) -> Vec<u32> {
    let colour = |(ray, hit): (&Ray, &Hit)| {
        let Some(corners) = scene.indices.get(hit.triangle as usize) else { return NOTHING };
        let corners = corners.map(|vertex| scene.positions[vertex as usize]);
        match Surface::new(corners, hit, ray.direction) {
            Some(surface) => word(surface.normal.to_array().map(|part| byte(0.5 + 0.5 * part))),
            // Without area there is no normal.
            None => word([0; 3]),
        }
    };
    rays.par_iter().zip(hits).map(colour).collect()
}

/// A colour for every triangle, neighbours apart by their numbers' bits.
pub(super) fn triangle_ids(hits: &[Hit]) -> Vec<u32> {
    let colour = |hit: &Hit| if hit.is_hit() { word(id_colour(hit.triangle)) } else { NOTHING };
    hits.par_iter().map(colour).collect()
}

/// Bits mixed by a multiplicative hash; none of the colours is dark.
fn id_colour(triangle: u32) -> [u8; 3] {
    let mut bits = triangle.wrapping_add(1).wrapping_mul(0x9e37_79b9);
    bits = (bits ^ (bits >> 15)).wrapping_mul(0x85eb_ca6b);
    bits ^= bits >> 13;
    let [r, g, b, _] = bits.to_le_bytes();
    [r, g, b].map(|part| 64 + (part >> 2) * 3)
}

/// Counts as colours from dark over red and yellow to white, and what they mean. The scale ends
/// where one pixel in a hundred lies above it, so that a few extremes do not darken the rest.
pub(super) fn heat(counts: &[u32]) -> (Vec<u32>, Option<String>) {
    if counts.is_empty() {
        return (Vec::new(), None);
    }
    let mut sorted = counts.to_vec();
    let at = (sorted.len() - 1) * 99 / 100;
    let (_, &mut top, _) = sorted.select_nth_unstable(at);
    let top = top.max(1);
    let sum: u64 = counts.par_iter().map(|&count| u64::from(count)).sum();
    let most = counts.par_iter().copied().max().unwrap_or(0);
    let words = counts.par_iter().map(|&count| word(heat_colour(count, top))).collect();
    let mean = sum as f64 / counts.len() as f64;
    (words, Some(format!("white is {top} and more; mean {mean:.1}, most {most}")))
}

fn heat_colour(count: u32, top: u32) -> [u8; 3] {
    const STOPS: [[f64; 3]; 6] = [
        [0.04, 0.04, 0.10],
        [0.28, 0.08, 0.42],
        [0.72, 0.18, 0.32],
        [0.95, 0.45, 0.12],
        [0.99, 0.82, 0.28],
        [1.00, 1.00, 0.94],
    ];
    let at = (f64::from(count) / f64::from(top)).min(1.0) * 5.0;
    let first = (at as usize).min(4);
    let weight = at - first as f64;
    [0, 1, 2].map(|i| byte(STOPS[first][i] * (1.0 - weight) + STOPS[first + 1][i] * weight))
}

/// A distance with three digits that count.
fn short(x: f64) -> String {
    match x.abs() {
        size if (0.01..10.0).contains(&size) => format!("{x:.3}"),
        size if (10.0..100_000.0).contains(&size) => format!("{x:.1}"),
        0.0 => "0".to_owned(),
        _ => format!("{x:.2e}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hit(t: f32, triangle: u32) -> Hit {
        Hit { t, triangle, u: 0.2, v: 0.2 }
    }

    #[test]
    fn nearer_is_brighter_and_nothing_is_told_apart() {
        let (words, legend) = depth(&[hit(1.0, 0), hit(2.0, 0), hit(3.0, 0), Hit::MISS]);
        let shades: Vec<u32> = words.iter().map(|word| word & 0xff).collect();
        assert_eq!(shades[0], 255);
        assert!(shades[1] < shades[0] && shades[2] < shades[1] && words[3] == NOTHING);
        assert!(words[2] != NOTHING);
        assert_eq!(legend.unwrap(), "bright 1.000 to dark 3.000");
        assert_eq!(depth(&[Hit::MISS]), (vec![NOTHING], None));
        assert_eq!(depth(&[hit(5.0, 0)]).0, [word([255; 3])]);
    }

    #[test]
    fn normals_face_the_eye() {
        let scene = Scene {
            positions: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            indices: vec![[0, 1, 2]],
            ..Scene::default()
        };
        let front = Ray::new([0.2, 0.2, 5.0], [0.0, 0.0, -1.0]);
        let back = Ray::new([0.2, 0.2, -5.0], [0.0, 0.0, 1.0]);
        let hits = [hit(5.0, 0), hit(5.0, 0), Hit::MISS];
        let words = normals(&scene, &[front, back, front], &hits);
        assert_eq!(words, [word([128, 128, 255]), word([128, 128, 0]), NOTHING]);
    }

    #[test]
    fn neighbours_have_colours_of_their_own() {
        let words = triangle_ids(&[hit(1.0, 0), hit(1.0, 1), hit(2.0, 0), Hit::MISS]);
        assert_eq!(words[0], words[2]);
        assert!(words[0] != words[1] && words[3] == NOTHING);
        let mut all: Vec<[u8; 3]> = (0..1000).map(id_colour).collect();
        all.sort_unstable();
        all.dedup();
        assert!(all.len() > 950, "{}", all.len());
    }

    #[test]
    fn heat_grows_and_ends_in_white() {
        let counts: Vec<u32> = (0..=100).collect();
        let (words, legend) = heat(&counts);
        let light = |word: u32| word.to_le_bytes()[..3].iter().map(|&b| u32::from(b)).sum::<u32>();
        assert!(words.windows(2).all(|pair| light(pair[0]) <= light(pair[1])));
        assert_eq!(words[100], word(heat_colour(1, 1)));
        assert_eq!(legend.unwrap(), "white is 99 and more; mean 50.0, most 100");
        assert_eq!(heat(&[0, 0]).0[0], word(heat_colour(0, 1)));
        assert_eq!(heat(&[]).0, []);
    }
}
