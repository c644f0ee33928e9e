//! What the console prints, read back as a script would read it.

use autoswing::calibration::{Calibration, CurrentIron};

/// An unasked `note` or an `error`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Notice {
    /// `note calibrated: ...`; the words.
    Calibrated(String),
    /// `note refused <code>: ...` or `error <code>: ...`.
    Refused {
        /// The stable code.
        code: String,
        /// What to do about it.
        words: String,
    },
}

impl Notice {
    /// A refusal.
    #[must_use]
    pub fn refused(code: &str, words: &str) -> Self {
        Self::Refused { code: code.to_owned(), words: words.to_owned() }
    }
}

/// The last note of a session that says how a solve ended.
#[must_use]
pub fn notice(session: &str) -> Option<Notice> {
    let notes = lines(session).filter_map(|line| line.strip_prefix("note "));
    let mut outcomes = notes.filter_map(|note| match note.strip_prefix("refused ") {
        Some(refused) => coded(refused),
        None => note.strip_prefix("calibrated: ").map(|words| Notice::Calibrated(words.to_owned())),
    });
    outcomes.next_back()
}

/// The error of a reply.
#[must_use]
pub fn error(reply: &str) -> Option<Notice> {
    lines(reply).find_map(|line| line.strip_prefix("error ")).and_then(coded)
}

fn coded(text: &str) -> Option<Notice> {
    text.split_once(": ").map(|(code, words)| Notice::refused(code, words))
}

/// `cal show`.
#[derive(Clone, Debug, PartialEq)]
pub struct Shown {
    /// The name of the method.
    pub method: String,
    /// The coefficients.
    pub calibration: Calibration,
    /// Expected heading error, degrees RMS.
    pub expected_rms_deg: f64,
    /// Expected heading error at the worst heading, degrees.
    pub expected_worst_deg: f64,
}

/// Reads the reply to `cal show`.
#[must_use]
pub fn shown(reply: &str) -> Option<Shown> {
    let line = |prefix: &str| lines(reply).find_map(|line| line.strip_prefix(prefix));
    let head = line("ok number ")?;
    let method = head.split_once(" of ")?.1.split_once(',')?.0.to_owned();
    let expected: [f32; 2] = numbers(head.split_once("expected error ")?.1)?;
    let field: [f32; 2] = numbers(line("field: ")?)?;
    let calibration = Calibration {
        w: [numbers(line("wx: ")?)?, numbers(line("wy: ")?)?, numbers(line("wz: ")?)?],
        b_ut: numbers(line("b: ")?)?,
        total_ut: field[0],
        inclination_rad: field[1].to_radians(),
        latency_s: latency_s(line("latency: ")?)?,
        current: current(line("current: ")?)?,
    };
    Some(Shown {
        method,
        calibration,
        expected_rms_deg: f64::from(expected[0]),
        expected_worst_deg: f64::from(expected[1]),
    })
}

/// The latency in use, seconds, of what is said about it.
fn latency_s(said: &str) -> Option<f32> {
    let used = said.strip_suffix(", used").map(numbers::<2>);
    used.map_or(Some(0.0), |found| found.map(|[latency_ms, _]| latency_ms / 1e3))
}

/// What goes with the current.
fn current(said: &str) -> Option<CurrentIron> {
    if said == "not known" {
        return Some(CurrentIron::NONE);
    }
    let [x, y, z, sigma_ut_per_a, mean_a, spread_a] = numbers(said)?;
    Some(CurrentIron { ut_per_a: [x, y, z], sigma_ut_per_a, mean_a, spread_a })
}

/// What `status` says of iron that has moved: what it adds to the corrected field, body axes, microtesla; `None` while
/// nothing is sure.
#[must_use]
pub fn iron_ut(status: &str) -> Option<[f64; 3]> {
    let line = lines(status).find_map(|line| line.strip_prefix("iron: moved by "))?;
    let (_, vector) = line.split_once("(x ")?;
    let (vector, _) = vector.split_once(", sigma")?;
    numbers(vector).map(|vector: [f32; 3]| vector.map(f64::from))
}

/// The words of a line that are numbers; `None` unless there are just as many as asked for.
fn numbers<const N: usize>(text: &str) -> Option<[f32; N]> {
    let found: Vec<f32> = text.split_whitespace().filter_map(|word| word.trim_end_matches(',').parse().ok()).collect();
    found.try_into().ok()
}

/// Lines without terminal control sequences.
fn lines(text: &str) -> impl DoubleEndedIterator<Item = &str> {
    text.split('\n').map(|line| line.trim_end().rsplit("\u{1b}[2K").next().unwrap_or_default())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn iron_that_moved_is_read_from_the_status() {
        let says = "ok calibrated\r\niron: moved by 5.2 uT since the calibration, mostly aft \
                    (x -4.9, y 0.3, z -1.7, sigma 0.4); headings allow for it\r\n";
        assert_eq!(iron_ut(says).map(|ut| ut.map(|c| (c * 10.0).round() as i32)), Some([-49, 3, -17]));
        assert_eq!(iron_ut("iron: as calibrated, as far as is sure\r\n"), None);
    }

    /// In the units of the library: radians, seconds, chip axes in their order.
    #[test]
    fn a_calibration_is_read_as_it_is_shown() {
        let says = "ok number 7 of maximum-likelihood, expected error 0.31 deg rms, sigma 0.62 deg at the worst heading\r\n\
                    wx: 1.01 0.02 0.03\r\nwy: 0.04 1.05 0.06\r\nwz: 0.07 0.08 1.09\r\nb: 1.5 -2.5 3.5 uT\r\n\
                    field: 48.00 uT, inclination 60.00 deg\r\nlatency: 25.0 ms, sigma 3.0 ms, used\r\n\
                    current: 0.1 -0.2 0.3 uT/A, sigma 0.01, used; 12.5 A, sigma 4.5\r\n";
        let shown = shown(says).unwrap();
        let current = CurrentIron { ut_per_a: [0.1, -0.2, 0.3], sigma_ut_per_a: 0.01, mean_a: 12.5, spread_a: 4.5 };
        let calibration = Calibration {
            w: [[1.01, 0.02, 0.03], [0.04, 1.05, 0.06], [0.07, 0.08, 1.09]],
            b_ut: [1.5, -2.5, 3.5],
            total_ut: 48.0,
            inclination_rad: 60_f32.to_radians(),
            latency_s: 0.025,
            current,
        };
        assert_eq!((shown.method.as_str(), shown.calibration), ("maximum-likelihood", calibration));
        assert!((shown.expected_rms_deg - 0.31).abs() < 1e-6 && (shown.expected_worst_deg - 0.62).abs() < 1e-6);
        // What was found and is not used is not in use.
        let unused = says.replace(", used\r\ncurrent", ", not used\r\ncurrent");
        assert!(super::shown(&unused).unwrap().calibration.latency_s.abs() < 1e-9);
    }

    /// What was refused first and calibrated then is calibrated.
    #[test]
    fn the_last_note_counts() {
        let says = "note refused few-samples: fly more\r\nnote calibrated: number 1\r\n";
        assert_eq!(notice(says), Some(Notice::Calibrated("number 1".to_owned())));
    }
}
