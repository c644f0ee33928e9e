use super::*;
use crate::log::LogFormat;
use crate::replay::data_loss;

fn flight_with_rate_gaps(step_s: f64, gap_stride: usize, gap_s: f64) -> Flight {
    let mut flight = Flight::new(LogFormat::ULog);
    let mut t_s = 0.0;
    for i in 1..=1001 {
        flight.body_rates.push_row(t_s, [0.0; 3]);
        t_s += if i % gap_stride == 0 { gap_s } else { step_s };
    }
    flight
}

fn rate_loss_with_gaps(step_s: f64, gap_stride: usize, gap_s: f64) -> Option<f64> {
    data_loss::excessive_rate_loss(&flight_with_rate_gaps(step_s, gap_stride, gap_s))
}

/// A step up to 1.5 times the median, or up to 0.15 s, is no gap.
#[test]
fn a_rate_loss_above_4_percent_is_reported() {
    assert_eq!(rate_loss_with_gaps(0.1, 30, 0.2), None);
    assert!((rate_loss_with_gaps(0.1, 20, 0.2).unwrap() - 0.05).abs() < 1e-6);
    for (step_s, gap_s, is_lost) in [(0.2, 0.28, false), (0.2, 0.32, true), (0.02, 0.14, false), (0.02, 0.16, true)] {
        assert_eq!(rate_loss_with_gaps(step_s, 10, gap_s).is_some(), is_lost, "{gap_s} s among {step_s} s");
    }
}

/// Rates are differences of the attitude if not measured; 3 Hz is too slow an attitude, 5 % too much loss.
#[test]
fn a_heading_is_integrated_only_from_measured_and_complete_rates_with_a_fast_attitude() {
    for (has_measured_rates, attitude_step_s, gap_stride, is_integrable) in
        [(true, 0.33, 30, true), (false, 0.33, 30, false), (true, 0.35, 30, false), (true, 0.33, 20, false)]
    {
        let mut flight = flight_with_rate_gaps(0.1, gap_stride, 0.2);
        flight.has_measured_rates = has_measured_rates;
        for i in 0..100 {
            flight.attitude.push_row(f64::from(i) * attitude_step_s, [0.0; 3]);
        }
        assert_eq!(data_loss::has_integrable_rates(&flight), is_integrable, "{attitude_step_s} s, 1 in {gap_stride}");
        assert_eq!(data_loss::excessive_rate_loss(&flight).is_some(), has_measured_rates && gap_stride == 20);
    }
}

#[test]
fn attitude_is_not_interpolated_over_two_lost_reports() {
    for (step_s, gap_s) in [(0.04, 0.25), (0.2, 0.5), (0.5, 0.7)] {
        let mut flight = Flight::new(LogFormat::ULog);
        for i in 0..100 {
            flight.attitude.push_row(f64::from(i) * step_s, [0.0; 3]);
        }
        assert!((data_loss::attitude_gap_limit_s(&flight, 0.7) - gap_s).abs() < 1e-9, "{step_s} s");
    }
}
