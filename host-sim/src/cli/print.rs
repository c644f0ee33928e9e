//! What the commands print alike, and what becomes of it when nobody reads it.

use std::io::{self, ErrorKind, Write as _};
use std::path::Path;
use std::process::ExitCode;
use std::sync::OnceLock;

use autoswing::calibration::Calibration;
use comfy_table::{Cell, CellAlignment, ContentArrangement, Table, presets};
use host_sim::report::{self, Report};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use serde::Serialize;
use serde_json::{Value, json};

use super::Failure;

/// Columns of a terminal that nobody has made wider.
pub const WIDTH: usize = 80;

/// Why standard output takes nothing any more.
static LOST: OnceLock<io::Error> = OnceLock::new();

/// What a shell tells of a program that ended because its output was closed: 128 and the number of SIGPIPE.
const CLOSED: u8 = 141;

/// Prints; what nobody reads is dropped, and [`ending`] tells. So that files are written and others' processes ended all the
/// same, nothing ends here.
pub fn out(text: &str) {
    bytes(text.as_bytes());
}

/// Prints what need not be text.
pub fn bytes(bytes: &[u8]) {
    if !is_lost() {
        let mut stdout = io::stdout().lock();
        if let Err(error) = stdout.write_all(bytes).and_then(|()| stdout.flush()) {
            // The first counts.
            let _ = LOST.set(error);
        }
    }
}

/// Prints a line.
pub fn line(text: impl std::fmt::Display) {
    out(&format!("{text}\n"));
}

/// Whether nothing can be printed any more.
pub fn is_lost() -> bool {
    LOST.get().is_some()
}

/// The same, for what goes on for long without printing: looks whether whoever read what was printed has gone.
pub fn is_left() -> bool {
    let stdout = io::stdout();
    let mut ends = [PollFd::new(&stdout, PollFlags::empty())];
    let now = Timespec { tv_sec: 0, tv_nsec: 0 };
    // Of a pipe without a reader; a file or a terminal never says so.
    if poll(&mut ends, Some(&now)).is_ok() && ends[0].revents().contains(PollFlags::ERR) {
        let _ = LOST.set(ErrorKind::BrokenPipe.into());
    }
    is_lost()
}

/// A line on the error output, where even that may be closed.
pub fn complain(text: impl std::fmt::Display) {
    let _ = writeln!(io::stderr(), "{text}");
}

/// How a command ends that would end with `code`: a closed pipe ends it as it ends other programs, without a word.
pub fn ending(code: ExitCode) -> ExitCode {
    match LOST.get() {
        None => code,
        Some(error) if error.kind() == ErrorKind::BrokenPipe => ExitCode::from(CLOSED),
        Some(error) => {
            complain(format_args!("host-sim: cannot write to the standard output: {error}"));
            ExitCode::from(2)
        }
    }
}

/// Decimals by the end of a number's name: what it means, and a digit to spare.
const DECIMALS: [(&str, i32); 7] =
    [("soft_iron", 4), ("_deg", 3), ("_percent", 2), ("_ut", 3), ("_ms", 3), ("_s", 2), ("readings", 0)];

/// Ratios, and what has no unit.
const OTHER_DECIMALS: i32 = 3;

/// What is told exactly: the calibration itself, at most nine digits of an f32.
const EXACT: &str = "coefficients";

/// Prints a value as one line of JSON, numbers rounded to what they mean; see docs/json.md.
pub fn json(value: impl Serialize) -> Result<(), Failure> {
    let mut value = serde_json::to_value(value).map_err(|error| Failure(error.to_string()))?;
    round(&mut value, OTHER_DECIMALS);
    line(value);
    Ok(())
}

fn round(value: &mut Value, decimals: i32) {
    match value {
        Value::Number(number) if number.is_f64() => {
            *value = json!(rounded(number.as_f64().unwrap_or(f64::NAN), decimals));
        }
        Value::Array(values) => values.iter_mut().for_each(|value| round(value, decimals)),
        Value::Object(fields) => {
            for (name, value) in fields.iter_mut().filter(|(name, _)| *name != EXACT) {
                let of_its_unit = DECIMALS.iter().find(|(end, _)| name.ends_with(end));
                round(value, of_its_unit.map_or(decimals, |(_, decimals)| *decimals));
            }
        }
        _ => {}
    }
}

