//! Sample selection of the module's collector, applied to a recorded flight with ten samples per second.

use autoswing::calibration::method_selection::Procedure;
use autoswing::calibration::{ConsiderSigmas, Method, Sample, Samples};
use autoswing::collection::{Collector, RetainedSamples};
use autoswing_module::compass::TrialSchedule;

use super::evaluation::solve_samples;
use super::random_flight::Recording;

/// Retained samples of a flight. Trial solves update the collector's coefficients at the device's pace.
#[must_use]
pub fn retain_samples(samples: &[Sample]) -> Recording {
    let mut retained = RetainedSamples::EMPTY;
    let mut collector = Collector::new(&mut retained);
    collector.begin_procedure(Procedure::Flight);
    let mut trial_schedule = TrialSchedule::NO_TRIAL;
    for &sample in samples {
        collector.push_sample(sample);
        if trial_schedule.start_trial_if_due(&collector, sample.time)
            && let Ok(solution) =
                solve_samples(Method::MaximumLikelihood, collector.fit_samples(), ConsiderSigmas::DEFAULT)
        {
            collector.use_trial_solution(&solution);
        }
    }
    Recording {
        fit_samples: sorted_by_time(collector.fit_samples()),
        held_back: sorted_by_time(collector.held_back_samples()),
    }
}

fn sorted_by_time(samples: Samples<'_>) -> Vec<Sample> {
    let mut samples: Vec<Sample> = samples.all_samples().copied().collect();
    samples.sort_by_key(|sample| sample.time.as_ms());
    samples
}

#[cfg(test)]
mod tests {
    use autoswing::frames::{Field, RollPitch};
    use autoswing::time::WrappingMillis;
    use log_analysis::replay::EarthFieldPrior;
    use log_analysis::replay::module_run::ModuleRun;
    use testkit::random::Random;

    use super::*;

    /// Four minutes of small turns about north, insufficient for a calibration.
    fn samples_of_small_turns() -> Vec<Sample> {
        let mut random = Random(3);
        let sample_at = |i: u16| {
            let t_s = f32::from(i) / 10.0;
            let attitude = RollPitch::from_deg(15.0 * libm::sinf(0.31 * t_s), 6.0 * libm::sinf(0.47 * t_s));
            let body_field = attitude.to_body_frame(Field::earth_field(50.0, 1.1, 0.4 * libm::sinf(0.2 * t_s))).ut;
            let field = Field::from_ut(
                body_field.x + 20.0 + 0.3 * random.normal(),
                body_field.y - 10.0 + 0.3 * random.normal(),
                body_field.z + 0.3 * random.normal(),
            );
            Sample { time: WrappingMillis::new(u32::from(i) * 100), ..Sample::new(field, attitude) }
        };
        (0..2400).map(sample_at).collect()
    }

    fn retained_without_trial_solves(samples: &[Sample]) -> Vec<Sample> {
        let mut retained = RetainedSamples::EMPTY;
        let mut collector = Collector::new(&mut retained);
        collector.begin_procedure(Procedure::Flight);
        for &sample in samples {
            collector.push_sample(sample);
        }
        sorted_by_time(collector.fit_samples())
    }

    #[test]
    fn trial_solves_change_the_retained_samples() {
        let samples = samples_of_small_turns();
        let mut retained = RetainedSamples::EMPTY;
        let mut module = ModuleRun::new(Procedure::Flight, &EarthFieldPrior::default(), 1, &mut retained);
        module.collect_samples(&samples);
        let collected = sorted_by_time(module.collector().fit_samples());
        assert_eq!(module.ended_s(), None);
        assert_eq!(collected, sorted_by_time(retain_samples(&samples).fit_samples()));
        assert_ne!(collected, retained_without_trial_solves(&samples));
    }
}
