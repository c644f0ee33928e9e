//! The store on a flash that keeps the rules of the STM32L4's, through power cuts, bad pages and garbage.

use embassy_futures::block_on;
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash};

use super::*;
use crate::calibration::{Calibration, Method, Orientation, Quality};
use crate::magnetometer::{Identity, Model};

const PAGE: usize = 2048;
const PAGES: usize = 4;
const WORD: usize = 8;
const REGION: Range<u32> = 0..(PAGE * PAGES) as u32;

/// A record that is different for every serial number.
pub(super) fn record(serial: u32) -> Record {
    let calibration = Calibration {
        b_ut: [serial as f32, 2.0, 3.0],
        inclination_rad: 1.0,
        total_ut: 48.0,
        ..Calibration::uncalibrated(Orientation::NONE)
    };
    let quality = Quality {
        method: Method::MaximumLikelihood,
        expected_rms_deg: 0.3,
        expected_worst_deg: 0.7,
        norm_residual: 0.004,
        dip_residual_deg: 0.4,
        samples: u16::MAX,
    };
    let sensor = Identity { model: Model::Lis3mdl, address: 0x1E };
    Record { calibration, quality, sensor, mount: Orientation::NONE, serial }
}

fn generations(serial: u32) -> Generations {
    Generations { current: Some(record(serial)), previous: Some(record(serial.wrapping_sub(1))) }
}

/// Deterministic noise (splitmix64).
#[derive(Clone)]
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }
}

/// What has become of the operation during which power failed.
#[derive(Clone, Copy, Debug)]
enum Cut {
    Before,
    /// A random part of its bits has changed.
    Torn,
    After,
}

const CUTS: [(Cut, u64); 5] = [(Cut::Before, 0), (Cut::Torn, 1), (Cut::Torn, 2), (Cut::Torn, 3), (Cut::After, 0)];

#[derive(Debug, PartialEq)]
enum FlashFault {
    NotErased,
    NoPower,
    BadPage,
}

impl NorFlashError for FlashFault {
    fn kind(&self) -> NorFlashErrorKind {
        NorFlashErrorKind::Other
    }
}

/// Programs a double word once after each erase (its error-correcting code allows no second time, not even after a
/// program that was cut off); erases pages; counts both.
#[derive(Clone)]
struct RamFlash {
    bytes: Vec<u8>,
    programmed: Vec<bool>,
    bad_page: Option<usize>,
    operations: usize,
    cut: Option<(usize, Cut)>,
    noise: Noise,
}

impl RamFlash {
    fn new() -> Self {
        Self {
            bytes: vec![0xFF; PAGE * PAGES],
            programmed: vec![false; PAGE * PAGES / WORD],
            bad_page: None,
            operations: 0,
            cut: None,
            noise: Noise(1),
        }
    }

    /// Changes the bytes from `start` on to `target`, unless power fails now.
    fn operate(&mut self, start: usize, target: &[u8]) -> Result<(), FlashFault> {
        let cut = match self.cut {
            Some((at, _)) if self.operations > at => return Err(FlashFault::NoPower),
            Some((at, cut)) if self.operations == at => Some(cut),
            _ => None,
        };
        self.operations += 1;
        for (byte, &target) in self.bytes[start..].iter_mut().zip(target) {
            let changed = match cut {
                None | Some(Cut::After) => 0xFF,
                Some(Cut::Before) => 0,
                Some(Cut::Torn) => self.noise.next() as u8,
            };
            *byte = (*byte & !changed) | (target & changed);
        }
        if cut.is_some() { Err(FlashFault::NoPower) } else { Ok(()) }
    }

    /// Lets power fail at this operation from now on.
    fn cut_at(&self, operation: usize, (cut, seed): (Cut, u64)) -> Self {
        Self { operations: 0, cut: Some((operation, cut)), noise: Noise(seed), ..self.clone() }
    }

    fn power_on(&self) -> Self {
        Self { operations: 0, cut: None, ..self.clone() }
    }
}

impl ErrorType for RamFlash {
    type Error = FlashFault;
}

impl ReadNorFlash for RamFlash {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), FlashFault> {
        bytes.copy_from_slice(&self.bytes[offset as usize..][..bytes.len()]);
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.bytes.len()
    }
}

impl NorFlash for RamFlash {
    const WRITE_SIZE: usize = WORD;
    const ERASE_SIZE: usize = PAGE;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), FlashFault> {
        for page in (from as usize..to as usize).step_by(PAGE) {
            if self.bad_page == Some(page / PAGE) {
                return Err(FlashFault::BadPage);
            }
            self.operate(page, &[0xFF; PAGE])?;
            self.programmed[page / WORD..(page + PAGE) / WORD].fill(false);
        }
        Ok(())
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), FlashFault> {
        for (start, word) in (offset as usize..).step_by(WORD).zip(bytes.chunks_exact(WORD)) {
            if core::mem::replace(&mut self.programmed[start / WORD], true) {
                return Err(FlashFault::NotErased);
            }
            self.operate(start, word)?;
        }
        Ok(())
    }
}

/// The flash after so many saves, the last one with that serial number.
fn flash_after(saves: u32) -> RamFlash {
    let mut flash = RamFlash::new();
    for serial in 1..=saves {
        save(&mut flash, serial).unwrap();
    }
    flash
}

