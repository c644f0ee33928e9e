//! What the firmware may cost, in instructions of a Cortex-M4: counted by the bench image, and by the machine's clock.

use serde::Serialize;

use super::{BenchTest, Emulator, EmulatorError};
use crate::module::{Module, Ran};
use crate::world::aircraft::Carried;

/// A limit on one way through the firmware.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Budget {
    /// Short name.
    pub name: &'static str,
    /// What is counted.
    pub of: &'static str,
    /// Instructions it may take.
    pub limit: u64,
    /// Instructions it takes; none if that could not be counted.
    pub counted: Option<u64>,
}

impl Budget {
    /// Whether it was counted and is within its limit.
    #[must_use]
    pub fn is_kept(&self) -> bool {
        self.counted.is_some_and(|counted| counted <= self.limit)
    }
}

/// What the bench image prints, and the limits.
///
/// Of the solve's instructions half are for eight passes over the samples, a quarter looks at what they say besides, and a
/// sixth is for advice. Where a latency is used, all is looked at again with it, and where iron by current is, until that
/// stays. It is done below everything that is urgent, in half a second on the reference board, or in one and a half.
const COUNTED_WITHIN: [(&str, &str, u64); 11] = [
    ("heading", "field and attitude to corrected heading with sigma", 1_200),
    ("watch", "an averaged sample held against the gyro, below everything that is urgent", 60_000),
    ("collect", "a sample of a flight that may tell more held against all that were kept, below all else", 2_500_000),
    ("nmea", "the longest of the NMEA sentences, with its checksum", 1_200),
    ("mavlink", "a MAVLink 2 ATTITUDE frame, byte by byte", 3_000),
    ("mavlink-out", "a VISION_POSITION_ESTIMATE, the longest of the messages that are sent often", 4_500),
    ("msp", "the answer to MSP_ATTITUDE, byte by byte", 2_000),
    ("msp-out", "a reading of an autopilot's compass, MSP2_SENSOR_COMPASS", 1_500),
    ("late", "the solve below of an attitude 60 ms late, which is found and used: solved twice", 38_000_000),
    ("current", "the solve below with iron by current, which is found and used: solved three times", 76_000_000),
    ("solve", "maximum likelihood of 2 x 256 samples, judgement and advice included", 25_000_000),
];

/// One whole sample.
const SAMPLE: (&str, &str, u64) = (
    "sample",
    "I2C registers to the last byte of three sentences, calibrated, median, with a port for each of two",
    14_000,
);

/// Seconds for the solve, at five times less than the board's speed.
const PATIENCE_S: u32 = 30;

/// Counts with the bench image in an emulator that was just started.
///
/// # Errors
///
/// Why the emulator failed meanwhile. What could not be counted is no error: it is `None` in its budget.
pub fn count(emulator: &mut Emulator) -> Result<Vec<Budget>, EmulatorError> {
    emulator.run_for_s(1.0);
    let sample = whole_way(emulator);
    emulator.printed();
    emulator.ask_bench(BenchTest::Budgets);
    let mut printed = String::new();
    for _ in 0..PATIENCE_S {
        // The last of the lines, and whole.
        let is_all = printed.split_once("solve: ").is_some_and(|(_, rest)| rest.contains('\n'));
        if is_all || emulator.run_for_s(1.0) == Ran::Failed {
            break;
        }
        printed += &emulator.printed();
    }
    if let Some(error) = emulator.take_failure() {
        return Err(error);
    }
    let of_image =
        COUNTED_WITHIN.iter().map(|&(name, of, limit)| Budget { name, of, limit, counted: value(&printed, name) });
    let (name, of, limit) = SAMPLE;
    Ok(of_image.chain([Budget { name, of, limit, counted: sample }]).collect())
}

/// The whole way of a sample in a module that is calibrated, which it is by a compass swing on the ground.
fn whole_way(emulator: &mut Emulator) -> Option<u64> {
    const HEADINGS: u8 = 8;
    let heading_rate_deg_s = 15.0;
    let step_deg = 360.0 / f64::from(HEADINGS);
    emulator.type_line("stream rate 80");
    emulator.type_line("cal start swing");
    for i in 0..HEADINGS {
        let heading_deg = f64::from(i) * step_deg;
        emulator.world().carry(Carried { heading_deg, heading_rate_deg_s: 0.0, ..Carried::default() });
        emulator.run_for_s(2.0);
        emulator.type_line(&format!("cal mark {heading_deg:.0}"));
        emulator.world().carry(Carried { heading_deg, heading_rate_deg_s, ..Carried::default() });
        emulator.run_for_s(step_deg / heading_rate_deg_s);
    }
    emulator.type_line("cal solve");
    emulator.run_for_s(2.0);
    emulator.take_ways();
    emulator.run_for_s(2.0);
    let is_calibrated = emulator.type_line("status").contains("ok calibrated");
    let mut ways = emulator.take_ways();
    ways.sort_unstable();
    ways.get(ways.len() / 2).copied().filter(|_| is_calibrated)
}

/// `name: 123` on a line of its own.
fn value(printed: &str, name: &str) -> Option<u64> {
    printed.lines().find_map(|line| line.trim().strip_prefix(name)?.strip_prefix(": ")?.parse().ok())
}
