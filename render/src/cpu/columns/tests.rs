use super::*;
use crate::layout::Frame;
use crate::lighting::{may_be_lit, shadow_ray};
use crate::scene_data::LIGHT_WORDS;
use crate::surface::meet;
use crate::vector::mul;
use crate::world::{OneMesh, World};
use bytemuck::Zeroable;
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::{Hit, Ray};

/// Numbers from -1 to 1, sometimes of another size, zero, or without a number.
struct Random(u32);

impl Random {
    fn word(&mut self) -> u32 {
        self.0 = self.0.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
        let word = ((self.0 >> ((self.0 >> 28) + 4)) ^ self.0).wrapping_mul(277_803_737);
        (word >> 22) ^ word
    }

    fn number(&mut self) -> f32 {
        let number = (self.word() >> 8) as f32 / 8_388_608.0 - 1.0;
        match self.word() % 64 {
            0 => 0.0,
            1 => number * 1e30,
            2 => number * 1e-30,
            3 => f32::from_bits(self.word()),
            4 => -0.0,
            _ => number,
        }
    }

    fn vector(&mut self) -> Vector {
        core::array::from_fn(|_| self.number())
    }
}

/// Bits, of which those of numbers that are none are alike.
fn bits<const N: usize>(vector: [f32; N]) -> [u32; N] {
    vector.map(|part| if part.is_nan() { f32::NAN.to_bits() } else { part.to_bits() })
}

fn words<const N: usize>(vector: [f32; N]) -> [u32; N] {
    vector.map(f32::to_bits)
}

#[test]
fn hits_are_met_as_one_by_one() {
    let mut random = Random(7);
    let mut differ = 0;
    for round in 0..200 {
        let triangles: Vec<Triangle> = (0..HITS)
            .map(|i| {
                let [a, b, c] = [random.vector(), random.vector(), random.vector()];
                // Some without area, in a line or in a point.
                match (round + i) % 16 {
                    0 => [a, a, a],
                    1 => [a, b, a],
                    _ => [a, b, c],
                }
            })
            .collect();
        // Materials, then normals, which are left out in some rounds.
        let has_normals = round % 4 != 0;
        let mut frame = Frame { normals_at: HITS as u32, ..Frame::zeroed() };
        let mut all = vec![0; HITS];
        if has_normals {
            all.extend((0..9 * HITS).map(|_| random.number().to_bits()));
        }
        frame.texcoords_at = all.len() as u32;
        let scene = SceneWords { words: &all, frame: &frame, environment: None };
        let mesh = Mesh::soup(&triangles).expect("not too many");
        let world = OneMesh(mesh);
        // As many as there are, and fewer.
        let count = if round % 3 == 0 { HITS } else { random.word() as usize % HITS };
        let mut hits = Hits::NONE;
        let mut asked = Vec::new();
        for triangle in 0..count as u32 {
            let ray = Ray::new(random.vector(), random.vector());
            let hit = Hit { t: 1.0, triangle, u: random.number(), v: random.number() };
            let normals = scene.has_normals().then(|| scene.corner_normals(triangle));
            let corners = world.corners_alone(triangle).expect("one mesh");
            hits.push(&corners, normals.as_ref(), ray.direction, [hit.u, hit.v]);
            asked.push((ray, hit));
        }
        hits.meet(has_normals);
        for (lane, (ray, hit)) in asked.iter().enumerate() {
            let one = meet(&scene, world, ray, (hit, 0));
            let (surface, from_front) = hits.surface(lane, 0, has_normals);
            let what = format!("round {round}, lane {lane}, {hit:?} of {ray:?}");
            assert_eq!(bits(surface.point), bits(one.surface.point), "{what}");
            assert_eq!(bits([surface.offset]), bits([one.surface.offset]), "{what}");
            let own = [surface, one.surface].map(|surface| bits(surface.geometric_normal));
            assert_eq!(own[0], own[1], "{what}");
            assert_eq!(bits(surface.normal), bits(one.surface.normal), "{what}");
            assert_eq!(from_front, one.from_front, "{what}");
            differ += usize::from(surface.normal != surface.geometric_normal);
        }
    }
    assert!(differ > 500, "{differ} normals are between those of corners");
}

/// Lights of both kinds, near and far.
fn some_lights(random: &mut Random, count: u32) -> Vec<u32> {
    let mut all = Vec::new();
    for light in 0..count {
        let kind = if light % 3 == 1 { DIRECTIONAL } else { DIRECTIONAL ^ 1 };
        all.push(kind);
        all.extend(words(random.vector()));
        all.extend(words(random.vector()));
        all.push(random.number().abs().to_bits());
    }
    assert_eq!(all.len(), (LIGHT_WORDS * count) as usize);
    all
}

fn some_surface(random: &mut Random) -> (Surface, Path) {
    let surface = Surface {
        point: random.vector(),
        offset: random.number() * 1e-6,
        geometric_normal: normalized(random.vector()),
        normal: normalized(random.vector()),
        scattering: random.vector(),
        ..Surface::default()
    };
    (surface, Path { weight: random.vector(), ..Path::default() })
}

#[test]
fn lights_ask_and_shine_as_one_by_one() {
    let mut random = Random(3);
    let (mut asked, mut silent) = (0, 0);
    for round in 0..100 {
        let count = 1 + random.word() % 6;
        let lights = some_lights(&mut random, count);
        let frame = Frame { lights: count, ..Frame::zeroed() };
        let scene = SceneWords { words: &lights, frame: &frame, environment: None };
        let world = OneMesh(Mesh::soup(&[]).expect("no triangles"));
        let surfaces = if round % 3 == 0 { CHUNK } else { random.word() as usize % CHUNK };
        let (mut all, paths): (Vec<Surface>, Vec<Path>) =
            (0..surfaces).map(|_| some_surface(&mut random)).unzip();
        let mut facing = Facing::NONE;
        for (number, surface) in all.iter().enumerate().filter(|(number, _)| number % 5 != 0) {
            facing.push(number, surface);
        }
        facing.ask(&scene, &mut all);
        let world = &world;
        for (number, (surface, path)) in all.iter().zip(&paths).enumerate() {
            let one = may_be_lit(&scene, *world, surface, path, (0, 0));
            let expected = if number % 5 == 0 { 0 } else { one };
            assert_eq!(surface.lights, expected, "round {round}, surface {number}");
            asked += expected.count_ones();
            silent += count - expected.count_ones();
        }
        let mut lit = Lit::of(&all, &paths);
        let union = all.iter().fold(0, |union, surface| union | surface.lights);
        assert_eq!(lit.asked(), union);
        for sample in 0..count as usize {
            let light = scene.light(sample as u32);
            let mut those = all.iter().zip(&paths).filter(|(s, _)| s.lights >> sample & 1 == 1);
            lit.each(sample, &light, |start, albedo, share| {
                let (surface, path) = those.next().expect("no more than ask");
                let (ray, brought) = shadow_ray(&scene, *world, surface, path, 0, sample as u32);
                assert_eq!(bits(start), bits(ray.origin), "round {round}");
                let own = mul(albedo, scaled(light.irradiance, share));
                assert_eq!(bits(own), bits(brought), "round {round}, light {sample}");
            });
            assert!(those.next().is_none(), "all that ask");
        }
    }
    assert!(asked > 5_000 && silent > 5_000, "{asked} asked, {silent} did not");
}
