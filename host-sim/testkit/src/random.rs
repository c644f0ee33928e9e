//! Seeded random numbers for tests, equal on every computer. The simulator has its own generator with a stream per
//! purpose.

/// Splitmix64 generator (G. L. Steele et al., "Fast splittable pseudorandom number generators", OOPSLA 2014).
#[derive(Clone, Debug)]
pub struct Random(pub u64);

impl Random {
    /// 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// A random byte.
    pub fn byte(&mut self) -> u8 {
        self.bits() as u8
    }

    /// `count` random bytes.
    pub fn bytes(&mut self, count: usize) -> Vec<u8> {
        (0..count).map(|_| self.byte()).collect()
    }

    /// Uniformly distributed over `low..high`.
    pub fn uniform(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * ((self.bits() >> 40) as f32 / (1_u64 << 24) as f32)
    }

    /// Standard normal, approximated to three sigmas by the sum of twelve uniform numbers.
    pub fn normal(&mut self) -> f32 {
        (0..12).map(|_| self.uniform(-0.5, 0.5)).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::Random;

    /// 100,000 numbers determine mean and variance to 0.3 % and 0.5 %; the bounds are six times that.
    #[test]
    fn random_numbers_have_their_mean_and_variance() {
        const NUMBER: usize = 100_000;
        let mut random = Random(1);
        let moments = |numbers: Vec<f64>| {
            let mean = numbers.iter().sum::<f64>() / NUMBER as f64;
            (mean, numbers.iter().map(|value| (value - mean) * (value - mean)).sum::<f64>() / NUMBER as f64)
        };
        let (mean, variance) = moments((0..NUMBER).map(|_| f64::from(random.normal())).collect());
        assert!(mean.abs() < 0.02 && (variance - 1.0).abs() < 0.03, "{mean} {variance}");
        let (mean, variance) = moments((0..NUMBER).map(|_| f64::from(random.uniform(-1.0, 3.0))).collect());
        assert!((mean - 1.0).abs() < 0.03 && (variance - 16.0 / 12.0).abs() < 0.03, "{mean} {variance}");
    }

    /// First numbers for seed 0 of the paper's reference implementation.
    #[test]
    fn seed_0_gives_the_reference_numbers() {
        let mut random = Random(0);
        assert_eq!([random.bits(), random.bits()], [0xE220_A839_7B1D_CDAF, 0x6E78_9E6A_A1B9_65F4]);
    }
}
