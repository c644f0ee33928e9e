//! Task of a port: distributes received messages, and sends messages with every estimate.

use core::future::pending;
use core::sync::atomic::Ordering;

use embassy_futures::select::{Either4, select4};
use embassy_futures::yield_now;
use embassy_time::Timer;
use embedded_io_async::{Read, Write};

use super::line::{calibration_to_report, route_message, update_line_state, with_snapshot};
use super::task_links::{AutopilotLine, LINE_ERROR_PAUSE, increment_counter, now, subscribe};
use crate::app::task_links::TaskLinks;
use crate::health::EventCounters;
use crate::port::{MessageSchedule, Port, TransmitBuffer};
use autoswing::time::Timestamp;
use autoswing_module::settings::{BaudRate, PortNumber, PortSettings, ProtocolKind, Settings};

/// Rate of checks for a silent autopilot; received changes apply at once.
const AUTOPILOT_SILENCE_CHECK_HZ: u8 = 5;

/// Port with a selectable baud rate.
pub trait SetBaud {
    /// Sets the baud rate of both directions.
    fn set_baud(&mut self, baud: BaudRate);
}

/// Waits for the settings; returns whether they name a protocol of a port. A board with one UART runs the console on it
/// otherwise.
pub async fn has_protocol(links: &TaskLinks, port_number: PortNumber) -> bool {
    subscribe(&links.settings).changed().await.settings_of_port(port_number).protocol != ProtocolKind::Auto
}

/// Runs a port for ever. Until the settings are loaded it is silent, at the baud rate of [`Settings::DEFAULT`].
pub async fn run_port(
    links: &TaskLinks,
    port_number: PortNumber,
    mut rx: impl Read,
    mut tx: impl Write + SetBaud,
) -> ! {
    let mut estimates = subscribe(&links.estimates);
    let mut changes = subscribe(&links.settings);
    let line = AutopilotLine::Port(port_number);
    let wires = links.links_of_line(line);
    let mut settings = changes.changed().await;
    let initial_settings = settings.settings_of_port(port_number);
    let mut port = Port::new(initial_settings.protocol, *port_number.port_element(&links.port_protocols()), now());
    apply_settings(&mut port, &mut tx, Settings::DEFAULT.settings_of_port(port_number), initial_settings);
    port.mavlink.set_signing_key(settings.signing_key);
    let mut published_counts = PublishedCounts::default();
    let mut silence_check = MessageSchedule::default();
    let mut bytes = [0; 64];
    loop {
        let write_output = async {
            match port.pending_output.pending_bytes() {
                [] => pending().await,
                bytes => tx.write(bytes).await,
            }
        };
        // The estimate is read again later: as this future's result it would occupy memory across every wait.
        let estimated = async {
            estimates.changed().await;
        };
        // Estimates come first: a line in error is ready at every poll, and would starve any future after it.
        match select4(estimated, write_output, wires.command_results.wait(), rx.read(&mut bytes)).await {
            Either4::First(()) => {
                increment_counter(&wires.heartbeat);
                if let Some(changed) = changes.try_changed() {
                    apply_settings(
                        &mut port,
                        &mut tx,
                        settings.settings_of_port(port_number),
                        changed.settings_of_port(port_number),
                    );
                    settings = changed;
                    port.mavlink.set_signing_key(settings.signing_key);
                }
                // MAVLink messages are less urgent than the other port's sentences of the same reading.
                if port.active_protocol(now()) == ProtocolKind::Mavlink {
                    yield_now().await;
                }
                let at = now();
                // One text or one poll per reading limits the work; each takes about the same time.
                match wires.messages.try_receive() {
                    Ok(message) if port.carries_texts() => port.mavlink.queue_text(&message),
                    _ => poll_port(links, &mut port, at, &settings),
                }
                if silence_check.is_due(at, AUTOPILOT_SILENCE_CHECK_HZ) {
                    update_port_state(links, line, &mut port, at);
                }
                if let Some(action) = links.take_autopilot_action(line) {
                    port.begin_autopilot_action(at, action);
                }
                if let Some(message) = port.mavlink.take_message(at) {
                    links.broadcast_message(&message);
                }
                links.send_command(line, port.mavlink.take_command());
                published_counts.add_new_counts(&port, &links.event_counters);
            }
            Either4::Second(Ok(number)) if number > 0 => port.pending_output.consume_bytes(number),
            Either4::Second(_) => port.pending_output.drop_after_line_error(),
            Either4::Third((command, result)) => port.mavlink.complete_command(command, result.as_ref().copied()),
            Either4::Fourth(Ok(read)) if read > 0 => {
                receive_bytes(links, line, &mut port, bytes.get(..read).unwrap_or_default());
            }
            Either4::Fourth(_) => {
                increment_counter(&links.event_counters.attitude_line_errors);
                Timer::after(LINE_ERROR_PAUSE).await;
            }
        }
    }
}

fn apply_settings(port: &mut Port, tx: &mut impl SetBaud, old_settings: PortSettings, new_settings: PortSettings) {
    port.set_protocol(new_settings.protocol);
    if new_settings.baud != old_settings.baud {
        tx.set_baud(new_settings.baud);
    }
}

/// Polls the protocol. A separate function, because the data is large and must not be kept across a wait.
#[inline(never)]
fn poll_port(links: &TaskLinks, port: &mut Port, now: Timestamp, settings: &Settings) {
    // Only MAVLink reports the calibration.
    let is_reported = port.active_protocol(now) == ProtocolKind::Mavlink;
    let correction =
        calibration_to_report(links, |calibration| is_reported && port.mavlink.is_unreported_calibration(calibration));
    with_snapshot(links, now, settings, correction.as_ref(), |snapshot| port.poll(snapshot));
}

fn receive_bytes(links: &TaskLinks, line: AutopilotLine, port: &mut Port, bytes: &[u8]) {
    let at = now();
    for &byte in bytes {
        if let Some(message) = port.process_byte(at, byte) {
            route_message(links, line, at, message, port.active_protocol(at) != ProtocolKind::Msp);
        }
    }
    update_port_state(links, line, port, at);
}

fn update_port_state(links: &TaskLinks, line: AutopilotLine, port: &mut Port, now: Timestamp) {
    update_line_state(links, line, port.active_protocol(now), port.is_armed(now), &mut port.mavlink);
}

/// Counts of a port's events that the module's counters already include.
#[derive(Debug, Default)]
struct PublishedCounts([u32; 4]);

impl PublishedCounts {
    fn add_new_counts(&mut self, port: &Port, counters: &EventCounters) {
        let TransmitBuffer {
            message_count: messages,
            headingless_message_count: without_heading,
            lost_message_count,
            ..
        } = port.pending_output;
        let counts = [messages, without_heading, lost_message_count, port.rejected_frame_count()];
        let totals =
            [&counters.messages, &counters.messages_empty, &counters.write_errors, &counters.attitude_frames_rejected];
        for ((counter, count), published_count) in totals.into_iter().zip(counts).zip(&mut self.0) {
            if count != *published_count {
                counter.fetch_add(count.wrapping_sub(*published_count), Ordering::Relaxed);
                *published_count = count;
            }
        }
    }
}
