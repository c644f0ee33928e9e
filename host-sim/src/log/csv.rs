//! A flight as a table: values separated by comma, semicolon or tab, with names in the first line.
//!
//! | column | unit, axes and sign |
//! |---|---|
//! | `t_s` | seconds |
//! | `mx`, `my`, `mz` | field in body axes forward, right, down, not corrected; milligauss, or microtesla on request |
//! | `mx2`, `my2`, `mz2`, ... | the same of a second compass, up to the eighth |
//! | `roll_deg`, `pitch_deg` | attitude; right wing down and nose up positive |
//! | `use` | optional: 0 keeps a row out of fit and score |
//! | `p_dps`, `q_dps`, `r_dps` | optional: body rates, deg/s, each the mean since the row before |
//! | `yaw_ref_deg` | optional: a heading to compare with, from any north |
//! | `yaw_deg` | optional: the autopilot's own yaw, from true north |
//! | `current_a` | optional: current, amperes |
//! | `lat_deg`, `lon_deg`, `height_m` | optional: where |
//! | `speed_m_s`, `course_deg` | optional, with those: speed and course over ground, from true north |
//! | `armed` | optional: 0 or 1 |
//!
//! Read by hand, a line at a time in bounded memory: quotes that never close, decimal commas and lines that are cut off are what
//! such tables have, and the crate `csv` holds a record however long it is.
//!
//! Others are passed over, and so are lines that begin with `#` and the `sep=` of a spreadsheet. Names may be in capitals. With semicolon or tab a comma is a decimal point. What is
//! empty or `nan` is not known there. A line that does not hold what it must costs that line.

use std::fmt;
use std::io::Read;

use super::flight::{Flight, Format, Gps};
use super::recorder::{Logged, MAX_COMPASSES, Recorder};
use super::series::Series;
use super::window::Window;

/// The unit of the field's columns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
    /// Milligauss, as ArduPilot logs.
    Milligauss,
    /// Microtesla.
    Microtesla,
}

impl Unit {
    const fn microtesla(self) -> f64 {
        match self {
            Self::Milligauss => 0.1,
            Self::Microtesla => 1.0,
        }
    }
}

/// Why a table cannot be read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum CsvError {
    /// The source cannot be read; why.
    Source(String),
    /// A column is missing; its name.
    NoColumn(String),
    /// A column of the rates is missing, though another is there; its name.
    NoRate(&'static str),
    /// There are no rows; the first line that could have been one, its column and what stands there.
    Empty(Option<(u64, String, String)>),
}

impl fmt::Display for CsvError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Source(why) => f.write_str(why),
            Self::NoColumn(name) => {
                write!(f, "no column {name}; needed are t_s, mx, my, mz, roll_deg, pitch_deg, named in the first line")
            }
            Self::NoRate(name) => write!(f, "no column {name}; p_dps, q_dps and r_dps belong together"),
            Self::Empty(None) => f.write_str("there are no rows"),
            Self::Empty(Some((line, column, found))) => {
                write!(f, "there are no rows; line {line}, {column}: {found:?} is not a number")
            }
        }
    }
}

impl std::error::Error for CsvError {}

/// Whether a table begins so: a line with the name of its time.
#[must_use]
pub fn begins_in(head: &[u8]) -> bool {
    let names = |line: &[u8]| {
        let line = String::from_utf8_lossy(line).into_owned();
        let separator = separator(&line);
        line.split(separator).any(|name| trimmed(name).eq_ignore_ascii_case("t_s"))
    };
    head.split(|&byte| byte == b'\n').find(|line| !is_comment(line)).is_some_and(names)
}

fn is_comment(line: &[u8]) -> bool {
    let text = line.trim_ascii();
    text.is_empty() || text.starts_with(b"#") || text.starts_with(b"sep=")
}

/// What separates, by what there is most of in the first line.
fn separator(header: &str) -> char {
    [',', ';', '\t'].into_iter().max_by_key(|&separator| header.matches(separator).count()).unwrap_or(',')
}

fn trimmed(value: &str) -> &str {
    value.trim_start_matches('\u{feff}').trim().trim_matches('"').trim()
}

