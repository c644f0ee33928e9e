//! The smooth heading: the raw one and the attitude source's body rates in a filter of two states.
//!
//! Each raw heading has the error of the attitude and of the reading at its instant, which lasts for seconds; what the
//! gyro says between two instants has next to none of it, but drifts. The filter holds the heading and the gyro's bias:
//!
//! ```text
//! psi  += turned - beta dt        Q_psi = 0.1^2 deg^2/s dt, and 1 % of what turned
//! beta += 0                       Q_beta = 0.002^2 (deg/s)^2/s dt
//! z     = raw - psi               R = v 2 tau / dt, v the raw heading's variance without the coefficients' share
//! ```
//!
//! An error that lasts for a time `tau` and is measured every `dt` weighs as much as a white one of `2 tau / dt` times
//! its variance. What is far off weighs less. The coefficients' share of the variance is the same before and after, and
//! no smoothing takes anything off it.
//!
//! The smooth heading is told only while it and the raw one say the same ([`Agreement`]): a gyro that is wrong shows in
//! the first turn.

use crate::attitude::Turning;
use crate::frames::{wrap_pi, wrap_two_pi};
use crate::heading::Heading;
use crate::time::Timestamp;

/// How long the error of a raw heading lasts, seconds: that of an attitude source's filter.
const CORRELATION_S: f32 = 2.0;

/// Without a raw heading for longer, the filter begins anew, microseconds.
const MAX_GAP_US: u64 = 3_000_000;

/// Faster than once round a second nothing is smoothed, radians a second.
const MAX_TURNING_RAD_S: f32 = core::f32::consts::TAU;

/// Of the heading by the gyro, radians squared a second: a random walk of 0.1 deg in a second.
const HEADING_WALK: f32 = square(0.2 * DEG);

/// The same of the gyro's bias, (rad/s)^2 a second: 0.002 deg/s.
const BIAS_WALK: f32 = square(0.002 * DEG);

/// What is thought of the gyro's bias at the beginning, (rad/s)^2: an autopilot has taken most of it off.
const BIAS_VARIANCE: f32 = square(0.1 * DEG);

/// What a gyro and the angles it is turned by leave of a turn: 1 % of each tenth of a second, seconds.
const SCALE_WALK_S: f32 = square(0.03) * 0.1;

/// No raw heading is better, radians squared: 0.05 deg.
const LEAST_VARIANCE: f32 = square(0.05 * DEG);

/// Beyond so many sigmas, a raw heading weighs less.
const FAR_SIGMAS: f32 = 3.0;

const DEG: f32 = core::f32::consts::PI / 180.0;

const fn square(x: f32) -> f32 {
    x * x
}

/// The filter, and whether it is believed. 60 bytes.
#[derive(Clone, Debug)]
pub(super) struct Smoother {
    state: Option<State>,
    agreement: Agreement,
    lasting: Lasting,
}

impl Smoother {
    /// Before any heading.
    pub const fn new() -> Self {
        Self { state: None, agreement: Agreement::NEW, lasting: Lasting::NEW }
    }

    /// Forgets everything: what a heading is made with has changed.
    pub fn reset(&mut self) {
        *self = Self::new();
    }

