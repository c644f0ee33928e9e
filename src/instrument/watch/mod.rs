//! The watch: field, attitude and gyro, held against each other ten times a second.
//!
//! A heading rests on the calibration and on the attitude, and neither says when it has ceased to be true. But what is
//! measured says more than a heading takes: the field's strength and inclination stay the same wherever the aircraft
//! points, its heading turns as the gyro does, and pitch and roll change as the gyro says. Eleven unknowns ([`model`])
//! explain what does not fit: hard iron that has moved, another place, a gyro that drifts, an attitude that leans or is
//! late. What they explain is taken out of the heading, with the sigma it leaves; what they do not explain
//! ([`contradiction`]) silences it.
//!
//! The filter is an extended Kalman filter in factors ([`factored`]), so that no rounding makes a variance negative. Its
//! residuals also teach how much the samples scatter ([`learnt`]).
//!
//! When something has changed, the variance of hard iron grows by the square of what is seen in all directions alike,
//! for what shows in two of them may be as large in the one that does not; the field's own and the attitude's grow, too.
//! Nothing is carried on by the gyro through a disturbance: that was tried, and was worse.

mod balance;
mod contradiction;
mod factored;
mod iron;
mod learnt;
mod model;
mod pushed;
#[cfg(test)]
mod tests;

use core::array;
use core::ops::Range;

use nalgebra::Vector3;

use crate::attitude::{Motion, Turning};
use crate::calibration::{Calibration, Sample, Uncertainty, inverse};
use crate::frames::{Attitude, Field, wrap_pi};
use crate::heading::{Heading, NoHeading};
use crate::time::Timestamp;
use crate::trig;
use balance::Balance;
use contradiction::{Contradiction, Deviation, PerKind, Verdict};
use factored::{Factored, Measurement};
use iron::Moved;
pub use iron::{Iron, IronNews};
use learnt::{Learnt, Variances};
use model::{
    BANK, BETA, DRIFT, Expected, INCLINATION, LATENCY, OFFSET, PITCH, Predicted, ROLL, STRENGTH, Seen, UNKNOWNS,
    Unknowns,
};
use pushed::Pushed;

/// Fixed numbers of the watch. Variances are in radians and parts of the total field.
#[derive(Clone, Copy, Debug)]
pub struct Config {
    /// Standard deviation of each unknown before the first sample, in the order of [`model`].
    pub sigmas: Unknowns,
    /// By how much its variance grows a second, as long as it is below that of the beginning: what wanders does so
    /// about where it is. The gyro's offset grows on.
    pub wander: Unknowns,
    /// The same of hard iron for so many seconds after something has changed: what has moved may move again.
    pub unsettled_s: f32,
    /// See `unsettled_s`.
    pub unsettled_sigma: f32,
    /// See `unsettled_s`.
    pub unsettled_wander: f32,
    /// What has changed need not be what the unknowns can explain: a heading's variance is so many times what they leave
    /// until it has settled.
    pub unsettled_times: f32,
    /// Hard iron of less than this fades, parts of the total field, and so do the attitude's errors: a calibration is
    /// taken to hold...
    pub max_fading: f32,
    /// ... by `1 - 1/e` in this time, seconds.
    pub fading_s: f32,
    /// Variances of the three measurements, per kind: so many times that of a sample; of the dip and of the heading, whose
    /// neighbouring errors are alike, times what is learnt of that, too, ...
    pub of_sample: PerKind<f32>,
    /// ... and so much more, for what no calibration models.
    pub floor: PerKind<f32>,
    /// Of what is left unknown of the coefficients, which is alike in all samples of an attitude, so many times the variance.
    pub coefficients_alike: f32,
    /// An attitude that changes is off by what it changes in this time besides, seconds.
    pub jitter_s: f32,
    /// A jump counts as no larger than this, parts of the total field.
    pub max_jump: f32,
    /// A jump of the attitude counts as no larger than this, radians.
    pub max_lean_rad: f32,
    /// Part of a jump that the attitude may be to blame for.
    pub lean: f32,
    /// No heading is told whose sigma by the watch is larger, radians.
    pub max_sigma_rad: f32,
    /// Hard iron that has moved by more is more than a calibration bears, parts of the total field.
    pub max_hard_iron: f32,
    /// Another place differs by no more in strength, ...
    pub max_strength: f32,
    /// ... and in inclination, radians.
    pub max_inclination_rad: f32,
    /// An attitude whose bias is larger is wrong, radians; and one that tells so much more or less of the bank.
    pub max_bias_rad: f32,
    /// See `max_bias_rad`.
    pub max_bank: f32,
    /// A reading whose heading is further from the gyro's, in sigmas of the difference, is not told.
    pub max_reading_sigmas: f32,
    /// When measurements contradict each other.
    pub contradiction: contradiction::Config,
    /// How the scatter is learnt.
    pub learnt: learnt::Config,
}

