//! Clouds of points that trees trip over, and queries to them.

use crate::random::Random;

/// Clouds that trees trip over.
pub fn clouds<const N: usize>() -> Vec<(&'static str, Vec<[f32; N]>)> {
    let mut random = Random::new(N as u64);
    let mut cloud = |count: usize, f: &mut dyn FnMut(&mut Random, usize) -> f32| {
        (0..count).map(|i| [(); N].map(|()| f(&mut random, i))).collect::<Vec<[f32; N]>>()
    };
    let mut all = vec![
        ("none", cloud(0, &mut |_, _| 0.0)),
        ("one", cloud(1, &mut |r, _| r.signed())),
        ("a block", cloud(16, &mut |r, _| r.signed())),
        ("a block and one", cloud(16 + 1, &mut |r, _| r.signed())),
        ("17 blocks", cloud(17 * 16 - 3, &mut |r, _| r.signed())),
        ("uniform", cloud(4500, &mut |r, _| r.signed())),
        ("coincident", cloud(700, &mut |_, _| 0.3)),
        ("few places", cloud(900, &mut |r, _| (r.below(3) as f32) * 0.1)),
        ("grid", cloud(1500, &mut |r, _| r.below(9) as f32)),
        ("diagonal", cloud(600, &mut |_, i| i as f32 * 0.01)),
        ("1e-30", cloud(600, &mut |r, _| r.signed() * 1e-30)),
        ("1e30", cloud(600, &mut |r, _| r.signed() * 1e30)),
        ("greatest", cloud(300, &mut |r, _| r.signed() * f32::MAX)),
        ("subnormal", cloud(300, &mut |r, _| r.signed() * 1e-39)),
        ("all sizes", cloud(900, &mut |r, _| r.signed() * 10f32.powi(r.below(61) as i32 - 30))),
    ];
    let mut holes = cloud(800, &mut |r, _| r.signed());
    for (i, point) in holes.iter_mut().enumerate().filter(|(i, _)| i % 3 == 0) {
        point[i % N] = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY][i / 3 % 3];
    }
    all.push(("not finite", holes));
    all
}

/// Queries near points of a cloud, at them, and far from all.
pub fn queries<const N: usize>(points: &[[f32; N]], random: &mut Random) -> Vec<[f32; N]> {
    let mut all = vec![[0.0; N], [f32::MAX; N], [-1e-30; N], [1e-39; N], [1.0; N]];
    for _ in 0..24 {
        let Some(&near) = points.get(random.below(points.len().max(1))) else { break };
        all.push(near);
        all.push(near.map(|x| x * (1.0 + 0.01 * random.signed())));
        all.push(near.map(|x| x + random.signed()));
    }
    all
}
