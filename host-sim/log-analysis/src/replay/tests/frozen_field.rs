use autoswing::frames::{Field, RollPitch};

use super::*;
use crate::log::time_series::Series;
use crate::replay::sensor_failure::sensor_failure;

#[test]
fn the_longest_frozen_field_is_reported() {
    for spans in [[(20, 32), (60, 90)], [(20, 50), (60, 72)]] {
        let (flight, mut compass) = compass_of_flown_turns();
        for (from_s, to_s) in spans {
            for (i, row) in compass.rows.iter_mut().enumerate() {
                if (from_s * 10..=to_s * 10).contains(&i) {
                    row.raw_field = Field::from_ut(20.0, 0.0, 40.0);
                    row.attitude = RollPitch::from_deg(if i % 2 == 0 { 10.0 } else { -10.0 }, 0.0);
                }
            }
        }
        let (from_s, to_s) = if spans[0].1 - spans[0].0 > 20 { spans[0] } else { spans[1] };
        let note = sensor_failure(&flight, &compass).unwrap().to_string();
        let [from_s, to_s] = [from_s, to_s].map(|time_s| compass.rows[time_s * 10].t_s.round());
        assert!(note.contains(&format!("from {from_s} to {to_s} s")), "{note}");
    }
}

/// Gaps up to 10 s occur with slow cards.
#[test]
fn a_field_ending_over_10_s_before_the_log_is_reported() {
    for (early_s, is_reported) in [(5.0, false), (15.0, true)] {
        let (mut flight, compass) = compass_of_flown_turns();
        let end_s = flight.attitude.rows().last().unwrap().t_s;
        let mut field = Series::new();
        for reading in flight.compasses[0].field.rows().iter().filter(|reading| reading.t_s <= end_s - early_s) {
            field.push_row(reading.t_s, reading.row_values);
        }
        flight.compasses[0].field = field;
        assert_eq!(sensor_failure(&flight, &compass).is_some(), is_reported, "{early_s}");
    }
}