impl Config {
    /// Measured in the simulator, and tried on recorded flights.
    pub const DEFAULT: Self = Self {
        sigmas: [0.006, 0.006, 0.006, 0.06, 0.1, 10.0, 0.0026, 0.004, 0.004, 0.02, 0.1],
        wander: [1e-7, 1e-7, 1e-7, 1e-7, 1e-7, 1e-6, 1e-9, 3e-7, 3e-7, 1e-7, 3e-5],
        unsettled_s: 60.0,
        unsettled_sigma: 0.01,
        unsettled_wander: 1e-6,
        unsettled_times: 5.0,
        max_fading: 0.03,
        fading_s: 1000.0,
        of_sample: [4.0, 1.0, 0.75],
        floor: [9e-6, 9e-6, 1.44e-4],
        coefficients_alike: 8.0,
        jitter_s: 0.01,
        max_jump: 0.5,
        max_lean_rad: 0.3,
        lean: 0.5,
        max_sigma_rad: 0.14,
        max_hard_iron: 0.6,
        max_strength: 0.2,
        max_inclination_rad: 0.2,
        max_bias_rad: 0.15,
        max_bank: 0.5,
        max_reading_sigmas: 4.5,
        contradiction: contradiction::Config::DEFAULT,
        learnt: learnt::Config::DEFAULT,
    };
}

/// A longer time without a sample is a gap: the gyro's offset is found anew, seconds.
const GAP_S: f32 = 3.0;

/// Between the first sample and the one before it, seconds: none was.
const FIRST_STEP_S: f32 = 0.1;

/// What a variance of an angle on the circle is when nothing is known of it.
const ANYWHERE_RAD2: f32 = 10.0;

/// The calibration that is watched.
#[derive(Clone, Copy, Debug)]
pub(super) struct Watched<'a> {
    pub calibration: &'a Calibration,
    pub uncertainty: &'a Uncertainty,
    pub readings_per_sample: u16,
}

/// What the watch makes of it all.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Adjustment {
    unknowns: Unknowns,
    /// What it leaves unknown of a heading, square radians.
    pub variance_rad2: f32,
    /// Scatter of a sample, as learnt; none before the first.
    variances: Option<Variances>,
    /// The run of the gyro that the unknowns' offset is of, and what is left unknown of that, square radians.
    gyro: Option<(u8, f32)>,
    /// Why there is no heading.
    pub verdict: Result<(), NoHeading>,
    /// Hard iron that has moved, once it is sure.
    pub iron: Option<Iron>,
}

impl Adjustment {
    /// Before the first sample: all is as calibrated.
    pub const NONE: Self = Self {
        unknowns: [0.0; UNKNOWNS],
        variance_rad2: 0.0,
        variances: None,
        gyro: None,
        verdict: Ok(()),
        iron: None,
    };

    /// The attitude as it is, given how it changes.
    pub fn attitude(&self, reported: Attitude, motion: &Motion) -> Attitude {
        model::attitude(reported, motion, &self.unknowns)
    }

    /// Whether a heading of a single reading can be one, by what the gyro says of its instant: a field that jumps shows
    /// here a tenth of a second before it shows in a sample.
    pub fn agrees(&self, config: &Config, heading: Heading, turning: Option<&Turning>) -> bool {
        let Some((turning, (run, offset_rad2))) = turning.zip(self.gyro) else { return true };
        let Turning { motion, turned_rad, .. } = turning;
        let by_gyro = turned_rad + self.unknowns[OFFSET] + self.unknowns[LATENCY] * motion.heading_rad_s;
        let off_rad = wrap_pi(heading.magnetic_rad - by_gyro);
        let variance = heading.sigma_rad * heading.sigma_rad + offset_rad2;
        turning.run != run || off_rad * off_rad <= config.max_reading_sigmas * config.max_reading_sigmas * variance
    }

