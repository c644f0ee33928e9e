//! What a module keeps of a flight's samples, which come ten a second.

use autoswing::calibration::Sample;
use autoswing::calibration::ladder::Procedure;
use autoswing::collection::Collector;

use super::trial::Recorded;

/// What the device's own collection keeps of whatever is flown.
#[must_use]
pub fn collect(samples: &[Sample]) -> Recorded {
    let mut collector = Collector::new();
    collector.begin(Procedure::Flight);
    for &sample in samples {
        collector.push(sample);
    }
    let all = |samples: autoswing::calibration::Samples<'_>| {
        let mut samples: Vec<Sample> = samples.all().copied().collect();
        samples.sort_by_key(|sample| sample.time.count());
        samples
    };
    Recorded::of_no_side(all(collector.fit()), all(collector.held_back()))
}
