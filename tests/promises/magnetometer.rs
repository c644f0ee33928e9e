//! Drivers with the register-level chip models: fresh, complete data, and recovery from faults.

use std::cell::RefCell;
use std::rc::Rc;

use autoswing::frames::Field;
use autoswing::reading::Reading;
use autoswing_firmware::chip::{ChipError, MeasuringChip as _};
use autoswing_firmware::magnetometer::lis3mdl::Lis3mdl;
use autoswing_firmware::magnetometer::rm3100::Rm3100;
use embassy_time::Instant;
use simulator::devices::i2c::{BusError, SimulatedI2cBus};
use simulator::devices::lis3mdl as chip;
use simulator::devices::rm3100::{self, Rm3100Fault};
use simulator::devices::sensor::SensorModel;
use simulator::devices::spi::SelectedDevice;
use simulator::module::Module as _;
use simulator::rig::Rig;
use simulator::sensors::SimulatedMagnetometer;
use simulator::world::WorldConfig;
use testkit::simulation::{ExecutorLevel, Simulation};

use crate::fixtures::full_status;

/// Runs `script` with a driver and its chip. The field's x component is 1 nT per 100 us since start, so a sample
/// contains its time of measurement with a resolution of 15 nT = 1.5 ms.
fn run_with_driver<F: Future<Output = ()> + 'static>(
    script: impl FnOnce(Lis3mdl<SimulatedI2cBus>, Rc<RefCell<chip::SimulatedLis3mdl>>) -> F,
) {
    let mut simulation = Simulation::new();
    let chip = chip::SimulatedLis3mdl::new(0, 0.0, Box::new(|at_us| Field::from_ut(at_us as f32 * 1e-5, 0.0, 0.0)));
    let bus = SimulatedI2cBus::new();
    bus.attach_device(chip.clone());
    simulation.run_to_end(ExecutorLevel::Interrupt, script(Lis3mdl::new(bus), chip));
}

fn measured_at_us(reading: &Reading) -> f32 {
    reading.field.ut.x * 1e5
}

/// 160 samples in 2 s at 80 Hz. A sample is at most 1.3 ms old: 0.5 ms of polling, two transfers (0.09 and 0.2 ms), and
/// half a count of the field that encodes time.
#[test]
fn every_measurement_is_read_once_and_fresh() {
    run_with_driver(|mut driver, _| async move {
        driver.init().await.unwrap();
        let mut last_us = measured_at_us(&driver.read_measurement().await.unwrap());
        for _ in 0..160 {
            let reading = driver.read_measurement().await.unwrap();
            assert!(!reading.was_overwritten);
            let (measured_us, now_us) = (measured_at_us(&reading), Instant::now().as_micros() as f32);
            assert!((-750.0..1_550.0).contains(&(now_us - measured_us)), "age {} us", now_us - measured_us);
            assert!((measured_us - last_us - 12_500.0).abs() <= 1_500.0, "{last_us} to {measured_us} us");
            last_us = measured_us;
        }
    });
}

#[test]
fn a_silent_chip_is_reported_and_works_again_after_init() {
    run_with_driver(|mut driver, chip| async move {
        driver.init().await.unwrap();
        chip.borrow_mut().set_silent(true);
        assert_eq!(driver.read_measurement().await, Err(ChipError::Bus(BusError::NoAcknowledge(0x1E))));
        assert_eq!(driver.init().await, Err(ChipError::Bus(BusError::NoAcknowledge(0x1E))));
        chip.borrow_mut().set_silent(false);
        driver.init().await.unwrap();
        driver.read_measurement().await.unwrap();
    });
}

/// After a power loss the chip is in power-down: no data, detected within four periods (50 ms) after the sleep of 11
/// ms.
#[test]
fn a_chip_that_lost_power_is_detected_and_reconfigured() {
    run_with_driver(|mut driver, chip| async move {
        driver.init().await.unwrap();
        driver.read_measurement().await.unwrap();
        chip.borrow_mut().power_cycle();
        let start = Instant::now();
        assert_eq!(driver.read_measurement().await, Err(ChipError::NoData));
        assert!(start.elapsed().as_millis() <= 62, "{} ms", start.elapsed().as_millis());
        driver.init().await.unwrap();
        driver.read_measurement().await.unwrap();
    });
}

