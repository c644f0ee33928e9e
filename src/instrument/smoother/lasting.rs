//! How much of the raw heading's noise is not smoothed away.

use super::square;

/// How much of the raw heading's noise lasts, and is not smoothed away: the filter cannot tell it from the truth. A
/// mean over five seconds of noise that lasts for half a second has an eleventh of its variance, of noise that lasts
/// as long as a turn most of it.
#[derive(Clone, Debug)]
pub(super) struct Lasting {
    /// Mean of the difference between raw and smooth heading, radians.
    mean_rad: f32,
    /// Its mean square, over the variance of the difference.
    share: f32,
    /// For how long it has been learnt, seconds.
    learnt_s: f32,
}

impl Lasting {
    /// Mean age of what the mean is of, seconds.
    const MEAN_AGE_S: f32 = 5.0;

    /// The same of the share, and what the first guess counts for, seconds.
    const MEMORY_S: f32 = 120.0;
    const GUESS_S: f32 = 10.0;

    /// The filter follows a third of what lasts so long, which the difference then lacks: found by simulation.
    const FOLLOWED: f32 = 1.5;

    /// Nothing learnt yet.
    pub const NEW: Self = Self { mean_rad: 0.0, share: 0.15, learnt_s: Self::GUESS_S };

    /// What the raw heading's variance is multiplied by for what lasts of it.
    pub fn share(&self) -> f32 {
        (Self::FOLLOWED * self.share).min(1.0)
    }

    /// The filter begins anew; what has been learnt stays.
    pub fn begin(&mut self) {
        self.mean_rad = 0.0;
    }

    /// Takes the difference of an instant with the variance that it should have.
    pub fn see(&mut self, off_rad: f32, variance: f32, step_s: f32) {
        self.mean_rad += (off_rad - self.mean_rad) * step_s / (Self::MEAN_AGE_S + step_s);
        self.learnt_s = (self.learnt_s + step_s).min(Self::MEMORY_S);
        let share = (square(self.mean_rad) / variance).min(1.0);
        self.share += (share - self.share) * step_s / (self.learnt_s + step_s);
    }
}
