use super::*;
use crate::log::LogFormat;
use crate::replay::data_loss;

fn rate_loss_with_gaps(step_s: f64, gap_stride: usize, gap_s: f64) -> Option<f64> {
    let mut flight = Flight::new(LogFormat::ULog);
    let mut t_s = 0.0;
    for i in 1..=1001 {
        flight.body_rates.push_row(t_s, [0.0; 3]);
        t_s += if i % gap_stride == 0 { gap_s } else { step_s };
    }
    data_loss::excessive_rate_loss(&flight)
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
