//! The firmware's driver on the simulated chip.

use autoswing::inertial::{AttitudeFilter, GRAVITY_M_S2, SensorOffsets};
use autoswing::time::Timestamp;
use autoswing_firmware::chip::{ChipError, MeasuringChip as _};
use autoswing_firmware::inertial_sensor::InertialSensor as _;
use autoswing_firmware::inertial_sensor::lsm6dsl::Lsm6dsl;
use embassy_time::Instant;
use log_analysis::numbers::square;
use nalgebra::Vector3;
use testkit::simulation::{ExecutorLevel, Simulation};

use super::*;
use crate::devices::i2c::{BusError, SimulatedI2cBus};

/// Specific force of a chip that lies level with its z axis down.
fn level_force() -> Vector3<f64> {
    Vector3::new(0.0, 0.0, -f64::from(GRAVITY_M_S2))
}

fn at_rest(_: u64) -> InertialTruth {
    InertialTruth { rates_rad_s: Vector3::zeros(), specific_force_m_s2: level_force(), temperature_c: 30.0 }
}

/// Runs `script` with the driver of a chip whose errors are drawn by `seed`.
fn run_driver<F: Future<Output = ()> + 'static>(
    seed: u64,
    error_scale: f64,
    source: impl FnMut(u64) -> InertialTruth + 'static,
    script: impl FnOnce(Lsm6dsl<SimulatedI2cBus>, Rc<RefCell<SimulatedLsm6dsl>>) -> F,
) {
    let chip = SimulatedLsm6dsl::new(seed, error_scale, Box::new(source));
    let bus = SimulatedI2cBus::new();
    bus.attach_device(chip.clone());
    Simulation::new().run_to_end(ExecutorLevel::Thread, script(Lsm6dsl::new(bus, ADDRESS), chip));
}

/// Each measurement is read once, soon after its end, with the units and signs of the motion.
#[test]
fn the_driver_reads_every_measurement_of_an_exact_chip() {
    let spinning = |at_us: u64| InertialTruth {
        rates_rad_s: Vector3::new(at_us as f64 * 1e-6, -8.0, 0.5),
        specific_force_m_s2: Vector3::new(3.0, -20.0, 50.0),
        temperature_c: 30.0,
    };
    run_driver(1, 0.0, spinning, |mut driver, _| async move {
        driver.init().await.unwrap();
        assert!(Instant::now().as_millis() < 400, "the sensor task's timeout: {}", Instant::now().as_millis());
        let mut last_s: Option<f32> = None;
        for _ in 0..200 {
            let reading = driver.read_measurement().await.unwrap();
            let measured_s = reading.sample.rates_rad_s.x;
            let age_s = Instant::now().as_micros() as f32 * 1e-6 - measured_s;
            // A poll's interval and both transfers; a count of 0.07 deg/s is 1.2 ms here.
            assert!((-0.001..0.003).contains(&age_s), "{age_s}");
            assert!(last_s.is_none_or(|last_s| (measured_s - last_s - 0.0048).abs() < 0.0015), "{measured_s}");
            last_s = Some(measured_s);
            assert!((reading.sample.rates_rad_s.y + 8.0).abs() < 1e-3 && !reading.is_saturated);
            assert!((reading.sample.specific_force_m_s2 - Vector3::new(3.0, -20.0, 50.0)).norm() < 4e-3);
            assert!((reading.temperature_c - 30.0).abs() < 0.01);
        }
    });
}

/// 2000 deg/s and 8 g are exceeded.
#[test]
fn a_clipped_measurement_says_so() {
    let fast = |_| InertialTruth { rates_rad_s: Vector3::new(0.0, 0.0, 45.0), ..at_rest(0) };
    run_driver(1, 0.0, fast, |mut driver, _| async move {
        assert!(matches!(driver.init().await, Err(ChipError::SelfTest(0x40))), "the z axis cannot move further");
        assert!(driver.read_measurement().await.unwrap().is_saturated);
    });
}

#[test]
fn every_flipped_bit_is_detected_and_restored() {
    run_driver(1, 1.0, at_rest, |mut driver, chip| async move {
        driver.init().await.unwrap();
        for register in 0x10..=0x19 {
            for bit in 0..8 {
                let written = chip.borrow().register_value(register);
                chip.borrow_mut().flip_register_bits(register, 1 << bit);
                let upset = driver.verify_configuration().await;
                assert!(matches!(upset, Err(ChipError::Configuration { .. })), "{register:#x} {bit}: {upset:?}");
                driver.init().await.unwrap();
                assert_eq!(chip.borrow().register_value(register), written);
            }
        }
    });
}