/// Reads a flight.
///
/// # Errors
///
/// What is wrong with it.
pub fn read(mut source: impl Read, unit: Unit) -> Result<Flight, CsvError> {
    let unreadable = |e: std::io::Error| CsvError::Source(e.to_string());
    let mut window = Window::new(&mut source);
    let mut number = 0_u64;
    let mut table: Option<Table> = None;
    // The first lines, until it is known whether they are in the order of time.
    let mut held = Vec::new();
    let mut reading: Option<Reading> = None;
    while let Some(line) = window.line().map_err(unreadable)? {
        number += 1;
        if is_comment(line.as_bytes()) {
            continue;
        }
        let Some(table) = &table else {
            table = Some(Table::of(&line)?);
            continue;
        };
        if let Some(reading) = &mut reading {
            reading.take(table, unit, number, &line);
            continue;
        }
        held.push((number, line));
        if held.len() == LOOKED_AT {
            let began = reading.insert(Reading::of(table, &held));
            held.drain(..).for_each(|(number, line)| began.take(table, unit, number, &line));
        }
    }
    let Some(table) = table else { return Err(CsvError::NoColumn("t_s".to_owned())) };
    let mut reading = reading.unwrap_or_else(|| Reading::of(&table, &held));
    held.drain(..).for_each(|(number, line)| reading.take(&table, unit, number, &line));
    reading.finish()
}

/// So many lines show whether a table is in the order of time.
const LOOKED_AT: usize = 1000;

/// What is being read.
struct Reading {
    recorder: Recorder,
    rates: Series<3>,
    armed: Series<1>,
    /// About the middle of the first lines' times, seconds; those of a table may count from 1970.
    about_s: f64,
    /// Whether the lines are sorted by something else: then times are believed as they stand, and no clock began anew.
    is_shuffled: bool,
    first_bad: Option<(u64, String, String)>,
}

impl Reading {
    /// By what the first lines say of their times. Where one in ten steps goes back by more than what a clock's disorder
    /// makes, or most go back at all, lines are not in the order of time.
    fn of(table: &Table, held: &[(u64, String)]) -> Self {
        const BACK_S: f64 = 3.0;
        let mut times_s: Vec<f64> =
            held.iter().filter_map(|(_, line)| table.values(line).need(table.t_s, "t_s").ok()).collect();
        let steps = |is: &dyn Fn(f64) -> bool| times_s.windows(2).filter(|pair| is(pair[1] - pair[0])).count();
        let [back, far_back] = [steps(&|step_s| step_s < 0.0), steps(&|step_s| step_s < -BACK_S)];
        let is_shuffled = far_back * 10 > times_s.len() || back * 3 > times_s.len() * 2;
        times_s.sort_by(f64::total_cmp);
        let about_s = times_s.get(times_s.len() / 2).copied().unwrap_or(0.0);
        let recorder = Recorder::new(Format::Csv);
        Self { recorder, rates: Series::new(), armed: Series::new(), about_s, is_shuffled, first_bad: None }
    }

    fn take(&mut self, table: &Table, unit: Unit, number: u64, line: &str) {
        if let Err((column, found)) = table.take(line, unit, self) {
            self.recorder.flight.counts.garbage += 1;
            self.first_bad.get_or_insert((number, column, found));
        }
    }

    /// Where a time lies on the flight's time line, seconds.
    fn at(&mut self, t_s: f64) -> Option<f64> {
        let since_s = t_s - self.about_s;
        if since_s.abs() >= MAX_S {
            self.recorder.flight.counts.bad_times += 1;
            None
        } else if self.is_shuffled {
            Some(since_s)
        } else {
            self.recorder.timeline.at((since_s * 1e6 + ZERO_US).round() as u64)
        }
    }

    fn finish(mut self) -> Result<Flight, CsvError> {
        self.rates.settle();
        for (t_s, at) in at_the_rows(&self.rates) {
            self.recorder.rates(t_s, at);
        }
        self.armed.settle();
        for row in self.armed.rows() {
            self.recorder.armed(row.t_s, row.of[0] != 0.0);
        }
        let flight = self.recorder.finish();
        // Of readings that are no field the rows are there.
        let is_empty = flight.compasses.is_empty() && flight.counts.unhealthy == 0;
        if is_empty { Err(CsvError::Empty(self.first_bad)) } else { Ok(flight) }
    }
}

/// Where the columns stand.
struct Table {
    separator: char,
    t_s: usize,
    fields: Vec<(u8, [usize; 3])>,
    attitude: [usize; 2],
    rates: Option<[usize; 3]>,
    usable: Option<usize>,
    reference: Option<usize>,
    yaw: Option<usize>,
    current: Option<usize>,
    place: Option<[usize; 2]>,
    height: Option<usize>,
    over_ground: [Option<usize>; 2],
    armed: Option<usize>,
}

/// Where the first lines' times stand on the clock of a log, microseconds: times before nothing are as good as others.
const ZERO_US: f64 = 1e13;

