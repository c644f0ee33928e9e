//! What outlives a restart unasked: a collection that is under way, in memory ([`Kept`](crate::collection::Kept)); and, in
//! flash, that there is one, and what the ports have found.

use super::{Compass, Effect, Phase, Refusal, Saving};
use crate::collection::{Context, Course};
use crate::settings::{PORTS, PortNumber, ProtocolKind};
use crate::store::{Remembered, StoreError};
use crate::time::WrappingMillis;

/// What a port has found is remembered when it has been so for so long, milliseconds.
const SETTLED_MS: u32 = 5000;

/// What flash holds of it, and what is to be there.
#[derive(Debug)]
pub(super) struct Memory {
    /// What was written last, or tried to be.
    written: Remembered,
    /// What is spoken, and since when.
    spoken: Option<([ProtocolKind; PORTS], WrappingMillis)>,
}

impl Memory {
    /// At the start, with what was in flash.
    pub const fn new(stored: Remembered) -> Self {
        Self { written: stored, spoken: None }
    }

    /// Takes notice of a save: a calibration ends a collection, and what is stored with it says so.
    pub fn is_written_with(&mut self, saving: &Saving, result: Result<(), StoreError>) {
        self.written.is_collecting &= result.is_err() || matches!(saving, Saving::Settings(_) | Saving::Remembered(_));
    }

    /// What is spoken, if it has been for long enough.
    fn settled(&mut self, spoken: [ProtocolKind; PORTS], now: WrappingMillis) -> Option<[ProtocolKind; PORTS]> {
        let (before, since) = *self.spoken.get_or_insert((spoken, now));
        if before != spoken {
            self.spoken = Some((spoken, now));
            return None;
        }
        (now.since(since) >= SETTLED_MS).then_some(spoken)
    }
}

impl Compass<'_> {
    /// Goes on with a collection that outlived the restart; or knows that one was lost.
    pub(super) fn resume(&mut self) {
        match self.collector.found() {
            // What was collected for another calibration than the one that is there has ended in this one.
            Some(Context { by_itself, serial }) if serial == self.serial() => match self.collector.course() {
                Course::GoesOn => {
                    self.phase = Phase::Collecting;
                    (self.auto.began, self.auto.is_held) = (by_itself, !by_itself);
                }
                Course::Stopped => self.auto.is_held = true,
                Course::Over => {}
            },
            Some(_) => self.collector.forget(),
            None if self.memory.written.is_collecting => self.last = Some(Err(Refusal::CollectionLost)),
            None => {}
        }
    }

    /// Has the memory of the collection be what it is now.
    #[inline(never)]
    pub(super) fn keep(&mut self) {
        self.collector.keep(Context { by_itself: self.auto.began, serial: self.serial() });
    }

    /// The number of the calibration that is there; 0 of none.
    fn serial(&self) -> u32 {
        self.generations.current.as_ref().map_or(0, |record| record.serial)
    }

    /// Writes what is to be remembered, if it is another than was written. It can wait: for the end of a solve, and until
    /// nothing else happens.
    pub(super) fn remember(&mut self, spoken: [ProtocolKind; PORTS], now: WrappingMillis) -> Effect {
        let mut wanted = self.memory.written;
        wanted.is_collecting = match self.collector.course() {
            Course::Over => false,
            Course::Stopped | Course::GoesOn => wanted.is_collecting || self.collector.is_worth_something(),
        };
        if let Some(settled) = self.memory.settled(spoken, now) {
            for ((number, found), kind) in PortNumber::ALL.into_iter().zip(&mut wanted.found).zip(settled) {
                // Silence is no news, nor is what was chosen.
                if self.settings.ports.of(number).protocol == ProtocolKind::Auto && kind != ProtocolKind::Auto {
                    *found = kind;
                }
            }
        }
        if wanted == self.memory.written || self.is_busy() || self.saving.is_some() {
            return Effect::None;
        }
        self.memory.written = wanted;
        self.save(Saving::Remembered(wanted))
    }
}
