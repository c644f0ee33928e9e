//! Headings of the rows by the module's instrument, and their score.

use autoswing::attitude::{self, AttitudeReport, BodyRates, SenderId};
use autoswing::calibration::Solution;
use autoswing::frames::RollPitch;
use autoswing::heading;
use autoswing::instrument::{Correction, Estimate, Instrument, InstrumentConfig};
use autoswing::reading::Reading;
use autoswing::time::{Timestamp, WrappingMillis};
use nalgebra::Vector3;

use super::data_loss;
use super::result::{HeadingRow, HeadingScore};
use super::row::{ReplayRow, heading_deg};
use super::rows::{self, attitudes_between};
use crate::log::LoggedFlight;
use crate::numbers::{mean_angle_deg, median, rms, square};
use crate::score::{within_percent, wrap_180};

/// Largest row interval for the monitor, microseconds. At 1 Hz it reports false hard-iron changes and degrades headings
/// by degrees. Rows averaged from two readings at 11 to 12.5 Hz are up to 0.18 s apart.
const MAX_MONITORED_INTERVAL_US: u32 = 190_000;

/// Heading errors that correspond to the scatter of field strength and of inclination, degrees RMS. An isotropic
/// disturbance of the field by a fraction `f` of its strength changes the inclination by `f` and the heading by `f /
/// cos I` radians.
pub(super) fn heading_scatter(rows: &[ReplayRow], field: &dyn Fn(&ReplayRow) -> Vector3<f64>) -> [f64; 2] {
    let polar: Vec<[f64; 2]> = rows
        .iter()
        .map(|row| {
            let field = field(row);
            let vertical_ut = row.down_in_body().dot(&field);
            [field.norm(), libm::atan2(vertical_ut, (field.norm_squared() - square(vertical_ut)).max(0.0).sqrt())]
        })
        .collect();
    let [strength, inclination_rad] = [0, 1].map(|i| median(polar.iter().map(|polar| polar[i])));
    [rms(polar.iter().map(|[f, _]| f / strength - 1.0)), rms(polar.iter().map(|[_, i]| i - inclination_rad))]
        .map(|rms| rms.to_degrees() / libm::cos(inclination_rad))
}

/// Estimate of the heading error from the scatter of strength and inclination, degrees RMS.
pub(super) fn rms_deg_by_scatter(rows: &[ReplayRow], field: &dyn Fn(&ReplayRow) -> Vector3<f64>) -> f64 {
    let [by_strength_deg, by_inclination_deg] = heading_scatter(rows, field);
    libm::hypot(by_strength_deg, by_inclination_deg) / std::f64::consts::SQRT_2
}

/// Whether the monitor runs at a row interval in seconds.
pub fn is_monitored(interval_s: f64) -> bool {
    interval_s * 1e6 <= f64::from(MAX_MONITORED_INTERVAL_US)
}

/// Instrument for the interval of these rows; attitude and field are simultaneous.
pub(super) fn instrument_config(rows: &[ReplayRow]) -> InstrumentConfig {
    let median_s = rows::median_step_s(rows).unwrap_or(0.1);
    // Gaps left by the selection of rows do not count as silence of the autopilot.
    let attitude =
        attitude::AttitudeConfig { latency_us: 0, restart_silence_us: u32::MAX, ..attitude::AttitudeConfig::DEFAULT };
    InstrumentConfig { attitude, ..InstrumentConfig::new((median_s * 1e6).round() as u32) }
}

fn row_timestamp(t_s: f64, start_s: f64) -> Timestamp {
    Timestamp::from_us(((t_s - start_s) * 1e6).round() as u64)
}

/// Feeds a row to the instrument; times count from `start_s`.
pub(super) fn estimate_heading(instrument: &mut Instrument, row: &ReplayRow, start_s: f64) -> Estimate {
    let now = row_timestamp(row.t_s, start_s);
    instrument.on_attitude(now, attitude_report(row.attitude, row.rates_rad_s));
    if let Some(amperes) = row.current_a {
        instrument.on_current(now, amperes);
    }
    instrument.on_reading(now, Reading { field: row.raw_field, is_saturated: false, was_overwritten: false })
}

