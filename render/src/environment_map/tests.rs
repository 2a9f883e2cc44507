use super::*;
use crate::random::words;
use crate::vector::{dot, length, normalized};
use std::f64::consts::{PI, TAU};

/// Numbers that look like chance, the same always.
fn numbers(seed: u32) -> impl FnMut() -> f64 {
    let mut index = 0;
    move || {
        index += 1;
        f64::from(words([seed, 1, 2], index)[0]) / 4_294_967_296.0
    }
}

/// Radiance of many sizes, and of some texels none.
fn patchy(width: u32, height: u32, seed: u32) -> EnvironmentMap {
    let mut number = numbers(seed);
    let texels = (0..width * height).map(|_| match (number() * 8.0) as u32 {
        0 | 1 => [0.0; 3],
        2 => [(number() * 100.0) as f32, 0.0, 0.0],
        _ => [(); 3].map(|()| number() as f32),
    });
    EnvironmentMap::new(width, height, texels.collect()).unwrap()
}

/// A dim sky with a small sun in it.
fn sunny(width: u32, height: u32) -> EnvironmentMap {
    let sun = (width / 3, height / 5);
    let texel = |at: u32| match (at % width, at / width) == sun {
        true => [4e4, 3e4, 2e4],
        false => [0.1, 0.2, 0.3 * (at / width) as f32 / height as f32],
    };
    EnvironmentMap::new(width, height, (0..width * height).map(texel).collect()).unwrap()
}

/// Column and row of a direction by the platform's functions, as fractions.
fn place([x, y, z]: Vector, map: &EnvironmentMap) -> [f64; 2] {
    let turned = f64::from(x).atan2(-f64::from(z)) + f64::from(map.rotation_degrees).to_radians();
    let across = (turned / TAU + 0.5).rem_euclid(1.0);
    let down = f64::from(y).clamp(-1.0, 1.0).acos() / PI;
    [across * f64::from(map.width), down * f64::from(map.height)]
}

/// The solid angle of a texel of a row.
fn solid_angle(map: &EnvironmentMap, row: u32) -> f64 {
    let edge = |row: u32| (PI * f64::from(row) / f64::from(map.height)).cos();
    TAU / f64::from(map.width) * (edge(row) - edge(row + 1))
}

fn directions(count: u32) -> impl Iterator<Item = Vector> {
    (0..count).map(|i| crate::warp::sphere(crate::random::pair([8, 8, 8], i)))
}

