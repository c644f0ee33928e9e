use super::*;

/// 2025-01-01, days since 1970-01-01: `date -d 2025-01-01 +%s` over 86400.
const EPOCH_DAY: u64 = 20_089;

fn place(latitude_deg: f32, longitude_deg: f32, height_m: f32) -> Position {
    Position::new(latitude_deg, longitude_deg, height_m).unwrap()
}

/// Date `days_after_epoch` days after 2025-01-01.
fn day(days_after_epoch: u64) -> Date {
    Date::from_unix_s((EPOCH_DAY + days_after_epoch) * 86_400).unwrap()
}

fn date_in_year(year: f32) -> Date {
    day(((year - 2025.0) * 365.25).round() as u64)
}

/// NOAA test value: year, height in kilometres, latitude, longitude; north, east, down in nanotesla.
type TestValue = ([f32; 4], [f32; 3]);

/// All of `WMM2025_TEST_VALUES.txt` (longitude 240 is -120 here), and a part of `WMM2025_TestValues.txt`.
const TEST_VALUES: [TestValue; 22] = [
    ([2025.0, 0.0, 80.0, 0.0], [6521.6, 145.9, 54791.5]),
    ([2025.0, 0.0, 0.0, 120.0], [39677.8, -109.6, -10580.2]),
    ([2025.0, 0.0, -80.0, -120.0], [6117.5, 15751.9, -52022.5]),
    ([2025.0, 100.0, 80.0, 0.0], [6216.0, 92.4, 52598.8]),
    ([2025.0, 100.0, 0.0, 120.0], [37688.6, -96.2, -10152.1]),
    ([2025.0, 100.0, -80.0, -120.0], [5907.6, 14780.3, -49540.7]),
    ([2027.5, 0.0, 80.0, 0.0], [6500.8, 294.5, 54869.4]),
    ([2027.5, 0.0, 0.0, 120.0], [39701.6, -167.4, -10381.8]),
    ([2027.5, 0.0, -80.0, -120.0], [6200.7, 15730.3, -51783.7]),
    ([2027.5, 100.0, 80.0, 0.0], [6196.7, 233.8, 52670.5]),
    ([2027.5, 100.0, 0.0, 120.0], [37711.5, -148.7, -9969.8]),
    ([2027.5, 100.0, -80.0, -120.0], [5984.0, 14760.1, -49317.7]),
    ([2025.0, 28.0, 89.0, -121.0], [-255.4, -1482.5, 56194.3]),
    ([2025.0, 65.0, 43.0, 93.0], [24299.9, 210.5, 50037.9]),
    ([2025.0, 51.0, -33.0, 109.0], [21737.8, -2090.3, -52710.0]),
    ([2025.5, 6.0, -36.0, -137.0], [23781.9, 8786.7, -32577.5]),
    ([2025.5, 8.0, -66.0, 17.0], [15201.4, -9925.5, -30881.1]),
    ([2026.0, 74.0, -57.0, 3.0], [13268.1, -5498.2, -23576.1]),
    ([2026.0, 62.0, -14.0, 99.0], [33437.8, -835.9, -33100.9]),
    ([2026.5, 14.0, 0.0, 80.0], [39431.4, -2133.5, -12188.8]),
    ([2027.0, 37.0, -66.0, -5.0], [16390.8, -5079.6, -28608.2]),
    ([2027.5, 73.0, -72.0, 95.0], [-2912.4, -12984.1, -55399.2]),
];

/// Tolerance 0.3 nT: rounding of 0.004 nT in `f32` for each of 90 terms, 0.05 nT in the test values, one day of 120 nT
/// per year. The next test finds smaller errors of coefficients.
#[test]
fn noaa_test_values_are_reproduced() {
    let mut worst: f32 = 0.0;
    for ([year, height_km, latitude_deg, longitude_deg], expected) in TEST_VALUES {
        let place = place(latitude_deg, longitude_deg, 1000.0 * height_km);
        let found = components_nt(place, years_since_epoch(date_in_year(year)));
        for (found, expected) in found.into_iter().zip(expected) {
            worst = worst.max((found - expected).abs());
        }
    }
    assert!(worst < 0.3, "{worst} nT");
}

