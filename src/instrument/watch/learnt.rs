//! How much the samples scatter, learnt from them: what the calibration found, and what the last seconds show.

/// Variances of a sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Variances {
    /// Of the strength, relative; of one sample, which has the mean of its readings.
    pub strength: f32,
    /// Of each of the two angles by which the attitude leans wrongly, square radians.
    pub tilt_rad2: f32,
}

/// Fixed numbers of this module.
#[derive(Clone, Copy, Debug)]
pub struct Config {
    /// Seconds over which the last residuals count.
    pub time_s: f32,
    /// Part of a variance that is of the last seconds; the rest is the calibration's.
    pub recent: f32,
    /// A residual of the dip counts as no more than so many of the calibration's sigmas: what is more is not noise.
    pub max_tilt_sigmas: f32,
    /// The same of the strength.
    pub max_strength_sigmas: f32,
    /// The strength is not taken to be off by less than this, ...
    pub min_strength: f32,
    /// ... nor by more: what is more is a disturbance.
    pub max_strength: f32,
    /// Seconds over which it is learnt how alike the errors of neighbouring samples are.
    pub alike_time_s: f32,
    /// How alike they are before that is learnt: the correlation of one sample's dip with the next one's, ...
    pub alike: f32,
    /// ... and how alike at the least and at the most.
    pub alike_range: [f32; 2],
}

impl Config {
    /// Measured on recorded flights: ten seconds, three quarters.
    pub const DEFAULT: Self = Self {
        time_s: 10.0,
        recent: 0.75,
        max_tilt_sigmas: 4.0,
        max_strength_sigmas: 6.0,
        min_strength: 0.003,
        max_strength: 0.008,
        alike_time_s: 30.0,
        alike: 0.78,
        alike_range: [0.6, 0.9],
    };
}

/// The variances of the last seconds.
#[derive(Clone, Copy, Debug)]
pub(super) struct Learnt {
    recent: Variances,
    /// The last two strengths, the newer one last.
    strengths: [f32; 2],
    /// The last dip's residual, radians, and means of its square and of its product with the one before.
    dip_rad: f32,
    dip_squared: f32,
    dip_product: f32,
    /// Mean of the square of the strength's residual: what is not white is in it, too.
    strength_squared: f32,
}

impl Learnt {
    /// The last seconds were as the calibration.
    pub fn new(config: &Config, own: Variances, strength: f32) -> Self {
        let dip_squared = own.tilt_rad2 + own.strength;
        Self {
            recent: own,
            strengths: [strength; 2],
            dip_rad: 0.0,
            dip_squared,
            dip_product: config.alike * dip_squared,
            strength_squared: own.strength.max(config.min_strength * config.min_strength),
        }
    }

    /// By how much the variance of a dip is to be multiplied for its errors being alike, so that a sum of many is off by
    /// what it is: `(1 + rho) / (1 - rho)`.
    pub fn alike(&self, config: &Config) -> f32 {
        let [least, most] = config.alike_range;
        // A square of nothing makes no number, which no comparison lets pass.
        let rho = (self.dip_product / self.dip_squared).max(least).min(most);
        (1.0 + rho) / (1.0 - rho)
    }

    /// What a sample is likely to be off, given what it is by the calibration.
    pub fn variances(&self, config: &Config, own: Variances) -> Variances {
        let mixed = |recent: f32, own: f32| own + config.recent * (recent - own);
        Variances {
            strength: mixed(self.recent.strength, own.strength),
            tilt_rad2: mixed(self.recent.tilt_rad2.max(0.0), own.tilt_rad2),
        }
    }

    /// What the strength is off by, slow errors included: currents, and what no coefficients explain.
    pub const fn strength_squared(&self) -> f32 {
        self.strength_squared
    }

    /// Takes what the strength of a sample is off by.
    pub fn see_off_strength(&mut self, config: &Config, residual: f32, step_s: f32) {
        let least = config.min_strength * config.min_strength;
        let most = config.max_tilt_sigmas * config.max_tilt_sigmas * self.strength_squared;
        follow(&mut self.strength_squared, (residual * residual).min(most).max(least), step_s / config.alike_time_s);
        self.strength_squared = self.strength_squared.min(config.max_strength * config.max_strength);
    }

    /// Takes the strength of a sample, `step_s` after the one before. Its second difference is of white noise alone, of
    /// six times its variance: what changes slowly cancels.
    pub fn see_strength(&mut self, config: &Config, own: Variances, strength: f32, step_s: f32) {
        let [before, last] = self.strengths;
        self.strengths = [last, strength];
        let second = strength - 2.0 * last + before;
        let most = config.max_strength_sigmas * config.max_strength_sigmas * own.strength;
        follow(&mut self.recent.strength, (second * second / 6.0).min(most), step_s / config.time_s);
    }

