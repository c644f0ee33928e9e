//! What a log has lost.

use super::*;
use crate::log::Format;
use crate::replay::lost;

/// Rates so many seconds apart, after every so manyeth of which there is a gap.
fn with_gaps(step_s: f64, every: usize, gap_s: f64) -> Option<f64> {
    let mut flight = Flight::new(Format::ULog);
    let mut t_s = 0.0;
    for i in 1..=1001 {
        flight.rates.push(t_s, [0.0; 3]);
        t_s += if i % every == 0 { gap_s } else { step_s };
    }
    lost::of_the_rates(&flight)
}

/// One rate in thirty may be lost, one in twenty is told; at half as long again as most a row is late, not lost, and in less than
/// 0.15 s no aircraft turns otherwise than its rates say.
#[test]
fn rates_are_lost_where_more_than_one_in_25_is() {
    assert_eq!(with_gaps(0.1, 30, 0.2), None);
    assert!((with_gaps(0.1, 20, 0.2).unwrap() - 0.05).abs() < 1e-6);
    for (step_s, gap_s, is_lost) in [(0.2, 0.28, false), (0.2, 0.32, true), (0.02, 0.14, false), (0.02, 0.16, true)] {
        assert_eq!(with_gaps(step_s, 10, gap_s).is_some(), is_lost, "{gap_s} s among {step_s} s");
    }
}

/// Attitudes are interpolated over one that is lost, not over two, unless those are a quarter of a second; nor over 0.7 s.
#[test]
fn attitudes_are_not_interpolated_over_two_that_are_lost() {
    for (step_s, gap_s) in [(0.04, 0.25), (0.2, 0.5), (0.5, 0.7)] {
        let mut flight = Flight::new(Format::ULog);
        for i in 0..100 {
            flight.attitude.push(f64::from(i) * step_s, [0.0; 3]);
        }
        assert!((lost::longest_gap_s(&flight, 0.7) - gap_s).abs() < 1e-9, "{step_s} s");
    }
}
