//! Tests of the bench image: instruction counts, and fatal errors. The simulator requests them through the lockstep;
//! results are written to the console port.

use core::f32::consts::TAU;
use core::fmt::{self, Write as _};
use core::hint::black_box;
use core::sync::atomic::{AtomicU32, Ordering};

use autoswing::attitude::{AttitudeReport, BodyRates, SenderId};
use autoswing::calibration::method_selection::Procedure;
use autoswing::calibration::{
    AngleRates, CollectionPart, Method, MotorCurrent, Prior, Sample, Samples, Solution, SolveProgress, Solver,
};
use autoswing::collection::{CollectionContext, Collector, RetainedSamples};
use autoswing::frames::{Field, RollPitch, Sensor};
use autoswing::heading::{Heading, HeadingLimits, compute_heading};
use autoswing::inertial::{AttitudeFilter, GRAVITY_M_S2, InertialSample, InertialSensorErrors, SensorOffsets};
use autoswing::instrument::{Correction, Estimate, Instrument, InstrumentConfig};
use autoswing::reading::Reading;
use autoswing::time::{Timestamp, WrappingMillis};
use autoswing_firmware::port::{CanNode, NodeContext, Port, Snapshot};
use autoswing_firmware::wire::dronecan::CanFrame;
use autoswing_firmware::wire::dronecan::outbound::{NodeInfo, SoftwareVersion};
use autoswing_firmware::wire::mavlink::{self, Address, OutboundMessage, Pose, Signatures};
use autoswing_firmware::wire::{msp, nmea};
use autoswing_module::compass::IndicatorState;
use autoswing_module::settings::{HeadingKind, ProtocolKind, Settings};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use embedded_io_async::Write as _;
use static_cell::{ConstStaticCell, StaticCell};

use super::machine_clock;
use super::uart::UartTx;

/// Samples per turn.
const SAMPLES_PER_TURN: usize = 256;

/// Attitude latency of the latency test, seconds.
const TEST_LATENCY_S: f32 = 0.06;

/// Interference of the motor-current test, microtesla per ampere on each axis: 7.5 uT at the mean current of 15 A.
const UT_PER_A: f32 = 0.5;

/// Duration of an instruction, nanoseconds (`-icount shift=6`).
const INSTRUCTION_NS: u64 = 64;
/// Duration of a clock tick, nanoseconds.
const TICK_NS: u64 = 40;

/// Test by number in the lockstep's messages (`BenchTest` in host-sim).
#[derive(Clone, Copy)]
enum BenchTest {
    /// Count instructions.
    Budgets = 1,
    /// Execute an undefined instruction.
    Fault = 2,
    /// Overflow the stack.
    Overflow = 3,
    /// Panic with a message of 200 characters.
    Panic = 4,
    /// Panic, now and at each later start.
    PanicAtEachStart = 5,
}

/// Value of `PANIC_AT_START`, in memory that survives a reset, that makes each start panic.
const PANIC_AT_START_MARK: u32 = 0x0BAD_57A7;

#[unsafe(link_section = ".uninit.starts")]
static PANIC_AT_START: AtomicU32 = AtomicU32::new(0);

const LONG_MESSAGE: &str = "asked for, with a message of 200 characters, the most that the next run has to show whole. \
    0123456789 0123456789 0123456789 0123456789 0123456789 0123456789 0123456789 0123456789 0123456789 end of it.";
const _: () = assert!(LONG_MESSAGE.len() == 200);

static REQUESTED_TEST: Signal<CriticalSectionRawMutex, BenchTest> = Signal::new();

/// Requests a test by number; zero requests none.
pub fn request_test(number: u8) {
    let tests =
        [BenchTest::Budgets, BenchTest::Fault, BenchTest::Overflow, BenchTest::Panic, BenchTest::PanicAtEachStart];
    if let Some(test) = tests.into_iter().find(|&test| test as u8 == number) {
        REQUESTED_TEST.signal(test);
    }
}

/// Runs requested tests. Fatal ones end the run.
pub async fn run_bench(mut tx: UartTx) -> ! {
    static RETAINED_SAMPLES: StaticCell<RetainedSamples> = StaticCell::new();
    panic_if_requested();
    let mut turns = BenchTurns::simulate_turns();
    let mut collector = Collector::new(RETAINED_SAMPLES.init_with(|| RetainedSamples::EMPTY));
    loop {
        let mut results = ResultText::new();
        let written = match REQUESTED_TEST.wait().await {
            BenchTest::Budgets => measure_instruction_counts(&mut turns, &mut collector, &mut results),
            BenchTest::Fault => cortex_m::asm::udf(),
            BenchTest::Overflow => {
                overflow_stack(black_box(0));
                results.write_str("\nerror no-overflow: the stack has no end\n")
            }
            BenchTest::Panic => panic!("{LONG_MESSAGE}"),
            BenchTest::PanicAtEachStart => {
                PANIC_AT_START.store(PANIC_AT_START_MARK, Ordering::Relaxed);
                panic_if_requested();
                Ok(())
            }
        };
        // Truncated results are detected by the simulator.
        let _ = written;
        let Ok(()) = tx.write_all(results.as_bytes()).await;
    }
}