/// Attitude report of a row, dated by arrival.
fn attitude_report(attitude: RollPitch, rates_rad_s: Option<[f32; 3]>) -> AttitudeReport {
    let body_rates = rates_rad_s.and_then(BodyRates::from_rad_s);
    AttitudeReport {
        sender: SenderId::default(),
        sender_clock_at_sending: WrappingMillis::default(),
        attitude,
        body_rates,
    }
}

fn calibrated_instrument(config: InstrumentConfig, solution: &Solution) -> Instrument {
    let mut instrument = Instrument::new(config);
    let calibration = Some((solution.calibration, solution.uncertainty));
    instrument.set_correction(Correction { calibration, ..Correction::UNCALIBRATED });
    instrument
}

/// Headings of the rows, with the flight's attitudes between them.
pub(super) fn compute_headings(
    rows: &[ReplayRow],
    flight: Option<&LoggedFlight>,
    solution: &Solution,
    config: InstrumentConfig,
) -> Vec<HeadingRow> {
    // Incomplete rates integrate to wrong turns.
    let has_complete_rates = flight.is_none_or(data_loss::has_integrable_rates);
    let usable_rates = |rates_rad_s: Option<[f32; 3]>| rates_rad_s.filter(|_| has_complete_rates);
    let is_monitored = has_complete_rates && config.reading_period_us <= MAX_MONITORED_INTERVAL_US;
    let start_s = rows.first().map_or(0.0, |row| row.t_s);
    let mut last_s = start_s;
    // One instrument accepts any field strength; the other determines the status.
    let mut instruments = [config.heading, heading::HeadingLimits::ANY_FIELD]
        .map(|heading| calibrated_instrument(InstrumentConfig { heading, ..config }, solution));
    let headings = rows.iter().map(|row| {
        let from_s = std::mem::replace(&mut last_s, row.t_s);
        let between = flight.map_or_else(Vec::new, |flight| attitudes_between(flight, from_s, row.t_s));
        let row = &ReplayRow { rates_rad_s: usable_rates(row.rates_rad_s), ..*row };
        let [sent, shown] = instruments.each_mut().map(|instrument| {
            for logged in &between {
                let report = attitude_report(logged.attitude, usable_rates(logged.rates_rad_s));
                instrument.on_attitude(row_timestamp(logged.t_s, start_s), report);
            }
            let estimate = estimate_heading(instrument, row, start_s);
            while instrument.next_sample().is_some() {}
            if is_monitored {
                instrument.update_monitor();
            }
            estimate
        });
        HeadingRow::from_estimate(row.t_s, &shown, sent.heading.map(|_| ()))
    });
    headings.collect()
}

/// Score over usable rows with a reference; calls `heading` for every row in order.
pub(super) fn score_rows(
    rows: &[ReplayRow],
    mut heading: impl FnMut(&ReplayRow) -> Option<(f64, f64)>,
) -> Option<HeadingScore> {
    let errors: Vec<(f64, f64)> = rows
        .iter()
        .filter_map(|row| {
            // No heading before the first report and in gaps.
            let (heading_deg, sigma_deg) = heading(row).filter(|(heading_deg, _)| heading_deg.is_finite())?;
            let reference_deg = row.reference_deg.filter(|_| row.is_usable)?;
            Some((wrap_180(heading_deg - reference_deg), sigma_deg))
        })
        .collect();
    // Circular, so that errors near 180 deg do not cancel.
    let mean_deg = mean_angle_deg(errors.iter().map(|(error, _)| *error))?;
    let demeaned = |error: f64| wrap_180(error - mean_deg);
    let normalised: Vec<f64> = errors.iter().map(|(error, sigma_deg)| demeaned(*error) / sigma_deg).collect();
    Some(HeadingScore {
        rms_deg: rms(errors.iter().map(|(error, _)| demeaned(*error))),
        mean_deg,
        row_count: errors.len(),
        within_sigmas_percent: within_percent(&normalised),
    })
}

