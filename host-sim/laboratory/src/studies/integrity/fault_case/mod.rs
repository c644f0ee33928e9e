//! Cases of the integrity study: fault, onset and flight.

mod case_definition;
mod case_list;
mod sweep_families;

pub use case_definition::{FaultCase, FaultOnset, RandomCase};
pub use case_list::ALL_CASES;
pub use sweep_families::{Change, SWEEP_FAMILIES};

/// The case with this name, if any.
#[must_use]
pub fn find_by_name(name: &str) -> Option<&'static FaultCase> {
    ALL_CASES.iter().find(|case| case.case_name == name)
}

/// The family with this name, if any.
#[must_use]
pub fn find_family(name: &str) -> Option<&'static FaultCase> {
    SWEEP_FAMILIES.iter().find(|family| family.case_name == name)
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;
    use simulator::routine::{CalibrationRoutine, TurnPlan};
    use simulator::world::WorldConfig;
    use simulator::world::aircraft::VehicleKind;

    use super::*;
    use crate::studies::integrity::integrity_plan::AttitudeProtocol;

    #[test]
    fn a_case_is_flown_by_the_vehicles_and_protocols_that_can_have_its_fault() {
        use AttitudeProtocol::{Mavlink, Msp};
        use VehicleKind::{Copter, Plane, Vtol};
        let hovering = [(Plane, false), (Copter, true), (Vtol, true)];
        for (name, vehicles, by_msp) in [
            ("clean", [(Plane, true), (Copter, true), (Vtol, true)], true),
            ("cal-yaw-only", hovering, true),
            ("cal-current-reported", hovering, true),
            ("cal-bank-5", [(Plane, true), (Copter, false), (Vtol, false)], true),
            ("cal-linkage-3", [(Plane, true), (Copter, false), (Vtol, true)], true),
            // MSP has one sender, and no body rates.
            ("second-vehicle", [(Plane, true), (Copter, true), (Vtol, true)], false),
            ("rates-sign", [(Plane, true), (Copter, true), (Vtol, true)], false),
        ] {
            let case = find_by_name(name).unwrap();
            for (aircraft, expected) in vehicles {
                assert_eq!(case.applies_to_vehicle(aircraft), expected, "{name} {aircraft:?}");
            }
            assert_eq!((case.applies_to_protocol(Mavlink), case.applies_to_protocol(Msp)), (true, by_msp), "{name}");
        }
    }

    #[test]
    fn a_copter_s_cases_are_flown_by_a_copter() {
        let draw_case = |name| find_by_name(name).unwrap().draw_case(3, VehicleKind::Copter, AttitudeProtocol::Mavlink);
        let clean_case = draw_case("clean");
        assert_eq!(clean_case.world, WorldConfig::random_world(3).with_vehicle_kind(VehicleKind::Copter));
        assert_eq!(clean_case.routine, CalibrationRoutine::for_vehicle(VehicleKind::Copter, TurnPlan::default(), 0.0));
        let pushed_case = draw_case("pushed").world.attitude_source.push_error_deg;
        assert!((pushed_case / clean_case.world.attitude_source.push_error_deg - 2.0).abs() < 1e-9);
        let current_ut = Vector3::from(draw_case("cal-current-unreported-20").world.current_interference_ut);
        assert!((current_ut.norm() - 20.0).abs() < 1e-9);
        assert_eq!(draw_case("cal-current-unreported-20").fault_onset, FaultOnset::Always);
        let hover = draw_case("cal-yaw-only").routine;
        assert_eq!(hover.legs(), clean_case.routine.routine_parts[0].legs.repeat(4));
        assert_eq!(hover.start_command, clean_case.routine.start_command);
    }

    #[test]
    fn a_change_during_calibration_begins_before_its_end() {
        for (aircraft, most_s) in [(VehicleKind::Plane, 195.0), (VehicleKind::Copter, 60.0)] {
            let latest_s = (0..200).fold(0.0_f64, |latest_s, seed| {
                match find_by_name("cal-moved-5")
                    .unwrap()
                    .draw_case(seed, aircraft, AttitudeProtocol::Mavlink)
                    .fault_onset
                {
                    FaultOnset::DuringCalibration { after_s, .. } => latest_s.max(after_s),
                    other => panic!("{other:?}"),
                }
            });
            assert!((0.9 * most_s..most_s).contains(&latest_s), "{aircraft:?}: {latest_s}");
        }
    }
}
