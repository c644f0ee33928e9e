//! What the firmware may cost, in instructions of a Cortex-M4: counted by the bench image, and by the machine's clock.

use serde::Serialize;

use super::{Emulator, EmulatorError};
use crate::module::{Module, Ran};

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
const COUNTED_WITHIN: [(&str, &str, u64); 4] = [
    ("heading", "field and attitude to corrected heading with sigma", 1_000),
    ("nmea", "the longest of the NMEA sentences, with its checksum", 2_500),
    ("mavlink", "a MAVLink 2 ATTITUDE frame, byte by byte", 3_000),
    ("solve", "maximum likelihood of 2 x 256 samples, judgement and advice included", 20_000_000),
];

/// One whole sample.
const SAMPLE: (&str, &str, u64) = ("sample", "I2C registers to the last byte of three sentences, median", 12_000);

/// Seconds for the solve, at five times less than the board's speed.
const PATIENCE_S: u32 = 30;

/// Counts with the bench image in an emulator that was just started; the module must be calibrated for the whole way to
/// count, which is what `calibrate` is for.
pub fn count(emulator: &mut Emulator) -> Result<Vec<Budget>, EmulatorError> {
    let mut printed = String::new();
    emulator.run_for_s(1.0);
    emulator.printed();
    emulator.type_line("stream rate 80");
    printed += &emulator.type_line("bench budgets");
    for _ in 0..PATIENCE_S {
        if emulator.run_for_s(1.0) == Ran::Failed {
            break;
        }
        printed += &emulator.printed();
        if printed.contains("solve: ") {
            break;
        }
    }
    if emulator.failure().is_some() {
        return Err(EmulatorError::Protocol(printed));
    }
    let mut budgets: Vec<Budget> = COUNTED_WITHIN
        .iter()
        .map(|&(name, of, limit)| Budget { name, of, limit, counted: value(&printed, name) })
        .collect();
    let (name, of, limit) = SAMPLE;
    budgets.push(Budget { name, of, limit, counted: median_way(emulator) });
    Ok(budgets)
}

/// `name: 123` on a line of its own.
fn value(printed: &str, name: &str) -> Option<u64> {
    printed.lines().find_map(|line| line.trim().strip_prefix(name)?.strip_prefix(": ")?.parse().ok())
}

fn median_way(emulator: &Emulator) -> Option<u64> {
    let mut ways = emulator.ways_ticks().to_vec();
    ways.sort_unstable();
    let ticks = ways.get(ways.len() / 2)?;
    Some(ticks * super::machine::TICK_NS / super::machine::INSTRUCTION_NS)
}