    /// Takes the residual of the dip, radians, of a sample `step_s` after the one before. The sensor's noise is in it,
    /// too, and is taken out.
    pub fn see_dip(&mut self, config: &Config, own: Variances, residual_rad: f32, step_s: f32) {
        let most = config.max_tilt_sigmas * config.max_tilt_sigmas * own.tilt_rad2;
        let most_rad = libm::sqrtf(most);
        let residual_rad = residual_rad.max(-most_rad).min(most_rad);
        follow(&mut self.recent.tilt_rad2, residual_rad * residual_rad - self.recent.strength, step_s / config.time_s);
        let part = step_s / config.alike_time_s;
        follow(&mut self.dip_squared, residual_rad * residual_rad, part);
        follow(&mut self.dip_product, residual_rad * self.dip_rad, part);
        self.dip_rad = residual_rad;
    }
}

/// An average that forgets.
fn follow(mean: &mut f32, value: f32, part: f32) {
    *mean += part.min(1.0) * (value - *mean);
}

#[cfg(test)]
mod tests {
    use testkit::random::Random;

    use super::*;

    const OWN: Variances = Variances { strength: 1e-4, tilt_rad2: 4e-4 };

    /// Noise of this many of the calibration's sigmas for a time, every tenth of a second, on a strength that drifts by
    /// a tenth of a percent a second.
    fn after(sigmas: f32, seconds: u16) -> Variances {
        let mut random = Random(1);
        let mut learnt = Learnt::new(&Config::DEFAULT, OWN, 1.0);
        for i in 0..10 * seconds {
            let strength = 1.0 + 1e-4 * f32::from(i) + 0.01 * sigmas * random.normal();
            learnt.see_strength(&Config::DEFAULT, OWN, strength, 0.1);
            let of_sensor = 0.01 * sigmas * random.normal();
            learnt.see_dip(&Config::DEFAULT, OWN, 0.02 * sigmas * random.normal() + of_sensor, 0.1);
        }
        learnt.variances(&Config::DEFAULT, OWN)
    }

    /// A quarter of the calibration's and three quarters of what is, to the scatter of the samples of ten seconds (about
    /// a tenth, more of second differences).
    #[test]
    fn the_last_seconds_count_three_quarters() {
        for (sigmas, expected) in [(1.0, 1.0), (2.0, 3.25), (0.0, 0.25)] {
            let found = after(sigmas, 120);
            assert!((found.strength / OWN.strength / expected - 1.0).abs() < 0.25, "{sigmas}: {found:?}");
            assert!((found.tilt_rad2 / OWN.tilt_rad2 / expected - 1.0).abs() < 0.25, "{sigmas}: {found:?}");
        }
    }

    /// After ten seconds `1 - 1/e` of a change is learnt.
    #[test]
    fn ten_seconds_are_remembered() {
        let mut learnt = Learnt::new(&Config::DEFAULT, OWN, 1.0);
        for _ in 0..100 {
            // (0.04 rad)^2, and the sensor's.
            learnt.see_dip(&Config::DEFAULT, OWN, 0.041_23, 0.1);
        }
        let recent = learnt.recent.tilt_rad2 / OWN.tilt_rad2;
        assert!((recent - (1.0 + 3.0 * 0.632)).abs() < 0.02, "{recent}");
    }

    /// Sixteen and thirty-six times the calibration's variance are the most that counts.
    #[test]
    fn what_is_no_noise_is_clipped() {
        let mut learnt = Learnt::new(&Config::DEFAULT, OWN, 1.0);
        for i in 0..2000_u16 {
            learnt.see_strength(&Config::DEFAULT, OWN, f32::from(i % 2), 0.1);
        }
        assert!((learnt.recent.strength / OWN.strength - 36.0).abs() < 0.01, "{learnt:?}");
        let mut learnt = Learnt::new(&Config::DEFAULT, OWN, 1.0);
        for _ in 0..2000 {
            learnt.see_dip(&Config::DEFAULT, OWN, 1.0, 0.1);
        }
        // Less the sensor's, a quarter of one.
        assert!((learnt.recent.tilt_rad2 / OWN.tilt_rad2 - 15.75).abs() < 0.01, "{learnt:?}");
    }

    /// A dip that scatters by less than the sensor alone makes it leaves no less than nothing to the attitude.
    #[test]
    fn no_variance_is_negative() {
        let mut learnt = Learnt::new(&Config::DEFAULT, OWN, 1.0);
        for _ in 0..2000 {
            learnt.see_dip(&Config::DEFAULT, OWN, 0.0, 0.1);
        }
        let found = learnt.variances(&Config::DEFAULT, OWN);
        assert!((found.tilt_rad2 - 1e-4).abs() < 1e-9, "a quarter of the calibration's: {found:?}");
    }

    /// A gap of minutes forgets, and no more.
    #[test]
    fn a_long_gap_replaces() {
        let mut learnt = Learnt::new(&Config::DEFAULT, OWN, 1.0);
        learnt.see_dip(&Config::DEFAULT, OWN, 0.014_142, 1000.0);
        assert!((learnt.recent.tilt_rad2 - 1e-4).abs() < 1e-8, "{learnt:?}");
    }
}
