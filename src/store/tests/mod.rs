//! The store on a flash that keeps the rules of the STM32L4's.

mod faults;
mod power_cuts;
mod versions;

use crc::{CRC_32_ISO_HDLC, Crc};
use embassy_futures::block_on;
use serde::Serialize;
use testkit::flash::RamFlash;

use super::*;
use crate::calibration::{Calibration, CurrentIron, Envelope, Latency, Method, Orientation, Quality, Uncertainty};
use crate::magnetometer::{Identity, Model};
use crate::settings::{HeadingKind, Settings};

const PAGE: usize = 2048;
/// As on the board.
const PAGES: usize = 8;
const REGION: Range<u32> = 0..(PAGE * PAGES) as u32;

type Flash = RamFlash<PAGE>;

/// A record that is different for every serial number.
pub(crate) fn record(serial: u32) -> Record {
    let calibration = Calibration {
        b_ut: [serial as f32, 2.0, 3.0],
        inclination_rad: 1.0,
        total_ut: 48.0,
        latency_s: -0.04,
        current: CurrentIron::NONE,
        ..Calibration::uncalibrated(Orientation::NONE)
    };
    let quality = Quality {
        method: Method::MaximumLikelihood,
        envelope: Envelope::Banked,
        expected_rms_deg: 0.3,
        expected_worst_deg: 0.7,
        norm_residual: 0.004,
        dip_residual_deg: 0.4,
        samples: u16::MAX,
        latency: Some(Latency { found_s: -0.042, sigma_s: 0.006 }),
    };
    let sensor = Identity { model: Model::Lis3mdl, address: 0x1E };
    let mut uncertainty = Uncertainty::NONE;
    uncertainty.sensor_sigma = 0.002;
    Record { calibration, quality, uncertainty, sensor, mount: Orientation::NONE, serial }
}

fn generations(serial: u32) -> Generations {
    Generations { current: Some(record(serial)), previous: Some(record(serial.wrapping_sub(1))) }
}

fn change(generations: &Generations) -> Change<'_> {
    Change::Generations { current: generations.current.as_ref(), previous: generations.previous.as_ref() }
}

/// Settings that are not the default ones.
pub(super) fn settings() -> Settings {
    let stream_heading = HeadingKind::Raw;
    Settings {
        declination_deg: Some(12.5),
        stream_on: false,
        stream_heading,
        accuracy_deg: 1.5,
        auto_on: false,
        ..Settings::default()
    }
}

/// The bytes of a version: its number, the contents in postcard's format, and the CRC-32 of both.
pub(super) fn value_of(version: u8, contents: &impl Serialize) -> Vec<u8> {
    let mut value = vec![version];
    value.extend(postcard::to_slice(contents, &mut [0; VALUE_SIZE]).unwrap().iter());
    sealed(value)
}

/// The value of contents of this version.
pub(super) fn present(contents: &Contents) -> Vec<u8> {
    value_of(VERSION, &(contents, contents.stored.generations.currents()))
}

/// The same with the CRC-32 behind it.
pub(super) fn sealed(mut value: Vec<u8>) -> Vec<u8> {
    value.extend(Crc::<u32>::new(&CRC_32_ISO_HDLC).checksum(&value).to_le_bytes());
    value
}

/// Writes any bytes as the newest item of a half.
fn put(flash: &mut Flash, half: usize, value: &[u8]) {
    block_on(Store::new(flash, REGION).append(half, value)).unwrap();
}

/// The bytes of the newest item of a half.
fn get(flash: &mut Flash, half: usize) -> Option<Vec<u8>> {
    let mut buffer = [0; ITEM_SIZE];
    let mut store = Store::new(flash, REGION);
    block_on(store.log(half).fetch_item::<&[u8]>(&mut buffer, &KEY)).unwrap().map(<[u8]>::to_vec)
}

/// The flash after so many saves, the last one with that serial number.
fn flash_after(saves: u32) -> Flash {
    let mut flash = Flash::new(PAGES);
    for serial in 1..=saves {
        save(&mut flash, serial).unwrap();
    }
    flash
}

/// A save of calibrations with a freshly started store.
fn save(flash: &mut Flash, serial: u32) -> Result<(), StoreError> {
    save_change(flash, change(&generations(serial)))
}

fn save_change(flash: &mut Flash, change: Change<'_>) -> Result<(), StoreError> {
    block_on(Store::new(flash, REGION).save(change))
}

fn load(flash: &mut Flash) -> Result<Stored, StoreError> {
    block_on(Store::new(flash, REGION).load())
}

fn load_generations(flash: &mut Flash) -> Result<Generations, StoreError> {
    load(flash).map(|stored| stored.generations)
}