/// Panics if `PANIC_AT_START` requires a panic at each start.
fn panic_if_requested() {
    assert!(PANIC_AT_START.load(Ordering::Relaxed) != PANIC_AT_START_MARK, "at each start");
}

type ResultText = heapless::String<320>;

/// Recurses without end.
#[expect(unconditional_recursion, reason = "that is what it is for")]
#[inline(never)]
fn overflow_stack(depth: u32) -> u32 {
    let ballast = black_box([depth; 64]);
    let below = overflow_stack(black_box(depth + 1));
    ballast.iter().fold(below, |sum, &word| sum.wrapping_add(word))
}

fn measure_instruction_counts(
    turns: &mut BenchTurns,
    collector: &mut Collector<'_>,
    out: &mut ResultText,
) -> fmt::Result {
    let (mut solve, mut late, mut current) = (0, 0, 0);
    turns.add_attitude_latency(TEST_LATENCY_S);
    let is_latency_found = turns.solve_turns(&mut late).is_some_and(|solution| solution.calibration.uses_latency());
    turns.add_attitude_latency(-TEST_LATENCY_S);
    turns.add_current(UT_PER_A);
    let is_current_found =
        turns.solve_turns(&mut current).is_some_and(|solution| solution.calibration.motor_current.is_applied());
    turns.add_current(-UT_PER_A);
    turns.remove_currents();
    let Some(solution) = turns.solve_turns(&mut solve) else { return writeln!(out, "\nerror not-solved: none") };
    let attitude = RollPitch::from_deg(23.0, 3.0);
    let field = simulated_field(attitude, 1.0);
    let mut found = Ok(Heading { magnetic_rad: 0.0, sigma_rad: 0.0, systematic_variance_rad2: 0.0 });
    let to_heading = count_instructions(|| {
        found = compute_heading(
            HeadingLimits::DEFAULT,
            black_box(&solution.calibration),
            black_box(&solution.uncertainty),
            black_box(field),
            black_box(attitude),
        );
    });
    let sentences = [
        count_instructions(|| drop(black_box(nmea::hdm_sentence(black_box(Some(123.4)))))),
        count_instructions(|| drop(black_box(nmea::hdg_sentence(black_box(Some(123.4)), black_box(Some(-11.3)))))),
        count_instructions(|| {
            drop(black_box(nmea::quality_sentence(black_box(&found), black_box(HeadingKind::Smooth))));
        }),
    ];
    let mut receiver = mavlink::MavlinkReceiver::default();
    let mut reports = 0;
    let to_report = count_instructions(|| {
        for &byte in black_box(&ATTITUDE_FRAME) {
            reports += u8::from(black_box(receiver.push_byte(black_box(byte)).is_some()));
        }
    });
    let mut receiver = msp::MspReceiver::default();
    let mut answers = 0;
    let to_answer = count_instructions(|| {
        for &byte in black_box(&ATTITUDE_ANSWER) {
            answers += u8::from(black_box(receiver.push_byte(black_box(byte)).is_some()));
        }
    });
    let to_pose = count_instructions(|| {
        let own_address = Address { system_id: 1, component_id: 158 };
        drop(black_box(OutboundMessage::pose_estimate(black_box(&VISION_POSE)).into_frame(
            own_address,
            0,
            &mut Signatures::default(),
        )));
    });
    let to_compass = count_instructions(|| {
        black_box(msp::compass_message(0, black_box(123_456), black_box(Field::from_ut(20.0, -5.1, 44.2))));
    });
    let over_msp = can_field_instructions().zip(msp_reading_instructions()).map(|(can, msp)| can.saturating_sub(msp));
    let to_watch = monitor_instructions(&solution);
    let to_collect = collection_instructions(collector);
    let to_attitude = inertial_instructions();
    writeln!(out)?;
    for (name, count, done) in [
        ("heading", to_heading, found.is_ok()),
        ("watch", to_watch, to_watch > 0),
        ("collect", to_collect, to_collect > 0),
        ("inertial", to_attitude, to_attitude > 0),
        ("nmea", sentences.into_iter().max().unwrap_or_default(), true),
        ("mavlink", to_report, reports == 1),
        ("mavlink-out", to_pose, true),
        ("msp", to_answer, answers == 1),
        ("msp-out", to_compass, true),
        ("can-over-msp", over_msp.unwrap_or_default(), over_msp.is_some()),
        ("late", late, is_latency_found),
        ("current", current, is_current_found),
        ("solve", solve, true),
    ] {
        writeln!(out, "{name}: {count}{}", if done { "" } else { " failed" })?;
    }
    Ok(())
}

