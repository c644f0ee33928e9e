//! Samples of a compass as JSON, drawn by `assets/charts.js`.

use serde_json::{Value, json};

use super::model::{CompassReport, DeviationCurve, ReportSample};

/// Largest number of samples of a compass on the page: 100 KB each thousand.
const MAX_PAGE_SAMPLES: usize = 2400;

/// Shortest gap at which the line of a chart is interrupted, seconds.
const LINE_GAP_S: f64 = 3.0;
/// Shortest gap at which the line of a chart is interrupted, in mean steps of the samples.
const LINE_GAP_STEPS: f64 = 4.0;

/// A number for each sample.
type SampleColumn = (&'static str, fn(&ReportSample) -> Option<f64>);

const SAMPLE_COLUMNS: [SampleColumn; 17] = [
    ("heading", |sample| sample.heading_deg),
    ("roll", |sample| Some(sample.roll_deg)),
    ("pitch", |sample| Some(sample.pitch_deg)),
    ("raw_x", |sample| sample.raw_ut.map(|ut| ut[0])),
    ("raw_y", |sample| sample.raw_ut.map(|ut| ut[1])),
    ("raw_z", |sample| sample.raw_ut.map(|ut| ut[2])),
    ("logged_x", |sample| sample.logged_ut.map(|ut| ut[0])),
    ("logged_y", |sample| sample.logged_ut.map(|ut| ut[1])),
    ("logged_z", |sample| sample.logged_ut.map(|ut| ut[2])),
    ("corrected_x", |sample| sample.corrected_ut.map(|ut| ut[0])),
    ("corrected_y", |sample| sample.corrected_ut.map(|ut| ut[1])),
    ("corrected_z", |sample| sample.corrected_ut.map(|ut| ut[2])),
    ("current", |sample| sample.current_a),
    ("before", |sample| sample.error_before_deg),
    ("parameters", |sample| sample.error_parameters_deg),
    ("module", |sample| sample.error_deg),
    ("sigma", |sample| sample.sigma_deg),
];

/// Whether a compass has data for the charts.
pub fn has_samples(compass: &CompassReport) -> bool {
    !compass.samples.is_empty() || !compass.curves_before.is_empty()
}

/// The samples in columns of hundredths (missing: null), `kinds` with a digit for each (1 usable, 4 without a heading), and all else that the charts need.
pub fn samples_json(compass: &CompassReport, error_name: &str) -> Value {
    let rows = with_gaps(&drawn_samples(&compass.samples));
    let column = |column_value: &dyn Fn(&ReportSample) -> Option<f64>| -> Option<Vec<Value>> {
        let cells: Vec<Option<i64>> = rows.iter().map(|(_, sample)| to_hundredths(column_value((*sample)?)?)).collect();
        cells.iter().any(Option::is_some).then(|| cells.into_iter().map(Value::from).collect())
    };
    let columns: serde_json::Map<String, Value> = SAMPLE_COLUMNS
        .iter()
        .filter_map(|(name, column_value)| Some(((*name).to_owned(), Value::from(column(column_value)?))))
        .collect();
    let kind = |sample: &ReportSample| u8::from(sample.is_usable) + 4 * u8::from(sample.is_heading_withheld);
    let kinds: String = rows.iter().map(|(_, sample)| char::from(b'0' + sample.map_or(0, kind))).collect();
    let curves = |curves: &[DeviationCurve]| -> Vec<Value> {
        let curve = |curve: &DeviationCurve| {
            let errors: Vec<_> = curve.errors_deg.iter().map(|deg| deg.and_then(to_hundredths)).collect();
            json!({ "name": curve.curve_name, "errors": errors })
        };
        curves.iter().map(curve).collect()
    };
    let marks = compass.event_marks.iter().filter(|mark| mark.time_s.is_finite());
    json!({
        "error": error_name,
        "before_name": compass.before_correction_name,
        "earth": compass.earth_field.filter(|earth| earth.iter().all(|number| number.is_finite())),
        "offset": compass.magnetic_offset_deg,
        "t": rows.iter().map(|(at_s, _)| to_hundredths(*at_s)).collect::<Vec<_>>(),
        "columns": columns,
        "kinds": kinds,
        "marks": marks.map(|mark| json!({ "at": mark.time_s, "name": mark.event_name })).collect::<Vec<_>>(),
        "curves": { "before": curves(&compass.curves_before), "after": curves(&compass.curves_after) },
    })
}

fn to_hundredths(number: f64) -> Option<i64> {
    number.is_finite().then(|| (number * 100.0).round() as i64)
}

/// Thins many samples to three per interval: the weakest and the strongest field, and the largest error.
fn drawn_samples(samples: &[ReportSample]) -> Vec<&ReportSample> {
    let size = if samples.len() > MAX_PAGE_SAMPLES { (3 * samples.len()).div_ceil(MAX_PAGE_SAMPLES) } else { 1 };
    let strength = |sample: &&ReportSample| {
        sample.corrected_ut.or(sample.raw_ut).map_or(0.0, |[x, y, z]| libm::hypot(libm::hypot(x, y), z))
    };
    let error = |sample: &&ReportSample| sample.error_deg.or(sample.error_before_deg).map_or(0.0, f64::abs);
    let mut drawn = Vec::new();
    for interval in samples.chunks(size) {
        let index = |largest_error: Option<&ReportSample>| {
            largest_error
                .and_then(|largest_error| interval.iter().position(|sample| std::ptr::eq(sample, largest_error)))
        };
        let mut chosen = [
            index(interval.iter().min_by(|a, b| strength(a).total_cmp(&strength(b)))),
            index(interval.iter().max_by(|a, b| strength(a).total_cmp(&strength(b)))),
            index(interval.iter().max_by(|a, b| error(a).total_cmp(&error(b)))),
        ]
        .to_vec();
        chosen.sort_unstable();
        chosen.dedup();
        drawn.extend(chosen.into_iter().flatten().filter_map(|i| interval.get(i)));
    }
    drawn
}

/// Samples with their times, and `None` in the middle of each gap.
fn with_gaps<'a>(samples: &[&'a ReportSample]) -> Vec<(f64, Option<&'a ReportSample>)> {
    let span_s = samples.first().zip(samples.last()).map_or(0.0, |(first, last)| last.time_s - first.time_s);
    let gap_s = LINE_GAP_S.max(LINE_GAP_STEPS * span_s / samples.len().max(1) as f64);
    let mut rows = Vec::new();
    let mut last_s = f64::INFINITY;
    for sample in samples.iter().filter(|sample| sample.time_s.is_finite()) {
        if sample.time_s - last_s > gap_s {
            rows.push((sample.time_s.midpoint(last_s), None));
        }
        last_s = sample.time_s;
        rows.push((sample.time_s, Some(*sample)));
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    fn report_with_samples(sample_count: u32) -> CompassReport {
        let sample = |i: u32| ReportSample {
            time_s: f64::from(i) * 0.02,
            raw_ut: Some([f64::from(i % 7), 0.0, 40.0]),
            error_deg: Some(f64::from(i % 5)),
            is_usable: !(100..200).contains(&i),
            is_heading_withheld: i == 0,
            ..ReportSample::default()
        };
        CompassReport { samples: (0..sample_count).map(sample).collect(), ..CompassReport::default() }
    }

    #[test]
    fn an_hour_has_bounded_size_and_keeps_its_extremes() {
        let mut hour = report_with_samples(180_000);
        hour.samples[90_000].raw_ut = Some([99.0, 0.0, 40.0]);
        hour.samples[120_000].error_deg = Some(-77.0);
        let json = samples_json(&hour, "error");
        let len = json["t"].as_array().unwrap().len();
        assert!((MAX_PAGE_SAMPLES / 2..=MAX_PAGE_SAMPLES + 2).contains(&len), "{len}");
        let has_value =
            |column: &str, number: i64| json["columns"][column].as_array().unwrap().contains(&json!(number));
        assert!(has_value("raw_x", 9900) && has_value("module", -7700) && !has_value("raw_x", 1));
        assert!(json["columns"].get("sigma").is_none(), "a column without numbers");
    }

    #[test]
    fn a_gap_has_a_row_without_numbers() {
        let mut compass = report_with_samples(400);
        let rows = |compass: &CompassReport| {
            let json = samples_json(compass, "error");
            let cells = json["columns"]["raw_z"].as_array().unwrap().clone();
            (json["kinds"].as_str().unwrap().to_owned(), cells.iter().filter(|cell| cell.is_null()).count())
        };
        let (kinds, empty) = rows(&compass);
        assert_eq!((&kinds[..2], &kinds[150..151], empty), ("51", "0", 0));
        for sample in &mut compass.samples[200..] {
            sample.time_s += 100.0;
        }
        assert_eq!(rows(&compass).1, 1);
        let empty = samples_json(&CompassReport::default(), "error");
        assert_eq!((empty["t"].as_array().unwrap().len(), empty["kinds"].as_str().unwrap()), (0, ""));
    }
}
