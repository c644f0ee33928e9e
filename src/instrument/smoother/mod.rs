//! The smooth heading: the raw one and the attitude source's body rates in a filter of two states.
//!
//! Each raw heading has the error of the attitude and of the reading at its instant, which lasts for seconds; what the
//! gyro says between two instants has next to none of it, but drifts. The filter holds the heading and the gyro's bias:
//!
//! ```text
//! psi  += turned - beta dt        Q_psi = 0.2^2 deg^2/s dt, and 3 % of what turned
//! beta += 0                       Q_beta = 0.002^2 (deg/s)^2/s dt
//! z     = raw - psi               R = v 2 tau / dt, v the raw heading's variance without the coefficients' share
//! ```
//!
//! An error that lasts for a time `tau` and is measured every `dt` weighs as much as a white one of `2 tau / dt` times
//! its variance. What is far off weighs less.
//!
//! What the filter itself takes for its variance is no standard deviation to send: in simulation, with a gyro without
//! errors, it is three times too large, on recorded flights half of what it must be. So the part of the raw heading's
//! noise that is not smoothed away is learnt ([`Lasting`]). The coefficients' share comes on top: it is the same from
//! one reading to the next, and no smoothing takes anything off it.
//!
//! The smooth heading is told only while it and the raw one say the same ([`Agreement`]): a gyro that is wrong shows in
//! the first turn.

mod agreement;
mod lasting;

use crate::attitude::Turning;
use crate::frames::{wrap_pi, wrap_two_pi};
use crate::heading::Heading;
use crate::time::Timestamp;
use agreement::{Agreed, Agreement};
use lasting::Lasting;

/// How long the error of a raw heading lasts, seconds: that of an attitude source's filter.
const CORRELATION_S: f32 = 2.0;

/// Without a raw heading for longer, the filter begins anew, microseconds.
const MAX_GAP_US: u64 = 3_000_000;

/// Faster than once round a second nothing is smoothed, radians a second.
const MAX_TURNING_RAD_S: f32 = core::f32::consts::TAU;

/// Of the heading by the gyro, radians squared a second: a random walk of 0.2 deg in a second. A
/// gyro alone has a tenth of it; the rest is for angles that are not those of the rates' instant.
const HEADING_WALK: f32 = square(0.2 * DEG);

/// The same of the gyro's bias, (rad/s)^2 a second: 0.002 deg/s.
const BIAS_WALK: f32 = square(0.002 * DEG);

/// What is thought of the gyro's bias at the beginning, (rad/s)^2: an autopilot has taken most of it off.
const BIAS_VARIANCE: f32 = square(0.1 * DEG);

/// What a gyro and the angles it is turned by leave of a turn: 3 % of each tenth of a second, seconds.
const SCALE_WALK_S: f32 = square(0.03) * 0.1;

/// No raw heading is better than 0.05 deg, and none worse than any, radians squared.
const LEAST_VARIANCE: f32 = square(0.05 * DEG);
const MOST_VARIANCE: f32 = square(180.0 * DEG);

/// Beyond so many sigmas, a raw heading weighs less.
const FAR_SIGMAS: f32 = 3.0;

const DEG: f32 = core::f32::consts::PI / 180.0;

const fn square(x: f32) -> f32 {
    x * x
}

/// The filter, whether it is believed, and how much it takes off. 84 bytes.
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
    #[inline(never)]
    pub fn smooth(&mut self, at: Timestamp, raw: Option<&Heading>, turning: Option<Turning>) -> Option<Heading> {
        let turning = turning?;
        if turning.motion.heading_rad_s.abs() > MAX_TURNING_RAD_S {
            self.state = None;
        }
        let raw = raw?;
        #[expect(clippy::manual_clamp, reason = "what is not a number becomes one here, and would not in a clamp")]
        let variance = (square(raw.sigma_rad) - raw.systematic_rad2).max(LEAST_VARIANCE).min(MOST_VARIANCE);
        let agreed = self.follow(at, raw.magnetic_rad, variance, &turning);
        if agreed == Agreed::Lost {
            self.agreement.begin();
            self.lasting.begin();
            self.state = Some(State::starting(at, raw.magnetic_rad, variance, &turning));
        }
        let state = self.state.as_ref().filter(|_| agreed == Agreed::Yes)?;
        let noise = self.lasting.share() * variance + self.agreement.doubt();
        Some(Heading {
            magnetic_rad: wrap_two_pi(state.heading_rad),
            sigma_rad: libm::sqrtf(noise + raw.systematic_rad2),
            systematic_rad2: raw.systematic_rad2,
        })
    }

    /// Carries the filter on to a raw heading and gives it that; lost where it cannot follow.
    fn follow(&mut self, at: Timestamp, raw_rad: f32, variance: f32, turning: &Turning) -> Agreed {
        let Some(state) = &mut self.state else { return Agreed::Lost };
        let Some(step) = state.predict(at, turning) else { return Agreed::Lost };
        let off_rad = wrap_pi(raw_rad - state.heading_rad);
        if !off_rad.is_finite() {
            return Agreed::Lost; // Nothing that is not a number stays.
        }
        let expected = state.variance() + variance;
        self.lasting.see(off_rad, expected, step.step_s);
        let agreed = self.agreement.see(off_rad, expected, step);
        state.measure(off_rad, variance, step.step_s);
        agreed
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

    /// Carries it on to an instant by what the gyro has turned since. None where that is not known: after a gap, or
    /// with another run of the gyro.
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

#[cfg(test)]
mod tests;
