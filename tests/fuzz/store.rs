//! The store: a flash with anything in it.

use std::sync::LazyLock;

use autoswing::settings::Settings;
use autoswing::store::{Change, Store, Stored};
use embassy_futures::block_on;
use proptest::collection::vec;
use proptest::prelude::*;
use testkit::flash::RamFlash;

use crate::{Promise, hold};

const PAGE: usize = 2048;
const PAGES: usize = 4;
const SIZE: usize = PAGE * PAGES;

type Flash = RamFlash<PAGE>;

/// A flash in which settings were saved, some times.
static SAVED: LazyLock<[Flash; 4]> = LazyLock::new(|| {
    [0, 1, 2, 30].map(|times| {
        let mut flash = Flash::new(PAGES);
        for time in 0..times {
            let settings = Settings { stream_rate_hz: 1 + time, ..Settings::DEFAULT };
            save(&mut flash, &settings).expect("a flash that is well");
        }
        flash
    })
});

fn save(flash: &mut Flash, settings: &Settings) -> Result<(), autoswing::store::StoreError> {
    block_on(Store::new(flash, 0..SIZE as u32).save(Change::Settings(settings)))
}

fn load(flash: &mut Flash) -> Result<Stored, autoswing::store::StoreError> {
    block_on(Store::new(flash, 0..SIZE as u32).load())
}

/// Bytes that stand at a place in the flash instead of those that were saved; most places are near the beginning of a page.
fn damage() -> impl Strategy<Value = Vec<(usize, Vec<u8>)>> {
    let near = (0..PAGES, 0..160_usize).prop_map(|(page, at)| page * PAGE + at);
    let at = prop_oneof![2 => near, 1 => 0..SIZE];
    let few = vec(any::<u8>(), 1..12);
    let same = (proptest::sample::select(&[0x00, 0xFF, 0x55][..]), 1..PAGE).prop_map(|(byte, size)| vec![byte; size]);
    vec((at, prop_oneof![3 => few, 1 => same]), 0..4)
}

/// What is loaded is in its ranges, and what is saved then is loaded again: whatever was there. Only a copy of a later firmware
/// is not written over, and that takes a right CRC, which one change of a few bytes in four billion gives.
#[test]
fn the_store_takes_whatever_is_in_the_flash() {
    hold((0..4_usize, damage()), |(times, damage)| -> Promise {
        let mut flash = SAVED[times].clone();
        for (at, bytes) in &damage {
            for (there, byte) in flash.bytes[*at..].iter_mut().zip(bytes) {
                *there = *byte;
            }
        }
        if let Ok(Stored { settings, generations, .. }) = load(&mut flash) {
            prop_assert!(settings.is_valid() && generations.current.is_none() && generations.previous.is_none());
        }
        let settings = Settings { stream_rate_hz: 77, ..Settings::DEFAULT };
        let saved = save(&mut flash, &settings);
        prop_assert_eq!(saved, Ok(()));
        prop_assert_eq!(load(&mut flash).map(|stored| stored.settings), Ok(settings));
        Ok(())
    });
}
