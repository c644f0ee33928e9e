//! Ctrl-C, and other ways to be told to end.

use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::flag;

use super::Failure;

/// Whether somebody wants it to end.
pub struct Interruption {
    stop: Arc<AtomicBool>,
    signal: Arc<AtomicUsize>,
}

/// What the second Ctrl-C does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Second {
    /// It ends at once.
    Ends,
    /// Nothing: what has to be cleared away is, and that takes no time.
    Waits,
}

impl Interruption {
    /// From now on a command that holds nothing ends at once when it is told to.
    pub fn ends() -> Result<(), Failure> {
        let always = Arc::new(AtomicBool::new(true));
        for signal in [SIGINT, SIGTERM, SIGHUP] {
            flag::register_conditional_shutdown(signal, status(signal), Arc::clone(&always)).map_err(failed)?;
        }
        Ok(())
    }

    /// From now on it is kept in mind.
    pub fn awaited(second: Second) -> Result<Self, Failure> {
        let interruption = Self { stop: Arc::new(AtomicBool::new(false)), signal: Arc::new(AtomicUsize::new(0)) };
        for signal in [SIGINT, SIGTERM, SIGHUP] {
            if second == Second::Ends {
                flag::register_conditional_shutdown(signal, status(signal), Arc::clone(&interruption.stop))
                    .map_err(failed)?;
            }
            flag::register_usize(signal, Arc::clone(&interruption.signal), status(signal) as usize).map_err(failed)?;
            flag::register(signal, Arc::clone(&interruption.stop)).map_err(failed)?;
        }
        Ok(interruption)
    }

    /// Set when somebody does.
    pub fn stop(&self) -> &Arc<AtomicBool> {
        &self.stop
    }

    /// What to end with, if somebody does: 128 and the signal's number, as a shell tells it; 130 by Ctrl-C.
    pub fn code(&self) -> Option<ExitCode> {
        let is_to_end = self.stop.load(Ordering::SeqCst);
        is_to_end.then(|| ExitCode::from(self.signal.load(Ordering::SeqCst) as u8))
    }
}

const fn status(signal: i32) -> i32 {
    128 + signal
}

fn failed(error: impl std::fmt::Display) -> Failure {
    Failure(format!("no-signals: {error}"))
}