    /// The calibration with the hard iron and in the field of now, with the scatter of now. The hard iron is that of the
    /// sensor: `W (m - b) - beta F = W (m - (b + W^-1 beta F))`.
    #[inline(never)]
    pub fn in_force(&self, watched: &Watched<'_>) -> (Calibration, Uncertainty) {
        let Watched { calibration, uncertainty, readings_per_sample } = *watched;
        let beta_ut = model::beta(&self.unknowns) * calibration.total_ut;
        let moved_ut = inverse(&calibration.w_matrix()).map_or_else(Vector3::zeros, |inverse| inverse * beta_ut);
        let adjusted = Calibration {
            b_ut: (calibration.b_vector_ut() + moved_ut).into(),
            inclination_rad: calibration.inclination_rad + self.unknowns[INCLINATION],
            total_ut: calibration.total_ut * (1.0 + self.unknowns[STRENGTH]),
            ..*calibration
        };
        let learnt = self.variances.map_or(*uncertainty, |variances| Uncertainty {
            sensor_sigma: libm::sqrtf(variances.strength * f32::from(readings_per_sample)),
            attitude_sigma_rad: libm::sqrtf(variances.tilt_rad2),
            ..*uncertainty
        });
        (adjusted, learnt)
    }
}

/// The watch. 0.9 KB.
#[derive(Debug)]
pub(super) struct Watch {
    config: Config,
    state: Factored<UNKNOWNS>,
    learnt: Option<Learnt>,
    contradiction: Contradiction,
    /// Whether the strength is among what contradicted since the silence began.
    field_contradicts: bool,
    /// Variance that the coefficients' errors make of the last sample's strength, dip or heading, the largest.
    coefficients: f32,
    /// For so long hard iron may move again, seconds.
    unsettled_s: f32,
    balance: Balance,
    pushed: Pushed,
    moved: Moved,
    last: Option<Timestamp>,
    /// The gyro's run that the offset belongs to.
    run: Option<u8>,
    adjustment: Adjustment,
}

impl Watch {
    /// All is as calibrated.
    pub fn new(config: Config) -> Self {
        Self {
            state: Factored::new(&config.sigmas),
            config,
            learnt: None,
            contradiction: Contradiction::NONE,
            field_contradicts: false,
            coefficients: 0.0,
            unsettled_s: 0.0,
            balance: Balance::NOTHING,
            pushed: Pushed::NOT,
            moved: Moved::NOT,
            last: None,
            run: None,
            adjustment: Adjustment::NONE,
        }
    }

    /// The fixed numbers.
    pub const fn config(&self) -> &Config {
        &self.config
    }

    /// What the watch makes of the samples so far.
    pub const fn adjustment(&self) -> &Adjustment {
        &self.adjustment
    }

    /// As if it had been said by what was seen.
    #[cfg(test)]
    pub fn set_verdict(&mut self, verdict: Result<(), NoHeading>) {
        self.adjustment.verdict = verdict;
    }

    /// Takes a sample whose last reading was at `at`, and what the gyro says of the sample's instant.
    #[inline(never)]
    pub fn see(&mut self, watched: &Watched<'_>, at: Timestamp, sample: &Sample, turning: Option<Turning>) {
        let Watched { calibration, .. } = watched;
        let field = calibration.body(sample).ut / calibration.total_ut;
        let motion = turning.map_or_else(Motion::default, |turning| turning.motion);
        let seen = Seen { field, attitude: sample.attitude_after(calibration.latency_s), motion };
        if !seen.is_finite() || turning.is_some_and(|turning| !turning.turned_rad.is_finite()) {
            return;
        }
        let step_s = self.last.map_or(FIRST_STEP_S, |last| at.us_since(last) as f32 * 1e-6);
        self.last = Some(at);
        self.pushed.see(seen.attitude, &seen.motion, step_s);
        self.wander(step_s);
        self.follow_the_gyro(&seen, turning, step_s);
        self.measure(watched, &seen, sample, turning, step_s);
        if !self.state.is_finite() {
            // No number should lead here; from here every number would be wrong.
            self.begin_anew();
            return;
        }
        self.adjust(watched, &seen, turning.as_ref(), step_s);
    }

