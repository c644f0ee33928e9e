//! What goes into the state machine and comes out of it.

use super::Prospect;
use super::refusal::Refusal;
use crate::calibration::ladder::Procedure;
use crate::calibration::{Advice, Calibration, Method, Orientation, Quality, Sample};
use crate::collection::Progress;
use crate::earth::{Day, Here, Place};
use crate::magnetometer::Identity;
use crate::settings::{PORTS, ProtocolKind, Setting, Settings};
use crate::store::{Record, StoreError};
use crate::time::WrappingMillis;
use crate::trig;

/// What happened.
#[derive(Clone, Copy, Debug)]
pub enum Event {
    /// A magnetometer answered; so many of its readings make a sample.
    SensorFound(Identity, u16),
    /// The autopilot says that it is armed, or that it is not any more; none: it says nothing.
    Armed(Option<bool>),
    /// The autopilot says where it is.
    Place(Place),
    /// The autopilot says what day it is.
    Day(Day),
    /// The next averaged sample of the flight.
    Sample(Sample),
    /// Somebody asked for something, at this time by the samples' clock.
    Command(Command, WrappingMillis),
    /// Time for the next step of a solve: wanted while [`Compass::is_busy`](super::Compass::is_busy).
    Advance,
    /// What is spoken on the ports at this time by the samples' clock; and a moment in which nothing else is to be done.
    Spoken([ProtocolKind; PORTS], WrappingMillis),
    /// The save asked for by [`Effect::Save`] has ended.
    Saved(Result<(), StoreError>),
}

/// What can be asked of the module.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Command {
    /// Begin collecting, from nothing, or with what the module has collected by itself.
    CalStart(Procedure),
    /// Begin collecting from nothing, whatever was collected; without a procedure by the one before.
    CalStartAgain(Option<Procedure>),
    /// The vehicle stands at this magnetic heading, degrees.
    CalMark(f32),
    /// Stop collecting, keep the samples.
    CalStop,
    /// Solve with the samples there are, by a method or by the one they support.
    CalSolve(Option<Method>),
    /// What is weak in the last solve, and what to fly.
    CalAdvise,
    /// Stop whatever runs, forget the samples.
    CalAbort,
    /// Forget the stored calibrations.
    CalClear,
    /// Back to the calibration before.
    CalUndo,
    /// State, progress, settings and the calibration in use.
    Report,
    /// Change a setting.
    Set(Setting),
    /// The vehicle stands at this magnetic heading, degrees: from now on that is what is shown there. None takes the
    /// offset away.
    Align(Option<f32>),
    /// The same, however much it adds.
    AlignSurely(f32),
    /// The module is about to be restarted, if nothing speaks against it.
    Restart,
}

impl Command {
    /// Whether it is refused while the autopilot is armed: in the air it would take away a heading that is flown by, or
    /// it needs a vehicle that stands. What a calibration in flight needs is none of these.
    #[must_use]
    pub const fn is_for_the_ground(self) -> bool {
        match self {
            Self::CalStart(Procedure::Swing)
            | Self::CalStartAgain(Some(Procedure::Swing))
            | Self::CalMark(_)
            | Self::CalClear
            | Self::CalUndo
            | Self::Set(Setting::Mount(_))
            | Self::Restart => true,
            Self::CalStart(Procedure::Flight | Procedure::Turns | Procedure::Level | Procedure::Tumble)
            | Self::CalStartAgain(_)
            | Self::CalStop
            | Self::CalSolve(_)
            | Self::CalAdvise
            | Self::CalAbort
            | Self::Report
            | Self::Set(_)
            | Self::Align(_)
            | Self::AlignSurely(_) => false,
        }
    }
}

/// What is to be done next.
#[expect(clippy::large_enum_variant, reason = "there is one of it, and the board has no heap")]
#[derive(Debug)]
pub enum Effect {
    /// Nothing.
    None,
    /// Tell the one who asked.
    Reply(Result<Reply, Refusal>),
    /// Tell whoever listens: a solve has ended.
    Notify(Outcome),
    /// Write [`Compass::to_save`](super::Compass::to_save) to flash and come back with [`Event::Saved`].
    Save,
}

