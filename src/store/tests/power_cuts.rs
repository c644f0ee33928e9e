//! Power that fails during a save, and again during the next one. `tests/persistence.rs` tries every pair of cuts; here
//! it is a few second cuts after each first one.

use testkit::flash::Cut;
use testkit::random::Random;

use super::*;

/// Second cuts that are tried after each first one.
const SECOND_CUTS: usize = 2;

/// Power fails near the ends of a save, where headers and markers are written, and at every seventh of the many words
/// between, from every fill of the region over more than one round; and after the restart somewhere in the next save.
/// Each time the record before or the new one is found, and with power the next save succeeds.
#[test]
fn power_cuts_anywhere_leave_old_or_new() {
    let mut random = Random(1);
    let mut cases = 0;
    for saves in 0..11 {
        let start = flash_after(saves);
        let old = if saves == 0 { Generations::default() } else { generations(saves) };
        for (first, first_cut) in cuts(&start, saves + 1) {
            let mut flash = start.cut_at(first, first_cut);
            save(&mut flash, saves + 1).unwrap_err();
            let mut once = flash.power_on();
            let case = format!("{saves} saves, {first_cut:?} at {first}");
            let between = one_of(&mut once, &[old, generations(saves + 1)], &case);
            let all: Vec<_> = cuts(&once, saves + 2).collect();
            for _ in 0..SECOND_CUTS {
                let (second, second_cut) = all[random.bits() as usize % all.len()];
                let mut flash = once.cut_at(second, second_cut);
                let case = format!("{case}, {second_cut:?} at {second}");
                save(&mut flash, saves + 2).unwrap_err();
                let mut flash = flash.power_on();
                one_of(&mut flash, &[between, generations(saves + 2)], &case);
                save(&mut flash, 1000).unwrap_or_else(|error| panic!("{case}: {error:?}"));
                assert_eq!(load_generations(&mut flash), Ok(generations(1000)), "{case}");
                cases += 1;
            }
        }
    }
    // Some 20 operations of each save, cut in four ways.
    assert!(cases > 1_500, "{cases}");
}

/// What is loaded, which must be one of these.
fn one_of(flash: &mut Flash, allowed: &[Generations], case: &str) -> Generations {
    let found = load_generations(flash).unwrap_or_else(|error| panic!("{case}: {error:?}"));
    assert!(allowed.contains(&found), "{case}: {found:?}");
    found
}

/// Where and how power fails in the save of these.
fn cuts(flash: &Flash, serial: u32) -> impl Iterator<Item = (usize, (Cut, u64))> + use<> {
    let mut complete = flash.power_on();
    save(&mut complete, serial).unwrap();
    Cut::in_operations(complete.operations)
}