#[test]
fn an_empty_flash_gives_the_defaults() {
    assert_eq!(load(&mut Flash::new(PAGES)), Ok(Stored::default()));
}

#[test]
fn settings_and_calibrations_do_not_disturb_each_other() {
    let mut flash = Flash::new(PAGES);
    save(&mut flash, 5).unwrap();
    save_change(&mut flash, Change::Settings(&settings())).unwrap();
    assert_eq!(load(&mut flash), Ok(Stored { settings: settings(), generations: generations(5), ..Stored::default() }));
    save(&mut flash, 6).unwrap();
    assert_eq!(load(&mut flash), Ok(Stored { settings: settings(), generations: generations(6), ..Stored::default() }));
    let only_current = Generations { previous: None, ..generations(7) };
    save_change(&mut flash, change(&only_current)).unwrap();
    assert_eq!(load(&mut flash), Ok(Stored { settings: settings(), generations: only_current, ..Stored::default() }));
    save_change(&mut flash, Change::Clear).unwrap();
    assert_eq!(
        load(&mut flash),
        Ok(Stored { settings: settings(), generations: Generations::default(), ..Stored::default() })
    );
}

/// Three times round a half of the region (two copies of 0.7 KB a page, 4 pages).
#[test]
fn every_one_of_many_saves_is_found_again() {
    let mut flash = Flash::new(PAGES);
    for serial in 1..=25 {
        save(&mut flash, serial).unwrap();
        assert_eq!(load_generations(&mut flash), Ok(generations(serial)));
    }
}

/// The newest copy's half is not written to: whatever happens there, it is whole.
#[test]
fn a_save_leaves_the_half_of_the_newest_copy_alone() {
    for saves in 1..=10 {
        let mut flash = flash_after(saves);
        let before = flash.bytes.clone();
        save(&mut flash, 500).unwrap();
        let halves = |bytes: &[u8]| [bytes[..PAGE * PAGES / 2].to_vec(), bytes[PAGE * PAGES / 2..].to_vec()];
        let same: Vec<bool> = halves(&before).iter().zip(halves(&flash.bytes)).map(|(a, b)| *a == b).collect();
        // The first save goes to the first half, the second to the second, and so on.
        assert_eq!(same, [saves % 2 == 1, saves % 2 == 0], "after {saves} saves");
    }
}

/// A count of saves that has wrapped is newer than one that has not, whichever half it is in.
#[test]
fn the_count_of_saves_wraps() {
    for first in [0, 1] {
        let mut flash = Flash::new(PAGES);
        for (saves, half) in [(u32::MAX - 1, first), (u32::MAX, 1 - first)] {
            let contents = Contents { saves, stored: Stored { generations: generations(1), ..Stored::default() } };
            put(&mut flash, half, &present(&contents));
        }
        for serial in 2..6 {
            save(&mut flash, serial).unwrap();
            assert_eq!(load_generations(&mut flash), Ok(generations(serial)), "{first}");
        }
        let saves = |flash: &mut Flash, half| Contents::decode(&get(flash, half).unwrap()).unwrap().saves;
        assert_eq!([saves(&mut flash, first), saves(&mut flash, 1 - first)], [2, 3]);
    }
}

/// Counts that are equal cannot come of saves; the first half is taken then, always.
#[test]
fn the_newer_count_is_the_one_up_to_half_the_range_ahead() {
    for (saves, than, newer) in [
        (1, 0, true),
        (0, 1, false),
        (7, 7, false),
        (0, u32::MAX, true),
        (u32::MAX, 0, false),
        (0x7FFF_FFFF, 0, true),
        (0x8000_0001, 0, false),
    ] {
        assert_eq!(is_newer(saves, than), newer, "{saves} than {than}");
    }
}

/// A region that begins in the middle of a flash is used to its last page, and nothing outside of it.
#[test]
fn only_the_region_is_touched() {
    let mut flash = Flash::new(PAGES);
    flash.bytes.fill(0x5A);
    let region = (2 * PAGE) as u32..(6 * PAGE) as u32;
    for serial in 1..=12 {
        block_on(Store::new(&mut flash, region.clone()).save(change(&generations(serial)))).unwrap();
    }
    let untouched = |page: usize| flash.bytes[page * PAGE..(page + 1) * PAGE].iter().all(|&byte| byte == 0x5A);
    let pages: Vec<bool> = (0..PAGES).map(untouched).collect();
    assert_eq!(pages, [true, true, false, false, false, false, true, true]);
    let found = block_on(Store::new(&mut flash, region).load()).unwrap();
    assert_eq!(found.generations, generations(12));
}
