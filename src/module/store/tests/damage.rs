//! Damaged pages.

use testkit::random::Random;

use super::*;

/// Flash with settings, two accepted calibrations, then other settings.
fn flash_with_values() -> Flash {
    let mut flash = Flash::new(PAGE_COUNT);
    let first = StoredCalibrations { current_calibration: Some(calibration_record(1)), previous_calibration: None };
    let mut both = first;
    both.make_current(&calibration_record(2));
    for change in [
        StoreChange::Settings(&Settings { stream_rate_hz: 5, ..settings() }),
        calibration_change(&first),
        calibration_change(&both),
        StoreChange::Settings(&settings()),
    ] {
        save_change(&mut flash, change).unwrap();
    }
    flash
}

/// Replacement bytes of a damaged page.
fn damaged_pages() -> [Vec<u8>; 4] {
    let mut noise = Random(3);
    [vec![0; PAGE_SIZE], vec![0xFF; PAGE_SIZE], vec![0x5A; PAGE_SIZE], (0..PAGE_SIZE).map(|_| noise.byte()).collect()]
}

/// The other calibration remains, the loss is reported, and saves succeed.
#[test]
fn one_damaged_page_never_loses_both_calibrations() {
    for saves in 0..8 {
        let mut flash = flash_with_values();
        for serial in 0..saves {
            save_calibration(&mut flash, 3 + serial).unwrap();
        }
        let whole = load_values(&mut flash).unwrap();
        for page in 0..PAGE_COUNT {
            for damage in damaged_pages() {
                let case = format!("page {page} after {saves} saves");
                let mut damaged = flash.clone();
                write_page(&mut damaged, page, &damage);
                let LoadedValues { stored_values: stored, load_error: error } = load_readable_values(&mut damaged);
                let StoredCalibrations { current_calibration: current, previous_calibration: previous } =
                    stored.stored_calibrations;
                assert!(current.is_some() || previous.is_some(), "{case}");
                assert_eq!(error.is_some(), current.is_none() || previous.is_none(), "{case}");
                assert!(stored.settings == whole.settings || stored.settings.stream_rate_hz == 5, "{case}");
                save_calibration(&mut damaged, 99).unwrap();
                assert_eq!(
                    load_values(&mut damaged),
                    Ok(StoredValues { stored_calibrations: stored_calibrations(99), ..stored }),
                    "{case}"
                );
            }
        }
    }
}

#[test]
fn damaged_states_are_reported_and_replaced() {
    for fields in [vec![], vec![1, 2, 3], vec![1, 1, 0, 7]] {
        let mut item = vec![flash_page::STORE_FORMAT, fields.len() as u8, 0];
        item.extend(fields);
        for page in CALIBRATION_SLOTS as usize..PAGE_COUNT {
            let mut flash = Flash::new(PAGE_COUNT);
            write_page(&mut flash, page, &append_crc(item.clone()));
            assert_eq!(load_values(&mut flash), Err(StoreError::Corrupt));
            save_calibration(&mut flash, 5).unwrap();
            assert_eq!(
                load_values(&mut flash),
                Ok(StoredValues { stored_calibrations: stored_calibrations(5), ..StoredValues::default() })
            );
        }
    }
    let mut flash = flash_after_saves(3);
    flash.bytes[CALIBRATION_SLOTS as usize * PAGE_SIZE..].fill(0x33);
    assert_eq!(
        load_readable_values(&mut flash),
        LoadedValues { stored_values: StoredValues::default(), load_error: Some(StoreError::Corrupt) }
    );
}
