//! Runs the device's state machine on recorded samples.

use autoswing::acceptance::AcceptancePolicy;
use autoswing::calibration::Sample;
use autoswing::calibration::method_selection::Procedure;
use autoswing::collection::RetainedSamples;
use autoswing::compass::{Command, Compass, Effect, Event};
use autoswing::reading::{Identity, Model};
use autoswing::settings::Settings;
use autoswing::store::StoredValues;
use autoswing::time::WrappingMillis;

use super::ReplayOptions;

/// Arbitrary: samples are already averaged, and nothing is stored.
const SENSOR: Identity = Identity { model: Model::Lis3mdl, address: 0x1E };

/// Feeds samples to a module in the flight procedure with its trial solves; returns the module and the number of
/// samples at the automatic end.
pub(super) fn collect_on_device<'a>(
    samples: &[Sample],
    options: &ReplayOptions,
    retained: &'a mut RetainedSamples,
) -> (Compass<'a>, Option<usize>) {
    let inclination_deg = options.inclination_deg.map(|degrees| degrees as f32);
    let settings = Settings { inclination_deg, ..Settings::DEFAULT };
    let mut compass =
        Compass::new(AcceptancePolicy::DEFAULT, &StoredValues { settings, ..StoredValues::default() }, retained);
    compass.step(Event::SensorDetected(SENSOR, 1));
    if let Some((place, day)) = options.place_and_day {
        compass.step(Event::Position(place));
        compass.step(Event::Date(day));
    }
    compass.step(Event::Command(Command::CalStart(Procedure::Flight), WrappingMillis::default()));
    let last = samples.iter().position(|&sample| {
        compass.step(Event::Sample(sample));
        while compass.is_busy() {
            if !matches!(compass.step(Event::Advance), Effect::None) {
                return true;
            }
        }
        false
    });
    (compass, last.map(|last| last + 1))
}

#[cfg(test)]
mod tests {
    use autoswing::calibration::{Current, Part, Rates, Samples};
    use autoswing::collection::Collector;
    use autoswing::frames::{Attitude, Field};
    use testkit::random::Random;

    use super::super::RowSelection;
    use super::*;
    use crate::accuracy::retention;

    /// Four minutes of small turns about north, insufficient for a calibration.
    fn samples() -> Vec<Sample> {
        let mut random = Random(3);
        let sample_at = |i: u16| {
            let t_s = f32::from(i) / 10.0;
            let attitude = Attitude::from_deg(15.0 * (0.31 * t_s).sin(), 6.0 * (0.47 * t_s).sin());
            let body = attitude.body(Field::earth(50.0, 1.1, 0.4 * (0.2 * t_s).sin())).ut;
            let field = Field::from_ut(
                body.x + 20.0 + 0.3 * random.normal(),
                body.y - 10.0 + 0.3 * random.normal(),
                body.z + 0.3 * random.normal(),
            );
            Sample {
                field,
                attitude,
                rates: Rates::ZERO,
                time: WrappingMillis::new(u32::from(i) * 100),
                current: Current::UNKNOWN,
                part: Part::FREE,
            }
        };
        (0..2400).map(sample_at).collect()
    }

    fn sorted(samples: Samples<'_>) -> Vec<Sample> {
        let mut samples: Vec<Sample> = samples.all().copied().collect();
        samples.sort_by_key(|sample| sample.time.as_ms());
        samples
    }

    /// Samples kept without results of trial solves.
    fn retained_without_trial_solves(samples: &[Sample]) -> Vec<Sample> {
        let mut retained = RetainedSamples::EMPTY;
        let mut collector = Collector::new(&mut retained);
        collector.begin(Procedure::Flight);
        for &sample in samples {
            collector.push(sample);
        }
        sorted(collector.fit())
    }

    #[test]
    fn trial_solves_change_the_retained_samples() {
        let samples = samples();
        let options = ReplayOptions::with_selection(RowSelection::Flight);
        let mut retained = RetainedSamples::EMPTY;
        let (compass, ended) = collect_on_device(&samples, &options, &mut retained);
        let collected = sorted(compass.collector().fit());
        assert_eq!(ended, None);
        assert_eq!(collected, sorted(retention::retain_samples(&samples).samples()));
        assert_ne!(collected, retained_without_trial_solves(&samples));
    }
}
