//! The order in which a batch is answered: queries that are near one another read the same nodes, which are then in
//! cache. It changes no answer.

/// Places of queries along a curve (Morton 1966) through the box from `lower` to `upper`. Those outside count as on its side.
pub(crate) fn along_curve<const N: usize>(
    queries: &[[f32; N]],
    lower: [f32; N],
    upper: [f32; N],
    keys: &mut Vec<u64>,
    spare: &mut Vec<u64>,
) {
    // Two digits of eleven bits: finer cells would not pay for a third pass.
    let bits = (22 / N) as u32;
    let cells = (1u32 << bits) as f32;
    let mut scale = [0.0; N];
    for axis in 0..N {
        scale[axis] = cells / (upper[axis] - lower[axis]);
    }
    keys.clear();
    for (place, query) in queries.iter().enumerate() {
        let mut code = 0;
        for axis in 0..N {
            // The conversion saturates, and takes a NaN for 0.
            let cell = (((query[axis] - lower[axis]) * scale[axis]) as u32).min((1 << bits) - 1);
            code |= spread::<N>(cell) << axis;
        }
        keys.push(u64::from(code) << 32 | place as u64);
    }
    // By eleven bits at a time, the lowest first.
    let passes = (bits * N as u32).div_ceil(11);
    spare.clear();
    spare.resize(keys.len(), 0);
    for pass in 0..passes {
        let digit = |key: u64| (key >> (32 + 11 * pass)) as usize & 2047;
        let mut starts = [0u32; 2048];
        for &key in keys.iter() {
            starts[digit(key)] += 1;
        }
        let mut sum = 0;
        for start in &mut starts {
            sum += core::mem::replace(start, sum);
        }
        for &key in keys.iter() {
            let start = &mut starts[digit(key)];
            spare[*start as usize] = key;
            *start += 1;
        }
        core::mem::swap(keys, spare);
    }
}

/// Bits that are `N` apart.
fn spread<const N: usize>(cell: u32) -> u32 {
    let mut code = 0;
    if N == 3 {
        let mut x = cell & 0x3ff;
        x = (x | x << 16) & 0x0300_00ff;
        x = (x | x << 8) & 0x0300_f00f;
        x = (x | x << 4) & 0x030c_30c3;
        return (x | x << 2) & 0x0924_9249;
    }
    for bit in 0..32 / N {
        code |= (cell >> bit & 1) << (bit * N);
    }
    code
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_query_has_one_place_and_neighbours_are_near() {
        let queries: Vec<[f32; 3]> =
            (0..1000u32).map(|i| [i % 10, i / 10 % 10, i / 100].map(|x| x as f32)).collect();
        let (mut keys, mut spare) = (Vec::new(), Vec::new());
        along_curve(&queries, [0.0; 3], [9.0; 3], &mut keys, &mut spare);
        let mut places: Vec<u32> = keys.iter().map(|&key| key as u32).collect();
        assert!(keys.is_sorted());
        let path: f32 = places
            .windows(2)
            .map(|two| {
                let [a, b] = [queries[two[0] as usize], queries[two[1] as usize]];
                (0..3).map(|axis| (a[axis] - b[axis]).abs()).sum::<f32>()
            })
            .sum();
        // In the order that they have, or any random one, it is 3 to 10 a step.
        assert!(path < 2400.0, "{path}");
        places.sort_unstable();
        assert!(places.iter().copied().eq(0..1000));
        assert_eq!(spread::<2>(0b1011), 0b100_0101);
        assert_eq!(spread::<3>(0b1011), 0b10_0000_1001);
    }
}
