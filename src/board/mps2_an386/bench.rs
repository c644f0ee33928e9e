//! What the bench image can do beyond the product: count instructions, and end badly. The world asks for it through the
//! lockstep; results go to the console's port, beside whatever the console prints.

use core::f32::consts::TAU;
use core::fmt::{self, Write as _};
use core::hint::black_box;

use autoswing::attitude::{Report, Source};
use autoswing::calibration::ladder::Procedure;
use autoswing::calibration::{Method, Prior, Progress, Rates, Sample, Samples, Solution, Solver};
use autoswing::collection::{Collector, Context, Kept};
use autoswing::frames::{Attitude, Field, Sensor};
use autoswing::heading::{self, Heading};
use autoswing::instrument::{self, Correction, Instrument};
use autoswing::magnetometer::Reading;
use autoswing::settings::HeadingKind;
use autoswing::time::{Timestamp, WrappingMillis};
use autoswing::wire::mavlink::{self, Address, Outgoing, Pose};
use autoswing::wire::{msp, nmea};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use embedded_io_async::Write as _;
use static_cell::StaticCell;

use super::clock;
use super::uart::UartTx;

/// Samples of a turn to one side.
const SAMPLES: usize = 256;

/// What an attitude source is late by that is late, seconds.
const LATE_S: f32 = 0.06;

/// What a current adds that does, microtesla per ampere: 8 uT in all.
const UT_PER_A: f32 = 0.5;

/// An instruction takes 64 ns (`-icount shift=6`), a tick 40 ns.
const INSTRUCTION_NS: u64 = 64;
const TICK_NS: u64 = 40;

/// A test, by its number in the lockstep's messages (`BenchTest` in host-sim).
#[derive(Clone, Copy)]
enum Test {
    /// Counts instructions.
    Budgets = 1,
    /// Executes what is no instruction.
    Fault = 2,
    /// Fills the stack.
    Overflow = 3,
    /// Panics.
    Panic = 4,
}

static ASKED: Signal<CriticalSectionRawMutex, Test> = Signal::new();

/// Asks for the test of this number; zero, which comes all the time, is none.
pub fn ask(number: u8) {
    let tests = [Test::Budgets, Test::Fault, Test::Overflow, Test::Panic];
    if let Some(test) = tests.into_iter().find(|&test| test as u8 == number) {
        ASKED.signal(test);
    }
}

/// Waits for tests to be asked for and runs them. Those that end badly end the run.
pub async fn run(mut tx: UartTx) -> ! {
    static KEPT: StaticCell<Kept> = StaticCell::new();
    let mut turns = Turns::fly();
    let mut collector = Collector::new(KEPT.init_with(|| Kept::EMPTY));
    loop {
        let mut results = Results::new();
        let written = match ASKED.wait().await {
            Test::Budgets => budgets(&mut turns, &mut collector, &mut results),
            Test::Fault => cortex_m::asm::udf(),
            Test::Overflow => {
                fill_stack(black_box(0));
                results.write_str("\nerror no-overflow: the stack has no end\n")
            }
            Test::Panic => panic!("asked for"),
        };
        // Results that do not fit are cut, and the world misses their end.
        let _ = written;
        let Ok(()) = tx.write_all(results.as_bytes()).await;
    }
}

/// Lines of results.
type Results = heapless::String<256>;

/// Calls itself for ever.
#[expect(unconditional_recursion, reason = "that is what it is for")]
#[inline(never)]
fn fill_stack(depth: u32) -> u32 {
    let ballast = black_box([depth; 64]);
    let below = fill_stack(black_box(depth + 1));
    ballast.iter().fold(below, |sum, &word| sum.wrapping_add(word))
}