/// Largest instruction count of a monitor update, over two seconds of a turn with body rates.
#[inline(never)]
fn monitor_instructions(solution: &Solution) -> u64 {
    let mut instrument = Instrument::new(InstrumentConfig::new(READING_PERIOD_US as u32));
    let calibration = Some((solution.calibration, solution.uncertainty));
    instrument.set_correction(Correction { calibration, ..Correction::UNCALIBRATED });
    let mut most = 0;
    for i in 1..160_u16 {
        let at = Timestamp::from_us(u64::from(i) * READING_PERIOD_US);
        let heading_rad = 0.004 * f32::from(i);
        let attitude = RollPitch::from_deg(25.0 + 0.01 * f32::from(i % 7), 3.0);
        let report = AttitudeReport {
            sender: SenderId::default(),
            sender_clock_at_sending: WrappingMillis::default(),
            attitude,
            body_rates: BodyRates::from_rad_s([0.0, 0.14, 0.29]),
        };
        instrument.on_attitude(at, report);
        let reading =
            Reading { field: simulated_field(attitude, heading_rad), is_saturated: false, was_overwritten: false };
        black_box(instrument.on_reading(at, reading));
        while instrument.next_sample().is_some() {}
        most = most.max(count_instructions(|| instrument.update_monitor()));
    }
    most
}

/// Largest instruction count of an update of the attitude filter, over two seconds at rest: its steps then measure the
/// gyro's offset, too.
#[inline(never)]
fn inertial_instructions() -> u64 {
    const PERIOD_US: u64 = 4_808;
    let mut filter = AttitudeFilter::new(InertialSensorErrors::CALIBRATED, SensorOffsets::UNKNOWN);
    let sample = InertialSample {
        rates_rad_s: [0.01, -0.01, 0.005].into(),
        specific_force_m_s2: [0.5, 1.0, -GRAVITY_M_S2].into(),
    };
    let updates = (1..=400).map(|i| {
        let at = Timestamp::from_us(i * PERIOD_US);
        count_instructions(|| {
            filter.update(black_box(at), black_box(&sample), black_box(Some(5.0)));
            black_box(filter.attitude());
        })
    });
    updates.max().unwrap_or_default()
}

/// Number of estimates for the benchmark of a protocol: two seconds.
const ESTIMATE_COUNT: u64 = 160;

fn bench_estimate(number: u64) -> Estimate {
    let compass_field = Some(Field::from_ut(20.0, -5.1, 44.2));
    Estimate { timestamp: Timestamp::from_us(number * READING_PERIOD_US), compass_field, ..Estimate::EMPTY }
}

fn snapshot<'a>(estimate: &'a Estimate, settings: &'a Settings) -> Snapshot<'a> {
    Snapshot {
        now: estimate.timestamp,
        estimate,
        settings,
        indicator_state: IndicatorState::Calibrated,
        calibration: None,
        can_node: None,
    }
}

/// Largest instruction count of a poll of the CAN node that sends a field alone, with its frame.
#[inline(never)]
fn can_field_instructions() -> Option<u64> {
    let settings = Settings { can_node: 42, ..Settings::DEFAULT };
    let software = SoftwareVersion::from_firmware(None);
    let mut node = CanNode::new(
        NodeInfo { node_name: "", software_version: software, hardware_version: [1, 0], unique_id: [7; 16] },
        settings.can_node,
    );
    // The node sends nothing before it has received a frame.
    node.receive_frame(Timestamp::START, &CanFrame::new(0, &[])?, &mut |_| {});
    let counts = (1..ESTIMATE_COUNT).filter_map(|number| {
        let estimate = bench_estimate(number);
        let snapshot = snapshot(&estimate, &settings);
        let context = NodeContext { snapshot, stored_settings: &settings };
        let mut frames = 0;
        let count = count_instructions(|| {
            black_box(node.poll(black_box(&context)));
            while black_box(node.frame_to_send()).is_some() {
                node.on_frame_sent(estimate.timestamp);
                frames += 1;
            }
        });
        (frames == 1).then_some(count)
    });
    counts.max()
}

