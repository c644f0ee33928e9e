//! Every vehicle's routine determines its calibration: what the module's instrument makes of the flight, what its collection
//! keeps of that, and what its solver makes of those.

use std::f64::consts::TAU;

use autoswing::attitude::{Report, Source};
use autoswing::calibration::ladder::Procedure;
use autoswing::calibration::{Calibration, Method, Prior, Sample, solve};
use autoswing::collection::{Collector, Kept};
use autoswing::frames::{Attitude, Field};
use autoswing::instrument::{Config, Instrument};
use autoswing::magnetometer::Reading;
use autoswing::time::{Timestamp, WrappingMillis};
use host_sim::accuracy::trial::{Ranges, Trial};
use host_sim::random::{Purpose, Random};
use host_sim::routine::{Plan, Routine};
use host_sim::score::{Figures, wrap_180};
use host_sim::simulation::Simulation;
use host_sim::world::aircraft::Kind;
use host_sim::world::airframe::Airframe;
use host_sim::world::attitude_source;
use host_sim::world::autopilot::Leg;
use host_sim::world::earth::Earth;
use host_sim::world::rotation::Euler;
use host_sim::world::{World, WorldConfig};

/// The same airframes and places as those of `bench accuracy`: soft iron to 30 %, hard iron to three times the horizontal
/// field, mounting to 20 deg, inclination -70 to 75 deg, attitude noise of 0.2 to 1 deg. That is correlated over half a
/// second, and the source's bias, its lean and what pushes make come on top.
fn harsh(kind: Kind, seed: u64) -> WorldConfig {
    const TOTAL_UT: f64 = 50.0;
    let trial = Trial::draw(&Ranges::HARSH, seed);
    let world = WorldConfig::random(seed).carried_by(kind);
    let noise_deg = trial.attitude_sigma_rad.to_degrees();
    WorldConfig {
        airframe: Airframe { a: trial.a, b_ut: trial.b * TOTAL_UT },
        earth: Earth { total_ut: TOTAL_UT, inclination_deg: trial.inclination_rad.to_degrees() },
        attitude_source: attitude_source::Config { noise_deg, ..world.attitude_source },
        ..world
    }
}

/// Samples of flown legs, ten a second: attitude at 50 Hz with its errors, the field at 80 Hz with noise of 0.32 uT.
fn flown(config: &WorldConfig, legs: &[Leg]) -> Vec<Sample> {
    const STEP_US: u64 = 2_500;
    let mut simulation = Simulation::new();
    let world = World::new(*config);
    let mut source = world.attitude_source();
    let mut noise = Random::new(config.seed, Purpose::Magnetometer);
    for &leg in legs {
        world.fly(leg);
    }
    let latency_us = (config.attitude_source.latency_ms * 1e3) as u64;
    let mut instrument = Instrument::new(Config::new(12_500));
    let mut samples = Vec::new();
    for tick in 8.. {
        let now_us = tick * STEP_US;
        simulation.run_until(now_us);
        if world.legs_left() == 0 {
            break;
        }
        let at = Timestamp::from_us(now_us);
        if now_us.is_multiple_of(20_000) {
            let truth = world.true_state(now_us - latency_us);
            let reported = source.report(&truth);
            let [roll_rad, pitch_rad] = [reported.roll_rad, reported.pitch_rad].map(|angle| angle as f32);
            let sender_time = WrappingMillis::new((now_us / 1000) as u32);
            let attitude = Attitude { roll_rad, pitch_rad };
            let rates_rad_s = truth.body_rates_rad_s().map(|rate| rate as f32);
            instrument.on_attitude(at, Report { source: Source::default(), sender_time, attitude, rates_rad_s });
        }
        if now_us.is_multiple_of(12_500) {
            let field = Field::new(world.sensor_field(now_us).ut + (noise.normal_vector() * 0.32).cast());
            instrument.on_reading(at, Reading { field, saturated: false, overrun: false });
            samples.extend(std::iter::from_fn(|| instrument.next_sample()));
        }
    }
    samples
}