/// Score of the headings by a field, microtesla, without their uncertainty.
pub(super) fn score_field(rows: &[ReplayRow], field: impl Fn(&ReplayRow) -> Vector3<f64>) -> Option<HeadingScore> {
    score_rows(rows, |row| Some((heading_deg(row, field(row)), f64::NAN)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::replay::tests::{compass_of_flown_turns, level_row};

    /// Errors of 150 deg and 10 deg to both sides: their mean, and 10 deg in two of four rows.
    #[test]
    fn a_score_is_an_rms_about_the_circular_mean() {
        let errors_deg = [150.0, 140.0, 150.0, 160.0];
        let mut rows: Vec<ReplayRow> = (0..7).map(|i| level_row(f64::from(i), 50.0 * f64::from(i))).collect();
        (rows[4].is_usable, rows[5].reference_deg) = (false, None);
        let mut offsets_deg = errors_deg.into_iter().chain([0.0, 0.0, f64::NAN]);
        let score = score_rows(&rows, |row| Some((50.0 * row.t_s + offsets_deg.next()?, 6.0))).unwrap();
        assert!((score.rms_deg - 50_f64.sqrt()).abs() < 1e-9 && (score.mean_deg - 150.0).abs() < 1e-9, "{score:?}");
        assert_eq!((score.row_count, score.within_sigmas_percent), (4, [50.0, 100.0]));
        assert_eq!(score_rows(&rows[4..6], |_| Some((0.0, 1.0))), None);
    }

    /// Rows averaged from two readings are up to 0.18 s apart.
    #[test]
    fn the_instrument_has_the_interval_of_the_rows() {
        let rows: Vec<ReplayRow> = (0..9).map(|i| level_row(f64::from(i) * 0.08 + f64::from(i / 5), 0.0)).collect();
        let config = instrument_config(&rows);
        assert_eq!(config.reading_period_us, 80_000);
        assert_eq!((config.attitude.latency_us, config.attitude.restart_silence_us), (0, u32::MAX));
        assert_eq!([0.1, 0.18, 0.2].map(is_monitored), [true, true, false]);
        assert_eq!(row_timestamp(12.5, 2.25).as_us(), 10_250_000);
    }

    #[test]
    fn the_module_smooths_headings_only_with_complete_rates() {
        let (mut flight, compass) = compass_of_flown_turns();
        let solution = *compass.parameter_fit.solution().unwrap();
        for has_rates in [true, false] {
            flight.has_measured_rates = has_rates;
            let headings = compute_headings(&compass.rows, Some(&flight), &solution, instrument_config(&compass.rows));
            let smoothed_count = headings.iter().filter(|row| row.smoothed_and_sigma_deg.is_some()).count();
            assert_eq!(smoothed_count * 2 > compass.rows.len(), has_rates, "{smoothed_count}");
            assert_eq!(smoothed_count == 0, !has_rates, "{smoothed_count}");
            for (heading, row) in headings.iter().zip(&compass.rows).skip(10) {
                let [sent_deg, sigma_deg] = heading.sent_and_sigma_deg();
                let error_deg = wrap_180(sent_deg - row.reference_deg.unwrap());
                assert!(error_deg.abs() < 5.0 * sigma_deg && heading.status.is_ok(), "{heading:?} {error_deg}");
            }
        }
    }

    #[test]
    fn headings_of_an_implausible_field_are_estimated_but_not_sent() {
        let (_, mut compass) = compass_of_flown_turns();
        for row in &mut compass.rows {
            row.raw_field.ut *= 1.6;
        }
        let solution = *compass.parameter_fit.solution().unwrap();
        let headings = compute_headings(&compass.rows, None, &solution, instrument_config(&compass.rows));
        for heading in &headings[10..] {
            assert!(heading.status.is_err() && heading.heading_deg.is_finite(), "{heading:?}");
        }
    }
}