#[test]
fn a_late_reader_sees_the_overrun() {
    run_with_driver(|mut driver, _| async move {
        driver.init().await.unwrap();
        driver.read_measurement().await.unwrap();
        embassy_time::Timer::after_millis(100).await;
        assert!(driver.read_measurement().await.unwrap().was_overwritten);
        assert!(!driver.read_measurement().await.unwrap().was_overwritten);
    });
}

/// As [`run_with_driver`], with an RM3100. The field's z component is 1 uT per 10 ms, resolved to 0.13 ms.
fn run_with_rm3100<F: Future<Output = ()> + 'static>(
    period_scale: f64,
    script: impl FnOnce(Rm3100<SelectedDevice>, Rc<RefCell<rm3100::SimulatedRm3100>>) -> F,
) {
    let mut simulation = Simulation::new();
    let field = |at_us| Field::from_ut(20.0, 0.0, at_us as f32 * 1e-4);
    let chip = rm3100::SimulatedRm3100::new(0, 0.0, period_scale, Box::new(field));
    let driver = Rm3100::new(SelectedDevice::new(chip.clone()));
    simulation.run_to_end(ExecutorLevel::Interrupt, script(driver, chip));
}

/// 75 Hz with an oscillator up to three standard deviations of 7 % off. z is measured last; its middle is 1.14 ms
/// before the end. Then 0.5 ms of polling, transfers of 0.016, 0.016 and 0.08 ms, and half a count of 0.07 ms.
#[test]
fn every_measurement_of_an_rm3100_is_read_once_and_fresh() {
    for period_scale in [1.0 / 1.21, 1.0, 1.0 / 0.79] {
        run_with_rm3100(period_scale, move |mut driver, _| async move {
            driver.init().await.unwrap();
            driver.read_measurement().await.unwrap();
            let measured_at_us = |reading: &Reading| reading.field.ut.z * 1e4;
            let mut last_us = measured_at_us(&driver.read_measurement().await.unwrap());
            for _ in 0..150 {
                let measured_us = measured_at_us(&driver.read_measurement().await.unwrap());
                let age_us = Instant::now().as_micros() as f32 - measured_us;
                assert!((1_060.0..1_850.0).contains(&age_us), "{period_scale}: age {age_us} us");
                let period_us = 13_333.0 * period_scale as f32;
                assert!((measured_us - last_us - period_us).abs() <= 150.0, "{last_us} to {measured_us} us");
                last_us = measured_us;
            }
        });
    }
}

/// On SPI nothing acknowledges: a chip that no longer drives the line is detected by its data.
#[test]
fn a_missing_rm3100_is_reported_and_works_again_after_init() {
    for idle_byte in [0xFF, 0x00] {
        run_with_rm3100(1.0, move |mut driver, chip| async move {
            chip.borrow_mut().set_fault(Some(Rm3100Fault::MissingChip(idle_byte)));
            assert_eq!(driver.init().await, Err(ChipError::WrongIdentity(idle_byte)));
            chip.borrow_mut().set_fault(None);
            driver.init().await.unwrap();
            driver.read_measurement().await.unwrap();
            chip.borrow_mut().set_fault(Some(Rm3100Fault::MissingChip(idle_byte)));
            assert_eq!(driver.read_measurement().await, Err(ChipError::NoData));
            chip.borrow_mut().set_fault(None);
            driver.init().await.unwrap();
            driver.read_measurement().await.unwrap();
        });
    }
}

#[test]
fn a_chip_that_is_no_working_rm3100_is_not_started() {
    run_with_rm3100(1.0, |mut driver, chip| async move {
        for (fault, error) in [
            (Rm3100Fault::WrongRevision(0x23), ChipError::WrongIdentity(0x23)),
            (Rm3100Fault::BrokenOscillator(0), ChipError::SelfTest(0xEF)),
            (Rm3100Fault::BrokenOscillator(1), ChipError::SelfTest(0xDF)),
            (Rm3100Fault::BrokenOscillator(2), ChipError::SelfTest(0xBF)),
            (Rm3100Fault::NeverReady, ChipError::NoData),
        ] {
            chip.borrow_mut().set_fault(Some(fault));
            assert_eq!(driver.init().await, Err(error));
        }
        chip.borrow_mut().set_fault(None);
        driver.init().await.unwrap();
        driver.read_measurement().await.unwrap();
        chip.borrow_mut().set_fault(Some(Rm3100Fault::NeverReady));
        assert_eq!(driver.read_measurement().await, Err(ChipError::NoData));
    });
}

