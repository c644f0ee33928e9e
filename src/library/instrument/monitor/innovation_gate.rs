//! Innovation gates of the monitor, as a state machine without a filter: innovations in, detected changes out.
//!
//! ```text
//!                    innovation beyond 4 sigma twice in a row,
//!                    or beyond 2 sigma six times in a row
//!   quiet ---------------------------------------------------> withhold 4 s <--+
//!     ^                                                          |  |  again   |
//!     +----------------------------------------------------------+  +----------+
//! ```
//!
//! Gross residuals, beyond any usable heading, may be short: a sensor restart, a steel hangar. Headings are withheld,
//! and the states stay unchanged for longer than the second that a sensor restart takes.

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum MeasurementKind {
    Strength,
    Inclination,
    Heading,
}

impl MeasurementKind {
    pub const ALL_MEASUREMENTS: [Self; 3] = [Self::Strength, Self::Inclination, Self::Heading];
}

pub(super) type PerKind<T> = [T; MeasurementKind::ALL_MEASUREMENTS.len()];

#[derive(Clone, Copy, Debug)]
pub(super) struct Innovation {
    /// Measured minus predicted value.
    pub residual: f32,
    /// Innovation variance if nothing has changed.
    pub variance: f32,
}

/// Half-width of the wide innovation gate, sigmas.
pub(super) const WIDE_GATE_SIGMAS: f32 = 4.0;

/// Consecutive innovations beyond the wide gate that detect a change: 0.2 s.
const WIDE_GATE_FAILURES: u8 = 2;

/// Half-width of the narrow innovation gate, sigmas.
const NARROW_GATE_SIGMAS: f32 = 2.0;

/// Consecutive innovations beyond the narrow gate that detect a change: 0.6 s.
const NARROW_GATE_FAILURES: u8 = 6;

/// Residual of relative strength or inclination (radians) above which a sample is gross.
const MIN_GROSS_RESIDUAL: f32 = 0.2;

/// Consecutive gross samples after which the usual gates apply again: 1.3 s, longer than a sensor restart.
const MAX_GROSS_SAMPLES: u8 = 13;

/// Time for which headings are withheld after a detected change, seconds.
const WITHHOLDING_S: f32 = 4.0;

/// Time withheld, or with states beyond their limits, after which the states no longer explain the field, seconds: four detected changes.
/// It is forgotten with the time constant below. States that ran away come back within their limits by chance. Beside passing iron of 50
/// uT, where 1.0 % of planes' headings were bad without this limit on states, none are any more; it empties 45 % of them, without it 38.
const MAX_WITHHELD_S: f32 = 16.0;
const WITHHELD_FORGETTING_TIME_S: f32 = 60.0;

/// Turn without a detected change that restores trust in the states, radians: 60 deg. In straight flight wrong states
/// may agree.
const REQUIRED_TURN_RAD: f32 = 1.05;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum GateResult {
    /// No change detected. A first innovation beyond the wide gate is not used.
    Consistent {
        /// Whether the filter's update uses the measurement of each kind.
        is_usable: PerKind<bool>,
    },
    /// A change was detected.
    ChangeDetected {
        /// Absolute residual of each kind that is beyond the narrow gate, otherwise zero.
        exceeding_residuals: PerKind<f32>,
    },
}

/// Counters of consecutive innovations beyond each gate.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct InnovationGate {
    beyond_wide_gate_counts: PerKind<u8>,
    beyond_narrow_gate_counts: PerKind<u8>,
    gross_sample_count: u8,
    withholding_remaining_s: f32,
    withheld_s: f32,
    required_turn_rad: f32,
}

impl InnovationGate {
    pub const NO_INNOVATIONS: Self = Self {
        beyond_wide_gate_counts: [0; 3],
        beyond_narrow_gate_counts: [0; 3],
        gross_sample_count: 0,
        withholding_remaining_s: 0.0,
        withheld_s: 0.0,
        required_turn_rad: 0.0,
    };

    /// Adds the gyro's turn during a step, radians, after the innovations at the end of the step have been tested, and whether
    /// the states were beyond their limits before it.
    pub fn update_turn(&mut self, turned_rad: f32, is_beyond_limits: bool, step_s: f32) {
        if self.withholding_remaining_s > 0.0 || is_beyond_limits {
            self.withheld_s += step_s;
        } else {
            self.withheld_s *= (1.0 - step_s / WITHHELD_FORGETTING_TIME_S).max(0.0);
            self.required_turn_rad = (self.required_turn_rad - turned_rad.abs()).max(0.0);
        }
        if self.withheld_s > MAX_WITHHELD_S {
            (self.withheld_s, self.required_turn_rad) = (MAX_WITHHELD_S, REQUIRED_TURN_RAD);
        }
    }

