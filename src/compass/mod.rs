//! The one state machine of the module: uncalibrated -> collecting -> solving -> verifying -> calibrated. A collection of
//! turns ends when there are enough; one of whatever is flown is solved on trial while it goes on (`trials.rs`), and ends
//! when it is good.
//!
//! [`Compass::step`] takes an [`Event`] and says what is to be done ([`Effect`]); it waits for nothing and touches no
//! hardware. A solve is cut into [`Event::Advance`] steps, so that whoever drives the machine can do other work between
//! them. The calibration in use is replaced only by one that [`acceptance`] lets through and that is
//! completely written.

mod auto;
mod glance;
mod messages;
mod refusal;
mod remember;
#[cfg(test)]
mod tests;
mod trials;

pub use glance::Glance;
pub use messages::{Command, Effect, Event, Outcome, Reply, Report, State, Summary, Verdict};
pub use refusal::Refusal;
pub use trials::{Pace, Prospect};

use crate::acceptance::{self, Grounds, Incumbent, Policy};
use crate::calibration::ladder::{self, Procedure, Selection};
use crate::calibration::{
    Advice, Mark, Method, Prior, Progress as Solving, Sample, Samples, Solution, SolveError, Solver,
};
use crate::collection::dataset::HELD_BACK_WHEN_COMPLETE;
use crate::collection::{Collector, Course, Kept, Lack, Recent};
use crate::earth::Here;
use crate::frames::wrap_pi;
use crate::instrument::{Correction, SampleAttitude};
use crate::magnetometer::Identity;
use crate::settings::{OutOfRange, Setting, Settings};
use crate::store::{Change, Generations, Record, Remembered, StoreError, Stored};
use crate::time::WrappingMillis;
use auto::Auto;
use remember::Memory;
use trials::Trials;

// A complete part has as many held-back samples as verification asks for.
const _: () = assert!(Policy::DEFAULT.min_held_back <= HELD_BACK_WHEN_COMPLETE);

/// A mounting within its right angle is off by at most this, degrees: more is likely to be a mistake.
const MAX_ALIGN_DEG: f32 = 20.0;

/// What runs now.
#[expect(clippy::large_enum_variant, reason = "there is one of it, and no heap to put it on")]
#[derive(Debug)]
enum Phase {
    Idle,
    Collecting,
    Solving(Solver),
    Verifying(Solution),
}

/// What is being written.
#[expect(clippy::large_enum_variant, reason = "there is one of it, and no heap to put it on")]
#[derive(Debug)]
enum Saving {
    /// The calibration that was accepted.
    Calibration(Record),
    /// What `cal undo` swaps.
    Undo,
    /// Nothing: `cal clear`.
    Clear,
    /// Changed settings.
    Settings(Settings),
    /// What nobody asked for.
    Remembered(Remembered),
}

/// The magnetometer that answered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct FoundSensor {
    identity: Identity,
    readings_per_sample: u16,
}

/// The state machine. About 3 KB, and the samples in memory that is lent.
#[derive(Debug)]
pub struct Compass<'a> {
    policy: Policy,
    settings: Settings,
    generations: Generations,
    sensor: Option<FoundSensor>,
    /// Whether the autopilot is armed, if that is known.
    is_armed: Option<bool>,
    here: Here,
    collector: Collector<'a>,
    recent: Recent,
    phase: Phase,
    saving: Option<Saving>,
    last: Option<Outcome>,
    advice: Option<Advice>,
    trials: Trials,
    auto: Auto,
    memory: Memory,
}

impl<'a> Compass<'a> {
    /// The machine at start, with what flash held, and a collection that the memory held. Not inlined: what it is made of
    /// would lie on the stack beside all that follows.
    #[must_use]
    #[inline(never)]
    pub fn new(policy: Policy, stored: &Stored, kept: &'a mut Kept) -> Self {
        let Stored { settings, generations, remembered } = *stored;
        let mut compass = Self {
            policy,
            settings,
            generations,
            sensor: None,
            is_armed: None,
            here: Here::NOWHERE,
            collector: Collector::new(kept),
            recent: Recent::new(),
            phase: Phase::Idle,
            saving: None,
            last: None,
            advice: None,
            trials: Trials::NONE,
            auto: Auto::NEW,
            memory: Memory::new(remembered),
        };
        compass.resume();
        compass
    }

