//! Handling of Ctrl-C and other termination signals.

use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::thread;
use std::time::Duration;

#[cfg(unix)]
use signal_hook::consts::SIGHUP;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;

use crate::command_failure::CommandFailure;
use crate::print;

/// Signals that end the program. On Windows, SIGINT is Ctrl-C.
const TERMINATION_SIGNALS: &[i32] = &[
    SIGINT,
    SIGTERM,
    #[cfg(unix)]
    SIGHUP,
];

/// Poll period of a command without clean-up.
const POLL_PERIOD: Duration = Duration::from_millis(20);

/// The signals that end the program, and whether one was received.
#[derive(Debug)]
pub struct TerminationSignals {
    stop: Arc<AtomicBool>,
    received_exit_status: Arc<AtomicUsize>,
}

/// Effect of a second Ctrl-C.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SecondSignal {
    /// A second signal ends the program at once.
    Exits,
    /// A second signal has no effect, because the clean-up is short and must finish.
    IsIgnored,
}

impl TerminationSignals {
    /// Installs immediate termination, for commands without clean-up.
    ///
    /// # Errors
    ///
    /// The system refuses a signal handler.
    pub fn install_immediate_exit() -> Result<(), CommandFailure> {
        let signals = Self::install_handlers(SecondSignal::Exits)?;
        thread::spawn(move || {
            while !signals.stop.load(Ordering::SeqCst) {
                thread::sleep(POLL_PERIOD);
            }
            print::clear_progress_line();
            signal_hook::low_level::exit(i32::from(signals.received_exit_status.load(Ordering::SeqCst) as u8));
        });
        Ok(())
    }

    /// Installs handlers that record the signal.
    ///
    /// # Errors
    ///
    /// The system refuses a signal handler.
    pub fn install_handlers(second_signal: SecondSignal) -> Result<Self, CommandFailure> {
        let interruption =
            Self { stop: Arc::new(AtomicBool::new(false)), received_exit_status: Arc::new(AtomicUsize::new(0)) };
        for &signal in TERMINATION_SIGNALS {
            if second_signal == SecondSignal::Exits {
                flag::register_conditional_shutdown(signal, exit_status(signal), Arc::clone(&interruption.stop))
                    .map_err(signal_failure)?;
            }
            flag::register_usize(signal, Arc::clone(&interruption.received_exit_status), exit_status(signal) as usize)
                .map_err(signal_failure)?;
            flag::register(signal, Arc::clone(&interruption.stop)).map_err(signal_failure)?;
        }
        Ok(interruption)
    }

    /// Set by the first signal.
    #[must_use]
    pub fn stop_flag(&self) -> &Arc<AtomicBool> {
        &self.stop
    }

    /// Exit code after a signal, if any: 128 plus its number, as in a shell; 130 for Ctrl-C.
    #[must_use]
    pub fn exit_code(&self) -> Option<ExitCode> {
        let is_to_end = self.stop.load(Ordering::SeqCst);
        is_to_end.then(|| ExitCode::from(self.received_exit_status.load(Ordering::SeqCst) as u8))
    }
}

const fn exit_status(signal: i32) -> i32 {
    128 + signal
}

fn signal_failure(error: impl std::fmt::Display) -> CommandFailure {
    CommandFailure(format!("no-signals: {error}"))
}
