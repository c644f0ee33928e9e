use nalgebra::Vector3;

use super::collector::Collector;
use super::retained_samples::RetainedSamples;
use crate::calibration::method_selection::Procedure;
use crate::calibration::{CollectionPart, Sample};
use crate::frames::{Field, Level, RollPitch};
use crate::time::WrappingMillis;

/// Horizontal field of all simulated samples, microtesla.
const RADIUS_UT: f32 = 20.0;

pub const HARD_IRON_UT: Vector3<f32> = Vector3::new(60.0, -45.0, 80.0);

/// A collector that has processed these samples.
pub fn collected(procedure: Procedure, samples: impl IntoIterator<Item = Sample>) -> Collector<'static> {
    let mut collector = Collector::new(Box::leak(Box::new(RetainedSamples::EMPTY)));
    collector.begin_procedure(procedure);
    samples.into_iter().for_each(|sample| collector.push_sample(sample));
    collector
}

/// Times of the fit samples of a part, then of those held back, milliseconds.
pub fn stored_times_ms(collector: &Collector<'_>, part: CollectionPart) -> [Vec<u32>; 2] {
    [collector.fit_samples(), collector.held_back_samples()]
        .map(|samples| times_ms(samples.samples_of_part(part).iter()))
}

pub fn times_ms<'a>(samples: impl IntoIterator<Item = &'a Sample>) -> Vec<u32> {
    samples.into_iter().map(|sample| sample.time.as_ms()).collect()
}

pub fn test_sample(field_ut: [f32; 3], time_ms: u32) -> Sample {
    Sample {
        time: WrappingMillis::new(time_ms),
        ..Sample::new(Field::from_ut(field_ut[0], field_ut[1], field_ut[2]), RollPitch::default())
    }
}

pub fn banked_sample(roll_deg: f32, pitch_deg: f32, time_ms: u32) -> Sample {
    Sample { attitude: RollPitch::from_deg(roll_deg, pitch_deg), ..test_sample([20.0, 0.0, 40.0], time_ms) }
}

/// Level sample on a circle whose hard iron is five times its radius.
pub fn circle_sample(heading_deg: f32) -> Sample {
    let (sin, cos) = heading_deg.to_radians().sin_cos();
    let field_ut = Vector3::new(RADIUS_UT * cos, -RADIUS_UT * sin, 45.0) + HARD_IRON_UT;
    test_sample(field_ut.into(), 0)
}

/// Samples of a turn at 10 Hz: 20 uT horizontal, 45 uT down, hard iron of 110 uT, 1 deg of bank wander.
pub fn turn_samples(roll_deg: f32, from_s: u16, to_s: u16, rate_deg_s: f32) -> impl Iterator<Item = Sample> {
    (from_s * 10..to_s * 10).map(move |i| {
        let t_s = f32::from(i) / 10.0;
        let attitude = RollPitch::from_deg(roll_deg + (t_s * 4.2).sin(), 2.0);
        let body = attitude.to_body_frame(Field::<Level>::earth_field(49.2, 1.152, (rate_deg_s * t_s).to_radians()));
        Sample {
            time: WrappingMillis::new(u32::from(i) * 100),
            ..Sample::new(Field::new(body.ut + HARD_IRON_UT), attitude)
        }
    })
}