/// Column sums of `WMM2025.COF`, nanotesla and nanotesla per year, and sums of squares.
#[test]
fn coefficients_match_noaa() {
    let expected = [
        (0.0, [-26454.1, 892_709_016.49, 487.8, 31_884_145.94]),
        (1.0, [-26481.8, 891_973_004.28, 432.8, 31_890_867.7]),
    ];
    for (years, [sum, squares, h_sum, h_squares]) in expected {
        let mut found = [0.0_f64; 4];
        let mut coefficients = MODEL_COEFFICIENTS.iter();
        for m in 0..=MAX_DEGREE {
            for n in m.max(1)..=MAX_DEGREE {
                let [g, h] = coefficients_at(*coefficients.next().unwrap(), n, m, years).map(f64::from);
                found = [found[0] + g, found[1] + g * g, found[2] + h, found[3] + h * h];
            }
        }
        assert!(coefficients.next().is_none());
        // An `f32` of 30,000 has a resolution of 0.002, squared 60.
        for (found, (expected, bound)) in
            found.into_iter().zip([(sum, 0.02), (squares, 100.0), (h_sum, 0.02), (h_squares, 10.0)])
        {
            assert!((found - expected).abs() < bound, "{years}: {found} {expected}");
        }
    }
}

fn field_of_test_value(([year, height_km, latitude_deg, longitude_deg], _): TestValue) -> EarthField {
    EarthField::from_model(place(latitude_deg, longitude_deg, 1000.0 * height_km), date_in_year(year)).unwrap()
}

/// The horizontal field is 1504 nT one degree from the north pole; the limit is 2 uT.
#[test]
fn near_a_magnetic_pole_there_is_no_declination() {
    let near = field_of_test_value(TEST_VALUES[12]);
    assert_eq!(near.declination_deg, None);
    assert!((near.inclination_deg - 88.47).abs() < 0.006 && (near.total_ut - 56.214_42).abs() < 0.000_3, "{near:?}");
    let (mut with, mut without) = (0, 0);
    for north in 0..400_u16 {
        let place = place(70.0 + 0.05 * f32::from(north), 140.0, 0.0);
        let [x, y, _] = components_nt(place, 0.0);
        let field = EarthField::from_model(place, day(0)).unwrap();
        assert_eq!(field.declination_deg.is_some(), trig::hypot(x, y) >= 2_000.0, "{place:?}");
        *(if field.declination_deg.is_some() { &mut with } else { &mut without }) += 1;
    }
    assert!(with > 20 && without > 20, "{with} {without}");
}

/// North turns with longitude, the field is constant.
#[test]
fn at_the_pole_only_declination_depends_on_longitude() {
    let at = |longitude_deg| EarthField::from_model(place(-90.0, longitude_deg, 2_800.0), day(0)).unwrap();
    let first = at(0.0);
    for longitude_deg in [-150.0, -30.0, 10.0, 90.0, 170.0] {
        let field = at(longitude_deg);
        let turned_deg = field.declination_deg.unwrap() - first.declination_deg.unwrap() + longitude_deg;
        assert!((turned_deg - 360.0 * (turned_deg / 360.0).round()).abs() < 0.01, "{longitude_deg}: {turned_deg}");
        assert!(
            (field.total_ut - first.total_ut).abs() < 1e-4
                && (field.inclination_deg - first.inclination_deg).abs() < 1e-3
        );
    }
}

#[test]
fn the_model_is_used_for_ten_years() {
    for (after, date, validity) in [
        (-1, (2024, 12, 31), ModelValidity::TooEarly),
        (0, (2025, 1, 1), ModelValidity::Valid),
        (1825, (2029, 12, 31), ModelValidity::Valid),
        (1826, (2030, 1, 1), ModelValidity::Extrapolated),
        (3651, (2034, 12, 31), ModelValidity::Extrapolated),
        (3652, (2035, 1, 1), ModelValidity::TooOld),
    ] {
        let day = Date::from_unix_s(EPOCH_DAY.saturating_add_signed(after) * 86_400).unwrap();
        assert_eq!((day.year_month_day(), ModelValidity::on_date(day)), (date, validity));
        let is_used = matches!(validity, ModelValidity::Valid | ModelValidity::Extrapolated);
        assert_eq!(EarthField::from_model(place(50.0, 10.0, 0.0), day).is_some(), is_used, "{date:?}");
    }
}
