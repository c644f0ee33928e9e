//! Sample selection of the module's collector, applied to a recorded flight with ten samples per second.

use autoswing::calibration::method_selection::Procedure;
use autoswing::calibration::{ConsiderSigmas, Method, Sample};
use autoswing::collection::{Collector, RetainedSamples};
use autoswing::compass::TrialSchedule;

use super::solve;
use super::trial::Recording;

/// Retained samples of a flight. Trial solves update the collector's coefficients at the device's pace.
#[must_use]
pub fn retain_samples(samples: &[Sample]) -> Recording {
    let mut retained = RetainedSamples::EMPTY;
    let mut collector = Collector::new(&mut retained);
    collector.begin(Procedure::Flight);
    let mut pace = TrialSchedule::NONE;
    for &sample in samples {
        collector.push(sample);
        if pace.is_due(&collector, sample.time)
            && let Ok(found) = solve(Method::MaximumLikelihood, collector.fit(), ConsiderSigmas::DEFAULT)
        {
            collector.use_trial_solution(&found);
        }
    }
    let all = |samples: autoswing::calibration::Samples<'_>| {
        let mut samples: Vec<Sample> = samples.all().copied().collect();
        samples.sort_by_key(|sample| sample.time.as_ms());
        samples
    };
    Recording::without_sides(all(collector.fit()), all(collector.held_back()))
}
