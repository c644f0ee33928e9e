use super::*;

const GOOD: &str = "t_s,extra,mx,my,mz,roll_deg,pitch_deg,use\n0,9,100,-200,400,10,-2,1\n0.1,9,101,-201,401,11,-3,0\n";

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
