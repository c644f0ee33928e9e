//! The device's own state machine, asked when it would have had enough.

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

/// After how many samples of whatever was flown the collection ends by itself; none if it does not.
pub(super) fn ends_after(samples: &[Sample], options: &Options) -> Option<usize> {
    let inclination_deg = options.inclination_deg.map(|degrees| degrees as f32);
    let settings = Settings { inclination_deg, ..Settings::DEFAULT };
    let mut kept = Kept::EMPTY;
    let mut compass = Compass::new(Policy::DEFAULT, &Stored { settings, ..Stored::default() }, &mut kept);
    compass.step(Event::SensorFound(SENSOR, 1));
    compass.step(Event::Command(Command::CalStart(Procedure::Flight), WrappingMillis::default()));
    samples
        .iter()
        .position(|&sample| {
            compass.step(Event::Sample(sample));
            while compass.is_busy() {
                if !matches!(compass.step(Event::Advance), Effect::None) {
                    return true;
                }
            }
            false
        })
        .map(|last| last + 1)
}
