//! The device's own state machine, asked what it would have collected, and when it would have had enough.

use autoswing::acceptance::Policy;
use autoswing::calibration::Sample;
use autoswing::calibration::ladder::Procedure;
use autoswing::collection::Kept;
use autoswing::compass::{Command, Compass, Effect, Event};
use autoswing::magnetometer::{Identity, Model};
use autoswing::settings::Settings;
use autoswing::store::Stored;
use autoswing::time::WrappingMillis;

use super::Options;

/// Any: samples have been averaged already, and nothing is stored.
const SENSOR: Identity = Identity { model: Model::Lis3mdl, address: 0x1E };

/// Gives samples of whatever was flown to a module, whose trial solves tell it which of them to keep: the module with what it
/// collected until that ended by itself, and after how many samples that was; none if it did not.
pub(super) fn collect<'a>(samples: &[Sample], options: &Options, kept: &'a mut Kept) -> (Compass<'a>, Option<usize>) {
    let inclination_deg = options.inclination_deg.map(|degrees| degrees as f32);
    let settings = Settings { inclination_deg, ..Settings::DEFAULT };
    let mut compass = Compass::new(Policy::DEFAULT, &Stored { settings, ..Stored::default() }, kept);
    compass.step(Event::SensorFound(SENSOR, 1));
    if let Some((place, day)) = options.here {
        compass.step(Event::Place(place));
        compass.step(Event::Day(day));
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
    use autoswing::calibration::{Rates, Samples};
    use autoswing::collection::Collector;
    use autoswing::frames::{Attitude, Field};
    use testkit::random::Random;

    use super::super::Selected;
    use super::*;
    use crate::accuracy::collected;

    /// Four minutes to and fro about north, of which nothing good comes, so that it does not end by itself.
    fn samples() -> Vec<Sample> {
        let mut random = Random(3);
        let of = |i: u16| {
            let t_s = f32::from(i) / 10.0;
            let attitude = Attitude::from_deg(15.0 * (0.31 * t_s).sin(), 6.0 * (0.47 * t_s).sin());
            let body = attitude.body(Field::earth(50.0, 1.1, 0.4 * (0.2 * t_s).sin())).ut;
            let field = Field::from_ut(
                body.x + 20.0 + 0.3 * random.normal(),
                body.y - 10.0 + 0.3 * random.normal(),
                body.z + 0.3 * random.normal(),
            );
            Sample { field, attitude, rates: Rates::NONE, time: WrappingMillis::new(u32::from(i) * 100) }
        };
        (0..2400).map(of).collect()
    }

    /// In the order of time.
    fn sorted(samples: Samples<'_>) -> Vec<Sample> {
        let mut samples: Vec<Sample> = samples.all().copied().collect();
        samples.sort_by_key(|sample| sample.time.count());
        samples
    }

    /// What a collector keeps that is not told what trial solves find.
    fn kept_untold(samples: &[Sample]) -> Vec<Sample> {
        let mut kept = Kept::EMPTY;
        let mut collector = Collector::new(&mut kept);
        collector.begin(Procedure::Flight);
        for &sample in samples {
            collector.push(sample);
        }
        sorted(collector.fit())
    }

    /// Which samples are kept depends on what the trial solves find: a module's are those, and not the ones that would be kept
    /// without.
    #[test]
    fn what_is_collected_is_told_by_trial_solves() {
        let samples = samples();
        let options = Options::of(Selected::Flight);
        let mut kept = Kept::EMPTY;
        let (compass, ended) = collect(&samples, &options, &mut kept);
        let collected = sorted(compass.collected().fit());
        assert_eq!(ended, None);
        assert_eq!(collected, sorted(collected::collect(&samples).samples()));
        assert_ne!(collected, kept_untold(&samples));
    }
}
