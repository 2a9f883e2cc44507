//! Seeded random numbers: PCG32 (O'Neill 2014), so that a failing case is named by its seed.

/// A small generator whose sequence is part of the tests: never change it.
#[derive(Clone, Debug)]
pub struct Random {
    state: u64,
}

impl Random {
    /// A generator; equal seeds give equal sequences.
    pub fn new(seed: u64) -> Random {
        let mut random = Random { state: 0 };
        random.bits();
        random.state = random.state.wrapping_add(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15));
        random.bits();
        random
    }

    /// 32 random bits.
    pub fn bits(&mut self) -> u32 {
        let old = self.state;
        self.state = old.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(0x14057b7ef767814f);
        let shifted = (((old >> 18) ^ old) >> 27) as u32;
        shifted.rotate_right((old >> 59) as u32)
    }

    /// Uniform in `[0, 1)`, with 53 random bits.
    pub fn unit(&mut self) -> f64 {
        let high = u64::from(self.bits()) << 21;
        let low = u64::from(self.bits()) >> 11;
        (high | low) as f64 / (1u64 << 53) as f64
    }

    /// Uniform in `[lo, hi)`.
    pub fn between(&mut self, lo: f64, hi: f64) -> f64 {
        lo + (hi - lo) * self.unit()
    }

    /// Uniform in `[-1, 1)`, of 2^24 floats that are equally far apart.
    pub fn signed(&mut self) -> f32 {
        (self.bits() >> 8) as f32 / 8_388_608.0 - 1.0
    }

    /// A point of the cube whose coordinates are within `reach` of 0.
    pub fn point(&mut self, reach: f32) -> [f32; 3] {
        [(); 3].map(|()| self.signed() * reach)
    }

    /// Uniform below `n`, which must not be 0.
    pub fn below(&mut self, n: usize) -> usize {
        ((u64::from(self.bits()) * n as u64) >> 32) as usize
    }

    /// One of the items.
    pub fn pick<T: Copy>(&mut self, items: &[T]) -> T {
        items[self.below(items.len())]
    }

    /// A uniform direction of length 1.
    pub fn direction(&mut self) -> [f64; 3] {
        loop {
            let d = [(); 3].map(|()| self.between(-1.0, 1.0));
            let squared = d.iter().map(|x| x * x).sum::<f64>();
            if squared > 1e-4 && squared <= 1.0 {
                return d.map(|x| x / squared.sqrt());
            }
        }
    }

    /// Uniform barycentric weights.
    pub fn barycentric(&mut self) -> [f64; 3] {
        let (mut u, mut v) = (self.unit(), self.unit());
        if u + v > 1.0 {
            (u, v) = (1.0 - u, 1.0 - v);
        }
        [1.0 - u - v, u, v]
    }

    /// Puts the items in random order (Fisher and Yates).
    pub fn shuffle<T>(&mut self, items: &mut [T]) {
        for i in (1..items.len()).rev() {
            items.swap(i, self.below(i + 1));
        }
    }
}
