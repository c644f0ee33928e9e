//! Parser of console output.

use autoswing::calibration::{Calibration, MotorCurrentInterference};

/// Refusal of a solve: `note refused <code>: ...` or `error <code>: ...`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Refusal {
    /// Stable code of the refusal.
    pub code: String,
    /// Explanation of the refusal.
    pub explanation: String,
}

impl Refusal {
    pub(crate) fn new(code: &str, explanation: &str) -> Self {
        Self { code: code.to_owned(), explanation: explanation.to_owned() }
    }

    fn parse(text: &str) -> Option<Self> {
        text.split_once(": ").map(|(code, explanation)| Self::new(code, explanation))
    }
}

/// Result of the last solve that a note in a transcript reports.
#[must_use]
pub fn parse_solve_notice(session: &str) -> Option<Result<(), Refusal>> {
    let notes = transcript_lines(session).filter_map(|line| line.strip_prefix("note "));
    let mut outcomes = notes.filter_map(|note| match note.strip_prefix("refused ") {
        Some(refused) => Refusal::parse(refused).map(Err),
        None => note.starts_with("calibrated: ").then_some(Ok(())),
    });
    outcomes.next_back()
}

/// Finds the error in the console's reply to a command.
#[must_use]
pub fn parse_error(reply: &str) -> Option<Refusal> {
    transcript_lines(reply).find_map(|line| line.strip_prefix("error ")).and_then(Refusal::parse)
}

/// Values printed by the console command `cal show`.
#[derive(Clone, Debug, PartialEq)]
pub struct ShownCalibration {
    /// Name of the calibration method.
    pub method: String,
    /// Coefficients of the shown calibration.
    pub calibration: Calibration,
    /// Estimated heading error, degrees RMS.
    pub expected_rms_deg: f64,
    /// Estimated heading error at the worst heading, degrees.
    pub expected_worst_deg: f64,
}

/// Parses the answer to `cal show`.
#[must_use]
pub fn parse_shown_calibration(reply: &str) -> Option<ShownCalibration> {
    let line = |prefix: &str| transcript_lines(reply).find_map(|line| line.strip_prefix(prefix));
    let number_line = line("ok number ")?;
    let method = number_line.split_once(" of ")?.1.split_once(',')?.0.to_owned();
    let expected: [f32; 2] = parse_numbers(number_line.split_once("expected error ")?.1)?;
    let field: [f32; 2] = parse_numbers(line("field: ")?)?;
    let calibration = Calibration {
        w: [parse_numbers(line("wx: ")?)?, parse_numbers(line("wy: ")?)?, parse_numbers(line("wz: ")?)?],
        b_ut: parse_numbers(line("b: ")?)?,
        total_ut: field[0],
        inclination_rad: field[1].to_radians(),
        latency_s: latency_s(line("latency: ")?)?,
        motor_current: parse_motor_current(line("current: ")?)?,
    };
    Some(ShownCalibration {
        method,
        calibration,
        expected_rms_deg: f64::from(expected[0]),
        expected_worst_deg: f64::from(expected[1]),
    })
}

/// Attitude latency in use, seconds; 0 if not in use.
fn latency_s(text: &str) -> Option<f32> {
    let used_latency = text.strip_suffix(", used").map(parse_numbers::<2>);
    used_latency.map_or(Some(0.0), |numbers| numbers.map(|[latency_ms, _]| latency_ms / 1e3))
}

fn parse_motor_current(text: &str) -> Option<MotorCurrentInterference> {
    if text == "not known" {
        return Some(MotorCurrentInterference::NO_INTERFERENCE);
    }
    let [x, y, z, sigma_ut_per_a, mean_current_a, current_sigma_a] = parse_numbers(text)?;
    Some(MotorCurrentInterference { ut_per_a: [x, y, z], sigma_ut_per_a, mean_current_a, current_sigma_a })
}

/// Estimated hard-iron change in the answer to `status`, body axes, microtesla; `None` without a significant change.
#[must_use]
pub fn hard_iron_change_ut(status: &str) -> Option<[f64; 3]> {
    let line = transcript_lines(status).find_map(|line| line.strip_prefix("hard iron: changed by "))?;
    let (_, vector) = line.split_once("(x ")?;
    let (vector, _) = vector.split_once(", sigma")?;
    parse_numbers(vector).map(|vector: [f32; 3]| vector.map(f64::from))
}

/// Numbers among the words of a line; `None` unless there are exactly `N`.
fn parse_numbers<const N: usize>(text: &str) -> Option<[f32; N]> {
    let numbers: Vec<f32> =
        text.split_whitespace().filter_map(|word| word.trim_end_matches(',').parse().ok()).collect();
    numbers.try_into().ok()
}

/// Lines without terminal control sequences.
fn transcript_lines(text: &str) -> impl DoubleEndedIterator<Item = &str> {
    text.split('\n').map(|line| line.trim_end().rsplit("\u{1b}[2K").next().unwrap_or_default())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Units of the library: radians, seconds, chip axes.
    #[test]
    fn a_shown_calibration_is_parsed() {
        let transcript = "ok number 7 of maximum-likelihood, expected error 0.31 deg rms, sigma 0.62 deg at the worst heading\r\n\
                    wx: 1.01 0.02 0.03\r\nwy: 0.04 1.05 0.06\r\nwz: 0.07 0.08 1.09\r\nb: 1.5 -2.5 3.5 uT\r\n\
                    field: 48.00 uT, inclination 60.00 deg\r\nlatency: 25.0 ms, sigma 3.0 ms, used\r\n\
                    current: 0.1 -0.2 0.3 uT/A, sigma 0.01, used; 12.5 A, sigma 4.5\r\n";
        let shown_calibration = parse_shown_calibration(transcript).unwrap();
        let current = MotorCurrentInterference {
            ut_per_a: [0.1, -0.2, 0.3],
            sigma_ut_per_a: 0.01,
            mean_current_a: 12.5,
            current_sigma_a: 4.5,
        };
        let calibration = Calibration {
            w: [[1.01, 0.02, 0.03], [0.04, 1.05, 0.06], [0.07, 0.08, 1.09]],
            b_ut: [1.5, -2.5, 3.5],
            total_ut: 48.0,
            inclination_rad: 60_f32.to_radians(),
            latency_s: 0.025,
            motor_current: current,
        };
        assert_eq!(
            (shown_calibration.method.as_str(), shown_calibration.calibration),
            ("maximum-likelihood", calibration)
        );
        assert!(
            (shown_calibration.expected_rms_deg - 0.31).abs() < 1e-6
                && (shown_calibration.expected_worst_deg - 0.62).abs() < 1e-6
        );
        // A latency that was estimated but not used is ignored.
        let unused = transcript.replace(", used\r\ncurrent", ", not used\r\ncurrent");
        assert!(parse_shown_calibration(&unused).unwrap().calibration.latency_s.abs() < 1e-9);
    }

    #[test]
    fn the_last_note_counts() {
        let transcript = "note refused few-samples: fly more\r\nnote calibrated: number 1\r\n";
        assert_eq!(parse_solve_notice(transcript), Some(Ok(())));
    }
}
