//! Pseudorandom numbers that depend on nothing but the hashed input.

/// A hash of a seed and some whole numbers (the finaliser of SplitMix64, Steele et al. 2014, once a
/// number).
pub fn hash(seed: u64, numbers: &[u64]) -> u64 {
    numbers.iter().fold(mix(seed), |state, &number| mix(state ^ number))
}

/// Such a hash as a number from 0 to 1, 1 excluded.
pub fn unit(seed: u64, numbers: &[u64]) -> f64 {
    (hash(seed, numbers) >> 11) as f64 / (1u64 << 53) as f64
}

fn mix(state: u64) -> u64 {
    let mut z = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_fill_the_unit_interval() {
        let mean = (0..10_000).map(|i| unit(1, &[i])).sum::<f64>() / 1e4;
        assert!((mean - 0.5).abs() < 0.02, "{mean}");
        assert_ne!(hash(1, &[2, 3]), hash(1, &[3, 2]));
    }

    /// The first number of the published generator with seed 0.
    #[test]
    fn the_finaliser_is_the_published_one() {
        assert_eq!(mix(0), 0xe220_a839_7b1d_cdaf);
    }
}
