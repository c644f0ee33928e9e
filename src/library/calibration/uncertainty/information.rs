//! Fisher information of samples and priors, with the sums of all statistics of one pass over the samples.

use nalgebra::Vector3;

use crate::calibration::fit::linearised_problem::LinearisedProblem;
use crate::calibration::hypotheses::attitude_error::AttitudeState;
use crate::calibration::hypotheses::attitude_error_table::{
    ATTITUDE_ERRORS, AttitudeErrorSums, LATENCY_INDEX, LaggedRoll, add_inclination_residual,
};
use crate::calibration::hypotheses::hard_iron_change::{HardIronChangeEffect, HardIronScan, derivative_by_hard_iron};
use crate::calibration::hypotheses::motor_current::InterferenceEstimate;
use crate::calibration::hypotheses::score_test::{ScoreTest, hard_iron_residuals};
use crate::calibration::model::{
    Likelihood, MeasuredSample, ModelParameters, ResidualEquation, SampleEquations, Vector13,
};
use crate::calibration::statistics::residuals::{Autocorrelation, ResidualStatistics};
use crate::calibration::types::quality::AttitudeLatency;
use crate::calibration::types::samples::{AngleRates, PART_COUNT, Samples, TimeSpan};
use crate::frames::RollPitch;

/// Fisher information, with the statistics of the residuals and the sums of the score tests.
#[derive(Clone, Debug)]
pub(in crate::calibration) struct Information {
    pub linear_system: LinearisedProblem,
    pub residuals: ResidualStatistics,
    pub attitude_error_sums: AttitudeErrorSums,
    /// Contributions of the samples to the gradient of the attitude latency.
    pub latency_contributions: Autocorrelation,
    pub motor_current_sums: ScoreTest<3>,
    /// Remaining errors of the interference, mount axes, units of field per ampere; their outer products sum to its
    /// covariance.
    pub interference_error_factors: [Vector3<f32>; 4],
    /// Effect of a detected hard-iron change; zero without one.
    pub hard_iron_change: HardIronChangeEffect,
}

impl Information {
    #[inline(never)]
    pub fn new(system: &LinearisedProblem) -> Self {
        Self {
            linear_system: system.clone(),
            residuals: ResidualStatistics::zero(),
            attitude_error_sums: core::array::from_fn(|_| ScoreTest::zero()),
            latency_contributions: Autocorrelation::default(),
            motor_current_sums: ScoreTest::zero(),
            interference_error_factors: [Vector3::zeros(); 4],
            hard_iron_change: HardIronChangeEffect { gradient: Vector13::zeros(), added_in_turns: Vector3::zeros() },
        }
    }

    /// Adds one pass over the samples. `scan`, given for turns, tests for a hard-iron change.
    #[inline(never)]
    pub fn accumulate_samples(
        &mut self,
        likelihood: &Likelihood,
        samples: Samples<'_>,
        unknowns: &Vector13,
        mut scan: Option<&mut HardIronScan>,
    ) {
        let parameters = ModelParameters::from_unknowns(unknowns);
        let mut lagged_roll = LaggedRoll::default();
        let time_span = TimeSpan::from_samples(samples);
        for sample in samples.iter() {
            let part = sample.part.index();
            let equations = likelihood.sample_equations(sample, None, &parameters);
            let attitude = sample.latency_compensated_attitude(likelihood.latency_s);
            let lagged_roll_rad = lagged_roll.filter_roll(sample.time, attitude.roll_rad);
            let centred_flight_fraction = time_span.map_or(0.0, |span| span.elapsed_fraction(sample.time) - 0.5);
            let state = AttitudeState { attitude, rates: sample.rates, lagged_roll_rad, centred_flight_fraction };
            self.add_inclination_residual(&equations, &state);
            if likelihood.motor_current.current_sigma_a > 0.0 {
                let share_a = likelihood.motor_current.current_deviation_a(sample);
                hard_iron_residuals(&equations).for_each(|equation| {
                    self.motor_current_sums.add_weighted_equation(
                        equation,
                        &derivative_by_hard_iron(&parameters.w, equation),
                        share_a,
                    );
                });
            }
            if let Some(inclination) = &equations.inclination_equation {
                let by_latency = ATTITUDE_ERRORS[LATENCY_INDEX].inclination_derivative(&equations, &state);
                self.latency_contributions
                    .add_residuals(part, [inclination.weight * by_latency * inclination.residual, 0.0]);
            }
            let inclination_residual =
                equations.inclination_equation.as_ref().map_or(0.0, ResidualEquation::clipped_residual);
            // Without a scan (ground methods), norm residuals of one heading are correlated through the error of the
            // given heading, whose sigma already covers it.
            let norm_residual = if scan.is_some() { equations.norm_equation.clipped_residual() } else { 0.0 };
            self.residuals.autocorrelation.add_residuals(part, [norm_residual, inclination_residual]);
            self.residuals.heteroscedasticity.add_residual(sample.attitude, inclination_residual);
            self.residuals.white_noise.add_residual(part, sample.time, equations.norm_equation.clipped_residual());
            if let Some(scan) = &mut scan {
                self.residuals.discrepancy.add_sample(part, sample, &equations);
                scan.add_sample(&self.linear_system, sample, &equations);
            }
        }
        for mark in samples.marks {
            let equations = likelihood.sample_equations(&mark.sample, Some(mark.heading_rad), &parameters);
            let attitude = mark.sample.latency_compensated_attitude(likelihood.latency_s);
            self.add_inclination_residual(&equations, &AttitudeState::steady_turn(attitude, mark.sample.rates));
            let inclination_residual =
                equations.inclination_equation.as_ref().map_or(0.0, ResidualEquation::clipped_residual);
            self.residuals.autocorrelation.add_residuals(PART_COUNT - 1, [0.0, inclination_residual]);
        }
    }