/// No flight is so far from its first lines, seconds.
const MAX_S: f64 = 1e6;

/// The column and what stands there.
type Bad = (String, String);

impl Table {
    fn of(header: &str) -> Result<Self, CsvError> {
        let separator = separator(header);
        let names: Vec<&str> = header.split(separator).map(trimmed).collect();
        let find = |name: &str| names.iter().position(|column| column.eq_ignore_ascii_case(name));
        let need = |name: &str| find(name).ok_or_else(|| CsvError::NoColumn(name.to_owned()));
        let mut fields = vec![(1, [need("mx")?, need("my")?, need("mz")?])];
        for number in 2..=MAX_COMPASSES {
            if let [Some(x), Some(y), Some(z)] = ["mx", "my", "mz"].map(|axis| find(&format!("{axis}{number}"))) {
                fields.push((number, [x, y, z]));
            }
        }
        let place = find("lat_deg").zip(find("lon_deg")).map(|(latitude, longitude)| [latitude, longitude]);
        Ok(Self {
            separator,
            t_s: need("t_s")?,
            fields,
            attitude: [need("roll_deg")?, need("pitch_deg")?],
            rates: rates_in(&find)?,
            usable: find("use"),
            reference: find("yaw_ref_deg"),
            yaw: find("yaw_deg").or_else(|| find("yaw_log_deg")),
            current: find("current_a"),
            place,
            height: find("height_m"),
            over_ground: ["speed_m_s", "course_deg"].map(find),
            armed: find("armed"),
        })
    }

    fn values<'a>(&self, line: &'a str) -> Values<'a> {
        Values { values: line.split(self.separator).map(trimmed).collect(), has_comma: self.separator != ',' }
    }

    fn take(&self, line: &str, unit: Unit, reading: &mut Reading) -> Result<(), Bad> {
        let values = self.values(line);
        let t_s = values.need(self.t_s, "t_s")?;
        let [roll_deg, pitch_deg] =
            [values.need(self.attitude[0], "roll_deg")?, values.need(self.attitude[1], "pitch_deg")?];
        let mut fields = Vec::new();
        for &(number, [x, y, z]) in &self.fields {
            let given = [x, y, z].map(|index| values.get(index));
            if number == 1 || given.iter().all(Option::is_some) {
                let field = [values.need(x, "mx")?, values.need(y, "my")?, values.need(z, "mz")?];
                fields.push((number, field.map(|axis| (axis * unit.microtesla()) as f32)));
            }
        }
        let optional = |index: Option<usize>, name: &str| match index {
            Some(index) if values.get(index).is_some() => values.need(index, name).map(Some),
            _ => Ok(None),
        };
        let usable = optional(self.usable, "use")?;
        let reference = optional(self.reference, "yaw_ref_deg")?;
        let yaw = optional(self.yaw, "yaw_deg")?;
        let read = match self.rates.filter(|rates| rates.iter().any(|&index| values.get(index).is_some())) {
            Some([p, q, r]) => Some([values.need(p, "p_dps")?, values.need(q, "q_dps")?, values.need(r, "r_dps")?]),
            None => None,
        };
        let Some(t_s) = reading.at(t_s) else { return Ok(()) };
        if let Some(read) = read {
            reading.rates.push(t_s, read.map(|dps| dps.to_radians() as f32));
        }
        if let Ok(Some(armed)) = optional(self.armed, "armed") {
            reading.armed.push(t_s, [f32::from(armed != 0.0)]);
        }
        let into = &mut reading.recorder;
        for (number, field_ut) in fields {
            into.field(number, Logged::Raw, t_s, field_ut, None);
        }
        let angles = [roll_deg, pitch_deg, yaw.unwrap_or(f64::NAN)];
        into.attitude(t_s, angles.map(|deg| deg.to_radians() as f32));
        let flight = &mut into.flight;
        if let Some(reference) = reference {
            flight.reference.push(t_s, [reference.to_radians() as f32]);
        }
        if let Some(usable) = usable {
            flight.usable.push(t_s, [f32::from(usable != 0.0)]);
        }
        if let Ok(Some(amperes)) = optional(self.current, "current_a") {
            into.current(t_s, amperes as f32);
        }
        if let Some([latitude, longitude]) = self.place.map(|place| place.map(|index| values.get(index)))
            && let (Some(latitude), Some(longitude)) = (latitude, longitude)
        {
            let height_m = self.height.and_then(|index| values.get(index)).unwrap_or(0.0) as f32;
            let [latitude_deg, longitude_deg] = [latitude, longitude].map(|deg| deg as f32);
            let known =
                |index: Option<usize>| index.and_then(|index| values.get(index)).map_or(f32::NAN, |of| of as f32);
            let [speed_m_s, course_deg] = self.over_ground.map(known);
            let yaw_deg = f32::NAN;
            into.gps(t_s, Gps { latitude_deg, longitude_deg, height_m, speed_m_s, course_deg, yaw_deg });
        }
        Ok(())
    }
}

