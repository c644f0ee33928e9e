//! Solves of a log's rows without the module's trial solves and automatic end.

use autoswing::calibration::method_selection::{self, Procedure};
use autoswing::calibration::{
    Advice, Calibration, CollectionPart, Method, Orientation, Prior, Sample, Samples, Solution, SolveError,
    solve_samples,
};
use autoswing::collection::{CollectionProblem, Collector, LEVEL_ROLL_RAD, RetainedSamples};
use autoswing::instrument::InstrumentConfig;
use autoswing_module::messages::Refusal;
use nalgebra::Vector3;

use super::result::{CalibrationOutcome, EarthFieldPrior};
use crate::log::FieldCorrection;
use crate::score::{GOOD_COMPASS_RMS_DEG, accepted_by_uncalibrated};

impl CalibrationOutcome {
    /// Outcome of a solve of samples that were selected without the module.
    fn of_solve(
        solve_result: &Result<Solution, SolveError>,
        [fit, held_back]: [Samples<'_>; 2],
        collection_problem: Option<CollectionProblem>,
    ) -> Self {
        let accepted = match solve_result {
            Ok(solution) => accepted_by_uncalibrated(solution, fit, held_back).map_err(Refusal::Rejected),
            Err(error) => Err(Refusal::Solve(*error)),
        };
        let solution = solve_result.as_ref().ok().copied();
        let advice = || solution.as_ref()?.advice.filter(Advice::is_worthwhile);
        let missing = || advice().map(|advice| CollectionProblem::MissingManoeuvre(advice.manoeuvre));
        Self {
            acceptance: accepted.map_err(|refusal| refusal.with_cause(collection_problem.or_else(missing))),
            solution,
            fitted_count: fit.all_samples().count(),
            collection_end_s: None,
        }
    }
}

pub(crate) fn solved_correction(solution: &Solution) -> FieldCorrection {
    calibrated_correction(&solution.calibration)
}

/// Correction by all coefficients of a calibration.
pub(super) fn calibrated_correction(calibration: &Calibration) -> FieldCorrection {
    FieldCorrection {
        matrix: calibration.w_matrix().map(f64::from),
        hard_iron_ut: calibration.b_vector_ut().map(f64::from),
        motor_ut_per_a: Vector3::from(calibration.motor_current.ut_per_a).map(f64::from),
    }
}

/// Whether the flight determines a fit as well as that of a good compass: one heading determines no inclination, and no
/// mirror image.
pub(super) fn is_determined(solution: &Solution) -> bool {
    f64::from(solution.quality.expected_rms_deg) <= GOOD_COMPASS_RMS_DEG
}

/// Prior of the module: an inclination that no option configures is that of the field model.
pub(super) fn solver_prior(prior: &EarthFieldPrior, config: InstrumentConfig) -> Prior {
    Prior {
        mount: Orientation::IDENTITY_ROTATION,
        inclination_rad: prior.inclination_rad(),
        is_inclination_modelled: prior.inclination_deg.is_none(),
        readings_per_sample: config.readings_per_sample(),
    }
}

/// Solves the samples that a collection in flight retains of all, with the device's choice of method.
pub(super) fn solve_retained_samples(samples: &[Sample], prior: &Prior) -> CalibrationOutcome {
    let procedure = Procedure::Flight;
    let mut retained = RetainedSamples::EMPTY;
    let mut collector = Collector::new(&mut retained);
    collector.begin_procedure(procedure);
    for &sample in samples {
        collector.push_sample(sample);
    }
    let parts = collector.selected_samples();
    let solve_result = method_selection::select_method(collector.fit_samples(), procedure)
        .and_then(|method| solve_samples(method, parts[0], prior));
    CalibrationOutcome::of_solve(&solve_result, parts, collector.collection_problem())
}

/// Solves evenly thinned samples.
pub(super) fn solve_evenly_thinned(samples: &[Sample], prior: &Prior) -> CalibrationOutcome {
    let [fit, held_back] = thin_evenly(samples).map(|samples| assign_collection_parts(&samples));
    let [fit, held_back] = [&fit, &held_back].map(|samples| Samples::new(samples));
    let solve_result = solve_samples(Method::MaximumLikelihood, fit, prior);
    CalibrationOutcome::of_solve(&solve_result, [fit, held_back], None)
}

/// Most rows that are fitted: about as many as the device fits.
const MAX_FIT_ROWS: usize = 384;

/// Samples to fit, evenly thinned, and samples to hold back, halfway between them. If there are fewer samples, all are fitted,
/// and verified on themselves.
fn thin_evenly(samples: &[Sample]) -> [Vec<Sample>; 2] {
    let fit_count = samples.len().min(MAX_FIT_ROWS);
    [0.0, 0.5].map(|phase| {
        (0..fit_count)
            .filter_map(|i| samples.get(((i as f64 + phase) * samples.len() as f64 / fit_count as f64) as usize))
            .copied()
            .collect()
    })
}

/// Time of a sample, seconds after the first row.
pub(super) fn sample_time_s(sample: &Sample) -> f64 {
    f64::from(sample.time.as_ms()) / 1e3
}

/// Samples assigned to turns and level flight by their bank.
fn assign_collection_parts(samples: &[Sample]) -> Vec<Sample> {
    let part_of = |roll_rad: f32| match roll_rad {
        roll_rad if roll_rad < -LEVEL_ROLL_RAD => Some(CollectionPart::LEFT),
        roll_rad if roll_rad > LEVEL_ROLL_RAD => Some(CollectionPart::RIGHT),
        roll_rad => (roll_rad.abs() <= LEVEL_ROLL_RAD).then_some(CollectionPart::LEVEL),
    };
    let assigned =
        samples.iter().filter_map(|sample| Some(Sample { part: part_of(sample.attitude.roll_rad)?, ..*sample }));
    assigned.collect()
}

#[cfg(test)]
mod tests {
    use autoswing::frames::{Field, RollPitch};
    use autoswing::time::WrappingMillis;

    use super::*;

    fn sample_at(t_s: f64, roll_deg: f32) -> Sample {
        let attitude = RollPitch::from_deg(roll_deg, 0.0);
        Sample {
            time: WrappingMillis::new((t_s * 1e3) as u32),
            ..Sample::new(Field::from_ut(20.0, 0.0, 40.0), attitude)
        }
    }

    /// The samples are 0.1 s apart; 384 are fitted at most. From twice as many on no sample is both fitted and held back.
    #[test]
    fn held_back_samples_lie_between_the_fitted_ones() {
        for (sample_count, fit_count) in [(1000, 384), (768, 384), (31, 31)] {
            let samples: Vec<Sample> = (0..sample_count).map(|i| sample_at(f64::from(i) / 10.0, 0.0)).collect();
            let [fit_s, held_back_s] =
                thin_evenly(&samples).map(|samples| samples.iter().map(sample_time_s).collect::<Vec<f64>>());
            assert_eq!([fit_s.len(), held_back_s.len()], [fit_count; 2]);
            let step_s = f64::from(sample_count) / 10.0 / fit_count as f64;
            for (i, (fitted_s, held_back_s)) in fit_s.into_iter().zip(held_back_s).enumerate() {
                for (time_s, phase) in [(fitted_s, 0.0), (held_back_s, 0.5)] {
                    let late_s = (i as f64 + phase) * step_s - time_s;
                    assert!((-1e-6..0.1).contains(&late_s), "{i} of {sample_count}: {time_s}");
                }
                assert_eq!(held_back_s > fitted_s, sample_count >= 768, "{i} of {sample_count}: {fitted_s}");
            }
        }
    }
}
