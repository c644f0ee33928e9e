//! The store on a flash that keeps the rules of the STM32L4's, through power cuts and garbage.

use embassy_futures::block_on;
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash};
use testkit::random::Random;

use super::*;
use crate::calibration::{Calibration, Envelope, Method, Orientation, Quality, Uncertainty};
use crate::magnetometer::{Identity, Model};

const PAGE: usize = 2048;
const PAGES: usize = 8;
const WORD: usize = 8;
const REGION: Range<u32> = 0..(PAGE * PAGES) as u32;

/// A record that is different for every serial number.
pub(crate) fn record(serial: u32) -> Record {
    let calibration = Calibration {
        b_ut: [serial as f32, 2.0, 3.0],
        inclination_rad: 1.0,
        total_ut: 48.0,
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

/// What has become of the operation during which power failed.
#[derive(Clone, Copy, Debug)]
enum Cut {
    Before,
    /// A random part of its bits has changed.
    Torn,
    After,
}

#[derive(Debug, PartialEq)]
enum FlashFault {
    NotErased,
    NoPower,
}

impl NorFlashError for FlashFault {
    fn kind(&self) -> NorFlashErrorKind {
        NorFlashErrorKind::Other
    }
}

/// Programs erased double words only; erases pages; counts both. It refuses a second program even with zeros, which the
/// STM32L4 allows: a word that a failure has torn is as stubborn there when its error correction fails.
#[derive(Clone)]
struct RamFlash {
    bytes: Vec<u8>,
    operations: usize,
    cut: Option<(usize, Cut)>,
    noise: Random,
}

impl RamFlash {
    fn new() -> Self {
        Self { bytes: vec![0xFF; PAGE * PAGES], operations: 0, cut: None, noise: Random(1) }
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
                Some(Cut::Torn) => self.noise.byte(),
            };
            *byte = (*byte & !changed) | (target & changed);
        }
        if cut.is_some() { Err(FlashFault::NoPower) } else { Ok(()) }
    }

    fn cut_at(&self, operation: usize, (cut, seed): (Cut, u64)) -> Self {
        Self { operations: 0, cut: Some((operation, cut)), noise: Random(seed), ..self.clone() }
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
        (from as usize..to as usize).step_by(PAGE).try_for_each(|page| self.operate(page, &[0xFF; PAGE]))
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), FlashFault> {
        for (start, word) in (offset as usize..).step_by(WORD).zip(bytes.chunks_exact(WORD)) {
            let erased = self.bytes[start..start + WORD] == [0xFF; WORD];
            if !erased {
                return Err(FlashFault::NotErased);
            }
            self.operate(start, word)?;
        }
        Ok(())
    }
}

/// The flash after so many saves, the last one with that serial number, and the store's own settings.
fn flash_after(saves: u32) -> RamFlash {
    let mut flash = RamFlash::new();
    for serial in 1..=saves {
        save(&mut flash, serial).unwrap();
    }
    flash
}

/// A save with a freshly started store, on a copy of the flash that takes its place.
fn save(flash: &mut RamFlash, serial: u32) -> Result<(), StoreError> {
    let mut store = Store::new(flash.clone(), REGION);
    let result = block_on(store.save(change(&generations(serial))));
    *flash = store.flash;
    result
}

fn load(flash: &RamFlash) -> Result<Generations, StoreError> {
    block_on(Store::new(flash.clone(), REGION).load_generations())
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
    block_on(store.save(change(&generations(5)))).unwrap();
    block_on(store.save(Change::Settings(&settings))).unwrap();
    block_on(store.save(change(&generations(6)))).unwrap();
    assert_eq!(block_on(store.load_settings()), Ok(settings));
    assert_eq!(block_on(store.load_generations()), Ok(generations(6)));
}

/// Three times round a half of the region (two copies of 0.7 KB a page, 4 pages).
#[test]
fn every_one_of_many_saves_is_found_again() {
    let mut flash = RamFlash::new();
    for serial in 1..=25 {
        save(&mut flash, serial).unwrap();
        assert_eq!(load(&flash), Ok(generations(serial)));
    }
}

/// How an operation can end when power fails: not at all, in part, in full.
const CUTS: [(Cut, u64); 4] = [(Cut::Before, 0), (Cut::Torn, 1), (Cut::Torn, 2), (Cut::After, 0)];

/// Power fails at every program and erase of a save, from every fill of the region over more than one round, and after
/// the restart at every program and erase of the next save: each time the record before or the new one is found, and
/// with power the next save succeeds. Second cuts are tried at every operation near the ends of the save, where headers
/// and markers are written, and at every seventh of the many words between, which are all alike.
#[test]
fn power_cuts_anywhere_leave_old_or_new() {
    let mut cases = 0;
    for saves in 0..11 {
        let start = flash_after(saves);
        let old = generations_after(saves);
        for (first, first_cut) in cuts(&start) {
            let mut flash = start.cut_at(first, first_cut);
            save(&mut flash, saves + 1).unwrap_err();
            let once = flash.power_on();
            let case = format!("{saves} saves, {first_cut:?} at {first}");
            let between = one_of(&once, &[old, generations(saves + 1)], &case);
            for (second, second_cut) in cuts(&once) {
                let mut flash = once.cut_at(second, second_cut);
                let case = format!("{case}, {second_cut:?} at {second}");
                save(&mut flash, saves + 2).unwrap_err();
                let mut flash = flash.power_on();
                one_of(&flash, &[between, generations(saves + 2)], &case);
                save(&mut flash, 1000).unwrap_or_else(|error| panic!("{case}: {error:?}"));
                assert_eq!(load(&flash), Ok(generations(1000)), "{case}");
                cases += 1;
            }
        }
    }
    assert!(cases > 20_000, "{cases}");
}

fn generations_after(saves: u32) -> Generations {
    if saves == 0 { Generations::default() } else { generations(saves) }
}

/// What is loaded, which must be one of these.
fn one_of(flash: &RamFlash, allowed: &[Generations], case: &str) -> Generations {
    let found = load(flash).unwrap_or_else(|error| panic!("{case}: {error:?}"));
    assert!(allowed.contains(&found), "{case}: {found:?}");
    found
}

/// Where and how power fails in the next save.
fn cuts(flash: &RamFlash) -> impl Iterator<Item = (usize, (Cut, u64))> + use<> {
    let mut complete = flash.power_on();
    save(&mut complete, 500).unwrap();
    let operations = complete.operations;
    let near_an_end = move |at: &usize| *at < 4 || *at + 4 >= operations || at.is_multiple_of(7);
    (0..operations).filter(near_an_end).flat_map(|at| CUTS.map(|cut| (at, cut)))
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
        let _ = load(&flash);
        save(&mut flash, 77).unwrap_or_else(|error| panic!("seed {seed}: {error:?}"));
        assert_eq!(load(&flash), Ok(generations(77)), "seed {seed}");
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
        if let Ok(found) = load(&damaged) {
            assert!(stored.contains(&found), "byte {position}");
        }
    }
}

#[test]
fn a_flash_that_refuses_is_reported() {
    let mut flash = RamFlash::new().cut_at(0, (Cut::Before, 0));
    assert_eq!(save(&mut flash, 1), Err(StoreError::Flash));
}