    /// How the last solve ended; at the start, that a collection was lost.
    #[must_use]
    pub fn last(&self) -> Option<&Outcome> {
        self.last.as_ref()
    }

    /// What is collected, or was until the last collection ended: for who replays a flight on a host.
    #[cfg(not(target_os = "none"))]
    #[must_use]
    pub const fn collected(&self) -> &Collector<'a> {
        &self.collector
    }

    /// Whether [`Event::Advance`] is wanted.
    #[must_use]
    pub fn is_busy(&self) -> bool {
        matches!(self.phase, Phase::Solving(_) | Phase::Verifying(_))
    }

    /// What headings are to be corrected with now, and what samples are wanted.
    #[must_use]
    pub fn correction(&self) -> Correction {
        let tumbles = matches!(self.phase, Phase::Collecting) && self.collector.procedure() == Procedure::Tumble;
        Correction {
            calibration: self.in_use().map(|record| (record.calibration, record.uncertainty)),
            knows_inclination: self
                .in_use()
                .is_none_or(|record| record.calibration.knows_inclination(record.quality.method)),
            align_deg: self.settings.align_deg,
            sample_attitude: if tumbles { SampleAttitude::Unknown } else { SampleAttitude::Interpolated },
            mount: self.sensor.map(|_| self.settings.mount),
            total_ut: self.total_ut(),
            is_armed: self.is_armed,
        }
    }

    /// The record in use: the stored one, if it is for this sensor and mounting.
    #[must_use]
    pub fn in_use(&self) -> Option<&Record> {
        let record = self.generations.current.as_ref()?;
        let fits = Some(record.sensor) == self.sensor.map(|sensor| sensor.identity);
        (fits && record.mount == self.settings.mount).then_some(record)
    }

    /// What the user has chosen.
    #[must_use]
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Settings in force: declination and inclination that were not entered are the field model's, where there is one.
    #[must_use]
    pub fn settings_in_force(&self) -> Settings {
        let Settings { declination_deg, inclination_deg, .. } = self.settings;
        let field = self.here.field();
        Settings {
            declination_deg: declination_deg.or_else(|| field?.declination_deg),
            inclination_deg: inclination_deg.or_else(|| Some(field?.inclination_deg)),
            ..self.settings
        }
    }

    /// Total intensity of the Earth's field here by the field model, microtesla, where it is known.
    #[must_use]
    pub fn total_ut(&self) -> Option<f32> {
        self.here.field().map(|field| field.total_ut)
    }

    /// The state, as people see it.
    #[must_use]
    pub fn state(&self) -> State {
        match self.phase {
            Phase::Collecting => State::Collecting,
            _ if self.trials.runs => State::Collecting,
            Phase::Solving(_) => State::Solving,
            Phase::Verifying(_) => State::Verifying,
            Phase::Idle if matches!(self.saving, Some(Saving::Calibration(_))) => State::Verifying,
            Phase::Idle if self.in_use().is_some() => State::Calibrated,
            Phase::Idle => State::Uncalibrated,
        }
    }

    /// What is to be written; none unless [`Effect::Save`] was the last effect.
    #[must_use]
    pub fn to_save(&self) -> Option<Change<'_>> {
        let Generations { current, previous } = &self.generations;
        Some(match self.saving.as_ref()? {
            Saving::Settings(settings) => Change::Settings(settings),
            Saving::Remembered(remembered) => Change::Remembered(*remembered),
            Saving::Undo => Change::Generations { current: previous.as_ref(), previous: current.as_ref() },
            Saving::Clear => Change::Clear,
            Saving::Calibration(record) => Change::Generations { current: Some(record), previous: current.as_ref() },
        })
    }

    /// Takes an event; says what is to be done.
    ///
    /// The paths below are never inlined: each has large values of its own, and in one frame they would all lie on the
    /// board's stack at once, beside the solver's.
    pub fn step(&mut self, event: Event) -> Effect {
        let effect = self.react(event);
        self.keep();
        effect
    }

    fn react(&mut self, event: Event) -> Effect {
        match event {
            Event::SensorFound(identity, readings_per_sample) => {
                self.sensor = Some(FoundSensor { identity, readings_per_sample });
                Effect::None
            }
            Event::Armed(is_armed) => {
                self.is_armed = is_armed;
                Effect::None
            }
            Event::Place(place) => {
                self.here.is_at(place);
                Effect::None
            }
            Event::Day(day) => {
                self.here.is_on(day);
                Effect::None
            }
            Event::Sample(sample) => self.sample(sample),
            Event::Command(command, now) => match self.command(command, now) {
                Ok(effect) => effect,
                Err(refusal) => Effect::Reply(Err(refusal)),
            },
            Event::Advance => self.advance(),
            Event::Saved(result) => self.saved(result),
            Event::Spoken(spoken, now) => self.remember(spoken, now),
        }
    }

    #[inline(never)]
    fn sample(&mut self, sample: Sample) -> Effect {
        self.recent.push(sample);
        self.begin_by_itself();
        if !self.collects() {
            return Effect::None;
        }
        self.collector.push(sample);
        self.keep();
        let is_complete = self.collector.progress().is_complete();
        self.trials.runs = !is_complete
            && self.collector.procedure() == Procedure::Flight
            && self.trials.is_due(&self.collector, sample.time);
        if !(is_complete || self.trials.runs) {
            return Effect::None;
        }
        match self.start_solving(None) {
            Ok(()) => Effect::None,
            Err(refusal) => self.end(Err(refusal)),
        }
    }

    #[inline(never)]
    fn command(&mut self, command: Command, now: WrappingMillis) -> Result<Effect, Refusal> {
        let swings = command == Command::CalStartAgain(None) && self.collector.procedure() == Procedure::Swing;
        if self.is_armed == Some(true) && (command.is_for_the_ground() || swings) {
            return Err(Refusal::Armed);
        }
        if self.must_wait(command) {
            if !self.trials.runs {
                return Err(Refusal::Busy);
            }
            // Nobody asked for a trial, and nobody waits for it.
            self.go_on();
        }
        match command {
            Command::CalStart(procedure) => self.start(procedure, false)?,
            Command::CalStartAgain(procedure) => self.start(procedure.unwrap_or(self.collector.procedure()), true)?,
            Command::CalMark(heading_deg) => return self.mark(heading_deg, now),
            Command::CalStop => match self.phase {
                Phase::Collecting => {
                    self.phase = Phase::Idle;
                    self.collector.go_on(Course::Stopped);
                    self.hold();
                }
                _ => return Err(Refusal::NotCollecting),
            },
            Command::CalSolve(method) => {
                self.start_solving(method).map_err(|refusal| refusal.because(self.lack()))?;
            }
            Command::CalAdvise => {
                return self.advice.map(|advice| Effect::Reply(Ok(Reply::Advice(advice)))).ok_or(Refusal::NotSolved);
            }
            Command::CalAbort => {
                self.forget();
                self.hold();
            }
            Command::CalClear => return Ok(self.save(Saving::Clear)),
            Command::CalUndo => return self.undo(),
            Command::Report => return Ok(Effect::Reply(Ok(Reply::Report(self.report())))),
            Command::Set(setting) => {
                let settings = self.settings.with(setting).map_err(Refusal::OutOfRange)?;
                if let Setting::Auto(true) = setting {
                    self.release(true);
                }
                return Ok(self.save(Saving::Settings(settings)));
            }
            Command::Align(heading_deg) => return self.align(heading_deg, false, now),
            Command::AlignSurely(heading_deg) => return self.align(Some(heading_deg), true, now),
            // Whoever asks does it.
            Command::Restart => self.collector.forgive_restarts(),
        }
        Ok(Effect::Reply(Ok(Reply::Done(self.state()))))
    }

    /// Begins to collect, or takes over what the module collects by itself, unless that is to be forgotten.
    fn start(&mut self, procedure: Procedure, forgets: bool) -> Result<(), Refusal> {
        self.sensor.ok_or(Refusal::NoSensor)?;
        let collects = matches!(self.phase, Phase::Collecting) && !forgets;
        if collects && !self.auto.began {
            return Err(Refusal::Collecting { by: self.collector.procedure(), wanted: procedure });
        }
        if !(collects && procedure == self.collector.procedure()) {
            self.begin(procedure);
        }
        self.hold();
        Ok(())
    }

    /// Collects from nothing.
    fn begin(&mut self, procedure: Procedure) {
        self.collector.begin(procedure);
        self.recent = Recent::new();
        self.trials = Trials::NONE;
        self.phase = Phase::Collecting;
    }

    /// Stops whatever runs and forgets the samples.
    #[inline(never)]
    fn forget(&mut self) {
        self.collector.forget();
        self.trials = Trials::NONE;
        self.auto.began = false;
        self.phase = Phase::Idle;
    }

    /// Whether a command has to wait for what runs. A save that has begun is finished: half a save is nobody's wish.
    fn must_wait(&self, command: Command) -> bool {
        match command {
            Command::Report | Command::CalAdvise => false,
            Command::CalAbort | Command::Restart => self.saving.is_some(),
            Command::Set(setting) if !setting.is_used_by_solves() => self.saving.is_some(),
            _ => self.is_busy() || self.saving.is_some(),
        }
    }

    /// Takes the last second of samples as those of a heading.
    fn mark(&mut self, heading_deg: f32, now: WrappingMillis) -> Result<Effect, Refusal> {
        let swinging = matches!(self.phase, Phase::Collecting) && self.collector.procedure() == Procedure::Swing;
        if !swinging {
            return Err(Refusal::NotSwinging);
        }
        in_circle(heading_deg)?;
        let sample = self.recent.steady(now).ok_or(Refusal::NotSteady)?;
        if !self.collector.mark(Mark { sample, heading_rad: heading_deg.to_radians() }) {
            return Err(Refusal::TooManyMarks);
        }
        // The next mark has samples of its own.
        self.recent = Recent::new();
        Ok(Effect::Reply(Ok(Reply::Marked(self.collector.progress().marks))))
    }

    /// What is added to every heading, so that the one of now is the given one.
    fn align(&mut self, heading_deg: Option<f32>, is_sure: bool, now: WrappingMillis) -> Result<Effect, Refusal> {
        let mut align_deg = 0.0;
        if let Some(heading_deg) = heading_deg {
            in_circle(heading_deg)?;
            let calibration = &self.in_use().ok_or(Refusal::NoCalibration)?.calibration;
            let steady = self.recent.steady(now).ok_or(Refusal::NotSteady)?;
            let shown_rad = steady.attitude.level(calibration.body(&steady)).heading_rad();
            align_deg = wrap_pi(heading_deg.to_radians() - shown_rad).to_degrees();
            if align_deg.abs() > MAX_ALIGN_DEG && !is_sure {
                return Err(Refusal::LargeAlignment { heading_deg, align_deg });
            }
        }
        Ok(self.save(Saving::Settings(Settings { align_deg, ..self.settings })))
    }

    fn undo(&mut self) -> Result<Effect, Refusal> {
        self.generations.previous.as_ref().ok_or(Refusal::NothingToUndo)?;
        Ok(self.save(Saving::Undo))
    }

    fn save(&mut self, what: Saving) -> Effect {
        self.saving = Some(what);
        Effect::Save
    }

    fn start_solving(&mut self, method: Option<Method>) -> Result<(), Refusal> {
        let sensor = self.sensor.ok_or(Refusal::NoSensor)?;
        if self.collector.fit().all().next().is_none() {
            return Err(Refusal::NoSamples);
        }
        let supported = || ladder::choose(self.collector.fit(), self.collector.procedure());
        let method = method.map_or_else(supported, Ok).map_err(Refusal::Solve)?;
        self.begin_solve(sensor, method, self.settings_in_force().inclination_deg)
    }

    /// Begins a solve with what is told of the inclination, degrees: by the user, or else by the field model.
    fn begin_solve(
        &mut self,
        sensor: FoundSensor,
        method: Method,
        inclination_deg: Option<f32>,
    ) -> Result<(), Refusal> {
        let prior = Prior {
            mount: self.settings.mount,
            inclination_rad: inclination_deg.map(f32::to_radians),
            readings_per_sample: sensor.readings_per_sample,
        };
        let consider = self.settings.attitude_error.consider();
        let solver =
            Solver::with_consider(method, to_fit(&self.collector), &prior, consider).map_err(Refusal::Solve)?;
        self.phase = Phase::Solving(solver);
        Ok(())
    }

    /// A solve has failed. Where the samples contradict an inclination that nobody entered, the ground differs from the field
    /// model there, or the attitude source is worse than allowed for: it is solved as if there were no model.
    fn failed(&mut self, error: SolveError) -> Effect {
        if let (SolveError::InclinationContradicted { .. }, None, Some(sensor)) =
            (error, self.settings.inclination_deg, self.sensor)
            && self.begin_solve(sensor, Method::MaximumLikelihood, None).is_ok()
        {
            return Effect::None;
        }
        self.end(Err(Refusal::Solve(error)))
    }

    /// One step of a solve or the verification.
    #[inline(never)]
    fn advance(&mut self) -> Effect {
        match &mut self.phase {
            Phase::Solving(solver) => match solver.step(to_fit(&self.collector)) {
                Solving::Continue => Effect::None,
                Solving::Finished(Ok(solution)) => {
                    self.advice = solution.advice;
                    self.phase = Phase::Verifying(solution);
                    Effect::None
                }
                Solving::Finished(Err(error)) => self.failed(error),
            },
            Phase::Verifying(_) => self.verify(),
            Phase::Idle | Phase::Collecting => Effect::None,
        }
    }

    #[inline(never)]
    fn verify(&mut self) -> Effect {
        let Phase::Verifying(candidate) = &self.phase else { return Effect::None };
        let accepted = self.accepted(candidate);
        if self.trials.runs {
            let refusal = accepted.as_ref().err().cloned();
            self.collector.learn(candidate);
            if !self.trials.end(candidate, refusal, &self.collector, self.settings.accuracy_deg) {
                self.go_on();
                return Effect::None;
            }
            // What the module began is over with it, whatever comes of it.
            self.auto.began = false;
        }
        match accepted {
            Ok(record) => {
                self.phase = Phase::Idle;
                self.save(Saving::Calibration(record))
            }
            Err(refusal) => self.end(Err(refusal)),
        }
    }

    /// The record of a candidate that may replace the calibration in use.
    #[inline(never)]
    fn accepted(&self, candidate: &Solution) -> Result<Record, Refusal> {
        let sensor = self.sensor.ok_or(Refusal::NoSensor)?.identity;
        let selection = Selection::of(self.collector.fit(), self.collector.procedure());
        let grounds = Grounds {
            fitted: selection.from(self.collector.fit()),
            held_back: selection.from(self.collector.held_back()),
            knows_attitude: self.collector.procedure() != Procedure::Tumble,
        };
        acceptance::judge(&self.policy, candidate, grounds, &self.incumbent()).map_err(Refusal::Rejected)?;
        let current = self.generations.current.as_ref();
        Ok(Record {
            calibration: candidate.calibration,
            quality: candidate.quality,
            uncertainty: candidate.uncertainty,
            sensor,
            mount: self.settings.mount,
            serial: current.map_or(1, |current| current.serial.wrapping_add(1)),
        })
    }

    fn incumbent(&self) -> Incumbent {
        self.in_use().map_or_else(
            || Incumbent::none(self.settings.mount),
            |record| Incumbent::in_use(record.calibration, record.quality),
        )
    }

    #[inline(never)]
    fn saved(&mut self, result: Result<(), StoreError>) -> Effect {
        let Some(saving) = self.saving.take() else { return Effect::None };
        self.memory.is_written_with(&saving, result);
        match (saving, result) {
            // Asked for by nobody, and not tried again until it is another.
            (Saving::Remembered(_), _) => Effect::None,
            (Saving::Calibration(record), Ok(())) => {
                self.generations.push(&record);
                self.end(Ok(Verdict::new(record.quality, &record.calibration)))
            }
            (Saving::Calibration(_), Err(error)) => self.end(Err(Refusal::Store(error))),
            (_, Err(error)) => Effect::Reply(Err(Refusal::Store(error))),
            (Saving::Undo, Ok(())) => {
                self.generations.undo();
                self.done()
            }
            (Saving::Clear, Ok(())) => {
                self.generations.clear();
                self.release(self.settings.auto_on);
                self.done()
            }
            (Saving::Settings(settings), Ok(())) => {
                if !settings.auto_on && self.settings.auto_on {
                    self.release(false);
                }
                self.settings = settings;
                self.done()
            }
        }
    }

    fn done(&self) -> Effect {
        Effect::Reply(Ok(Reply::Done(self.state())))
    }

    /// Goes on collecting after a trial, or instead of it.
    fn go_on(&mut self) {
        self.trials.runs = false;
        self.phase = Phase::Collecting;
        self.collector.forgive_restarts();
    }

    /// Why samples are missing, or show too little.
    fn lack(&self) -> Option<Lack> {
        self.collector.lack().or_else(|| self.trials.prospect.as_ref().and_then(Prospect::lack))
    }

    /// A solve has ended; the samples stay for another with other settings.
    fn end(&mut self, outcome: Outcome) -> Effect {
        let outcome = outcome.map_err(|refusal| refusal.because(self.lack()));
        if let (true, Err(refusal)) = (self.trials.runs, &outcome) {
            self.trials.prospect = Some(Prospect::none(refusal.clone()));
            self.go_on();
            return Effect::None;
        }
        // What the module collects by itself goes on when somebody has asked in vain what there is by now.
        self.auto.began &= outcome.is_err();
        self.collector.forgive_restarts();
        if !self.auto.began {
            self.collector.go_on(Course::Over);
        }
        self.phase = if self.auto.began { Phase::Collecting } else { Phase::Idle };
        self.last = Some(outcome.clone());
        Effect::Notify(outcome)
    }

    fn report(&self) -> Report {
        Report {
            state: self.state(),
            is_armed: self.is_armed,
            is_auto: self.auto.began,
            awaits_arming: self.awaits_arming(),
            progress: self.collector.progress(),
            prospect: self.trials.prospect.clone(),
            settings: self.settings,
            here: self.here,
            current: self.generations.current.as_ref().map(Summary::from),
            has_previous: self.generations.previous.is_some(),
            last: self.last.clone(),
        }
    }
}

/// The samples that a solve uses.
fn to_fit<'a>(collector: &'a Collector<'_>) -> Samples<'a> {
    Selection::of(collector.fit(), collector.procedure()).from(collector.fit())
}

fn in_circle(heading_deg: f32) -> Result<(), Refusal> {
    if (0.0..=360.0).contains(&heading_deg) {
        Ok(())
    } else {
        Err(Refusal::OutOfRange(OutOfRange("a magnetic heading is 0 to 360 degrees")))
    }
}