/// RMS heading error at exact field and attitude: level, and tilted by 20 deg to eight sides, at twelve headings.
fn rms_deg(calibration: &Calibration, config: &WorldConfig) -> f64 {
    let tilts = (0..8).map(|side| f64::from(side) / 8.0 * TAU).map(|side| [20.0 * side.cos(), 20.0 * side.sin()]);
    let errors: Vec<f64> = std::iter::once([0.0; 2])
        .chain(tilts)
        .flat_map(|[roll_deg, pitch_deg]| (0..12).map(move |i| [roll_deg, pitch_deg, f64::from(i) * 30.0]))
        .map(|[roll_deg, pitch_deg, heading_deg]| {
            let truth = Euler::from_deg(roll_deg, pitch_deg, heading_deg);
            let sensed = config.airframe.measure(&config.earth.body_field_ut(truth));
            let level = Attitude::from_deg(roll_deg as f32, pitch_deg as f32).level(calibration.apply(sensed));
            wrap_180(f64::from(level.heading_rad().to_degrees()) - heading_deg)
        })
        .collect();
    Figures::of(&errors).rms_deg
}

fn routine(kind: Kind) -> Routine {
    Routine::of(kind, Plan { circles: 3.0, ..Plan::default() }, 0.0)
}

/// RMS heading errors after these legs: the median of 40 airframes, and what a tenth of them exceed. What cannot be solved
/// is infinitely wrong.
fn median_and_worst_decile_deg(kind: Kind, legs: &[Leg]) -> [f64; 2] {
    let mut rms: Vec<f64> = (100..140)
        .map(|seed| {
            let config = harsh(kind, seed);
            let mut kept = Kept::EMPTY;
            let mut collector = Collector::new(&mut kept);
            collector.begin(Procedure::Flight);
            for sample in flown(&config, legs) {
                collector.push(sample);
            }
            let prior = Prior { readings_per_sample: 8, ..Prior::default() };
            let solved = solve(Method::MaximumLikelihood, collector.fit(), &prior);
            solved.map_or(f64::INFINITY, |solution| rms_deg(&solution.calibration, &config))
        })
        .collect();
    rms.sort_by(f64::total_cmp);
    [rms[rms.len() / 2], rms[rms.len() * 9 / 10]]
}

/// The promise for a copter is 0.8 and 1.6 deg; measured were 0.57 and 1.20.
#[test]
fn a_copter_s_routine_determines_its_calibration() {
    let [median, worst_decile] = median_and_worst_decile_deg(Kind::Copter, &routine(Kind::Copter).legs());
    assert!(median <= 0.8 && worst_decile <= 1.6, "{median}, {worst_decile}");
}

/// What the pushes are for. Turning alone tilts it as the wind does, to one side of the earth.
#[test]
fn turning_in_hover_is_not_enough() {
    let [median, _] = median_and_worst_decile_deg(Kind::Copter, &routine(Kind::Copter).parts[0].legs.repeat(3));
    assert!(median > 1.6, "{median}");
}

/// Measured: 0.28 and 0.57 deg of an aeroplane with three circles each way, 0.25 and 0.62 of a VTOL, 0.54 and 1.25 of a
/// rover, 0.72 and 1.47 of a boat, whose tilts are small and whose attitude is always pushed about.
#[test]
fn so_do_the_others() {
    for (kind, most_median, most_worst_decile) in
        [(Kind::Plane, 0.4, 0.8), (Kind::Vtol, 0.4, 0.9), (Kind::Rover, 0.8, 1.6), (Kind::Boat, 1.0, 2.0)]
    {
        let [median, worst_decile] = median_and_worst_decile_deg(kind, &routine(kind).legs());
        assert!(median <= most_median && worst_decile <= most_worst_decile, "{kind:?}: {median}, {worst_decile}");
    }
}