/// A save by a store that has just started.
fn save(flash: &mut RamFlash, serial: u32) -> Result<(), StoreError> {
    let mut store = Store::new(flash.clone(), REGION);
    let result = block_on(store.save_generations(&generations(serial)));
    *flash = store.flash;
    result
}

fn load(flash: &RamFlash) -> Result<Generations, StoreError> {
    block_on(Store::new(flash.clone(), REGION).load_generations())
}

/// The erase and programs of one save.
fn operations_of_a_save(flash: &RamFlash) -> usize {
    let mut flash = flash.power_on();
    save(&mut flash, 1).unwrap();
    flash.operations
}

#[test]
fn an_empty_flash_gives_the_defaults() {
    let mut store = Store::new(RamFlash::new(), REGION);
    assert_eq!(block_on(store.load_settings()), Ok(Settings::default()));
    assert_eq!(block_on(store.load_generations()), Ok(Generations::default()));
}

#[test]
fn settings_and_calibrations_do_not_disturb_each_other() {
    let mut store = Store::new(RamFlash::new(), REGION);
    let settings = Settings { declination_deg: Some(12.5), stream_on: false, ..Settings::default() };
    block_on(store.save_generations(&generations(5))).unwrap();
    block_on(store.save_settings(&settings)).unwrap();
    block_on(store.save_generations(&generations(6))).unwrap();
    assert_eq!(block_on(store.load_settings()), Ok(settings));
    assert_eq!(block_on(store.load_generations()), Ok(generations(6)));
}

/// Several times round the pages, one erase for each save.
#[test]
fn every_one_of_many_saves_is_found_again_and_wear_is_even() {
    let mut flash = RamFlash::new();
    for serial in 1..=50 {
        save(&mut flash, serial).unwrap();
        assert_eq!(load(&flash), Ok(generations(serial)));
    }
    assert_eq!(flash.operations, 50 * (1 + SNAPSHOT_SIZE / WORD));
}

/// Power fails at every program and erase of a save, and again at every one of the save after that, for every page the
/// save can go to: what was there before or what was to be written is there, and the next save succeeds.
#[test]
fn power_cuts_anywhere_leave_old_or_new() {
    for saves in 0..=PAGES as u32 {
        let start = flash_after(saves);
        let operations = operations_of_a_save(&start);
        let old = load(&start).unwrap();
        for (first, second) in (0..operations).flat_map(|first| (0..operations).map(move |second| (first, second))) {
            for (first_cut, second_cut) in CUTS.into_iter().zip(CUTS.into_iter().cycle().skip(second % CUTS.len())) {
                let case = format!("{saves} saves, {first_cut:?} at {first}, {second_cut:?} at {second}");
                let mut flash = start.cut_at(first, first_cut);
                save(&mut flash, 1000).unwrap_err();
                let between = load(&flash);
                assert!(between == Ok(old) || between == Ok(generations(1000)), "{case}: {between:?}");

                let mut flash = flash.cut_at(second, second_cut);
                save(&mut flash, 2000).unwrap_err();
                let after = load(&flash);
                assert!(after == between || after == Ok(generations(2000)), "{case}: {after:?}");

                let mut flash = flash.power_on();
                save(&mut flash, 3000).unwrap();
                assert_eq!(load(&flash), Ok(generations(3000)), "{case}");
            }
        }
    }
}

/// Whatever is in the region: no panic, and a save works afterwards.
#[test]
fn garbage_is_survived() {
    for seed in 0..200 {
        let mut noise = Noise(seed);
        // From all of it to a few flipped bytes in a good image.
        let density = 1_u64 << (seed % 12);
        let mut flash = flash_after(seed as u32 % 7);
        for byte in &mut flash.bytes {
            if noise.next().is_multiple_of(density) {
                *byte = noise.next() as u8;
            }
        }
        flash.programmed.fill(true);
        let _ = load(&flash);
        save(&mut flash, 77).unwrap_or_else(|error| panic!("seed {seed}: {error:?}"));
        assert_eq!(load(&flash), Ok(generations(77)), "seed {seed}");
    }
}

/// A damaged byte can cost the newest copy, but what is loaded was stored once or is an error.
#[test]
fn damage_never_invents_a_calibration() {
    let flash = flash_after(3);
    let stored: Vec<_> = (1..=3).map(generations).collect();
    for position in 0..PAGE * PAGES {
        let mut damaged = flash.clone();
        damaged.bytes[position] ^= 0x5A;
        let found = load(&damaged).unwrap();
        assert!(stored.contains(&found), "byte {position}");
    }
}

#[test]
fn only_garbage_is_reported() {
    let mut flash = RamFlash::new();
    flash.bytes.fill(0x3C);
    assert_eq!(load(&flash), Err(StoreError::Corrupt));
}

#[test]
fn a_bad_page_is_passed_over() {
    let mut flash = RamFlash { bad_page: Some(1), ..RamFlash::new() };
    for serial in 1..=10 {
        save(&mut flash, serial).unwrap();
        assert_eq!(load(&flash), Ok(generations(serial)));
    }
}

#[test]
fn a_flash_that_refuses_is_reported() {
    let mut flash = RamFlash::new().cut_at(0, (Cut::Before, 0));
    assert_eq!(save(&mut flash, 1), Err(StoreError::Flash));
}
