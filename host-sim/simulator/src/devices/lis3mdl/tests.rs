use autoswing::frames::Field;
use embassy_time::Timer;
use embedded_hal_async::i2c::I2c;

use super::*;
use crate::devices::i2c::SimulatedI2cBus;
use log_analysis::numbers::square;
use testkit::simulation::{ExecutorLevel, Simulation};

const READ_XYZ: u8 = 0x28 | 0x80;

/// Runs `script` on a bus with a noise-free chip in a constant field.
fn run_on_bus<F: Future<Output = ()> + 'static>(
    field_ut: [f32; 3],
    script: impl FnOnce(SimulatedI2cBus, Rc<RefCell<SimulatedLis3mdl>>) -> F,
) {
    run_in_field(0.0, move |_| field_ut, script);
}

/// Runs `script` on a bus with a chip in the field `field_ut(t)`.
fn run_in_field<F: Future<Output = ()> + 'static>(
    noise_scale: f64,
    field_ut: impl Fn(u64) -> [f32; 3] + 'static,
    script: impl FnOnce(SimulatedI2cBus, Rc<RefCell<SimulatedLis3mdl>>) -> F,
) {
    let mut simulation = Simulation::new();
    let chip = SimulatedLis3mdl::new(1, noise_scale, Box::new(move |at_us| Field::new(field_ut(at_us).into())));
    let bus = SimulatedI2cBus::new();
    bus.attach_device(chip.clone());
    simulation.run_to_end(ExecutorLevel::Thread, script(bus, chip));
}

async fn read_register(bus: &mut SimulatedI2cBus, register: u8) -> u8 {
    let mut value = [0];
    bus.write_read(ADDRESS, &[register], &mut value).await.unwrap();
    value[0]
}

async fn write_register(bus: &mut SimulatedI2cBus, register: u8, value: u8) {
    bus.write(ADDRESS, &[register, value]).await.unwrap();
}

async fn read_counts(bus: &mut SimulatedI2cBus) -> [i16; 3] {
    let mut bytes = [0; 6];
    bus.write_read(ADDRESS, &[READ_XYZ], &mut bytes).await.unwrap();
    [0, 2, 4].map(|low| i16::from_le_bytes([bytes[low], bytes[low + 1]]))
}

/// Ultra-high performance on all axes, 80 Hz (12.5 ms), 4 gauss, block data update, continuous.
async fn start_continuous(bus: &mut SimulatedI2cBus) {
    bus.write(ADDRESS, &[0x20 | 0x80, 0x7C, 0x00, 0x00, 0x0C, 0x40]).await.unwrap();
}

#[test]
fn reset_values_are_those_of_the_data_sheet() {
    run_on_bus([0.0; 3], |mut bus, _| async move {
        for (register, value) in [(0x0F, 0x3D), (0x20, 0x10), (0x21, 0), (0x22, 3), (0x23, 0), (0x24, 0), (0x27, 0)] {
            assert_eq!(read_register(&mut bus, register).await, value, "register {register:#04x}");
        }
        Timer::after_millis(2000).await;
        assert_eq!(read_register(&mut bus, 0x27).await, 0, "powered down: nothing is ever ready");
    });
}

#[test]
fn burst_write_and_read_follow_auto_increment_and_the_output_wraps() {
    run_on_bus([10.0, -20.0, 40.0], |mut bus, _| async move {
        start_continuous(&mut bus).await;
        assert_eq!(read_register(&mut bus, 0x23).await, 0x0C);
        assert_eq!(read_register(&mut bus, 0x24).await, 0x40);
        Timer::after_millis(13).await;
        let mut bytes = [0; 8];
        bus.write_read(ADDRESS, &[READ_XYZ], &mut bytes).await.unwrap();
        // Field of 0.1, -0.2, 0.4 gauss at 6842 counts per gauss.
        assert_eq!(i16::from_le_bytes([bytes[0], bytes[1]]), 684);
        assert_eq!(i16::from_le_bytes([bytes[2], bytes[3]]), -1368);
        assert_eq!(i16::from_le_bytes([bytes[4], bytes[5]]), 2737);
        assert_eq!(bytes[6..8], bytes[0..2], "after Z comes X again, not the temperature");
        let mut read_back = [0; 2];
        bus.write_read(ADDRESS, &[0x28], &mut read_back).await.unwrap();
        assert_eq!(read_back[0], read_back[1], "without the increment bit the address stays");
    });
}