struct Values<'a> {
    values: Vec<&'a str>,
    /// Whether a comma is a decimal point.
    has_comma: bool,
}

impl Values<'_> {
    /// A number; none where nothing stands, or that it is none.
    fn get(&self, index: usize) -> Option<f64> {
        let text = self.values.get(index).filter(|text| !text.is_empty() && !text.eq_ignore_ascii_case("nan"))?;
        // What is no number is not nothing.
        Some(self.number(text).unwrap_or(f64::NAN))
    }

    fn number(&self, text: &str) -> Option<f64> {
        if self.has_comma { text.replace(',', ".").parse().ok() } else { text.parse().ok() }
    }

    fn need(&self, index: usize, column: &str) -> Result<f64, Bad> {
        let bad =
            || (column.to_owned(), self.values.get(index).copied().unwrap_or_default().chars().take(40).collect());
        self.get(index).filter(|number| number.is_finite()).ok_or_else(bad)
    }
}

/// Where the columns of the rates stand: all three or none.
fn rates_in(find: &dyn Fn(&str) -> Option<usize>) -> Result<Option<[usize; 3]>, CsvError> {
    let names = ["p_dps", "q_dps", "r_dps"];
    let found = names.map(find);
    if let [Some(p), Some(q), Some(r)] = found {
        return Ok(Some([p, q, r]));
    }
    let missing = names.iter().zip(found).find(|(_, index)| index.is_none());
    match missing {
        Some((name, _)) if found.iter().any(Option::is_some) => Err(CsvError::NoRate(name)),
        _ => Ok(None),
    }
}

/// A step that is so many times as long as most is a gap: its mean says little of its ends.
const GAP_STEPS: f64 = 3.0;

