//! Whether the smooth heading is believed.

use super::{DEG, Step, square};

/// What the raw heading says of the smooth one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Agreed {
    /// They have said the same for long enough.
    Yes,
    /// They have not, or not for long.
    NotYet,
    /// They have not for so long that the filter is lost.
    Lost,
}

/// Whether raw and smooth heading say the same: the mean of their difference over two seconds within three of their
/// joint sigmas. A gyro that is quickly wrong shows sooner, in two differences one after the other of four sigmas; or
/// of four times what they scatter from one to the next, where the raw heading is noisier than it says. A single one
/// is nothing.
#[derive(Clone, Debug)]
pub(super) struct Agreement {
    /// Mean of the difference, radians.
    mean_rad: f32,
    /// The difference before.
    last_rad: f32,
    /// What the differences scatter from one to the next: the mean of half the square of that step.
    scatter: f32,
    /// The difference before was too large, and to this side.
    beyond: Option<bool>,
    /// For how long they have agreed, up to how long they have to, seconds.
    agreed_s: f32,
    /// What they have yet to turn in agreement, radians.
    owed_rad: f32,
    /// For how long they have not, seconds.
    against_s: f32,
    /// See [`Self::doubt`].
    doubt: f32,
}

impl Agreement {
    /// Mean age of what the means are of, seconds: that of two seconds in a row.
    const MEAN_AGE_S: f32 = 1.0;

    /// The mean difference may be so many joint sigmas.
    const MEAN_SIGMAS: f32 = 3.0;

    /// A single one.
    const SINGLE_SIGMAS: f32 = 4.0;

    /// So long they have to agree, seconds.
    const SETTLED_S: f32 = 2.0;

    /// After a contradiction they have to agree in a turn, or in as much to and fro, radians: a gyro that is wrong
    /// agrees as long as nothing turns.
    const PROOF_RAD: f32 = 45.0 * DEG;

    /// After so long the filter is lost, seconds.
    const LOST_AFTER_S: f32 = 5.0;

    /// Nothing seen yet.
    pub const NEW: Self = Self {
        mean_rad: 0.0,
        last_rad: 0.0,
        scatter: 0.0,
        beyond: None,
        agreed_s: 0.0,
        owed_rad: 0.0,
        against_s: 0.0,
        doubt: 0.0,
    };

    /// The filter begins anew, and what was owed before is still owed.
    pub fn begin(&mut self) {
        *self = Self { owed_rad: self.owed_rad, ..Self::NEW };
    }

    /// What the square of the mean difference is beyond its variance, radians squared: one of the two is off by that,
    /// and it may be the smooth one.
    pub const fn doubt(&self) -> f32 {
        self.doubt
    }

    /// Takes the difference of an instant with the variance that it should have, and what the gyro has turned since the
    /// one before.
    pub fn see(&mut self, off_rad: f32, variance: f32, step: Step) -> Agreed {
        let Step { step_s, turned_rad } = step;
        let part = step_s / (Self::MEAN_AGE_S + step_s);
        self.mean_rad += part * (off_rad - self.mean_rad);
        self.doubt = (square(self.mean_rad) - variance).max(0.0);
        let usual = square(Self::SINGLE_SIGMAS) * variance.max(self.scatter);
        self.scatter += part * (0.5 * square(off_rad - self.last_rad) - self.scatter);
        self.last_rad = off_rad;
        let beyond = (square(off_rad) > usual).then_some(off_rad > 0.0);
        let is_quick = beyond.is_some() && beyond == self.beyond;
        self.beyond = beyond;
        if is_quick || square(self.mean_rad) > square(Self::MEAN_SIGMAS) * variance {
            (self.agreed_s, self.owed_rad) = (0.0, Self::PROOF_RAD);
            self.against_s += step_s;
            return if self.against_s > Self::LOST_AFTER_S { Agreed::Lost } else { Agreed::NotYet };
        }
        self.against_s = 0.0;
        self.agreed_s = (self.agreed_s + step_s).min(Self::SETTLED_S);
        self.owed_rad = (self.owed_rad - turned_rad.abs()).max(0.0);
        if self.agreed_s >= Self::SETTLED_S && self.owed_rad <= 0.0 { Agreed::Yes } else { Agreed::NotYet }
    }
}
