//! What a module keeps of a flight's samples, which come ten a second: the one place to change when the device's own
//! collection keeps them.

use autoswing::calibration::Sample;
use autoswing::collection::dataset::FIT_CAPACITY;

use super::trial::Recorded;

/// As many as the device holds of both sides together.
const CAPACITY: usize = 2 * FIT_CAPACITY;

/// Evenly thinned to what the device holds; the ones half-way between are held back.
#[must_use]
pub fn collect(samples: &[Sample]) -> Recorded {
    // Of a short flight every other one: there must be some between.
    let number = CAPACITY.min(samples.len() / 2);
    let thinned = |phase: f64| -> Vec<Sample> {
        let index = |i: usize| ((i as f64 + phase) * samples.len() as f64 / number as f64) as usize;
        (0..number).filter_map(|i| samples.get(index(i))).copied().collect()
    };
    Recorded::of_no_side(thinned(0.0), thinned(0.5))
}

#[cfg(test)]
mod tests {
    use super::*;
    use autoswing::calibration::Rates;
    use autoswing::frames::{Attitude, Field};
    use autoswing::time::WrappingMillis;

    #[test]
    fn no_sample_is_both_fitted_and_held_back() {
        let sample = |i: u32| Sample {
            field: Field::from_ut(0.0, 0.0, 0.0),
            attitude: Attitude::default(),
            rates: Rates::NONE,
            time: WrappingMillis::new(i),
        };
        for (flown, kept) in [(100, 50), (1800, CAPACITY), (12_000, CAPACITY)] {
            let samples: Vec<Sample> = (0..flown).map(sample).collect();
            let recorded = collect(&samples);
            let times = |samples: autoswing::calibration::Samples<'_>| -> Vec<u32> {
                samples.iter().map(|sample| sample.time.count()).collect()
            };
            let (fit, held_back) = (times(recorded.samples()), times(recorded.held_back()));
            assert_eq!((fit.len(), held_back.len()), (kept, kept));
            assert!(fit.iter().all(|time| !held_back.contains(time)));
            assert!(fit.windows(2).all(|pair| pair[0] < pair[1]));
            // From the beginning to the end.
            assert!(fit[0] == 0 && flown - fit[kept - 1] <= 1 + flown / kept as u32);
        }
    }
}
