//! A flash that fails or is damaged: each error with its code and words, and what it leaves behind.

use testkit::flash::{Cut, Lie};
use testkit::random::Random;

use super::*;

const HALF: usize = PAGE * PAGES / 2;

fn half_bytes(half: usize) -> Range<usize> {
    half * HALF..(half + 1) * HALF
}

#[test]
fn each_error_has_a_code_and_says_what_to_do() {
    for (error, code, words) in [
        (StoreError::Flash, "store-flash", "the flash memory failed; try again, then replace the board"),
        (StoreError::Corrupt, "store-corrupt", "what was stored is damaged; calibrate anew"),
        (
            StoreError::UnknownVersion(VERSION + 1),
            "store-version",
            "a later firmware stored it; load that firmware, or forget it: cal clear all",
        ),
        (StoreError::UnknownVersion(1), "store-version", "a firmware long ago stored it; calibrate anew"),
        (StoreError::Full, "store-full", "it does not fit; this is a fault of the firmware, please report it"),
        (
            StoreError::Verify,
            "store-verify",
            "what was written reads back differently; try again, then replace the board",
        ),
        (StoreError::Invalid, "store-invalid", "a value is out of its range; nothing was written"),
    ] {
        assert_eq!((error.code(), error.to_string().as_str()), (code, words));
    }
}

#[test]
fn a_flash_that_refuses_to_write_is_reported() {
    let mut flash = Flash::new(PAGES).cut_at(0, (Cut::Before, 0));
    assert_eq!(save(&mut flash, 1), Err(StoreError::Flash));
}

/// What cannot be read now may be readable after the next start: neither half is written to, however few reads fail.
#[test]
fn a_flash_that_cannot_be_read_is_not_written() {
    for saves in [0, 1, 2, 7] {
        for half in [0, 1] {
            for times in [1, 2, usize::MAX] {
                let good = flash_after(saves);
                let mut flash = good.clone();
                flash.operations = 0;
                flash.unreadable = Some((half_bytes(half), times));
                assert_eq!(save(&mut flash, 99), Err(StoreError::Flash), "{saves} {half} {times}");
                assert_eq!((flash.operations, &flash.bytes), (0, &good.bytes), "{saves} {half} {times}");
            }
        }
    }
}

#[test]
fn a_flash_that_cannot_be_read_is_reported_when_nothing_else_is_there() {
    let mut flash = flash_after(2);
    flash.unreadable = Some((0..2 * HALF, usize::MAX));
    assert_eq!(load(&mut flash), Err(StoreError::Flash));
    // The second save went to the second half; the first half's copy still counts.
    flash.unreadable = Some((half_bytes(1), usize::MAX));
    assert_eq!(load_generations(&mut flash), Ok(generations(1)));
    flash.unreadable = Some((half_bytes(0), usize::MAX));
    assert_eq!(load_generations(&mut flash), Ok(generations(2)));
    let mut empty = Flash::new(PAGES);
    empty.unreadable = Some((half_bytes(1), usize::MAX));
    assert_eq!(load(&mut empty), Err(StoreError::Flash), "it may be what the other half lacks");
}

/// A flash may take a program without a word and keep what it held, so that the half's older copy is read back; or may
/// program other bits. (Where it ignores what marks a page as used, the log itself says that there is no room.)
#[test]
fn what_reads_back_differently_is_reported() {
    for (lie, fills) in [(Lie::Ignores, 2..4), (Lie::Alters, 0..7)] {
        for saves in fills {
            let mut flash = flash_after(saves);
            flash.lie = Some(lie);
            assert_eq!(save(&mut flash, 99), Err(StoreError::Verify), "{lie:?} after {saves}");
            let old = if saves == 0 { Generations::default() } else { generations(saves) };
            assert_eq!(load_generations(&mut flash.power_on()), Ok(old), "{lie:?} after {saves}");
        }
    }
}

/// Two records take 0.7 KB; these pages have a quarter.
#[test]
fn what_does_not_fit_is_reported() {
    const SMALL: usize = 256;
    let mut flash = RamFlash::<SMALL>::new(PAGES);
    let region = 0..(SMALL * PAGES) as u32;
    let result = block_on(Store::new(&mut flash, region.clone()).save(change(&generations(1))));
    assert_eq!(result, Err(StoreError::Full));
    // Settings alone do.
    block_on(Store::new(&mut flash, region.clone()).save(Change::Settings(&settings()))).unwrap();
    assert_eq!(block_on(Store::new(&mut flash, region).load()).unwrap().settings, settings());
}

#[test]
fn a_value_out_of_its_range_is_refused_and_nothing_written() {
    for saves in [0, 3] {
        let mut flash = flash_after(saves);
        flash.operations = 0;
        let bad = Settings { stream_rate_hz: 0, ..Settings::default() };
        assert_eq!(save_change(&mut flash, Change::Settings(&bad)), Err(StoreError::Invalid));
        assert_eq!(flash.operations, 0);
    }
}

/// One damaged half is no loss while the other holds a copy; two are, and the next save begins anew with the defaults.
#[test]
fn damaged_contents_are_reported_and_replaced() {
    let broken = sealed(vec![VERSION, 1, 2, 3]);
    for half in [0, 1] {
        let mut flash = Flash::new(PAGES);
        put(&mut flash, half, &broken);
        assert_eq!(load(&mut flash), Err(StoreError::Corrupt));
        let contents = Contents {
            saves: 7,
            stored: Stored { settings: settings(), generations: generations(4), ..Stored::default() },
        };
        put(&mut flash, 1 - half, &present(&contents));
        assert_eq!(load(&mut flash), Ok(contents.stored));
        put(&mut flash, 1 - half, &broken);
        assert_eq!(load(&mut flash), Err(StoreError::Corrupt));
        save(&mut flash, 5).unwrap();
        assert_eq!(load(&mut flash), Ok(Stored { generations: generations(5), ..Stored::default() }));
    }
}

/// Whatever is in the region: no panic, and a save works afterwards.
#[test]
fn garbage_is_survived() {
    for seed in 0..200 {
        let mut noise = Random(seed);
        // From a few flipped bytes in a good image to all of it.
        let density = 1_u64 << (seed % 12);
        let mut flash = flash_after(seed as u32 % 20);
        for byte in &mut flash.bytes {
            if noise.bits().is_multiple_of(density) {
                *byte = noise.byte();
            }
        }
        let _ = load(&mut flash);
        save(&mut flash, 77).unwrap_or_else(|error| panic!("seed {seed}: {error:?}"));
        assert_eq!(load_generations(&mut flash), Ok(generations(77)), "seed {seed}");
    }
}

/// A damaged byte can cost the newest record, but what is loaded was stored once or is an error.
#[test]
fn damage_never_invents_a_calibration() {
    let flash = flash_after(5);
    let stored: Vec<_> = (1..=5).map(generations).chain([Generations::default()]).collect();
    for position in 0..PAGE {
        let mut damaged = flash.clone();
        damaged.bytes[position] ^= 0x5A;
        if let Ok(found) = load_generations(&mut damaged) {
            assert!(stored.contains(&found), "byte {position}");
        }
    }
}
