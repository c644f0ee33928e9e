//! Instruction budgets of the firmware on a Cortex-M4, counted by the bench image and by the emulator's clock.

use serde::Serialize;
use simulator::module::{Module, ModuleRunEnd};
use simulator::world::aircraft::PrescribedMotion;

use super::emulated_machine::BenchTest;
use super::emulated_module::Emulator;
use super::error::EmulatorError;

/// Instruction limit of a firmware path.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct InstructionBudget {
    /// Short name of the path.
    pub name: &'static str,
    /// Description of the path.
    #[serde(rename = "of")]
    pub description: &'static str,
    /// Largest allowed number of instructions.
    pub limit: u64,
    /// Counted instructions; `None` if not counted.
    pub counted: Option<u64>,
}

impl InstructionBudget {
    /// Whether the count exists and is within its limit.
    #[must_use]
    pub fn is_within_limit(&self) -> bool {
        self.counted.is_some_and(|counted| counted <= self.limit)
    }
}

/// Name, description and limit of each count. The bench image prints all of them except [`SAMPLE`].
///
/// A solve spends half of its instructions on eight passes over the samples, a quarter on diagnostics and a sixth on
/// advice. An estimated attitude latency requires a second solve; motor-current interference is iterated to
/// convergence. The solve runs at the lowest priority and takes 0.5 to 1.5 s on the reference board.
const INSTRUCTION_LIMITS: [(&str, &str, u64); 14] = [
    ("heading", "field and attitude to corrected heading with sigma", 1_000),
    ("watch", "the monitor, an averaged sample: ten times a second, after its sentences", 43_000),
    ("collect", "a further sample of a flight, compared with all retained ones, at the lowest priority", 1_920_000),
    ("inertial", "gyro and accelerometer to attitude, with a step of its Kalman filter: 208 times a second", 10_000),
    ("nmea", "the longest of the NMEA sentences, with its checksum", 1_200),
    ("mavlink", "a MAVLink 2 ATTITUDE frame, byte by byte", 3_000),
    ("mavlink-out", "a VISION_POSITION_ESTIMATE, the longest of the messages that are sent often", 4_500),
    ("msp", "the answer to MSP_ATTITUDE, byte by byte", 2_000),
    ("msp-out", "a reading of an autopilot's compass, MSP2_SENSOR_COMPASS", 1_500),
    ("can-over-msp", "a field by CAN (node's poll and frame), in excess of a reading by MSP (port's poll)", 1_500),
    ("late", "the solve below with an attitude latency of 60 ms, estimated and used: solved twice", 28_000_000),
    ("current", "the solve below with motor-current interference, estimated and used: solved three times", 55_000_000),
    ("solve", "maximum likelihood of 2 x 256 samples, assessment and advice included", 18_500_000),
    (SAMPLE, "I2C registers to the last byte of three sentences, calibrated, two ports, median", 12_600),
];

/// Name of the path that the emulator's clock counts.
const SAMPLE: &str = "sample";

/// Time limit of the solve, seconds, at a fifth of the board's speed.
const SOLVE_TIMEOUT_S: u32 = 30;

/// Counts instructions with the bench image in a newly started emulator.
///
/// # Errors
///
/// The emulator's failure. A missing count is not an error but `None` in its budget.
pub fn count_budgets(emulator: &mut Emulator) -> Result<Vec<InstructionBudget>, EmulatorError> {
    emulator.run_for_s(1.0);
    let sample = sample_path_instruction_count(emulator);
    emulator.take_console_output();
    emulator.request_bench_test(BenchTest::Budgets);
    let mut printed = String::new();
    for _ in 0..SOLVE_TIMEOUT_S {
        // All results are printed once the line of the solve is complete.
        let is_complete = printed.split_once("solve: ").is_some_and(|(_, after_solve)| after_solve.contains('\n'));
        if is_complete || emulator.run_for_s(1.0) == ModuleRunEnd::Failed {
            break;
        }
        printed += &emulator.take_console_output();
    }
    if let Some(error) = emulator.take_failure() {
        return Err(error);
    }
    let budgets = INSTRUCTION_LIMITS.iter().map(|&(name, description, limit)| {
        let counted = if name == SAMPLE { sample } else { printed_value(&printed, name) };
        InstructionBudget { name, description, limit, counted }
    });
    Ok(budgets.collect())
}

/// Instructions of the full sample path in a module calibrated by a compass swing.
fn sample_path_instruction_count(emulator: &mut Emulator) -> Option<u64> {
    const HEADING_COUNT: u8 = 8;
    let heading_rate_deg_s = 15.0;
    let step_deg = 360.0 / f64::from(HEADING_COUNT);
    emulator.send_console_line("set stream-rate 80");
    emulator.send_console_line("cal start swing");
    for i in 0..HEADING_COUNT {
        let heading_deg = f64::from(i) * step_deg;
        emulator.world().set_prescribed_motion(PrescribedMotion {
            heading_deg,
            heading_rate_deg_s: 0.0,
            ..PrescribedMotion::default()
        });
        emulator.run_for_s(2.0);
        emulator.send_console_line(&format!("cal mark {heading_deg:.0}"));
        emulator.world().set_prescribed_motion(PrescribedMotion {
            heading_deg,
            heading_rate_deg_s,
            ..PrescribedMotion::default()
        });
        emulator.run_for_s(step_deg / heading_rate_deg_s);
    }
    emulator.send_console_line("cal solve");
    emulator.run_for_s(2.0);
    emulator.take_path_instruction_counts();
    emulator.run_for_s(2.0);
    let is_calibrated = emulator.send_console_line("status").contains("ok calibrated");
    let mut path_instructions = emulator.take_path_instruction_counts();
    path_instructions.sort_unstable();
    path_instructions.get(path_instructions.len() / 2).copied().filter(|_| is_calibrated)
}

/// The number in the line `name: 123`.
fn printed_value(printed: &str, name: &str) -> Option<u64> {
    printed.lines().find_map(|line| line.trim().strip_prefix(name)?.strip_prefix(": ")?.parse().ok())
}
