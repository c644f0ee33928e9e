//! Agreement test between smoothed and raw heading.

use crate::trig::{DEG, square};

/// Time since the last reading, and the gyro's turn in it.
#[derive(Clone, Copy, Debug)]
pub(super) struct GyroStep {
    pub step_s: f32,
    pub turned_rad: f32,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum AgreementResult {
    /// Compass and gyro have agreed for long enough.
    InAgreement,
    /// Compass and gyro disagree, or have not agreed for long enough.
    NotInAgreement,
    /// Compass and gyro have disagreed for so long that the filter must restart.
    Lost,
}

/// Agreement test: the exponential mean of the innovation over two seconds must be within 3 sigma. A fast failure of
/// the gyro is detected earlier, by two consecutive innovations beyond 4 sigma on the same side; if the raw heading is
/// noisier than its sigma, the scatter of the innovations replaces the sigma. A single outlier is ignored.
#[derive(Clone, Debug)]
pub(super) struct AgreementTest {
    mean_innovation_rad: f32,
    last_innovation_rad: f32,
    /// Scatter: half the mean squared difference of consecutive innovations.
    innovation_scatter_rad2: f32,
    last_exceeded_side: Option<bool>,
    agreement_s: f32,
    /// Turn still required before agreement is reported, radians.
    required_turn_rad: f32,
    disagreement_s: f32,
    excess_variance_rad2: f32,
}

impl AgreementTest {
    /// Time constant of the means, seconds; equals the mean age in a 2 s window.
    const MEAN_TIME_CONSTANT_S: f32 = 1.0;

    /// Gate of the mean innovation, sigmas.
    const MEAN_GATE_SIGMAS: f32 = 3.0;

    /// Gate of a single innovation, sigmas.
    const SINGLE_GATE_SIGMAS: f32 = 4.0;

    /// Required duration of agreement, seconds.
    const REQUIRED_AGREEMENT_S: f32 = 2.0;

    /// Required turn after a disagreement, to either side, radians: a wrong gyro is unobservable in straight flight.
    const REQUIRED_TURN_RAD: f32 = 45.0 * DEG;

    /// Disagreement after which the filter restarts, seconds.
    const MAX_DISAGREEMENT_S: f32 = 5.0;

    pub const INITIAL: Self = Self {
        mean_innovation_rad: 0.0,
        last_innovation_rad: 0.0,
        innovation_scatter_rad2: 0.0,
        last_exceeded_side: None,
        agreement_s: 0.0,
        required_turn_rad: 0.0,
        disagreement_s: 0.0,
        excess_variance_rad2: 0.0,
    };

    /// Restarts the test with the filter, except for the turn still required.
    pub fn restart_test(&mut self) {
        *self = Self { required_turn_rad: self.required_turn_rad, ..Self::INITIAL };
    }

    /// Excess of the squared mean innovation over its variance, rad^2: an error of the raw or the smoothed heading.
    pub const fn excess_variance_rad2(&self) -> f32 {
        self.excess_variance_rad2
    }

    pub fn test_innovation(&mut self, innovation_rad: f32, variance: f32, step: GyroStep) -> AgreementResult {
        let GyroStep { step_s, turned_rad } = step;
        let weight = step_s / (Self::MEAN_TIME_CONSTANT_S + step_s);
        self.mean_innovation_rad += weight * (innovation_rad - self.mean_innovation_rad);
        self.excess_variance_rad2 = (square(self.mean_innovation_rad) - variance).max(0.0);
        let limit_rad2 = square(Self::SINGLE_GATE_SIGMAS) * variance.max(self.innovation_scatter_rad2);
        self.innovation_scatter_rad2 +=
            weight * (0.5 * square(innovation_rad - self.last_innovation_rad) - self.innovation_scatter_rad2);
        self.last_innovation_rad = innovation_rad;
        let exceeded_side = (square(innovation_rad) > limit_rad2).then_some(innovation_rad.is_sign_negative());
        let is_fast_failure = exceeded_side.is_some() && exceeded_side == self.last_exceeded_side;
        self.last_exceeded_side = exceeded_side;
        if is_fast_failure || square(self.mean_innovation_rad) > square(Self::MEAN_GATE_SIGMAS) * variance {
            (self.agreement_s, self.required_turn_rad) = (0.0, Self::REQUIRED_TURN_RAD);
            self.disagreement_s += step_s;
            return if self.disagreement_s > Self::MAX_DISAGREEMENT_S {
                AgreementResult::Lost
            } else {
                AgreementResult::NotInAgreement
            };
        }
        self.disagreement_s = 0.0;
        self.agreement_s = (self.agreement_s + step_s).min(Self::REQUIRED_AGREEMENT_S);
        self.required_turn_rad = (self.required_turn_rad - turned_rad.abs()).max(0.0);
        if self.agreement_s >= Self::REQUIRED_AGREEMENT_S && self.required_turn_rad <= 0.0 {
            AgreementResult::InAgreement
        } else {
            AgreementResult::NotInAgreement
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::instrument::smoother::tests::STEP_S;

    /// Repeats an innovation of variance 1 in a turn.
    fn repeat_innovation(agreement: &mut AgreementTest, innovation_rad: f32, seconds: f32) -> AgreementResult {
        let step = GyroStep { step_s: STEP_S, turned_rad: 0.1 * DEG };
        let steps = (seconds / STEP_S) as usize;
        (0..steps).map(|_| agreement.test_innovation(innovation_rad, 1.0, step)).last().unwrap()
    }

    /// Excess variance: `2.9^2 - 1`, and none below 1 sigma.
    #[test]
    fn a_mean_innovation_over_one_sigma_adds_excess_variance() {
        for (innovation, excess_variance) in [(0.9, 0.0), (-0.9, 0.0), (2.9, 7.41), (-2.9, 7.41)] {
            let mut agreement = AgreementTest::INITIAL;
            repeat_innovation(&mut agreement, innovation, 20.0);
            let found = agreement.excess_variance_rad2();
            assert!((found - excess_variance).abs() < 0.01, "{innovation}: {found}");
        }
    }

    /// Ten times 2.5 s of contradiction; 5 s without agreement between would lose the smoother.
    #[test]
    fn agreement_between_contradictions_restarts_their_time() {
        let mut agreement = AgreementTest::INITIAL;
        for _ in 0..10 {
            assert_eq!(repeat_innovation(&mut agreement, 5.0, 2.5), AgreementResult::NotInAgreement);
            repeat_innovation(&mut agreement, 0.0, 25.0);
        }
    }
}