#[test]
fn directions_see_the_texel_that_their_angles_say() {
    for (map, degrees) in [
        (patchy(7, 5, 1), 0.0),
        (patchy(8, 4, 2), 30.0),
        (patchy(1, 1, 3), 77.0),
        (patchy(2, 3, 4), -725.0),
        (patchy(301, 97, 5), 180.0),
    ] {
        let map = map.with_rotation(degrees).unwrap();
        let mut seen = 0;
        for direction in directions(4000) {
            let [across, down] = place(direction, &map);
            let is_edge = |x: f64| (x - x.round()).abs() < 1e-4;
            if is_edge(across) || is_edge(down) {
                continue;
            }
            let at = down as usize * map.width as usize + across as usize;
            assert_eq!(map.radiance(direction), map.texels[at], "{map:?} {direction:?}");
            seen += 1;
        }
        assert!(seen > 2000, "{seen}");
    }
    // The middle is towards -z, and what is right of it is right of it; turned by 90 degrees it is where the left was.
    let texels = [[1.0; 3], [2.0; 3], [3.0; 3], [4.0; 3]];
    let map = EnvironmentMap::new(4, 1, texels.to_vec()).unwrap();
    let at = |map: &EnvironmentMap, x: f32, z: f32| map.radiance(normalized([x, 0.1, z]))[0];
    assert_eq!([at(&map, -0.1, -1.0), at(&map, 0.1, -1.0), at(&map, 1.0, 0.1)], [2.0, 3.0, 4.0]);
    let map = map.with_rotation(90.0).unwrap();
    assert_eq!([at(&map, -1.0, 0.1), at(&map, -1.0, -0.1)], [2.0, 3.0]);
    for odd in [[0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [0.0; 3], [f32::NAN; 3]] {
        assert!(map.radiance(odd)[0] >= 1.0);
    }
}

/// The density is the luminance of a texel over that of all, and its integral is 1.
#[test]
fn densities_are_those_of_the_light() {
    for map in [patchy(7, 5, 1), patchy(64, 33, 2), sunny(128, 64), patchy(2, 1, 8)] {
        let of_texel = |row: u32, column: u32| {
            let texel = map.texels[(row * map.width + column) as usize];
            luminance(texel)
        };
        let all = |of: &dyn Fn(u32, u32) -> f64| -> f64 {
            let texels = (0..map.height).flat_map(|row| (0..map.width).map(move |c| (row, c)));
            texels.map(|(row, column)| of(row, column) * solid_angle(&map, row)).sum()
        };
        let total = all(&of_texel);
        let density =
            |row: u32, column: u32| f64::from(map.density_of(row as usize, column as usize));
        let whole = all(&density);
        assert!((whole - 1.0).abs() < 1e-5, "{map:?}: {whole}");
        for row in 0..map.height {
            for column in 0..map.width {
                let (found, want) = (density(row, column), of_texel(row, column) / total);
                // What is much darker than the brightest has few of the parts of one.
                assert!(
                    (found - want).abs() < 1e-3 * want + 1e-6,
                    "{map:?} {row} {column}: {found} {want}"
                );
            }
        }
        let light = map.total().map(f64::from);
        for channel in 0..3 {
            let want = all(&|row, column| {
                f64::from(map.texels[(row * map.width + column) as usize][channel])
            });
            assert!((light[channel] - want).abs() < 1e-5 * want, "{map:?}: {light:?}");
        }
    }
    let even = EnvironmentMap::new(16, 8, vec![[3.0; 3]; 128]).unwrap();
    for direction in directions(500) {
        assert!((f64::from(even.density(direction)) * 4.0 * PI - 1.0).abs() < 1e-5);
    }
}

/// What is drawn has the density and radiance that its direction has, and every texel its share.
#[test]
fn samples_are_distributed_as_said() {
    for map in [patchy(7, 5, 1), patchy(12, 9, 4).with_rotation(200.0).unwrap()] {
        let count = 200_000;
        let mut found = vec![0u32; map.texels.len()];
        let mut edges = 0;
        for index in 0..count {
            let MapSample { direction, radiance, density } = map.sample(words([5, 6, 7], index));
            assert!((length(direction) - 1.0).abs() < 1e-6);
            assert!(density > 0.0 && radiance != [0.0; 3]);
            let (row, column) = map.place(direction);
            found[row * map.width as usize + column] += 1;
            let same = map.radiance(direction) == radiance && map.density(direction) == density;
            edges += u32::from(!same);
        }
        // Roundings carry few over an edge.
        assert!(edges < count / 2000, "{edges}");
        for (at, found) in (0..).zip(found) {
            let row = at / map.width;
            let share = f64::from(map.density_of(row as usize, (at % map.width) as usize))
                * solid_angle(&map, row);
            let (want, count) = (share * f64::from(count), f64::from(count));
            // Five standard deviations of chance; these points are more even than chance.
            let allowed = 5.0 * (want * (1.0 - share)).sqrt() + count / 2000.0 * 2.0;
            assert!((f64::from(found) - want).abs() <= allowed, "{at}: {found} {want}");
        }
    }
}

/// The irradiance of a tilted plane by brute force over parts of texels, in `f64`.
fn irradiance(map: &EnvironmentMap, normal: [f64; 3]) -> f64 {
    let parts = 24;
    let mut sum = 0.0;
    for row in 0..map.height {
        for column in 0..map.width {
            let radiance = f64::from(map.texels[(row * map.width + column) as usize][0]);
            for (i, j) in (0..parts * parts).map(|k| (k / parts, k % parts)) {
                let part =
                    |at: u32, k: u32| f64::from(at) + (f64::from(k) + 0.5) / f64::from(parts);
                let down = PI * part(row, i) / f64::from(map.height);
                let across = TAU * (part(column, j) / f64::from(map.width) - 0.5);
                let (sine, y) = down.sin_cos();
                let towards = [sine * across.sin(), y, -sine * across.cos()];
                let cosine: f64 = (0..3).map(|k| towards[k] * normal[k]).sum();
                let cell =
                    sine * PI / f64::from(map.height * parts) * TAU / f64::from(map.width * parts);
                sum += radiance * cosine.max(0.0) * cell;
            }
        }
    }
    sum
}

/// A small sun is found by nearly each sample; of even samples few find it.
#[test]
fn the_sun_is_found() {
    let map = sunny(64, 32);
    let normal = normalized([0.3, 0.9, -0.2]);
    let want = irradiance(&map, normal.map(f64::from));
    let moments = |sample: &dyn Fn(u32) -> f64, count: u32| {
        let values: Vec<f64> = (0..count).map(sample).collect();
        let mean = values.iter().sum::<f64>() / f64::from(count);
        let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
        (mean, squares / f64::from(count))
    };
    let cosine = |direction| f64::from(dot(direction, normal)).max(0.0);
    let by_light = |index| {
        let MapSample { direction, radiance, density } = map.sample(words([1, 1, 1], index));
        f64::from(radiance[0]) * cosine(direction) / f64::from(density)
    };
    let evenly = |index| {
        let direction = crate::warp::sphere(crate::random::pair([1, 1, 1], index));
        f64::from(map.radiance(direction)[0]) * cosine(direction) * 4.0 * PI
    };
    let (mean, variance) = moments(&by_light, 4096);
    assert!((mean / want - 1.0).abs() < 0.002, "{mean} {want}");
    // The standard deviation of one sample is a part of the mean.
    assert!(variance.sqrt() < 0.5 * want, "{variance}");
    let (mean, even) = moments(&evenly, 1 << 18);
    assert!((mean / want - 1.0).abs() < 0.05, "{mean} {want}");
    assert!(even > 1000.0 * variance, "{even} {variance}");
}

#[test]
fn maps_that_cannot_be() {
    use EnvironmentMapError::{Radiance, Rotation, Size, Strength};
    let new = EnvironmentMap::new;
    assert!(matches!(new(0, 0, vec![]), Err(Size { .. })));
    assert!(matches!(new(2, 2, vec![[0.0; 3]; 3]), Err(Size { found: 3, .. })));
    assert!(matches!(new(16_385, 1, vec![[0.0; 3]; 16_385]), Err(Size { .. })));
    let mut texels = vec![[0.0; 3]; 6];
    texels[5][1] = -1.0;
    assert_eq!(new(3, 2, texels), Err(Radiance { column: 2, row: 1, value: -1.0 }));
    let bright = new(1, 1, vec![[1e12; 3]]).unwrap();
    assert!(matches!(bright.clone().with_strength(1.1), Err(Strength { .. })));
    assert!(matches!(bright.with_rotation(f32::NAN), Err(Rotation { .. })));
    let black = new(2, 2, vec![[0.0; 3]; 4]).unwrap();
    assert!(!black.shines() && patchy(4, 4, 1).shines());
    assert!(!patchy(4, 4, 1).with_strength(0.0).unwrap().shines());
    // Black everywhere is drawn evenly, and gives nothing.
    assert_eq!(black.sample([7, 9]).radiance, [0.0; 3]);
}

#[test]
fn digests_name_what_is_shown() {
    let map = patchy(4, 4, 1);
    let mut all = vec![map.digest()];
    all.push(map.clone().with_strength(2.0).unwrap().digest());
    all.push(map.clone().with_rotation(1.0).unwrap().digest());
    all.push(patchy(4, 4, 2).digest());
    all.push(patchy(2, 8, 1).digest());
    assert_eq!(map.clone().with_rotation(0.0).unwrap().digest(), all[0]);
    all.sort();
    all.dedup();
    assert_eq!(all.len(), 5);
}
