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
}
