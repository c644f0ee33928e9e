use super::*;

/// Time after the start of the module; a vehicle can move 300 m each second.
const TEST_TIME: WrappingMillis = WrappingMillis::new(5_000);

fn position_at(latitude_deg: f32, longitude_deg: f32) -> Position {
    Position::new(latitude_deg, longitude_deg, 100.0).unwrap()
}

/// State after reports of these positions, hours after the first, on a day of the model.
fn local_field_at(positions: &[(u32, Position)], context: PositionContext) -> LocalField {
    let mut local_field = LocalField::UNKNOWN;
    local_field.update_date(day(20_779), None);
    for &(hours, position) in positions {
        local_field.update_position(TEST_TIME.plus_ms(hours * 3_600_000), position, context);
    }
    local_field
}

fn day(days: u64) -> Date {
    Date::from_unix_s(days * 86_400).unwrap()
}

/// The date changes at midnight, or because the first date was wrong.
#[test]
fn the_field_follows_the_date() {
    let position = position_at(51.1, 13.7);
    let mut local_field = LocalField::UNKNOWN;
    local_field.update_position(TEST_TIME, position, PositionContext::default());
    for days in [20_000, 20_779, 20_780, 21_000] {
        local_field.update_date(day(days), None);
        assert_eq!(
            (local_field.date(), local_field.model_field()),
            (Some(day(days)), EarthField::from_model(position, day(days)).as_ref())
        );
    }
}

/// 1 km, against 3 km; distance counts from the position of the last update.
#[test]
fn small_movements_keep_the_field() {
    let start = position_at(51.1, 13.7);
    for (latitude_deg, longitude_deg, is_same) in [
        (51.11, 13.715, true),
        (51.09, 13.685, true),
        (51.13, 13.7, false),
        (51.07, 13.7, false),
        (51.1, 13.74, false),
        (51.1, 13.66, false),
        (51.1, -13.7, false),
    ] {
        let positions = [(0, start), (12, position_at(latitude_deg, longitude_deg))];
        let [before, after] =
            [&positions[..1], &positions].map(|reports| local_field_at(reports, PositionContext::default()));
        assert_eq!(after.model_field() == before.model_field(), is_same, "{latitude_deg} {longitude_deg}");
    }
    let positions: Vec<_> =
        (0..10_u8).map(|step| (step.into(), position_at(51.1 + 0.015 * f32::from(step), 13.7))).collect();
    let last_position = local_field_at(&positions, PositionContext::default()).model_position().unwrap();
    assert!((last_position.latitude_deg - 51.22).abs() < 0.001, "{last_position:?}");
}

/// Bavaria; in Greenland the inclination differs by 15 deg, at the same latitude in Canada by 5 deg.
const BAVARIA: [f32; 2] = [48.1, 11.6];
const GREENLAND: [f32; 2] = [72.0, -40.0];
const CANADA: [f32; 2] = [48.1, -80.0];

/// Reports one position each second for 30 s, long after the last one from Bavaria; returns whether it is accepted.
fn is_position_accepted([latitude_deg, longitude_deg]: [f32; 2], after_ms: u32, context: PositionContext) -> bool {
    let mut local_field = local_field_at(&[(0, position_at(BAVARIA[0], BAVARIA[1]))], context);
    let before = local_field.model_field().copied();
    assert!(before.is_some());
    for second in 0..30 {
        let at = TEST_TIME.plus_ms(after_ms + 1000 * second);
        local_field.update_position(at, position_at(latitude_deg, longitude_deg), context);
    }
    local_field.model_field().copied() != before
}

#[test]
fn a_disarmed_vehicle_takes_a_distant_position_that_persists() {
    let context = PositionContext { is_disarmed: true, ..PositionContext::default() };
    assert!(is_position_accepted(CANADA, 1000, context) && is_position_accepted(GREENLAND, 1000, context));
    let [bavaria, greenland] =
        [BAVARIA, GREENLAND].map(|[latitude_deg, longitude_deg]| position_at(latitude_deg, longitude_deg));
    let local_field = local_field_at(&[(0, bavaria), (0, greenland)], context);
    assert_eq!(local_field.model_position(), Some(bavaria), "a single report is ignored");
}

/// Without a fix, an estimator starts at zero and drifts.
#[test]
fn a_position_near_zero_is_ignored() {
    for (latitude_deg, longitude_deg, is_none) in [(0.000_3, -0.009, true), (0.000_3, 0.02, false), (-0.02, 0.0, false)]
    {
        let local_field = local_field_at(&[(0, position_at(latitude_deg, longitude_deg))], PositionContext::default());
        assert_eq!(local_field.model_position().is_none(), is_none, "{latitude_deg} {longitude_deg}");
    }
}

#[test]
fn a_position_must_agree_with_the_calibrated_inclination() {
    let context = PositionContext { is_disarmed: true, calibrated_inclination_deg: Some(64.0) };
    assert!(is_position_accepted(CANADA, 1000, context) && !is_position_accepted(GREENLAND, 1000, context));
}

/// Largest change of declination within 0.02 deg, relative to the model's error `sqrt(0.26^2 + (5.417 uT / H)^2)`
/// deg, over the Earth.
#[test]
fn the_distance_limit_costs_under_a_quarter_sigma_of_declination() {
    let mut worst: f32 = 0.0;
    for row in 0..170_u8 {
        for column in 0..90_u8 {
            let at = position_at(f32::from(row) - 84.5, 4.0 * f32::from(column) - 179.5);
            let field = |position| EarthField::from_model(position, day(20_779)).unwrap();
            let field_here = field(at);
            let Some(declination_deg) = field_here.declination_deg else { continue };
            let horizontal_ut = field_here.total_ut * field_here.inclination_deg.to_radians().cos();
            let sigma_deg = 0.26_f32.hypot(5.417 / horizontal_ut);
            for (north_deg, east_deg) in [(0.02, 0.0), (0.0, 0.02), (0.02, 0.02), (0.02, -0.02)] {
                let field_there = field(position_at(at.latitude_deg + north_deg, at.longitude_deg + east_deg));
                let Some(moved_deg) = field_there.declination_deg else { continue };
                let change_deg = moved_deg - declination_deg;
                let change_deg = change_deg - 360.0 * (change_deg / 360.0).round();
                worst = worst.max(change_deg.abs() / sigma_deg);
            }
        }
    }
    assert!(worst < 0.25, "{worst}");
}
