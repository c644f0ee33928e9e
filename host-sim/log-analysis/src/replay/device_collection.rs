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
#[must_use]
pub fn collect_on_device<'a>(
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
