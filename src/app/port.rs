//! Runs a port: reads bytes and passes on what is heard in them, waits for estimates, and writes what is to be told.

use core::future::pending;
use core::sync::atomic::Ordering;

use embassy_futures::select::{Either4, select4};
use embassy_futures::yield_now;
use embassy_time::{Duration, Timer};
use embedded_io_async::{Read, Write};

use super::Links;
use super::links::{Stamped, count, listen, now, publish};
use crate::compass::Glance;
use crate::health::Counters;
use crate::instrument::Correction;
use crate::port::{Facts, Heard, Output, Pace, Port};
use crate::settings::{Baud, PortNumber, PortSettings, ProtocolKind, Settings};
use crate::time::Timestamp;

/// A line in error is left alone for a byte or two, so that it cannot take all the time there is.
const PAUSE: Duration = Duration::from_micros(200);

/// Whether an autopilot has fallen silent is looked at so often; what it says is seen at once.
const SILENCE_LOOKS_HZ: u8 = 5;

/// A port whose speed can be chosen.
pub trait SetBaud {
    /// From now on it is this fast, in both directions.
    fn set_baud(&mut self, baud: Baud);
}

/// Runs a port for ever, from when it is known what the user has chosen: before, it is silent. It is at the speed of
/// [`Settings::DEFAULT`] until then.
pub async fn run(links: &Links, number: PortNumber, mut rx: impl Read, mut tx: impl Write + SetBaud) -> ! {
    let mut estimates = listen(&links.estimates);
    let mut changes = listen(&links.settings);
    let mut texts = listen(&links.texts);
    let wires = links.port(number);
    let mut settings = changes.changed().await;
    let chosen = settings.ports.of(number);
    let mut port = Port::new(chosen.protocol, *number.of(&links.spoken()), now());
    adapt(&mut port, &mut tx, Settings::DEFAULT.ports.of(number), chosen);
    let mut counted = Counted::default();
    let mut silence = Pace::new();
    let mut bytes = [0; 64];
    loop {
        let written = async {
            match port.output.pending() {
                [] => pending().await,
                bytes => tx.write(bytes).await,
            }
        };
        // It is looked at where it is told: here it would be carried through every wait.
        let estimated = async {
            estimates.changed().await;
        };
        // Estimates first: a line in error is always ready.
        match select4(estimated, written, wires.answers.wait(), rx.read(&mut bytes)).await {
            Either4::First(()) => {
                count(&wires.heartbeat);
                if let Some(changed) = changes.try_changed() {
                    adapt(&mut port, &mut tx, settings.ports.of(number), changed.ports.of(number));
                    settings = changed;
                }
                // Nothing that is told in MAVLink is as urgent as what the other port tells of the same reading.
                if port.spoken(now()) == ProtocolKind::Mavlink {
                    yield_now().await;
                }
                let at = now();
                // One thing a reading: what a note takes is as much as what is told.
                if port.has_notes()
                    && let Some(text) = texts.try_changed()
                {
                    port.note(text.strip_prefix("note ").unwrap_or(&text));
                } else {
                    tell(links, &mut port, at, &settings);
                }
                if silence.is_due(at, SILENCE_LOOKS_HZ) {
                    links.port_is(number, port.spoken(at), port.is_armed(at));
                }
                counted.see(&port, &links.counters);
            }
            Either4::Second(Ok(number)) if number > 0 => port.output.written(number),
            Either4::Second(_) => port.output.fail(),
            Either4::Third((order, result)) => port.answer(order, result.as_ref().copied()),
            Either4::Fourth(Ok(read)) if read > 0 => {
                hear(links, number, &mut port, bytes.get(..read).unwrap_or_default());
            }
            Either4::Fourth(_) => {
                count(&links.counters.attitude_line_errors);
                Timer::after(PAUSE).await;
            }
        }
    }
}

fn adapt(port: &mut Port, tx: &mut impl SetBaud, before: PortSettings, changed: PortSettings) {
    port.choose(changed.protocol);
    if changed.baud != before.baud {
        tx.set_baud(changed.baud);
    }
}

/// Has the port make what is due. What it is made of is large, and is not kept across a wait.
#[inline(never)]
fn tell(links: &Links, port: &mut Port, now: Timestamp, settings: &Settings) {
    let Some(estimate) = links.estimates.try_get() else { return };
    let glance = links.glance.try_get().unwrap_or(Glance::Waiting);
    // Nobody else tells it, and it is seldom another.
    let is_told = port.spoken(now) == ProtocolKind::Mavlink;
    let is_new = |correction: &Correction| {
        is_told && correction.calibration.as_ref().is_some_and(|(calibration, _)| port.has_not_seen(calibration))
    };
    let correction = links.correction.try_get_and(is_new);
    let calibration = correction.as_ref().and_then(|correction| correction.calibration.as_ref());
    port.poll(&Facts { now, estimate: &estimate, settings, glance, calibration });
}

/// Passes on what is in some bytes.
fn hear(links: &Links, number: PortNumber, port: &mut Port, bytes: &[u8]) {
    let at = now();
    for &byte in bytes {
        match port.byte(at, byte) {
            Some(Heard::Attitude(report)) if links.takes_attitude_of(number, at, &report) => {
                count(&links.counters.attitude_reports);
                links.offer(&links.reports, Stamped { at, value: report });
            }
            Some(Heard::Attitude(_) | Heard::Foreign) => count(&links.counters.attitude_foreign),
            // Somebody asks again where it is not answered.
            Some(Heard::Asked(order)) => drop(links.orders.try_send((number, order))),
            Some(Heard::Place(place)) => publish(&links.place, place),
            Some(Heard::Day(day)) => publish(&links.day, day),
            Some(Heard::Current(value)) => links.current.sender().send(Stamped { at, value }),
            Some(Heard::Life) | None => {}
        }
    }
    links.port_is(number, port.spoken(at), port.is_armed(at));
}

/// What of a port's counts is in the module's already.
#[derive(Debug, Default)]
struct Counted([u32; 4]);

impl Counted {
    fn see(&mut self, port: &Port, counters: &Counters) {
        let Output { told, empty, lost, .. } = port.output;
        let now = [told, empty, lost, port.rejected()];
        let of = [&counters.messages, &counters.messages_empty, &counters.write_errors, &counters.attitude_rejected];
        for ((counter, now), before) in of.into_iter().zip(now).zip(&mut self.0) {
            if now != *before {
                counter.fetch_add(now.wrapping_sub(*before), Ordering::Relaxed);
                *before = now;
            }
        }
    }
}
