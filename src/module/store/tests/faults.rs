//! Flash that fails to read or write: error code, text, and remaining values.

use testkit::flash::SilentFault;

use super::*;

fn page_byte_range(page: usize) -> Range<usize> {
    page * PAGE_SIZE..(page + 1) * PAGE_SIZE
}

#[test]
fn an_unreadable_flash_is_not_written() {
    for saves in [0, 1, 2, 7] {
        for page in 0..PAGE_COUNT {
            for times in [1, 2, usize::MAX] {
                let good = flash_after_saves(saves);
                let mut flash = good.clone();
                flash.operation_count = 0;
                flash.unreadable = Some((page_byte_range(page), times));
                assert_eq!(save_calibration(&mut flash, 99), Err(StoreError::Flash), "{saves} {page} {times}");
                assert_eq!((flash.operation_count, &flash.bytes), (0, &good.bytes), "{saves} {page} {times}");
            }
        }
    }
}

#[test]
fn an_unreadable_page_is_reported_and_the_others_are_loaded() {
    let mut flash = flash_after_saves(2);
    flash.unreadable = Some((0..PAGE_COUNT * PAGE_SIZE, usize::MAX));
    assert_eq!(load_values(&mut flash), Err(StoreError::Flash));
    // The second page for states is unreadable; the first state remains valid.
    flash.unreadable = Some((page_byte_range(5), usize::MAX));
    assert_eq!(load_stored_calibrations(&mut flash), Ok(stored_calibrations(1)));
    flash.unreadable = Some((page_byte_range(4), usize::MAX));
    assert_eq!(load_stored_calibrations(&mut flash), Ok(stored_calibrations(2)));
    // The first save wrote calibrations 1 and 0 to the first two slots, the second wrote calibration 2 to the third.
    flash.unreadable = Some((page_byte_range(2), usize::MAX));
    let LoadedValues { stored_values: stored, load_error: error } = load_readable_values(&mut flash);
    let only_previous = StoredCalibrations { current_calibration: None, ..stored_calibrations(2) };
    assert_eq!((stored.stored_calibrations, error), (only_previous, Some(StoreError::Flash)));
    let mut empty = Flash::new(PAGE_COUNT);
    empty.unreadable = Some((page_byte_range(7), usize::MAX));
    assert_eq!(load_values(&mut empty), Err(StoreError::Flash), "that page may hold the only state");
}

/// Flash that keeps its bits or programs other bits without an error. (If it ignores an erase as well, it refuses the
/// write.)
#[test]
fn bytes_that_read_back_differently_are_reported() {
    for (fault, save_range) in [(SilentFault::WritesIgnored, 0..3), (SilentFault::WritesAltered, 0..7)] {
        for saves in save_range {
            let mut flash = flash_after_saves(saves);
            flash.silent_fault = Some(fault);
            assert_eq!(save_calibration(&mut flash, 99), Err(StoreError::ReadBackDiffers), "{fault:?} after {saves}");
            let old = if saves == 0 { StoredCalibrations::default() } else { stored_calibrations(saves) };
            assert_eq!(load_stored_calibrations(&mut flash.power_on()), Ok(old), "{fault:?} after {saves}");
        }
    }
}