#[test]
fn data_ready_comes_at_the_data_rate_and_overrun_when_late() {
    run_on_bus([0.0; 3], |mut bus, _| async move {
        start_continuous(&mut bus).await;
        Timer::after_micros(12_300).await;
        assert_eq!(
            read_register(&mut bus, 0x27).await,
            0x00,
            "12.37 ms after the start: one period of 80 Hz is 12.5 ms"
        );
        Timer::after_micros(130).await;
        assert_eq!(read_register(&mut bus, 0x27).await, 0x0F);
        read_counts(&mut bus).await;
        assert_eq!(read_register(&mut bus, 0x27).await, 0x00, "reading all axes clears the flags");
        Timer::after_millis(26).await;
        assert_eq!(read_register(&mut bus, 0x27).await, 0xFF, "two periods unread: overrun");
        read_register(&mut bus, 0x29).await;
        assert_eq!(
            read_register(&mut bus, 0x27).await,
            0xE6,
            "the high byte of x clears x only; no longer all are new"
        );
    });
}

/// A measurement ends between the reads of low and high byte.
#[test]
fn block_data_update_keeps_the_two_bytes_of_an_axis_together() {
    // 255 counts for the first 20 ms, then 256: mixed bytes give 511 or 0.
    let field = |at_us| if at_us < 20_000 { [3.727; 3] } else { [3.7416; 3] };
    for (control5, expected) in [(0x40, [0xFF, 0x00]), (0x00, [0xFF, 0x01])] {
        run_in_field(0.0, field, move |mut bus, _| async move {
            start_continuous(&mut bus).await;
            write_register(&mut bus, 0x24, control5).await;
            Timer::after_millis(14).await;
            let low = read_register(&mut bus, 0x28).await;
            Timer::after_millis(13).await;
            let high = read_register(&mut bus, 0x29).await;
            assert_eq!([low, high], expected, "CTRL_REG5 {control5:#04x}");
            assert_eq!(read_counts(&mut bus).await[0], 256, "afterwards the new measurement is there");
        });
    }
}

#[test]
fn full_scales_have_their_sensitivities_and_saturate_at_16_bits() {
    run_on_bus([100.0, 1e4, -1e4], |mut bus, _| async move {
        for (control2, counts_per_gauss) in [(0x00, 6842), (0x20, 3421), (0x40, 2281), (0x60, 1711)] {
            start_continuous(&mut bus).await;
            write_register(&mut bus, 0x21, control2).await;
            Timer::after_millis(20).await;
            assert_eq!(read_counts(&mut bus).await, [counts_per_gauss, i16::MAX, i16::MIN]);
        }
    });
}

/// 4000 measurements determine sigma to 1.1 %; the bound is four times that.
#[test]
fn noise_is_that_of_the_data_sheet_and_grows_as_averaging_shrinks() {
    for (settings, ratio) in [(0x62, 1.0_f64), (0x02, (1000.0_f64 / 155.0).sqrt())] {
        run_in_field(
            1.0,
            |_| [20.0, 0.0, 40.0],
            move |mut bus, _| async move {
                write_register(&mut bus, 0x20, settings).await;
                write_register(&mut bus, 0x23, settings >> 3 & 0x0C).await;
                write_register(&mut bus, 0x22, 0x00).await;
                let mut squares = [0.0; 3];
                for _ in 0..4000 {
                    Timer::after_millis(7).await;
                    let measured = read_counts(&mut bus).await.map(|count| f64::from(count) / 6842.0);
                    for axis in 0..3 {
                        squares[axis] += square(measured[axis] - [0.2, 0.0, 0.4][axis]);
                    }
                }
                for (axis, data_sheet) in [3.2e-3, 3.2e-3, 4.1e-3].into_iter().enumerate() {
                    let sigma = (squares[axis] / 4000.0).sqrt();
                    let expected = data_sheet * ratio;
                    assert!((sigma / expected - 1.0).abs() < 0.045, "axis {axis}: {sigma} for {expected} gauss");
                }
            },
        );
    }
}

/// Nine bytes (address, register, address, six data bytes) of 22.5 us, rounded up.
#[test]
fn a_transfer_takes_the_time_of_its_bytes() {
    run_on_bus([0.0; 3], |mut bus, _| async move {
        let before_us = clock::now_us();
        read_counts(&mut bus).await;
        assert_eq!(clock::now_us() - before_us, 203);
    });
}

/// The self-test adds 2, 2 and 0.55 gauss.
#[test]
fn self_test_and_byte_order_match_the_data_sheet() {
    run_on_bus([30.0, 100.0, 50.0], |mut bus, _| async move {
        start_continuous(&mut bus).await;
        Timer::after_millis(20).await;
        let without_self_test = read_counts(&mut bus).await;
        write_register(&mut bus, 0x20, 0x7D).await;
        Timer::after_millis(20).await;
        let with_self_test = read_counts(&mut bus).await;
        let difference = [0, 1, 2]
            .map(|axis| (f64::from(with_self_test[axis] - without_self_test[axis]) / 6842.0 * 100.0).round() as i16);
        assert_eq!(difference, [200, 200, 55]);
        write_register(&mut bus, 0x20, 0x7C).await;
        write_register(&mut bus, 0x23, 0x0E).await;
        Timer::after_millis(20).await;
        assert_eq!(read_counts(&mut bus).await, without_self_test.map(i16::swap_bytes));
    });
}
