//! What a module keeps of a flight's samples, which come ten a second.

use autoswing::calibration::ladder::Procedure;
use autoswing::calibration::{Consider, Method, Sample};
use autoswing::collection::{Collector, Kept};
use autoswing::compass::Pace;

use super::solve;
use super::trial::Recorded;

/// What the device's own collection keeps of whatever is flown, told by trial solves at the device's pace.
#[must_use]
pub fn collect(samples: &[Sample]) -> Recorded {
    let mut kept = Kept::EMPTY;
    let mut collector = Collector::new(&mut kept);
    collector.begin(Procedure::Flight);
    let mut pace = Pace::NONE;
    for &sample in samples {
        collector.push(sample);
        if pace.is_due(&collector, sample.time)
            && let Ok(found) = solve(Method::MaximumLikelihood, collector.fit(), Consider::DEFAULT)
        {
            collector.learn(&found);
        }
    }
    let all = |samples: autoswing::calibration::Samples<'_>| {
        let mut samples: Vec<Sample> = samples.all().copied().collect();
        samples.sort_by_key(|sample| sample.time.count());
        samples
    };
    Recorded::of_no_side(all(collector.fit()), all(collector.held_back()))
}