/// Writes a page and says where it is: not on standard output, whose last line may belong to a JSON object.
pub fn write_report(report: &Report, path: &Path) -> Result<(), Failure> {
    let written = report::write(report, path).map_err(|error| {
        Failure(format!("cannot write the report to {}: {error}; --report names another folder", path.display()))
    })?;
    if !is_lost() {
        complain(format_args!("report: {}", written.display()));
    }
    Ok(())
}

/// The command line, as a shell would take it again; the program by its name alone.
pub fn command_line() -> String {
    let words = std::env::args().skip(1).map(|word| {
        let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_./=,:+@%".contains(c);
        let is_word = !word.is_empty() && word.chars().all(is_plain);
        if is_word { word } else { format!("'{}'", word.replace('\'', "'\\''")) }
    });
    std::iter::once("host-sim".to_owned()).chain(words).collect::<Vec<_>>().join(" ")
}

/// The twelve coefficients.
pub fn coefficients(calibration: &Calibration) -> Value {
    json!({
        "w": calibration.w.as_flattened().iter().copied().map(shortest).collect::<Vec<_>>(),
        "b_ut": calibration.b_ut.map(shortest),
    })
}

/// The f64 that prints as the f32 does: 0.1 and not 0.10000000149.
pub fn shortest(value: f32) -> f64 {
    value.to_string().parse().unwrap_or(f64::NAN)
}

/// Rounded to so many decimals, for JSON that people read; never a minus before what rounds to nothing.
pub fn rounded(value: f64, decimals: i32) -> f64 {
    let scale = 10_f64.powi(decimals);
    (value * scale).round() / scale + 0.0
}

pub fn right_aligned(text: impl ToString) -> Cell {
    Cell::new(text).set_alignment(CellAlignment::Right)
}

/// A table without rows, of columns with these names. It is as wide as its contents, for a number that is broken in two is
/// none; names are broken where they say.
pub fn table<T: ToString>(names: impl IntoIterator<Item = T>) -> Table {
    let mut table = Table::new();
    table.load_style(presets::UTF8_FULL_CONDENSED);
    table.set_header(names.into_iter().map(right_aligned));
    table
}

/// The same of many columns: what stands at the right needs no space before it.
pub fn narrow_table<T: ToString>(names: impl IntoIterator<Item = T>) -> Table {
    let mut table = table(names);
    table.column_iter_mut().for_each(|column| {
        column.set_padding((0, 1));
    });
    table
}

/// A table whose words are broken at [`WIDTH`].
pub fn words_table<const N: usize>(names: [&str; N]) -> Table {
    let mut table = table([""; N]);
    table.set_header(names);
    table.set_content_arrangement(ContentArrangement::Dynamic).set_width(WIDTH as u16);
    table
}

/// Adds words, broken at [`WIDTH`]; the lines that go on are indented by two more.
pub fn say(out: &mut String, indent: &str, words: &str) {
    let further = " ".repeat(indent.len() + 2);
    let mut line = indent.to_owned();
    let mut is_begun = false;
    for word in words.split(' ') {
        if is_begun && line.chars().count() + 1 + word.chars().count() > WIDTH {
            out.push_str(&line);
            out.push('\n');
            line.clone_from(&further);
        } else if is_begun {
            line.push(' ');
        }
        line.push_str(word);
        is_begun = true;
    }
    out.push_str(&line);
    out.push('\n');
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_has_the_digits_of_its_unit() {
        let mut value = json!({
            "rms_deg": 0.123_456_789, "ratio": 1.000_55, "within_percent": [68.268_9, 95.0], "wrong": 3,
            "readings": 191.6, "mean_deg": -0.000_01,
            "coefficients": { "w": [1.012_345_6] }, "errors": [{ "right_deg": [[1.234_56]] }],
        });
        round(&mut value, OTHER_DECIMALS);
        let expected = json!({
            "rms_deg": 0.123, "ratio": 1.001, "within_percent": [68.27, 95.0], "wrong": 3,
            "readings": 192.0, "mean_deg": 0.0,
            "coefficients": { "w": [1.012_345_6] }, "errors": [{ "right_deg": [[1.235]] }],
        });
        assert_eq!(value, expected);
        assert_eq!(value["mean_deg"].to_string(), "0.0");
    }
}
