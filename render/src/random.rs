//! Sequences that look random and are whole numbers on the way, so that every device has the same.

/// A hash of three words (Jarzynski and Olano 2020, PCG3D).
pub(crate) fn hash3(mut v: [u32; 3]) -> [u32; 3] {
    v = v.map(|x| x.wrapping_mul(1_664_525).wrapping_add(1_013_904_223));
    v[0] = v[0].wrapping_add(v[1].wrapping_mul(v[2]));
    v[1] = v[1].wrapping_add(v[2].wrapping_mul(v[0]));
    v[2] = v[2].wrapping_add(v[0].wrapping_mul(v[1]));
    v = v.map(|x| x ^ (x >> 16));
    v[0] = v[0].wrapping_add(v[1].wrapping_mul(v[2]));
    v[1] = v[1].wrapping_add(v[2].wrapping_mul(v[0]));
    v[2] = v[2].wrapping_add(v[0].wrapping_mul(v[1]));
    v
}

/// The upper 24 bits as a number from 0 to 1, 1 excluded. Exact.
pub(crate) fn unit(word: u32) -> f32 {
    (word >> 8) as f32 * (1.0 / 16_777_216.0)
}

/// Where in its pixel a sample lies: the sequence R2 (Roberts 2018), which starts at the centre.
pub(crate) fn sample_offset(sequence: u32) -> [f32; 2] {
    [0xc13f_a9a9, 0x91e1_0da5u32]
        .map(|step: u32| unit(0x8000_0000u32.wrapping_add(step.wrapping_mul(sequence))))
}

/// Three numbers for a sample of the surfaces that shine: the sequence R3, shifted by a hash of where
/// it is used (Cranley and Patterson 1976).
pub(crate) fn light_sample(pixel: u32, wave: u32, seed: u32, index: u32) -> [u32; 3] {
    let shift = hash3([pixel, wave, seed]);
    let steps = [0xd1b5_4a32u32, 0xabc9_8388, 0x8cb9_2ba7];
    std::array::from_fn(|i| shift[i].wrapping_add(steps[i].wrapping_mul(index)))
}

/// The uses of random numbers at one point of a path: each has numbers of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub(crate) enum Use {
    /// Which part of a surface answers, and whether the path goes on.
    Choice = 0,
    /// The direction in which the path goes on.
    Direction = 1,
    /// A direction of the environment.
    Sky = 2,
    /// Points of shining triangles; two for each sample from here on.
    Area = 3,
}

/// Two numbers from 0 to 1, 1 excluded, for a use.
pub(crate) fn pair(key: [u32; 3], index: u32) -> [f32; 2] {
    words(key, index).map(unit)
}

/// The words of [`pair`]: point `index` of the (0, 2) sequence of Sobol in base 2, shuffled and
/// scrambled by a hash of where it is used (Burley 2020, after Owen 1995; the hash is that of Laine and Karras 2011 with
/// Burley's constants). Points of one key are stratified; those of two keys are independent.
pub(crate) fn words(key: [u32; 3], index: u32) -> [u32; 2] {
    let [order, first, second] = hash3(key);
    let index = scramble(index, order);
    [scramble(index.reverse_bits(), first), scramble(sobol(index), second)]
}

/// The key of a use at a point of a path. `which` is the pixel of a path from the camera.
pub(crate) fn key(which: u32, wave: u32, used: u32, seed: u32) -> [u32; 3] {
    [which, wave * 32 + used, seed]
}

/// The key of a use of photons at a bounce; those that leave the lights use `wave` 0 and `used` from 0, by light.
pub(crate) fn photon_key(pass: u32, wave: u32, used: u32, seed: u32) -> [u32; 3] {
    [pass, 0x8000_0000 | wave << 16 | used, seed]
}

/// The second dimension of the sequence.
fn sobol(mut index: u32) -> u32 {
    let (mut result, mut direction) = (0, 1u32 << 31);
    while index != 0 {
        if index & 1 == 1 {
            result ^= direction;
        }
        index >>= 1;
        direction ^= direction >> 1;
    }
    result
}

/// Owen's scrambling: every bit is turned over or not as the bits above it decide.
fn scramble(x: u32, seed: u32) -> u32 {
    let mut x = x.reverse_bits().wrapping_add(seed);
    for factor in [0x6c50_b47cu32, 0xb82f_1e52, 0xc7af_e638, 0x8d22_f6e6] {
        x ^= x.wrapping_mul(factor);
    }
    x.reverse_bits()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_sample_is_the_centre_and_sixteen_fill_the_pixel() {
        assert_eq!(sample_offset(0), [0.5, 0.5]);
        let mut cells = [false; 16];
        for i in 0..64 {
            let [x, y] = sample_offset(i);
            cells[(x * 4.0) as usize + 4 * (y * 4.0) as usize] = true;
        }
        assert_eq!(cells, [true; 16]);
    }

    #[test]
    fn hashes_fill_the_unit_cube() {
        let mut sums = [0.0f64; 3];
        for i in 0..4096 {
            for (sum, word) in sums.iter_mut().zip(hash3([i, 7, 1])) {
                *sum += f64::from(unit(word)) / 4096.0;
            }
        }
        assert!(sums.iter().all(|mean| (mean - 0.5).abs() < 0.02), "{sums:?}");
    }

    /// Of 2^n points that follow one another, every box of area 2^-n holds one.
    #[test]
    fn pairs_are_stratified_and_those_of_two_keys_are_not_the_same() {
        for seed in 0..20 {
            for bits in 0..=4 {
                let mut boxes = [false; 16];
                for index in 32..48 {
                    let [x, y] = pair([7, 1, seed], index);
                    let (columns, rows) = ((1 << bits) as f32, (16 >> bits) as f32);
                    boxes[(x * columns) as usize + (y * rows) as usize * (1 << bits)] = true;
                }
                assert_eq!(boxes, [true; 16], "{seed} {bits}");
            }
        }
        assert_ne!(pair(key(3, 0, 0, 1), 5), pair(key(3, 0, 1, 1), 5));
        assert_ne!(pair(key(3, 0, 0, 1), 5), pair(key(3, 1, 0, 1), 5));
    }

    /// Products of numbers of two keys have the mean of independent ones.
    #[test]
    fn pairs_of_two_keys_are_independent() {
        let mut sum = 0.0f64;
        for index in 0..65_536 {
            let [x, _] = pair(key(3, 0, 0, 1), index);
            let [y, _] = pair(key(3, 0, 1, 1), index);
            sum += f64::from(x) * f64::from(y) / 65_536.0;
        }
        assert!((sum - 0.25).abs() < 0.005, "{sum}");
    }
}