    /// Tests the innovations of a sample `step_s` after the last one; `None` for a kind without a measurement.
    pub fn test_innovations(&mut self, innovations: PerKind<Option<Innovation>>, step_s: f32) -> GateResult {
        self.withholding_remaining_s = (self.withholding_remaining_s - step_s).max(0.0);
        if self.is_awaiting_gross_end(&innovations) {
            return GateResult::Consistent { is_usable: [false; 3] };
        }
        let mut usable = [true; 3];
        let mut sizes = [0.0; 3];
        let mut has_changed = false;
        for (i, innovation) in innovations.into_iter().enumerate() {
            // A missing measurement leaves the counters unchanged.
            let Some(Innovation { residual, variance }) = innovation else { continue };
            let beyond = |sigmas: f32| residual * residual > sigmas * sigmas * variance;
            let (is_beyond_wide, is_beyond_narrow) = (beyond(WIDE_GATE_SIGMAS), beyond(NARROW_GATE_SIGMAS));
            self.beyond_wide_gate_counts[i] =
                if is_beyond_wide { self.beyond_wide_gate_counts[i].saturating_add(1) } else { 0 };
            self.beyond_narrow_gate_counts[i] =
                if is_beyond_narrow { self.beyond_narrow_gate_counts[i].saturating_add(1) } else { 0 };
            has_changed |= self.beyond_wide_gate_counts[i] >= WIDE_GATE_FAILURES
                || self.beyond_narrow_gate_counts[i] >= NARROW_GATE_FAILURES;
            usable[i] = !is_beyond_wide;
            sizes[i] = if is_beyond_narrow { residual.abs() } else { 0.0 };
        }
        if has_changed {
            self.withholding_remaining_s = WITHHOLDING_S;
            GateResult::ChangeDetected { exceeding_residuals: sizes }
        } else {
            GateResult::Consistent { is_usable: usable }
        }
    }

    /// Counts gross samples; whether to wait for the end of a short disturbance.
    fn is_awaiting_gross_end(&mut self, innovations: &PerKind<Option<Innovation>>) -> bool {
        let [strength, inclination, _] = innovations;
        let is_gross = [strength, inclination].into_iter().flatten().any(|d| d.residual.abs() > MIN_GROSS_RESIDUAL);
        self.gross_sample_count = if is_gross { self.gross_sample_count.saturating_add(1) } else { 0 };
        let is_waiting = is_gross && self.gross_sample_count < MAX_GROSS_SAMPLES;
        if is_waiting {
            // Averaged samples at the start and end of a gross disturbance are partly disturbed, and must not complete
            // a sequence.
            (self.beyond_wide_gate_counts, self.beyond_narrow_gate_counts) = ([0; 3], [0; 3]);
        }
        is_waiting
    }

    /// Time for which headings were withheld, seconds, forgotten within a minute.
    pub const fn withheld_s(&self) -> f32 {
        self.withheld_s
    }

    /// Whether a change was detected in the last seconds.
    pub fn is_change_recent(&self) -> bool {
        self.withholding_remaining_s > 0.0 && self.gross_sample_count == 0
    }

    pub fn is_withholding(&self) -> bool {
        self.withholding_remaining_s > 0.0 || self.gross_sample_count > 0 || self.required_turn_rad > 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 20 % of the field, or 11 deg of inclination, for up to 1.2 s: a restart of the sensor.
    #[test]
    fn gross_innovations_are_withheld_for_up_to_12_samples() {
        let innovations_of = |residual: f32, kind: usize| {
            core::array::from_fn(|k| (k == kind).then_some(Innovation { residual, variance: 1e-4 }))
        };
        let detects = |gate: &mut InnovationGate, residual: f32, kind: usize| {
            matches!(gate.test_innovations(innovations_of(residual, kind), 0.1), GateResult::ChangeDetected { .. })
        };
        for kind in [0, 1] {
            let mut gate = InnovationGate::NO_INNOVATIONS;
            assert!(!detects(&mut gate, 0.1, kind), "the first sample is partly disturbed");
            for residual in [0.3, -0.3].into_iter().cycle().take(12) {
                let verdict = gate.test_innovations(innovations_of(residual, kind), 0.1);
                assert_eq!(verdict, GateResult::Consistent { is_usable: [false; 3] });
                assert!(gate.is_withholding());
            }
            let mut ended = gate;
            assert!(!detects(&mut ended, 0.1, kind), "the last sample is partly disturbed");
            let verdict = ended.test_innovations(innovations_of(0.0, kind), 0.1);
            assert_eq!((verdict, ended.is_withholding()), (GateResult::Consistent { is_usable: [true; 3] }, false));
            assert!(
                !detects(&mut gate, 0.3, kind) && detects(&mut gate, 0.3, kind),
                "a longer disturbance is a change"
            );
        }
        // Smaller innovations of the field are a change at once, and so is any of the heading.
        for (residual, kind) in [(0.15, 0), (0.15, 1), (2.0, 2)] {
            let mut gate = InnovationGate::NO_INNOVATIONS;
            assert!(!detects(&mut gate, residual, kind) && detects(&mut gate, residual, kind), "{residual} {kind}");
        }
    }

    /// A turn of 60 deg within the limits.
    #[test]
    fn states_that_were_beyond_their_limits_for_long_are_trusted_after_a_turn() {
        for (seconds, is_trusted) in [(15, true), (17, false)] {
            let mut gate = InnovationGate::NO_INNOVATIONS;
            (0..10 * seconds).for_each(|_| gate.update_turn(0.0, true, 0.1));
            assert_eq!(!gate.is_withholding(), is_trusted, "{seconds}");
            (0..11).for_each(|_| gate.update_turn(-0.1, false, 0.1));
            assert!(!gate.is_withholding(), "{seconds}");
        }
    }
}