/// An answer that is not a refusal.
#[expect(clippy::large_enum_variant, reason = "there is one of it, and the board has no heap")]
#[derive(Clone, Debug)]
pub enum Reply {
    /// Done; the state the module is in now.
    Done(State),
    /// So many headings have been given.
    Marked(u16),
    /// What is weak in the last solve, and what to fly.
    Advice(Advice),
    /// Everything there is to know.
    Report(Report),
}

/// The states of the module, as people see them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum State {
    /// No calibration for this sensor and mounting.
    Uncalibrated,
    /// Collecting samples of turns.
    Collecting,
    /// Solving for the coefficients.
    Solving,
    /// Verifying on held-back samples, and writing.
    Verifying,
    /// A calibration is in use.
    Calibrated,
}

impl State {
    /// The word shown to people.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Uncalibrated => "uncalibrated",
            Self::Collecting => "collecting",
            Self::Solving => "solving",
            Self::Verifying => "verifying",
            Self::Calibrated => "calibrated",
        }
    }
}

/// State, progress, settings and the calibration in use.
#[derive(Clone, Debug)]
pub struct Report {
    /// The state.
    pub state: State,
    /// Whether the autopilot is armed, if that is known.
    pub is_armed: Option<bool>,
    /// Whether the module began the collection by itself.
    pub is_auto: bool,
    /// Whether such a collection begins, or goes on, when the autopilot arms.
    pub awaits_arming: bool,
    /// Progress of the collection.
    pub progress: Progress,
    /// What the collection would end in by now, if it was tried.
    pub prospect: Option<Prospect>,
    /// What the user has chosen.
    pub settings: Settings,
    /// Where it is, and the Earth's field there.
    pub here: Here,
    /// The stored calibration, whether or not it fits this sensor and mounting.
    pub current: Option<Summary>,
    /// Whether `cal undo` would bring one back.
    pub has_previous: bool,
    /// How the last solve ended.
    pub last: Option<Outcome>,
}

/// A stored calibration, without the uncertainty of each coefficient.
#[derive(Clone, Debug)]
pub struct Summary {
    /// The coefficients.
    pub calibration: Calibration,
    /// How good they are expected to be.
    pub quality: Quality,
    /// The sensor they were found with.
    pub sensor: Identity,
    /// How that sensor was mounted.
    pub mount: Orientation,
    /// Counts the calibrations this module has accepted.
    pub serial: u32,
}

impl From<&Record> for Summary {
    fn from(record: &Record) -> Self {
        let Record { calibration, quality, sensor, mount, serial, .. } = *record;
        Self { calibration, quality, sensor, mount, serial }
    }
}

impl Summary {
    /// What is to be expected of it.
    #[must_use]
    pub fn verdict(&self) -> Verdict {
        Verdict::new(self.quality, &self.calibration)
    }
}

/// What is to be expected of a calibration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Verdict {
    /// How good it is expected to be.
    pub quality: Quality,
    /// What a degree of attitude error costs in level flight: degrees of heading, at the heading where it costs most.
    /// None where the inclination is not known, which tumbling does not show.
    pub attitude_cost: Option<f32>,
}

impl Verdict {
    /// Of a calibration of this quality. A tilt about magnetic north turns the vertical part of the field into the
    /// horizontal one: `d psi = tan(inclination) d phi`, from Liu 2007 eq. 3.
    #[inline(never)]
    pub(super) fn new(quality: Quality, calibration: &Calibration) -> Self {
        let (sin, cos) = trig::sin_cos(calibration.inclination_rad);
        let attitude_cost = calibration.knows_inclination(quality.method).then_some((sin / cos).abs());
        Self { quality, attitude_cost }
    }
}

/// How a solve ended.
pub type Outcome = Result<Verdict, Refusal>;