    /// Takes the raw heading of an instant and what the gyro says of it; gives the smooth one, if it is to be told.
    pub fn smooth(&mut self, at: Timestamp, raw: Option<&Heading>, turning: Option<Turning>) -> Option<Heading> {
        let turning = turning?;
        if turning.motion.heading_rad_s.abs() > MAX_TURNING_RAD_S {
            self.state = None;
        }
        let raw = raw?;
        let variance = (square(raw.sigma_rad) - raw.coefficients_variance).max(LEAST_VARIANCE);
        let step = self.state.as_mut().and_then(|state| state.predict(at, &turning));
        let (Some(state), Some(step)) = (&mut self.state, step) else {
            self.agreement.begin();
            self.state = Some(State::starting(at, raw.magnetic_rad, variance, &turning));
            return None;
        };
        let off_rad = wrap_pi(raw.magnetic_rad - state.heading_rad);
        self.lasting.see(off_rad, state.variance() + variance, step.step_s);
        let agreed = self.agreement.see(off_rad, state.variance() + variance, step);
        if agreed == Agreed::Lost {
            self.agreement.begin();
            *state = State::starting(at, raw.magnetic_rad, variance, &turning);
            return None;
        }
        state.measure(off_rad, variance, step.step_s);
        (agreed == Agreed::Yes).then(|| Heading {
            magnetic_rad: wrap_two_pi(state.heading_rad),
            sigma_rad: libm::sqrtf(self.lasting.share * variance + raw.coefficients_variance),
            coefficients_variance: raw.coefficients_variance,
        })
    }
}

/// Heading and bias of the gyro with their covariance, `[c + u u b, u b; u b, b]`: that of the bias, how the heading
/// hangs on it, and what is left of the heading's if the bias were known. It is a covariance whatever rounding does, as
/// long as `b` and `c` are not negative, and both are sums and products of what is not.
#[derive(Clone, Debug)]
struct State {
    at: Timestamp,
    turned_rad: f32,
    run: u8,
    heading_rad: f32,
    bias_rad_s: f32,
    /// `b`.
    bias_variance: f32,
    /// `u`, seconds.
    by_bias_s: f32,
    /// `c`.
    known_bias_variance: f32,
}

/// From one raw heading to the next.
#[derive(Clone, Copy, Debug)]
struct Step {
    step_s: f32,
    /// By the gyro.
    turned_rad: f32,
}

impl State {
    fn starting(at: Timestamp, heading_rad: f32, variance: f32, turning: &Turning) -> Self {
        Self {
            at,
            turned_rad: turning.turned_rad,
            run: turning.run,
            heading_rad: wrap_pi(heading_rad),
            bias_rad_s: 0.0,
            bias_variance: BIAS_VARIANCE,
            by_bias_s: 0.0,
            known_bias_variance: variance,
        }
    }

    /// Variance of the heading.
    fn variance(&self) -> f32 {
        self.known_bias_variance + square(self.by_bias_s) * self.bias_variance
    }

    /// Carries it on to an instant by what the gyro has turned since. None where that is not known: after a gap, or with
    /// another run of the gyro.
    fn predict(&mut self, at: Timestamp, turning: &Turning) -> Option<Step> {
        let step_us = at.us_since(self.at);
        if turning.run != self.run || step_us > MAX_GAP_US {
            return None;
        }
        let step_s = step_us as f32 * 1e-6;
        let turned_rad = wrap_pi(turning.turned_rad - self.turned_rad);
        (self.at, self.turned_rad) = (at, turning.turned_rad);
        self.heading_rad = wrap_pi(self.heading_rad + turned_rad - self.bias_rad_s * step_s);
        self.by_bias_s -= step_s;
        let scale = SCALE_WALK_S * square(turning.motion.heading_rad_s);
        self.known_bias_variance += (HEADING_WALK + scale) * step_s;
        // The bias walks, and the heading hangs less on what it has become.
        let walk = BIAS_WALK * step_s;
        let walked = self.bias_variance + walk;
        self.known_bias_variance += square(self.by_bias_s) * self.bias_variance * walk / walked;
        self.by_bias_s *= self.bias_variance / walked;
        self.bias_variance = walked;
        Some(Step { step_s, turned_rad })
    }