/// Rates that are means over the time since the row before, made those at the rows: the mean of the times before and after
/// a row, which neither lags nor leads. A row at the edge of a gap has that of the side where its neighbour is; the mean
/// over a gap is better than nothing where there is no other.
fn at_the_rows(rates: &Series<3>) -> Vec<(f64, [f32; 3])> {
    let Some(step_s) = rates.median_step_s() else {
        return rates.rows().iter().map(|row| (row.t_s, row.of)).collect();
    };
    let rows = rates.rows();
    let is_gap = |later: usize| rows[later].t_s - rows[later - 1].t_s > GAP_STEPS * step_s;
    (0..rows.len())
        .map(|i| {
            let before = rows[i].of;
            let after = rows.get(i + 1).filter(|_| !is_gap(i + 1)).map(|next| next.of);
            let begins = i == 0 || is_gap(i);
            let at = match after {
                Some(after) if begins => after,
                Some(after) => std::array::from_fn(|axis| before[axis].midpoint(after[axis])),
                None => before,
            };
            (rows[i].t_s, at)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: &str =
        "t_s,extra,mx,my,mz,roll_deg,pitch_deg,use\n0,9,100,-200,400,10,-2,1\n0.1,9,101,-201,401,11,-3,0\n";

    fn parsed(text: &str) -> Result<Flight, CsvError> {
        read(text.as_bytes(), Unit::Milligauss)
    }

    #[test]
    fn columns_are_found_by_name_and_units_converted() {
        let flight = parsed(GOOD).unwrap();
        let rows = flight.compasses[0].field.rows();
        assert_eq!(rows.len(), 2);
        assert_eq!(rows[0].of.map(f32::to_bits), [10.0_f32, -20.0, 40.0, 10.0, -20.0, 40.0].map(f32::to_bits));
        assert!((flight.attitude.rows()[1].of[1].to_degrees() + 3.0).abs() < 1e-5);
        assert_eq!(flight.usable.rows().iter().map(|row| row.of[0]).collect::<Vec<_>>(), [1.0, 0.0]);
        let in_ut = read(GOOD.as_bytes(), Unit::Microtesla).unwrap();
        assert_eq!(in_ut.compasses[0].field.rows()[0].of[..3], [100.0, -200.0, 400.0]);
    }

    #[test]
    fn semicolons_tabs_decimal_commas_comments_and_ends_of_lines_are_read() {
        let commas = parsed(GOOD).unwrap();
        for text in [
            GOOD.replace(',', ";").replace('.', ","),
            GOOD.replace(',', "\t"),
            format!("# of a boat\n\n{}", GOOD.replace('\n', "\r\n")),
            GOOD.replace("t_s", "\u{feff}\"t_s\""),
        ] {
            let flight = parsed(&text).unwrap();
            assert_eq!(flight.compasses[0].field, commas.compasses[0].field, "{text}");
            assert!(begins_in(text.as_bytes()), "{text}");
        }
        assert!(!begins_in(b"time,mx\n") && !begins_in(b""));
    }

    /// A line that is cut off, one with words and one that is empty in a needed place cost themselves.
    #[test]
    fn a_broken_line_costs_that_line() {
        for bad in ["0.2,9,10", "0.2,9,x,-200,400,10,-2,1\n", "0.2,9,100,,400,10,-2,1\n", "0.2,9,100,inf,400,10,-2,1"] {
            let flight = parsed(&format!("{GOOD}{bad}")).unwrap();
            assert_eq!((flight.compasses[0].field.rows().len(), flight.counts.garbage), (2, 1), "{bad}");
        }
    }

    #[test]
    fn rows_are_put_in_order_and_an_instant_counts_once() {
        let text = format!("{GOOD}0.05,9,100,-200,400,10,-2,1\n0.1,9,0,0,0.1,0,0,1\n");
        let flight = parsed(&text).unwrap();
        let times: Vec<f64> = flight.compasses[0].field.rows().iter().map(|row| row.t_s).collect();
        assert_eq!(times.len(), 3);
        assert!(times.is_sorted() && flight.counts.repeats > 0);
    }

    #[test]
    fn what_is_wrong_is_named_with_its_line() {
        let error = |text: &str| parsed(text).unwrap_err();
        assert_eq!(error("t_s,mx,my,mz,roll_deg\n"), CsvError::NoColumn("pitch_deg".to_owned()));
        assert_eq!(error("t_s,mx,my,mz,roll_deg,pitch_deg\n"), CsvError::Empty(None));
        let bad = CsvError::Empty(Some((2, "my".to_owned(), "nan".to_owned())));
        assert_eq!(error("t_s,mx,my,mz,roll_deg,pitch_deg\n1,1,nan,3,4,5\n"), bad);
        for (columns, missing) in
            [("q_dps,r_dps", "p_dps"), ("p_dps,r_dps", "q_dps"), ("q_dps,p_dps", "r_dps"), ("r_dps", "p_dps")]
        {
            let error = error(&format!("t_s,mx,my,mz,roll_deg,pitch_deg,{columns}\n"));
            assert_eq!(error, CsvError::NoRate(missing));
            assert!(error.to_string().starts_with(&format!("no column {missing};")), "{error}");
        }
    }

    /// What the rates of these times, about one axis, become.
    fn found(read: &[(f64, Option<f32>)]) -> Vec<f32> {
        let mut rates = Series::new();
        for &(t_s, rate) in read {
            if let Some(rate) = rate {
                rates.push(t_s, [0.0, rate, -rate]);
            }
        }
        at_the_rows(&rates)
            .into_iter()
            .map(|(_, [p, q, r])| {
                assert!(p.abs() < 1e-9 && (r + q).abs() < 1e-9);
                q
            })
            .collect()
    }

    /// Of a rate that grows evenly from nothing, the mean of each second is half a second old.
    #[test]
    fn a_row_s_rate_is_that_of_its_instant() {
        let read: Vec<_> = (0..5).map(|i| (f64::from(i), Some(i as f32 - 0.5))).collect();
        assert_eq!(found(&read), [0.5, 1.0, 2.0, 3.0, 3.5]);
    }

    /// Steps of one second, one of three and one of a little more.
    #[test]
    fn nothing_is_taken_from_beyond_a_gap() {
        let read = [(0.0, 9.0), (1.0, 2.0), (2.0, 4.0), (5.0, 8.0), (6.0, 2.0), (9.1, 7.0), (10.1, 4.0), (11.1, 6.0)];
        let expected = [2.0, 3.0, 6.0, 5.0, 2.0, 4.0, 5.0, 6.0];
        assert_eq!(found(&read.map(|(t_s, rate)| (t_s, Some(rate)))), expected);
        assert_eq!(found(&[(0.0, Some(1.0))]), [1.0]);
        assert_eq!(found(&[(0.0, Some(1.0)), (1.0, Some(3.0)), (9.0, Some(5.0))]).last(), Some(&5.0));
    }
}