    /// In a function of its own: a whole watch lies on the stack meanwhile.
    #[inline(never)]
    fn begin_anew(&mut self) {
        *self = Self::new(self.config);
    }

    /// Time passes.
    fn wander(&mut self, step_s: f32) {
        let Config { mut wander, mut sigmas, unsettled_sigma, unsettled_wander, .. } = self.config;
        self.unsettled_s = (self.unsettled_s - step_s).max(0.0);
        if self.unsettled_s > 0.0 {
            wander[BETA..STRENGTH].fill(unsettled_wander);
            sigmas[BETA..STRENGTH].fill(unsettled_sigma);
        }
        for (i, (variance_per_s, sigma)) in wander.into_iter().zip(sigmas).enumerate() {
            if i == OFFSET || self.state.variance_of(i) < sigma * sigma {
                self.state.loosen(i, variance_per_s * step_s);
            }
        }
        self.state.carry(OFFSET, DRIFT, step_s);
        // Where nothing tells them apart, a day of noise must not add up to something; what has changed stays.
        let kept = (1.0 - step_s / self.config.fading_s).max(0.0);
        if model::beta(self.state.mean()).norm() < self.config.max_fading {
            self.fade(BETA..STRENGTH, kept);
        }
        self.fade(ROLL..UNKNOWNS, kept);
    }

    /// These unknowns shrink.
    fn fade(&mut self, unknowns: Range<usize>, kept: f32) {
        for i in unknowns {
            let faded = kept * self.state.mean()[i];
            self.state.set_mean(i, faded);
        }
    }

    /// Finds the gyro's offset anew where its count has begun anew, or after a gap.
    fn follow_the_gyro(&mut self, seen: &Seen, turning: Option<Turning>, step_s: f32) {
        if let Some(turning) = turning.filter(|turning| self.run != Some(turning.run) || step_s > GAP_S) {
            let measured = seen.field - model::beta(self.state.mean());
            let attitude = model::attitude(seen.attitude, &seen.motion, self.state.mean());
            let heading_rad = attitude.level(Field::new(measured)).heading_rad();
            self.state.set_mean(OFFSET, wrap_pi(heading_rad - turning.turned_rad));
            self.state.loosen(OFFSET, ANYWHERE_RAD2);
            self.balance = Balance::NOTHING;
        }
        self.run = turning.map(|turning| turning.run);
    }

    /// Learns from a sample.
    #[inline(never)]
    fn measure(&mut self, watched: &Watched<'_>, seen: &Seen, sample: &Sample, turning: Option<Turning>, step_s: f32) {
        let Watched { calibration, uncertainty, .. } = watched;
        let unknowns = *self.state.mean();
        let expected = Expected::new(&unknowns, calibration.inclination_rad, turning.as_ref());
        let predicted = Predicted::new(seen, &unknowns, &expected);
        let variances = self.scatter(watched, &predicted, step_s);
        let x = (sample.field.ut - calibration.b_vector_ut()) / calibration.total_ut;
        self.coefficients =
            predicted.by_field().map(|by| uncertainty.coefficients_variance(&by, &x)).into_iter().fold(0.0, f32::max);
        let variance = |kind: usize, of_sample: f32, by_field: Vector3<f32>| {
            let Config { of_sample: times, floor, coefficients_alike, .. } = self.config;
            let coefficients = uncertainty.coefficients_variance(&by_field, &x);
            times[kind] * of_sample + floor[kind] + coefficients_alike * coefficients
        };
        let alike = self.learnt.as_ref().map_or(1.0, |learnt| learnt.alike(&self.config.learnt));
        let strength = self.learnt.as_ref().map_or(0.0, Learnt::strength_squared);
        let Motion { roll_rad_s, pitch_rad_s, .. } = seen.motion;
        let late_rad = self.config.jitter_s * trig::hypot(roll_rad_s, pitch_rad_s);
        let tilt_rad2 = alike * (variances.tilt_rad2 + late_rad * late_rad + self.pushed.variance_rad2());
        let tan_squared = predicted.tan_dip * predicted.tan_dip;
        let [by_strength, by_dip, by_heading] = predicted.by_field();
        let measurements = [
            Some(predicted.strength(&expected, variance(0, strength, by_strength))),
            Some(predicted.inclination(&expected, variance(1, tilt_rad2, by_dip))),
            predicted.heading(&expected, seen, variance(2, tilt_rad2 * tan_squared, by_heading)),
        ];
        self.see_dip(watched, measurements[1].as_ref(), step_s);
        if let (Some(learnt), Some(strength)) = (&mut self.learnt, &measurements[0]) {
            learnt.see_off_strength(&self.config.learnt, strength.residual, step_s);
        }
        let deviations = array::from_fn(|kind| measurements[kind].as_ref().map(|m| self.deviation(m)));
        let verdict = self.contradiction.see(&self.config.contradiction, deviations, step_s);
        let learn = match verdict {
            Verdict::Fits { learn } => learn,
            Verdict::Changed { sizes } => {
                self.loosen(&predicted, sizes);
                [true; 3]
            }
        };
        for (measurement, _) in measurements.into_iter().zip(learn).filter(|(_, learn)| *learn) {
            self.learn(measurement, &unknowns);
        }
        if turning.is_some() {
            let measured = self.balance.see(seen.attitude, &seen.motion, step_s.min(GAP_S), self.state.mean());
            self.learn(measured, &{ *self.state.mean() });
        }
        let offset_rad = self.state.mean()[OFFSET];
        self.state.set_mean(OFFSET, wrap_pi(offset_rad));
    }