/// Least instruction count of a poll of an MSP port that sends a reading alone.
#[inline(never)]
fn msp_reading_instructions() -> Option<u64> {
    let compass_length = msp::compass_message(0, 0, Field::from_ut(0.0, 0.0, 0.0)).len();
    let mut port = Port::new(ProtocolKind::Msp, ProtocolKind::Auto, Timestamp::START);
    let counts = (1..ESTIMATE_COUNT).filter_map(|number| {
        let estimate = bench_estimate(number);
        let snapshot = snapshot(&estimate, &Settings::DEFAULT);
        let mut length = 0;
        let count = count_instructions(|| {
            port.poll(black_box(&snapshot));
            length = black_box(port.pending_output.pending_bytes()).len();
            port.pending_output.consume_bytes(length);
        });
        (length == compass_length).then_some(count)
    });
    counts.min()
}

/// Largest instruction count of a flight sample at full buffers, over 20 samples.
#[inline(never)]
fn collection_instructions(collector: &mut Collector<'_>) -> u64 {
    const FULL_BUFFER_SAMPLES: usize = 700;
    let mut noise = Noise(2);
    collector.begin_procedure(Procedure::Flight);
    let mut most = 0;
    for i in 0..FULL_BUFFER_SAMPLES + 20 {
        let sample = bench_sample(if i % 2 == 0 { -1.0 } else { 1.0 }, i, &mut noise);
        let count = count_instructions(|| {
            collector.push_sample(sample);
            collector.update_header(CollectionContext::default());
        });
        if i >= FULL_BUFFER_SAMPLES {
            most = most.max(count);
        }
    }
    most
}

/// Sensor period of the reference sensor, microseconds.
const READING_PERIOD_US: u64 = 12_500;

fn count_instructions(f: impl FnOnce()) -> u64 {
    let ticks = |f: &mut dyn FnMut()| {
        critical_section::with(|_| {
            let before = machine_clock::ticks();
            f();
            machine_clock::ticks() - before
        })
    };
    let reading_the_clock = ticks(&mut || {});
    let mut f = Some(f);
    let all = ticks(&mut || {
        if let Some(f) = f.take() {
            f();
        }
    });
    all.saturating_sub(reading_the_clock) * TICK_NS / INSTRUCTION_NS
}