/// A line each, after the one that the console's prompt stands on: a name and the instructions it takes.
fn budgets(turns: &mut Turns, collector: &mut Collector<'_>, out: &mut Results) -> fmt::Result {
    let (mut solve, mut late, mut current) = (0, 0, 0);
    turns.delay(LATE_S);
    let is_latency_found = turns.solve(&mut late).is_some_and(|solution| solution.calibration.uses_latency());
    turns.delay(-LATE_S);
    turns.draw(UT_PER_A);
    let is_current_found = turns.solve(&mut current).is_some_and(|solution| solution.calibration.current.is_used());
    turns.draw(-UT_PER_A);
    turns.forget_currents();
    let Some(solution) = turns.solve(&mut solve) else { return writeln!(out, "\nerror not-solved: none") };
    let attitude = Attitude::from_deg(23.0, 3.0);
    let field = sensed(attitude, 1.0);
    let mut found = Ok(Heading { magnetic_rad: 0.0, sigma_rad: 0.0, systematic_rad2: 0.0 });
    let to_heading = instructions(|| {
        found = heading::heading(
            heading::Config::DEFAULT,
            black_box(&solution.calibration),
            black_box(&solution.uncertainty),
            black_box(field),
            black_box(attitude),
        );
    });
    let sentences = [
        instructions(|| drop(black_box(nmea::hdm(black_box(Some(123.4)))))),
        instructions(|| drop(black_box(nmea::hdg(black_box(Some(123.4)), black_box(Some(-11.3)))))),
        instructions(|| drop(black_box(nmea::quality(black_box(&found), black_box(HeadingKind::Smooth))))),
    ];
    let mut receiver = mavlink::Receiver::new();
    let mut reports = 0;
    let to_report = instructions(|| {
        for &byte in black_box(&ATTITUDE_FRAME) {
            reports += u8::from(black_box(receiver.push(black_box(byte)).is_some()));
        }
    });
    let mut receiver = msp::Receiver::new();
    let mut answers = 0;
    let to_answer = instructions(|| {
        for &byte in black_box(&ATTITUDE_ANSWER) {
            answers += u8::from(black_box(receiver.push(black_box(byte)).is_some()));
        }
    });
    let to_pose = instructions(|| {
        let own = Address { system: 1, component: 158 };
        drop(black_box(Outgoing::vision(black_box(&POSE)).frame(own, 0)));
    });
    let to_compass = instructions(|| {
        black_box(msp::compass(0, black_box(123_456), black_box(Field::from_ut(20.0, -5.1, 44.2))));
    });
    let to_watch = watching(&solution);
    let to_collect = collecting(collector);
    writeln!(out)?;
    for (name, count, done) in [
        ("heading", to_heading, found.is_ok()),
        ("watch", to_watch, to_watch > 0),
        ("collect", to_collect, to_collect > 0),
        ("nmea", sentences.into_iter().max().unwrap_or_default(), true),
        ("mavlink", to_report, reports == 1),
        ("mavlink-out", to_pose, true),
        ("msp", to_answer, answers == 1),
        ("msp-out", to_compass, true),
        ("late", late, is_latency_found),
        ("current", current, is_current_found),
        ("solve", solve, true),
    ] {
        writeln!(out, "{name}: {count}{}", if done { "" } else { " failed" })?;
    }
    Ok(())
}

/// The most that a look at a sample takes, of two seconds of a turn with body rates.
#[inline(never)]
fn watching(solution: &Solution) -> u64 {
    let mut instrument = Instrument::new(instrument::Config::new(READING_US as u32));
    let calibration = Some((solution.calibration, solution.uncertainty));
    instrument.correct_with(Correction { calibration, ..Correction::NONE });
    let mut most = 0;
    for i in 1..160_u16 {
        let at = Timestamp::from_us(u64::from(i) * READING_US);
        let heading_rad = 0.004 * f32::from(i);
        let attitude = Attitude::from_deg(25.0 + 0.01 * f32::from(i % 7), 3.0);
        let report = Report {
            source: Source::default(),
            sender_time: WrappingMillis::default(),
            attitude,
            rates_rad_s: [0.0, 0.14, 0.29],
        };
        instrument.on_attitude(at, report);
        let reading = Reading { field: sensed(attitude, heading_rad), saturated: false, overrun: false };
        black_box(instrument.on_reading(at, reading));
        while instrument.next_sample().is_some() {}
        if instrument.has_to_watch() {
            most = most.max(instructions(|| instrument.watch()));
        }
    }
    most
}

/// The most that a sample of whatever is flown takes when there is no room for it: of twenty beyond what fills all buffers.
#[inline(never)]
fn collecting(collector: &mut Collector<'_>) -> u64 {
    const FILLED: usize = 700;
    let mut noise = Noise(2);
    collector.begin(Procedure::Flight);
    let mut most = 0;
    for i in 0..FILLED + 20 {
        let sample = sample(if i % 2 == 0 { -1.0 } else { 1.0 }, i, &mut noise);
        let count = instructions(|| {
            collector.push(sample);
            collector.keep(Context::default());
        });
        if i >= FILLED {
            most = most.max(count);
        }
    }
    most
}

/// Time between two readings of the reference sensor, microseconds.
const READING_US: u64 = 12_500;

