//! Task of the console: serves a terminal, operated by a person or a script.

use embassy_futures::select::{Either3, select3};
use embassy_time::{Duration, Instant, Timer, with_timeout};
use embedded_io_async::{Read, Write};

use super::task_links::{CommandSource, LINE_ERROR_PAUSE};
use crate::app::task_links::TaskLinks;
use crate::console::session::Session;
use crate::console::{Request, reply, write_help};
use crate::health::{Diagnostics, ResetCause, StackUse};
use autoswing::instrument::Estimate;
use autoswing_module::compass::{Command, Reply};
use autoswing_module::messages::Refusal;

/// Write timeout, after which the pending output is dropped.
const WRITE_TIMEOUT: Duration = Duration::from_millis(500);

/// Delay of a restart, in which the reply to `reboot` is sent.
const REBOOT_DELAY: Duration = Duration::from_millis(50);

/// Functions of a board for the tasks.
pub trait Platform {
    /// Restarts the module. On a board this does not return; on the host the simulator stops the tasks at their next
    /// wait.
    fn reboot(&mut self);

    /// Peak stack use, if known.
    fn peak_stack_use(&self) -> Option<StackUse> {
        None
    }
}

/// Runs the console for ever.
pub async fn run_console(
    links: &TaskLinks,
    mut rx: impl Read,
    mut tx: impl Write,
    mut platform: impl Platform,
    reset_cause: ResetCause,
) -> ! {
    let session = Session::new(|out| reply::write_greeting(out, &reset_cause));
    let mut terminal = Terminal { links, session, reset_cause };
    let mut bytes = [0; 32];
    let mut read = 0..0;
    // Each await point occurs once in this function: every one costs memory in this task and code in flash.
    loop {
        flush_output(&mut terminal.session, &mut tx).await;
        if let Some(&byte) = read.next().and_then(|index| bytes.get(index)) {
            let Some(command) = terminal.process_byte(byte) else { continue };
            let mut result = execute_command(links, command).await;
            if reports_resulting_state(command) && result.is_ok() {
                result = execute_command(links, Command::Status).await;
            }
            terminal.write_reply(command, &result, &platform);
            continue;
        }
        match select3(links.restart_request.wait(), rx.read(&mut bytes), links.console_messages.receive()).await {
            Either3::First(()) => reboot_after_reply(&mut platform).await,
            Either3::Second(Ok(number)) if number > 0 => read = 0..number,
            Either3::Second(_) => Timer::after(LINE_ERROR_PAUSE).await,
            Either3::Third(message) => terminal.session.write_notice(|out| reply::write_notice(out, &message)),
        }
    }
}

/// Whether the reply shows the resulting state, which has to be requested after the command.
const fn reports_resulting_state(command: Command) -> bool {
    matches!(command, Command::Set(_) | Command::Align(_) | Command::AlignConfirmed(_) | Command::CalUndo)
}

/// Executes requested restarts, in place of the console on a board whose UART serves a port.
pub async fn restart_without_terminal(links: &TaskLinks, mut platform: impl Platform) -> ! {
    loop {
        links.restart_request.wait().await;
        reboot_after_reply(&mut platform).await;
    }
}

async fn reboot_after_reply(platform: &mut impl Platform) {
    Timer::after(REBOOT_DELAY).await;
    platform.reboot();
}

/// Terminal session and the sources of its replies.
struct Terminal<'a> {
    links: &'a TaskLinks,
    session: Session,
    reset_cause: ResetCause,
}

impl Terminal<'_> {
    /// Processes a received byte; returns a command for the state machine.
    fn process_byte(&mut self, byte: u8) -> Option<Command> {
        match self.session.process_byte(byte)? {
            Err(error) => self.session.write_reply(|out| reply::write_line_error(out, &error)),
            Ok(Request::Help(help_topic)) => self.session.write_reply(|out| write_help(out, help_topic)),
            Ok(Request::Version) => self.session.write_reply(reply::write_version),
            Ok(Request::Command(command)) => return Some(command),
        }
        None
    }

    fn write_reply(&mut self, command: Command, result: &Result<Reply, Refusal>, platform: &impl Platform) {
        let health = self.diagnostics(platform);
        self.session.write_reply(|out| reply::write_reply(out, command, result, &health));
    }

    fn diagnostics(&self, platform: &impl Platform) -> Diagnostics {
        let Estimate { attitude, heading, installation_change: change, current_a, .. } =
            self.links.estimates.try_get().unwrap_or(Estimate::EMPTY);
        Diagnostics {
            sensor: self.links.sensor.try_get().map(|sensor| sensor.identity),
            attitude,
            heading,
            installation_change: change,
            current_a,
            event_counts: self.links.event_counts(),
            reset_cause: self.reset_cause,
            uptime_s: Instant::now().as_secs() as u32,
            stack_use: platform.peak_stack_use(),
            port_protocols: self.links.port_protocols(),
            can_state: self.links.can_state(),
        }
    }
}

/// Sends a command to the state machine, which replies within one step of a solve or one save.
async fn execute_command(links: &TaskLinks, command: Command) -> Result<Reply, Refusal> {
    links.commands.send((CommandSource::Console, command)).await;
    links.replies.receive().await
}

async fn flush_output(session: &mut Session, tx: &mut impl Write) {
    if !session.pending_output().is_empty() {
        let _ = with_timeout(WRITE_TIMEOUT, tx.write_all(session.pending_output())).await;
        session.clear_output();
    }
}