    /// Takes a raw heading that is off by so much, with its variance; `step_s` after the one before.
    fn measure(&mut self, off_rad: f32, variance: f32, step_s: f32) {
        if step_s <= 0.0 {
            return; // The same instant again says nothing new.
        }
        let expected = self.variance() + variance;
        let far = (square(off_rad) / (square(FAR_SIGMAS) * expected)).max(1.0);
        let noise = far * variance * (2.0 * CORRELATION_S / step_s);
        let known = self.known_bias_variance;
        let heading_by_bias = self.by_bias_s * self.bias_variance;
        let sum = known + self.by_bias_s * heading_by_bias + noise;
        self.heading_rad = wrap_pi(self.heading_rad + off_rad * (known + self.by_bias_s * heading_by_bias) / sum);
        self.bias_rad_s += off_rad * heading_by_bias / sum;
        // The same in factors: Bierman, "Factorization Methods for Discrete Sequential Estimation", 1977, for two.
        let rest = noise / (known + noise);
        self.bias_variance *= (known + noise) / sum;
        self.by_bias_s *= rest;
        self.known_bias_variance *= rest;
    }
}

/// How much of the raw heading's noise lasts, and is not smoothed away: the filter cannot tell it from the truth. A mean
/// over ten seconds of noise that lasts for half a second has a twentieth of its variance, of noise that lasts as long as
/// a turn most of it.
#[derive(Clone, Debug)]
struct Lasting {
    /// Mean of the difference between raw and smooth heading, radians.
    mean_rad: f32,
    /// Its mean square, over the variance of the difference.
    share: f32,
    /// For how long it has been learnt, seconds.
    learnt_s: f32,
}

impl Lasting {
    /// Mean age of what the mean is of, seconds.
    const MEAN_AGE_S: f32 = 10.0;

    /// The same of the share, and what the first guess counts for, seconds.
    const MEMORY_S: f32 = 120.0;
    const GUESS_S: f32 = 10.0;

    const NEW: Self = Self { mean_rad: 0.0, share: 0.3, learnt_s: Self::GUESS_S };

    /// Takes the difference of an instant with the variance that it should have.
    fn see(&mut self, off_rad: f32, variance: f32, step_s: f32) {
        self.mean_rad += (off_rad - self.mean_rad) * step_s / (Self::MEAN_AGE_S + step_s);
        self.learnt_s = (self.learnt_s + step_s).min(Self::MEMORY_S);
        let share = (square(self.mean_rad) / variance).min(1.0);
        self.share += (share - self.share) * step_s / (self.learnt_s + step_s);
    }
}

/// What the raw heading says of the smooth one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Agreed {
    /// They have said the same for long enough.
    Yes,
    /// They have not, or not for long.
    NotYet,
    /// They have not for so long that the filter is lost.
    Lost,
}

/// Whether raw and smooth heading say the same: the mean of their difference over two seconds within three of their
/// joint sigmas. A gyro that is quickly wrong shows sooner, in two differences one after the other of four sigmas; or of
/// four times what they scatter from one to the next, where the raw heading is noisier than it says. A single one is
/// nothing.
#[derive(Clone, Debug)]
struct Agreement {
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

    /// After a contradiction they have to agree in a turn, or in as much to and fro, radians: a gyro that is wrong agrees
    /// as long as nothing turns.
    const PROOF_RAD: f32 = 45.0 * DEG;

    /// After so long the filter is lost, seconds.
    const LOST_AFTER_S: f32 = 5.0;

    const NEW: Self =
        Self { mean_rad: 0.0, last_rad: 0.0, scatter: 0.0, beyond: None, agreed_s: 0.0, owed_rad: 0.0, against_s: 0.0 };

    /// The filter begins anew, and what was owed before is still owed.
    fn begin(&mut self) {
        *self = Self { owed_rad: self.owed_rad, ..Self::NEW };
    }

    /// Takes the difference of an instant with the variance that it should have, and what the gyro has turned since the
    /// one before.
    fn see(&mut self, off_rad: f32, variance: f32, step: Step) -> Agreed {
        let Step { step_s, turned_rad } = step;
        let part = step_s / (Self::MEAN_AGE_S + step_s);
        self.mean_rad += part * (off_rad - self.mean_rad);
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
