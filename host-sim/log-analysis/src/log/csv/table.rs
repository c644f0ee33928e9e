//! Columns of a table and the parser of its lines.

use super::super::flight::Gps;
use super::super::flight_builder::{FieldProcessing, MAX_COMPASSES};
use super::{CsvError, FieldUnit, TableReader, separator, trimmed};

pub(super) struct TableLayout {
    separator: char,
    pub t_s: usize,
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

/// Column name and invalid content.
pub(super) type InvalidCell = (String, String);

impl TableLayout {
    pub fn from_header(header: &str) -> Result<Self, CsvError> {
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

    pub fn values<'a>(&self, line: &'a str) -> LineValues<'a> {
        LineValues {
            values: line.split(self.separator).map(trimmed).collect(),
            has_decimal_comma: self.separator != ',',
        }
    }

    pub fn read_line(&self, line: &str, unit: FieldUnit, reading: &mut TableReader) -> Result<(), InvalidCell> {
        let values = self.values(line);
        let t_s = values.require(self.t_s, "t_s")?;
        let [roll_deg, pitch_deg] =
            [values.require(self.attitude[0], "roll_deg")?, values.require(self.attitude[1], "pitch_deg")?];
        let mut fields = Vec::new();
        for &(number, [x, y, z]) in &self.fields {
            let given = [x, y, z].map(|index| values.get(index));
            if number == 1 || given.iter().all(Option::is_some) {
                let field = [values.require(x, "mx")?, values.require(y, "my")?, values.require(z, "mz")?];
                fields.push((number, field.map(|axis| (axis * unit.microtesla()) as f32)));
            }
        }
        let optional = |index: Option<usize>, name: &str| match index {
            Some(index) if values.get(index).is_some() => values.require(index, name).map(Some),
            _ => Ok(None),
        };
        let usable = optional(self.usable, "use")?;
        let reference = optional(self.reference, "yaw_ref_deg")?;
        let yaw = optional(self.yaw, "yaw_deg")?;
        let read = match self.rates.filter(|rates| rates.iter().any(|&index| values.get(index).is_some())) {
            Some([p, q, r]) => {
                Some([values.require(p, "p_dps")?, values.require(q, "q_dps")?, values.require(r, "r_dps")?])
            }
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
            into.push_field(number, FieldProcessing::BodyRaw, t_s, field_ut, None);
        }
        let angles = [roll_deg, pitch_deg, yaw.unwrap_or(f64::NAN)];
        into.push_attitude(t_s, angles.map(|deg| deg.to_radians() as f32));
        let flight = &mut into.flight;
        if let Some(reference) = reference {
            flight.reference_heading.push(t_s, [reference.to_radians() as f32]);
        }
        if let Some(usable) = usable {
            flight.usable.push(t_s, [f32::from(usable != 0.0)]);
        }
        if let Ok(Some(amperes)) = optional(self.current, "current_a") {
            into.push_current(t_s, amperes as f32);
        }
        if let Some([latitude, longitude]) = self.place.map(|place| place.map(|index| values.get(index)))
            && let (Some(latitude), Some(longitude)) = (latitude, longitude)
        {
            let height_m = self.height.and_then(|index| values.get(index)).unwrap_or(0.0) as f32;
            let [latitude_deg, longitude_deg] = [latitude, longitude].map(|deg| deg as f32);
            let known =
                |index: Option<usize>| index.and_then(|index| values.get(index)).map_or(f32::NAN, |value| value as f32);
            let [speed_m_s, course_deg] = self.over_ground.map(known);
            let yaw_deg = f32::NAN;
            into.push_gps(t_s, Gps { latitude_deg, longitude_deg, height_m, speed_m_s, course_deg, yaw_deg });
        }
        Ok(())
    }
}

pub(super) struct LineValues<'a> {
    values: Vec<&'a str>,
    has_decimal_comma: bool,
}

impl LineValues<'_> {
    /// The number in a column; none if empty or `nan`, NaN if invalid.
    fn get(&self, index: usize) -> Option<f64> {
        let text = self.values.get(index).filter(|text| !text.is_empty() && !text.eq_ignore_ascii_case("nan"))?;
        // Invalid text must not count as absent.
        Some(self.number(text).unwrap_or(f64::NAN))
    }

    fn number(&self, text: &str) -> Option<f64> {
        if self.has_decimal_comma { text.replace(',', ".").parse().ok() } else { text.parse().ok() }
    }

    pub fn require(&self, index: usize, column: &str) -> Result<f64, InvalidCell> {
        let bad =
            || (column.to_owned(), self.values.get(index).copied().unwrap_or_default().chars().take(40).collect());
        self.get(index).filter(|number| number.is_finite()).ok_or_else(bad)
    }
}

/// Indices of the rate columns: all three or none.
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
