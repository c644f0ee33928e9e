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