/// Instructions that something takes, with interrupts off.
fn instructions(f: impl FnOnce()) -> u64 {
    let ticks = |f: &mut dyn FnMut()| {
        critical_section::with(|_| {
            let before = clock::ticks();
            f();
            clock::ticks() - before
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

/// A left and a right turn.
struct Turns {
    left: &'static mut [Sample],
    right: &'static mut [Sample],
}

impl Turns {
    /// To be called once.
    fn fly() -> Self {
        static LEFT: StaticCell<[Sample; SAMPLES]> = StaticCell::new();
        static RIGHT: StaticCell<[Sample; SAMPLES]> = StaticCell::new();
        let mut noise = Noise(1);
        let left = LEFT.init_with(|| core::array::from_fn(|i| sample(-1.0, i, &mut noise)));
        let right = RIGHT.init_with(|| core::array::from_fn(|i| sample(1.0, i, &mut noise)));
        Self { left, right }
    }

    /// Makes the attitude source later by so much.
    fn delay(&mut self, late_s: f32) {
        for sample in self.left.iter_mut().chain(&mut *self.right) {
            sample.attitude = sample.attitude_after(-late_s);
        }
    }

    /// Lets motors draw a current that is told, and that adds so much on each axis, microtesla per ampere.
    fn draw(&mut self, ut_per_a: f32) {
        for (i, sample) in self.left.iter_mut().chain(&mut *self.right).enumerate() {
            let amperes = 15.0 + 5.0 * libm::sinf(i as f32 * 0.08);
            sample.field = Field::new(sample.field.ut.add_scalar(ut_per_a * amperes));
            sample.rates = sample.rates.with_current(Some(amperes));
        }
    }

    /// Nobody has told a current.
    fn forget_currents(&mut self) {
        for sample in self.left.iter_mut().chain(&mut *self.right) {
            sample.rates = sample.rates.with_current(None);
        }
    }

    /// Solves by maximum likelihood, counting instructions.
    fn solve(&self, count: &mut u64) -> Option<Solution> {
        let samples = Samples { left: &*self.left, right: &*self.right, level: &[], ..Samples::default() };
        let mut solver = None;
        *count += instructions(|| {
            solver = Solver::new(Method::MaximumLikelihood, samples, &Prior::default()).ok();
        });
        let mut solver = solver?;
        loop {
            let mut progress = Progress::Continue;
            *count += instructions(|| progress = solver.step(samples));
            if let Progress::Finished(end) = progress {
                return end.ok();
            }
        }
    }
}

/// Times in a turn that bank and pitch go to and fro, as fast as in light weather.
const WANDERS: [f32; 2] = [29.0, 23.0];

/// Milliseconds from sample to sample.
const SPACING_MS: u32 = 400;

/// The `i`-th sample of a turn to a side, in an aircraft of some iron; bank and pitch wander by some degrees.
fn sample(side: f32, i: usize, noise: &mut Noise) -> Sample {
    let part = i as f32 / SAMPLES as f32;
    let [roll, pitch] = WANDERS.map(|times| times * TAU * part);
    let attitude = Attitude::from_deg(side * 25.0 + 2.0 * libm::sinf(roll), 3.0 + 1.5 * libm::cosf(pitch));
    let turn_s = (SAMPLES as u32 * SPACING_MS) as f32 * 1e-3;
    let [by_roll, by_pitch] = WANDERS.map(|times| times * TAU / turn_s);
    let rates = Rates::from_rad_s([
        2_f32.to_radians() * by_roll * libm::cosf(roll),
        -1.5_f32.to_radians() * by_pitch * libm::sinf(pitch),
        side * TAU / turn_s,
    ]);
    let field = sensed(attitude, side * part * TAU);
    let noisy = field.ut.map(|ut| ut + 0.3 * noise.next());
    let reported = Attitude {
        roll_rad: attitude.roll_rad + 0.005 * noise.next(),
        pitch_rad: attitude.pitch_rad + 0.005 * noise.next(),
    };
    Sample { field: Field::new(noisy), attitude: reported, rates, time: WrappingMillis::new(SPACING_MS * i as u32) }
}

/// What the sensor measures.
fn sensed(attitude: Attitude, heading_rad: f32) -> Field<Sensor> {
    let body = attitude.body(Field::earth(53.0, 0.95, heading_rad)).ut;
    let soft_iron = nalgebra::Matrix3::new(1.02, 0.05, -0.03, -0.02, 0.95, 0.04, 0.03, -0.04, 1.03);
    Field::new(soft_iron * body + nalgebra::Vector3::new(9.0, -4.0, 6.0))
}

/// Noise without a seed of its own: the sum of four numbers of a linear congruential generator, of variance one.
struct Noise(u32);

impl Noise {
    fn next(&mut self) -> f32 {
        let mut uniform = || {
            self.0 = self.0.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (self.0 >> 8) as f32 / 16_777_216.0 - 0.5
        };
        (uniform() + uniform() + uniform() + uniform()) * 1.732
    }
}

/// MAVLink 2, ATTITUDE: roll 0.4, pitch 0.05, yaw 1, rates 0.01, 0.02, 0.2 rad/s at 1234567 ms.
const ATTITUDE_FRAME: [u8; 40] = [
    0xFD, 0x1C, 0x00, 0x00, 0x07, 0x01, 0x01, 0x1E, 0x00, 0x00, 0x87, 0xD6, 0x12, 0x00, 0xCD, 0xCC, 0xCC, 0x3E, 0xCD,
    0xCC, 0x4C, 0x3D, 0x00, 0x00, 0x80, 0x3F, 0x0A, 0xD7, 0x23, 0x3C, 0x0A, 0xD7, 0xA3, 0x3C, 0xCD, 0xCC, 0x4C, 0x3E,
    0xA0, 0x10,
];

/// MSP version 2, the answer to MSP_ATTITUDE: roll 23.0, pitch 3.0, heading 100 deg.
const ATTITUDE_ANSWER: [u8; 15] =
    [0x24, 0x58, 0x3E, 0x00, 0x6C, 0x00, 0x06, 0x00, 0xE6, 0x00, 0x1E, 0x00, 0x64, 0x00, 0x8B];

/// The longest of the messages that are sent often.
const POSE: Pose = Pose {
    at: Timestamp::from_us(1_234_567_000),
    roll_pitch_yaw_rad: [0.4, 0.05, 1.0],
    yaw_variance_rad2: 1e-4,
    reset_counter: 1,
};