/// Reset values are 37 Hz and no continuous mode: no data within four periods (53 ms) after the sleep of 10.5 ms.
#[test]
fn an_rm3100_that_lost_power_is_detected_and_reconfigured() {
    run_with_rm3100(1.0, |mut driver, chip| async move {
        driver.init().await.unwrap();
        driver.read_measurement().await.unwrap();
        chip.borrow_mut().power_cycle();
        assert_eq!(driver.verify_configuration().await, Err(ChipError::Configuration { written: 0x95, read: 0x96 }));
        let start = Instant::now();
        assert_eq!(driver.read_measurement().await, Err(ChipError::NoData));
        assert!(start.elapsed().as_millis() <= 65, "{} ms", start.elapsed().as_millis());
        driver.init().await.unwrap();
        driver.read_measurement().await.unwrap();
    });
}

/// The registers by which ArduPilot's driver recognises the chip, also after a restart without a power cycle.
#[test]
fn an_rm3100_keeps_the_default_cycle_counts_and_survives_a_restart_of_the_module() {
    run_with_rm3100(1.0, |mut driver, chip| async move {
        for _ in 0..2 {
            driver.init().await.unwrap();
            for _ in 0..20 {
                driver.read_measurement().await.unwrap();
                driver.verify_configuration().await.unwrap();
            }
            let cycle_counts: Vec<u8> = (0x04..0x0A).map(|register| chip.borrow().peek_register(register)).collect();
            assert_eq!(cycle_counts, [0x00, 0xC8, 0x00, 0xC8, 0x00, 0xC8]);
            driver = Rm3100::new(SelectedDevice::new(chip.clone()));
        }
    });
}

fn module_with_rm3100() -> (Rig, Rc<RefCell<rm3100::SimulatedRm3100>>) {
    let mut rig = Rig::new(WorldConfig { sensor: SensorModel::Rm3100, ..WorldConfig::of_table1(1) });
    rig.run_for_s(2.0);
    let SimulatedMagnetometer::Rm3100(chip) = &rig.magnetometer else { unreachable!("selected above") };
    let chip = chip.clone();
    (rig, chip)
}

/// Silence counts after eight periods, 107 ms; a stuck axis after 48 readings, 0.64 s.
#[test]
fn a_module_detects_each_fault_of_its_rm3100_and_uses_it_again() {
    for (fault, after_s, reason) in [
        (Rm3100Fault::MissingChip(0xFF), 0.3, "sensor-silent"),
        (Rm3100Fault::MissingChip(0x00), 0.3, "sensor-silent"),
        (Rm3100Fault::NeverReady, 0.3, "sensor-silent"),
        (Rm3100Fault::StuckAxis(2), 0.7, "sensor-stuck"),
    ] {
        let (mut rig, chip) = module_with_rm3100();
        let status = full_status(&mut rig);
        assert!(status.contains("sensor: RM3100 on SPI") && status.contains("heading: none, uncalibrated"), "{status}");
        chip.borrow_mut().set_fault(Some(fault));
        rig.run_for_s(after_s);
        let status = full_status(&mut rig);
        assert!(status.contains(&format!("heading: none, {reason}")), "{fault:?}: {status}");
        chip.borrow_mut().set_fault(None);
        rig.run_for_s(1.0);
        let status = full_status(&mut rig);
        assert!(status.contains("heading: none, uncalibrated"), "{fault:?}: {status}");
    }
}

/// Registers are verified every 0.1 s; a restarted chip has no data before that. The self-test takes 36 ms.
#[test]
fn a_module_repairs_upset_registers_of_its_rm3100() {
    for register in [0x04, 0x05, 0x06, 0x07, 0x08, 0x09, 0x0B] {
        let (mut rig, chip) = module_with_rm3100();
        let before = chip.borrow().peek_register(register);
        chip.borrow_mut().flip_register_bits(register, 0x02);
        rig.run_for_s(0.2);
        assert_eq!(chip.borrow().peek_register(register), before);
        let status = full_status(&mut rig);
        assert!(status.contains("1 register upsets repaired"), "{register:#x}: {status}");
        assert!(status.contains("heading: none, uncalibrated"), "{register:#x}: {status}");
    }
    let (mut rig, chip) = module_with_rm3100();
    chip.borrow_mut().power_cycle();
    rig.run_for_s(0.5);
    assert!(full_status(&mut rig).contains("heading: none, uncalibrated"));
    assert_eq!(chip.borrow().peek_register(0x0B), 0x95);
}
