//! Power failures during a save, and again during the next one.

use testkit::flash::CutProgress;
use testkit::random::Random;

use super::*;

/// Second cuts per first one.
const SECOND_CUTS_PER_FIRST: usize = 2;

/// Cuts near the ends of a save and at every seventh word between, at every fill of the region, then a second cut in
/// the next save. Saves succeed afterwards.
#[test]
fn power_cuts_anywhere_leave_old_or_new() {
    let mut random = Random(1);
    let mut cases = 0;
    for saves in 0..11 {
        let start = flash_after_saves(saves);
        let old = if saves == 0 { StoredCalibrations::default() } else { stored_calibrations(saves) };
        for (first, first_cut) in cuts_of_save(&start, saves + 1) {
            let mut flash = start.cut_at(first, first_cut);
            save_calibration(&mut flash, saves + 1).unwrap_err();
            let mut once = flash.power_on();
            let case = format!("{saves} saves, {first_cut:?} at {first}");
            let between = load_and_assert_allowed(&mut once, &[old, stored_calibrations(saves + 1)], &case);
            let all: Vec<_> = cuts_of_save(&once, saves + 2).collect();
            for _ in 0..SECOND_CUTS_PER_FIRST {
                let (second, second_cut) = all[random.bits() as usize % all.len()];
                let mut flash = once.cut_at(second, second_cut);
                let case = format!("{case}, {second_cut:?} at {second}");
                save_calibration(&mut flash, saves + 2).unwrap_err();
                let mut flash = flash.power_on();
                load_and_assert_allowed(&mut flash, &[between, stored_calibrations(saves + 2)], &case);
                save_calibration(&mut flash, 1000).unwrap_or_else(|error| panic!("{case}: {error:?}"));
                assert_eq!(load_stored_calibrations(&mut flash), Ok(stored_calibrations(1000)), "{case}");
                cases += 1;
            }
        }
    }
    // About 20 operations per save, cut in four ways.
    assert!(cases > 1_500, "{cases}");
}

/// A retry after the cut succeeds.
#[test]
fn a_power_cut_during_any_change_leaves_the_old_or_new_values() {
    let startup_values =
        StartupValues { is_collecting: true, detected_protocols: [ProtocolKind::Mavlink, ProtocolKind::Auto] };
    let StoredCalibrations { current_calibration: current, previous_calibration: previous } = stored_calibrations(9);
    let undone = StoredCalibrations { current_calibration: previous, previous_calibration: current };
    for saves in 0..6 {
        let mut start = Flash::new(PAGE_COUNT);
        for serial in 0..saves {
            save_change(&mut start, StoreChange::Settings(&Settings { stream_rate_hz: 1 + serial, ..settings() }))
                .unwrap();
        }
        save_calibration(&mut start, 9).unwrap();
        for change in [
            StoreChange::Settings(&settings()),
            StoreChange::StartupValues(startup_values),
            StoreChange::Clear,
            calibration_change(&undone),
            calibration_change(&stored_calibrations(10)),
        ] {
            let old = load_values(&mut start).unwrap();
            let mut complete = start.power_on();
            save_change(&mut complete, change).unwrap();
            let new = load_values(&mut complete).unwrap();
            assert_ne!(old, new, "{change:?}");
            for (at, cut) in (0..complete.operation_count).flat_map(|at| CutProgress::ALL.map(|cut| (at, cut))) {
                let case = format!("{change:?}, {cut:?} at {at}");
                let mut flash = start.cut_at(at, cut);
                save_change(&mut flash, change).unwrap_err();
                let mut flash = flash.power_on();
                let found = load_values(&mut flash);
                assert!(found == Ok(old) || found == Ok(new), "{case}: {found:?}");
                save_change(&mut flash, change).unwrap();
                assert_eq!(load_values(&mut flash), Ok(new), "{case}");
            }
        }
    }
}

/// Loads the calibrations and asserts that they are among `allowed`.
fn load_and_assert_allowed(flash: &mut Flash, allowed: &[StoredCalibrations], case: &str) -> StoredCalibrations {
    let found = load_stored_calibrations(flash).unwrap_or_else(|error| panic!("{case}: {error:?}"));
    assert!(allowed.contains(&found), "{case}: {found:?}");
    found
}

/// Operation and kind of each power cut during a save.
fn cuts_of_save(flash: &Flash, serial: u32) -> impl Iterator<Item = (usize, (CutProgress, u64))> + use<> {
    let mut complete = flash.power_on();
    save_calibration(&mut complete, serial).unwrap();
    CutProgress::cuts_at_sampled_operations(complete.operation_count)
}