#[test]
fn a_chip_that_fails_is_reported() {
    run_driver(1, 1.0, at_rest, |mut driver, chip| async move {
        chip.borrow_mut().set_failed_sensor(true);
        assert_eq!(driver.init().await, Err(ChipError::SelfTest(0x10)));
        chip.borrow_mut().set_failed_sensor(false);
        driver.init().await.unwrap();
        chip.borrow_mut().power_cycle();
        assert_eq!(driver.read_measurement().await, Err(ChipError::NoData));
        driver.init().await.unwrap();
        chip.borrow_mut().set_frozen(true);
        assert_eq!(driver.init().await, Err(ChipError::SelfTest(0x77)));
        chip.borrow_mut().set_silent(true);
        assert_eq!(driver.init().await, Err(ChipError::Bus(BusError::NoAcknowledge(ADDRESS))));
    });
}

/// 300 chips: zero-rate level of 3 deg/s that drifts by 0.015 deg/s/K, zero-g level of 40 mg, noise of 4 mdps/sqrt(Hz) in
/// half of 208 Hz.
#[test]
fn errors_are_those_of_the_data_sheet() {
    let (mut offsets, mut drifts, mut forces, mut noise) = (0.0, 0.0, 0.0, 0.0);
    for seed in 0..300 {
        let mut errors = MeasurementErrors::new(seed, 1.0);
        let mut samples_at = |temperature_c: f64| -> Vec<InertialTruth> {
            let exact = InertialTruth { temperature_c, specific_force_m_s2: Vector3::zeros(), ..at_rest(0) };
            (0..100).map(|_| errors.measure(&exact, 208.0)).collect()
        };
        let rate_deg_s = |sample: &InertialTruth| sample.rates_rad_s.x.to_degrees();
        let mean_deg_s = |samples: &[InertialTruth]| samples.iter().map(rate_deg_s).sum::<f64>() / 100.0;
        let samples = samples_at(25.0);
        let cold_deg_s = mean_deg_s(&samples);
        offsets += square(cold_deg_s) / 300.0;
        drifts += square((mean_deg_s(&samples_at(85.0)) - cold_deg_s) / 60.0) / 300.0;
        forces += square(samples[0].specific_force_m_s2.x / 9.806_65 * 1e3) / 300.0;
        noise += samples.iter().map(|sample| square(rate_deg_s(sample) - cold_deg_s)).sum::<f64>() / 29_700.0;
    }
    assert!((offsets.sqrt() - 3.0).abs() < 0.5 && (forces.sqrt() - 40.0).abs() < 7.0, "{offsets} {forces}");
    assert!((drifts.sqrt() - 0.015).abs() < 0.0025, "{}", drifts.sqrt());
    assert!((noise.sqrt() - 0.0408).abs() < 0.001, "{}", noise.sqrt());
}

/// Chips of the data sheet's errors: after two seconds of rest the tilt is known as well as the accelerometer's offset
/// allows, which sigma includes, and the rates are free of the gyro's.
#[test]
fn the_attitude_filter_knows_the_errors_of_the_chip() {
    for seed in 0..20 {
        run_driver(seed, 1.0, at_rest, |mut driver, _| async move {
            driver.init().await.unwrap();
            let mut filter = AttitudeFilter::new(driver.sensor_errors(), SensorOffsets::UNKNOWN);
            for _ in 0..416 {
                let reading = driver.read_measurement().await.unwrap();
                filter.update(Timestamp::from_us(Instant::now().as_micros()), &reading.sample, None);
            }
            let attitude = filter.attitude().unwrap();
            let tilt_rad = libm::hypotf(attitude.attitude.roll_rad, attitude.attitude.pitch_rad);
            let sigma_rad = attitude.tilt_sigma_rad();
            assert!(tilt_rad < 4.0 * sigma_rad && sigma_rad < 0.15, "{tilt_rad} {sigma_rad}");
            assert!(attitude.rates_rad_s.norm().to_degrees() < 0.3, "{}", attitude.rates_rad_s.norm().to_degrees());
        });
    }
}
