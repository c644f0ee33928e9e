//! Stores written by other firmware.

use std::format;

use testkit::flash::CutProgress;

use super::*;

const LATER_FORMAT: u8 = flash_page::STORE_FORMAT + 1;

/// Item of another format, longer than any item of this format.
fn item_of_format(format: u8) -> Vec<u8> {
    let mut item = vec![format];
    item.extend(1000_u16.to_le_bytes());
    item.extend((0..1000).map(|n| n as u8));
    append_crc(item)
}

/// Another format on one, two or all pages; the others are erased, hold values of this format, or are damaged.
fn flashes_with_other_format() -> Vec<(String, Flash)> {
    let item = item_of_format(LATER_FORMAT);
    let mut flashes = Vec::new();
    let mut damaged = Flash::new(PAGE_COUNT);
    damaged.bytes.fill(0x5A);
    for (others, flash) in [("erased", Flash::new(PAGE_COUNT)), ("in use", flash_after_saves(6)), ("damaged", damaged)]
    {
        for first in 0..PAGE_COUNT {
            for pages in [first..first + 1, first..PAGE_COUNT, 0..first + 1] {
                let mut flash = flash.clone();
                flash.operation_count = 0;
                pages.clone().for_each(|page| write_page(&mut flash, page, &item));
                flashes.push((format!("in pages {pages:?}, others {others}"), flash));
            }
        }
    }
    flashes
}

/// Values of this format are not loaded, because they may be outdated: which of them remain depends on the number of
/// saves by the other firmware.
#[test]
fn another_format_is_reported_and_left_untouched() {
    for (case, flash) in flashes_with_other_format() {
        let mut copy = flash.clone();
        let error = StoreError::OtherFormat(LATER_FORMAT);
        assert_eq!(
            load_readable_values(&mut copy),
            LoadedValues { stored_values: StoredValues::default(), load_error: Some(error) },
            "{case}"
        );
        let nothing = StoreChange::StoredCalibrations { current: None, previous: None };
        let startup_values = StoreChange::StartupValues(StartupValues::DEFAULT);
        for change in
            [StoreChange::Settings(&settings()), calibration_change(&stored_calibrations(8)), nothing, startup_values]
        {
            assert_eq!(save_change(&mut copy, change), Err(error), "{case}");
        }
        assert_eq!((copy.operation_count, &copy.bytes), (0, &flash.bytes), "{case}");
    }
}

#[test]
fn each_other_format_is_named() {
    for format in (0..=255).filter(|format| *format != flash_page::STORE_FORMAT) {
        assert_eq!(flash_page::parse_page(&item_of_format(format)), PageContent::OtherFormat(format));
    }
}

/// After a cut at any operation no old value is loaded, and a second clearing succeeds.
#[test]
fn a_power_cut_while_clearing_leaves_the_other_format_or_the_defaults() {
    for (case, start) in flashes_with_other_format() {
        let mut complete = start.clone();
        save_change(&mut complete, StoreChange::Clear).unwrap();
        for at in 0..complete.operation_count {
            for cut in CutProgress::ALL {
                let mut flash = start.cut_at(at, cut);
                save_change(&mut flash, StoreChange::Clear).unwrap_err();
                let mut flash = flash.power_on();
                let found = load_values(&mut flash);
                let allowed = [Err(StoreError::OtherFormat(LATER_FORMAT)), Ok(StoredValues::default())];
                assert!(allowed.contains(&found), "{case}, {cut:?} at {at}: {found:?}");
                save_change(&mut flash, StoreChange::Clear).unwrap();
                assert_eq!(load_values(&mut flash), Ok(StoredValues::default()), "{case}, {cut:?} at {at}");
            }
        }
    }
}