    pub(super) fn add_inclination_residual(&mut self, equations: &SampleEquations, state: &AttitudeState) {
        let Some(inclination) = &equations.inclination_equation else { return };
        self.residuals.inclination_information.add_row(&inclination.jacobian_row, inclination.weight);
        add_inclination_residual(&mut self.attitude_error_sums, equations, state);
    }

    /// Adds a hypothetical noise-free sample at an attitude and a heading. Its residual is zero.
    pub fn add_hypothetical_sample(
        &mut self,
        likelihood: &Likelihood,
        parameters: &ModelParameters,
        attitude: RollPitch,
        heading_rad: f32,
    ) {
        let tilt = attitude.tilt_rotation();
        let Some(x) = parameters.expected_field(&tilt, heading_rad) else { return };
        let measured = MeasuredSample { centred_field: x, tilt_rotation: tilt, heading_rad: None };
        let equations = SampleEquations::new(parameters, &measured, &likelihood.noise, &likelihood.config, false);
        self.linear_system.add_sample_equations(&equations);
        self.add_inclination_residual(&equations, &AttitudeState::steady_turn(attitude, AngleRates::UNKNOWN));
    }

    /// Attitude latency, and the derivative of the unknowns by it (1/s). `None` without attitude rates.
    #[inline(never)]
    pub fn estimate_latency(&self, used_s: f32) -> Option<(AttitudeLatency, Vector13)> {
        let sums = &self.attitude_error_sums[LATENCY_INDEX];
        let score = sums.eliminate_coefficients(&self.linear_system, &self.linear_system.step_to_maximum()?)?;
        let latency = AttitudeLatency::estimate_latency(sums, &score, &self.latency_contributions, used_s)?;
        Some((latency, -score.nuisance_columns[0]))
    }

    /// Motor-current interference; its error enters the covariance. `None` without a varying current.
    #[inline(never)]
    pub fn estimate_interference(&mut self, likelihood: &Likelihood) -> Option<InterferenceEstimate> {
        if likelihood.motor_current.current_sigma_a == 0.0 {
            return None;
        }
        let score = self
            .motor_current_sums
            .eliminate_coefficients(&self.linear_system, &self.linear_system.step_to_maximum()?)?;
        let estimate = InterferenceEstimate::new(&score, likelihood, self.residuals.autocorrelation_inflation())?;
        self.interference_error_factors = estimate.covariance_factors(&likelihood.interference_per_ampere());
        Some(estimate)
    }

    /// Step of the unknowns that follows a change of the interference.
    pub fn step_for_interference_change(&self, interference_change: &Vector3<f32>) -> Option<Vector13> {
        Some(-self.linear_system.covariance_times(&self.motor_current_sums.gradient_effect(interference_change))?)
    }
}