    /// What a sample scatters by, learnt from its strength.
    fn scatter(&mut self, watched: &Watched<'_>, predicted: &Predicted, step_s: f32) -> Variances {
        let own = watched.own();
        let config = &self.config.learnt;
        let learnt = self.learnt.get_or_insert_with(|| Learnt::new(config, own, predicted.total));
        learnt.see_strength(config, own, predicted.total, step_s);
        learnt.variances(config, own)
    }

    fn see_dip(&mut self, watched: &Watched<'_>, dip: Option<&Measurement<UNKNOWNS>>, step_s: f32) {
        if let (Some(learnt), Some(dip)) = (&mut self.learnt, dip) {
            learnt.see_dip(&self.config.learnt, watched.own(), dip.residual, step_s);
        }
    }

    fn deviation(&self, measurement: &Measurement<UNKNOWNS>) -> Deviation {
        let Measurement { row, residual, variance } = measurement;
        Deviation { residual: *residual, variance: self.state.variance(row) + variance }
    }

    /// Learns from a measurement that was predicted with these unknowns, which those before it may have changed.
    #[inline(never)]
    fn learn(&mut self, measurement: Option<Measurement<UNKNOWNS>>, predicted_with: &Unknowns) {
        let Some(mut measurement) = measurement else { return };
        let changes = self.state.mean().iter().zip(predicted_with).map(|(now, then)| now - then);
        measurement.residual -= measurement.row.iter().zip(changes).map(|(d, change)| d * change).sum::<f32>();
        self.state.learn(&measurement);
    }

    /// Something has changed: what may have, is less certain by the size of what is seen.
    fn loosen(&mut self, predicted: &Predicted, [strength, inclination, heading]: PerKind<f32>) {
        let Config { max_jump, max_lean_rad, lean, .. } = self.config;
        let cos_dip = 1.0 / libm::sqrtf(1.0 + predicted.tan_dip * predicted.tan_dip);
        // A heading is off by what lies across the horizontal part of the field, over that part.
        let [strength, inclination, across] = [strength, inclination, heading * cos_dip].map(|size| size.min(max_jump));
        let field = strength.max(inclination);
        let iron = field.max(across);
        for axis in 0..3 {
            self.state.loosen(BETA + axis, iron * iron);
        }
        self.state.loosen(STRENGTH, field * field);
        self.state.loosen(INCLINATION, field * field);
        // A heading is off by the tangent of the dip times the tilt; near the equator a tilt does little.
        let sin_dip = (predicted.tan_dip * cos_dip).abs().max(0.3);
        let tilt_rad = lean * inclination.max(across / sin_dip).min(max_lean_rad);
        self.state.loosen(ROLL, tilt_rad * tilt_rad);
        self.state.loosen(PITCH, tilt_rad * tilt_rad);
        self.field_contradicts |= strength > 0.0;
        self.unsettled_s = self.config.unsettled_s;
    }

