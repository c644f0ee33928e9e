use super::*;
use crate::log::time_series::Series;
use crate::replay::data_loss;
use crate::test_flight::flight_of_motion;

/// 100 s of measured rates at 10 Hz, of which one in `loss_stride` is lost, with an attitude at a rate in Hz.
fn flight_with_lost_rates(loss_stride: usize, attitude_rate_hz: f64) -> LoggedFlight {
    let still = |_| ([0.0; 3], [0.0; 3]);
    let mut rates = Series::new();
    for (_, row) in
        flight_of_motion(10.0, 1000, still).body_rates.rows().iter().enumerate().filter(|(i, _)| i % loss_stride != 1)
    {
        rates.push_row(row.t_s, row.row_values);
    }
    let whole = flight_of_motion(attitude_rate_hz, (100.0 * attitude_rate_hz) as u16, still);
    LoggedFlight { body_rates: rates, has_measured_rates: true, ..whole }
}

/// Rates are differences of the attitude if they are not measured. Of a slow attitude, and of a tenth of lost rates,
/// headings cannot be integrated; a fiftieth is harmless.
#[test]
fn a_heading_is_integrated_only_from_measured_and_complete_rates_with_a_fast_attitude() {
    for (has_measured_rates, attitude_rate_hz, loss_stride, is_integrable) in
        [(true, 5.0, 50, true), (false, 5.0, 50, false), (true, 2.0, 50, false), (true, 5.0, 10, false)]
    {
        let mut flight = flight_with_lost_rates(loss_stride, attitude_rate_hz);
        flight.has_measured_rates = has_measured_rates;
        assert_eq!(
            data_loss::has_integrable_rates(&flight),
            is_integrable,
            "{attitude_rate_hz} Hz, 1 in {loss_stride}"
        );
        let lost = data_loss::excessive_rate_loss(&flight);
        assert_eq!(lost.is_some(), has_measured_rates && loss_stride == 10, "{lost:?}");
        assert!(lost.is_none_or(|lost| (lost - 0.11).abs() < 0.01), "100 gaps in 900 rows: {lost:?}");
    }
}

#[test]
fn attitude_is_not_interpolated_over_two_lost_reports() {
    for (rate_hz, gap_s) in [(25.0, 0.25), (5.0, 0.5), (2.0, 0.7)] {
        let flight = flight_of_motion(rate_hz, 100, |_| ([0.0; 3], [0.0; 3]));
        assert!((data_loss::attitude_gap_limit_s(&flight, 0.7) - gap_s).abs() < 1e-9, "{rate_hz} Hz");
    }
}
