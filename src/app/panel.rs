//! The board's lamp and button: how the module is, seen from afar, and a calibration without a console.
//!
//! | lamp | says |
//! |---|---|
//! | a short flash every two seconds | waiting: uncalibrated, and nothing is collected |
//! | lit for a part of each second | collecting: the longer, the nearer to its end |
//! | lit, a short break every two seconds | calibrated |
//! | five flashes a second | trouble: no sensor, no attitude, or the last solve was refused; `status` says what |
//!
//! It never stands still: a lamp that does belongs to a module that is dead. The button, held for two seconds, is `cal start`.

use embassy_time::{Duration, Ticker};

use super::Links;
use crate::compass::Glance;
use crate::heading::NoHeading;

/// What a board has for a person who stands beside it.
pub trait Panel {
    /// Lights the lamp, or puts it out.
    fn light(&mut self, on: bool);

    /// Whether the button is down; never, where there is none.
    fn is_pressed(&self) -> bool;
}

/// Lamp and button are looked at so often, milliseconds: a contact that bounces has settled.
const STEP_MS: u16 = 50;

/// The button is held for so long, milliseconds: nobody does that by chance.
const HOLD_MS: u16 = 2000;

/// The lamp's patterns begin anew so often, milliseconds.
const ROUND_MS: u16 = 2000;

/// A short flash, or a short break, milliseconds.
const SHORT_MS: u16 = 100;

/// What the lamp tells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Lamp {
    Of(Glance),
    Trouble,
}

impl Lamp {
    /// Whether it is lit, so long after the beginning of a round.
    fn is_lit(self, ms: u16) -> bool {
        match self {
            Self::Of(Glance::Waiting) => ms < SHORT_MS,
            Self::Of(Glance::Collecting(percent)) => {
                // Something of each second is light and something is dark, whatever the share.
                ms % 1000 < u16::from(percent.clamp(10, 90)) * 10
            }
            Self::Of(Glance::Calibrated) => ms >= SHORT_MS,
            Self::Of(Glance::Refused) | Self::Trouble => (ms / SHORT_MS).is_multiple_of(2),
        }
    }
}

/// Shows and listens for ever.
pub async fn run(links: &Links, mut panel: impl Panel) -> ! {
    let mut ticker = Ticker::every(Duration::from_millis(STEP_MS.into()));
    let (mut ms, mut held_ms) = (0, 0);
    loop {
        ticker.next().await;
        panel.light(lamp(links).is_lit(ms));
        ms = (ms + STEP_MS) % ROUND_MS;
        let before_ms = held_ms;
        held_ms = if panel.is_pressed() { (held_ms + STEP_MS).min(HOLD_MS) } else { 0 };
        if held_ms == HOLD_MS && before_ms < HOLD_MS {
            links.pressed.signal(());
        }
    }
}

/// What is to be told now. What takes the heading away and is no want of a calibration is trouble; and no attitude, without
/// which nothing can be collected, unless somebody does.
fn lamp(links: &Links) -> Lamp {
    let glance = links.glance.try_get().unwrap_or(Glance::Waiting);
    let is_well = links.estimates.try_get().is_some_and(|estimate| match estimate.heading {
        Ok(_) => true,
        Err(reason) => reason == NoHeading::Uncalibrated && (estimate.attitude.is_some() || glance != Glance::Waiting),
    });
    if is_well { Lamp::Of(glance) } else { Lamp::Trouble }
}