    /// Says what it all means for headings from now on.
    #[inline(never)]
    fn adjust(&mut self, watched: &Watched<'_>, seen: &Seen, turning: Option<&Turning>, step_s: f32) {
        let unknowns = *self.state.mean();
        let expected = Expected::new(&unknowns, watched.calibration.inclination_rad, turning);
        let row = Predicted::new(seen, &unknowns, &expected).heading_row;
        let variance_rad2 = self.state.variance(&row);
        let is_silent = self.contradiction.is_silent();
        self.field_contradicts &= is_silent;
        let sigma = (0..3).map(|axis| libm::sqrtf(self.state.variance_of(BETA + axis))).fold(0.0, f32::max);
        let change = model::beta(&unknowns);
        // As long as nothing has changed, all that is left unknown is the coefficients'.
        let is_settled = self.unsettled_s <= 0.0 && change.norm() < self.config.max_fading;
        // What is left unknown of the coefficients may look like iron.
        let is_sure = self.moved.see(&change, libm::sqrtf(sigma * sigma + self.coefficients), is_silent, step_s);
        let total_ut = watched.calibration.total_ut;
        let own = watched.own();
        self.adjustment = Adjustment {
            unknowns,
            variance_rad2: if is_settled { 0.0 } else { self.config.unsettled_times * variance_rad2 },
            variances: self.learnt.as_ref().map(|learnt| {
                let Variances { strength, tilt_rad2 } = learnt.variances(&self.config.learnt, own);
                Variances { strength, tilt_rad2: tilt_rad2 + self.pushed.variance_rad2() }
            }),
            gyro: self.run.map(|run| (run, self.state.variance_of(OFFSET))),
            verdict: self.verdict(&unknowns, seen, &row, variance_rad2),
            iron: is_sure.then(|| Iron { change_ut: change * total_ut, sigma_ut: sigma * total_ut }),
        };
    }

    /// Whether there is a heading, and if not, what is to blame.
    #[inline(never)]
    fn verdict(&self, unknowns: &Unknowns, seen: &Seen, row: &Unknowns, variance_rad2: f32) -> Result<(), NoHeading> {
        let Config { max_sigma_rad, max_strength, max_inclination_rad, .. } = self.config;
        let iron = model::beta(unknowns).norm();
        let lean_rad = unknowns[ROLL].abs().max(unknowns[PITCH].abs());
        if iron > self.config.max_hard_iron {
            return Err(NoHeading::FieldChanged);
        }
        if self.contradiction.is_silent() {
            // An attitude that is wrong leaves the strength as it is.
            let tilt_rad = lean_rad.max((unknowns[BANK] * seen.attitude.roll_rad).abs());
            let is_attitude = !self.field_contradicts && tilt_rad > iron;
            return Err(if is_attitude { NoHeading::AttitudeContradicted } else { NoHeading::FieldDisturbed });
        }
        if unknowns[STRENGTH].abs() > max_strength || unknowns[INCLINATION].abs() > max_inclination_rad {
            return Err(NoHeading::FieldDisturbed);
        }
        if lean_rad > self.config.max_bias_rad || unknowns[BANK].abs() > self.config.max_bank {
            return Err(NoHeading::AttitudeContradicted);
        }
        if variance_rad2 > max_sigma_rad * max_sigma_rad {
            let mut by_iron = *row;
            by_iron[ROLL..=LATENCY].fill(0.0);
            let is_iron = self.state.variance(&by_iron) > variance_rad2 / 2.0;
            return Err(if is_iron { NoHeading::FieldChanged } else { NoHeading::AttitudeContradicted });
        }
        Ok(())
    }
}

impl Watched<'_> {
    /// What a sample scatters by as the calibration found it.
    fn own(&self) -> Variances {
        let Uncertainty { sensor_sigma, attitude_sigma_rad, .. } = *self.uncertainty;
        Variances {
            strength: sensor_sigma * sensor_sigma / f32::from(self.readings_per_sample.max(1)),
            tilt_rad2: attitude_sigma_rad * attitude_sigma_rad,
        }
    }
}