/// Samples of a left and a right turn.
struct BenchTurns(&'static mut [Sample]);

impl BenchTurns {
    /// Simulates the turns; may be called only once.
    fn simulate_turns() -> Self {
        // An array made by a function would be on the stack first.
        static TURN_SAMPLES: ConstStaticCell<heapless::Vec<Sample, { 2 * SAMPLES_PER_TURN }>> =
            ConstStaticCell::new(heapless::Vec::new());
        let (turns, mut noise) = (TURN_SAMPLES.take(), Noise(1));
        let turn_ms = SAMPLES_PER_TURN as u32 * SAMPLE_INTERVAL_MS;
        for (side, part, begin_ms) in [(-1.0, CollectionPart::LEFT, 0), (1.0, CollectionPart::RIGHT, turn_ms)] {
            turns.extend((0..SAMPLES_PER_TURN).map(|i| {
                let sample = bench_sample(side, i, &mut noise);
                Sample { part, time: WrappingMillis::new(begin_ms + sample.time.as_ms()), ..sample }
            }));
        }
        Self(turns)
    }

    /// Adds attitude latency, seconds.
    fn add_attitude_latency(&mut self, latency_s: f32) {
        for sample in &mut *self.0 {
            sample.attitude = sample.latency_compensated_attitude(-latency_s);
        }
    }

    /// Adds a varying motor current with this interference on each axis, microtesla per ampere.
    fn add_current(&mut self, ut_per_a: f32) {
        for (i, sample) in self.0.iter_mut().enumerate() {
            let amperes = 15.0 + 5.0 * libm::sinf(i as f32 * 0.08);
            sample.field = Field::new(sample.field.ut.add_scalar(ut_per_a * amperes));
            sample.current = MotorCurrent::from_a(Some(amperes));
        }
    }

    /// Removes the currents from the samples.
    fn remove_currents(&mut self) {
        for sample in &mut *self.0 {
            sample.current = MotorCurrent::UNKNOWN;
        }
    }

    /// Solves by maximum likelihood and adds up instructions.
    fn solve_turns(&self, count: &mut u64) -> Option<Solution> {
        let samples = Samples::new(self.0);
        let mut solver = None;
        *count += count_instructions(|| {
            solver = Solver::new(Method::MaximumLikelihood, samples, &Prior::default()).ok();
        });
        let mut solver = solver?;
        loop {
            let mut progress = SolveProgress::Continue;
            *count += count_instructions(|| progress = solver.solve_step(samples));
            if let SolveProgress::Finished(end) = progress {
                return end.ok();
            }
        }
    }
}

/// Oscillations of bank and pitch per turn, as in light turbulence.
const OSCILLATIONS_PER_TURN: [f32; 2] = [29.0, 23.0];

/// Interval between samples, milliseconds.
const SAMPLE_INTERVAL_MS: u32 = 400;

/// The `i`-th sample of a turn, with soft and hard iron, and bank and pitch oscillating by some degrees.
fn bench_sample(side: f32, i: usize, noise: &mut Noise) -> Sample {
    let part = i as f32 / SAMPLES_PER_TURN as f32;
    let [roll, pitch] = OSCILLATIONS_PER_TURN.map(|times| times * TAU * part);
    let attitude = RollPitch::from_deg(side * 25.0 + 2.0 * libm::sinf(roll), 3.0 + 1.5 * libm::cosf(pitch));
    let turn_s = (SAMPLES_PER_TURN as u32 * SAMPLE_INTERVAL_MS) as f32 * 1e-3;
    let [by_roll, by_pitch] = OSCILLATIONS_PER_TURN.map(|times| times * TAU / turn_s);
    let rates = AngleRates::from_rad_s([
        2_f32.to_radians() * by_roll * libm::cosf(roll),
        -1.5_f32.to_radians() * by_pitch * libm::sinf(pitch),
        side * TAU / turn_s,
    ]);
    let field = simulated_field(attitude, side * part * TAU);
    let noisy = field.ut.map(|ut| ut + 0.3 * noise.next_noise());
    let reported = RollPitch {
        roll_rad: attitude.roll_rad + 0.005 * noise.next_noise(),
        pitch_rad: attitude.pitch_rad + 0.005 * noise.next_noise(),
    };
    Sample {
        rates,
        time: WrappingMillis::new(SAMPLE_INTERVAL_MS * i as u32),
        ..Sample::new(Field::new(noisy), reported)
    }
}

fn simulated_field(attitude: RollPitch, heading_rad: f32) -> Field<Sensor> {
    let body = attitude.to_body_frame(Field::earth_field(53.0, 0.95, heading_rad)).ut;
    let soft_iron = nalgebra::Matrix3::new(1.02, 0.05, -0.03, -0.02, 0.95, 0.04, 0.03, -0.04, 1.03);
    Field::new(soft_iron * body + nalgebra::Vector3::new(9.0, -4.0, 6.0))
}

/// Pseudo-random noise of variance one: the sum of four numbers of a linear congruential generator.
struct Noise(u32);

impl Noise {
    fn next_noise(&mut self) -> f32 {
        let mut uniform = || {
            self.0 = self.0.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (self.0 >> 8) as f32 / 16_777_216.0 - 0.5
        };
        (uniform() + uniform() + uniform() + uniform()) * 1.732
    }
}

/// MAVLink 2 ATTITUDE: roll 0.4, pitch 0.05, yaw 1, rates 0.01, 0.02, 0.2 rad/s at 1234567 ms.
const ATTITUDE_FRAME: [u8; 40] = [
    0xFD, 0x1C, 0x00, 0x00, 0x07, 0x01, 0x01, 0x1E, 0x00, 0x00, 0x87, 0xD6, 0x12, 0x00, 0xCD, 0xCC, 0xCC, 0x3E, 0xCD,
    0xCC, 0x4C, 0x3D, 0x00, 0x00, 0x80, 0x3F, 0x0A, 0xD7, 0x23, 0x3C, 0x0A, 0xD7, 0xA3, 0x3C, 0xCD, 0xCC, 0x4C, 0x3E,
    0xA0, 0x10,
];

/// MSP version 2 reply to MSP_ATTITUDE: roll 23.0, pitch 3.0, heading 100 deg.
const ATTITUDE_ANSWER: [u8; 15] =
    [0x24, 0x58, 0x3E, 0x00, 0x6C, 0x00, 0x06, 0x00, 0xE6, 0x00, 0x1E, 0x00, 0x64, 0x00, 0x8B];

/// Pose for VISION_POSITION_ESTIMATE, the longest of the frequent messages.
const VISION_POSE: Pose = Pose {
    timestamp: Timestamp::from_us(1_234_567_000),
    roll_pitch_yaw_rad: [0.4, 0.05, 1.0],
    yaw_variance_rad2: 1e-4,
    reset_counter: 1,
};
