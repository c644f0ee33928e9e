//! The one state machine of the module: uncalibrated -> collecting -> solving -> verifying -> calibrated.
//!
//! [`Compass::step`] takes an [`Event`] and says what is to be done ([`Effect`]); it waits for nothing and touches no
//! hardware. A solve is cut into [`Event::Advance`] steps, so that whoever drives the machine can do other work between
//! them. The calibration in use is replaced only by one that was verified on held-back samples, beats it there, and is
//! completely written.

mod messages;
mod refusal;

pub use messages::{Command, Effect, Event, Outcome, Reply, Report, State, Summary};
pub use refusal::Refusal;

use crate::calibration::ladder::{self, Procedure, Selection};
use crate::calibration::verification::{self, Scores};
use crate::calibration::{
    Advice, Calibration, Mark, Method, Prior, Progress as Solving, Sample, Samples, Solution, Solver,
};
use crate::collection::{Collector, Recent, averager};
use crate::frames::wrap_pi;
use crate::magnetometer::Identity;
use crate::settings::Settings;
use crate::store::{Change, Generations, Record, StoreError};
use crate::time::WrappingMillis;

/// Fixed numbers of the machine.
#[derive(Clone, Copy, Debug)]
pub struct Config {
    /// A calibration expected to be worse than this is refused, degrees RMS: an uncalibrated compass in a clean
    /// airframe is about as good.
    pub max_expected_rms_deg: f32,
    /// Held-back samples needed of each part that was used: one for every sector but a few.
    pub min_held_back: u16,
    /// A candidate expected to be worse than the calibration in use by more than this factor, or found where less
    /// shows, is thinner.
    pub thinner_by: f32,
    /// A thinner candidate is only taken when it explains the held-back samples this many times better: then the
    /// airframe's iron has changed, and the calibration in use is wrong whatever it was expected to be.
    pub contradicted_by: f32,
}

impl Config {
    /// Numbers for every vehicle.
    pub const DEFAULT: Self =
        Self { max_expected_rms_deg: 3.0, min_held_back: 8, thinner_by: 1.5, contradicted_by: 3.0 };
}

/// What runs now.
#[allow(clippy::large_enum_variant, reason = "there is one of it, and no heap to put it on")]
#[derive(Debug)]
enum Phase {
    Idle,
    Collecting,
    Solving(Solver),
    Verifying(Solution),
    /// The record of the calibration that passed, while it is written.
    Saving(Record),
}

/// What is being written.
#[derive(Debug)]
enum Pending {
    /// The calibration that passed verification.
    Calibration,
    /// `cal undo`.
    Undo,
    /// `cal clear`.
    Clear,
    /// Changed settings.
    Settings(Settings),
}

/// The state machine. About 18 KB, most of it samples.
#[derive(Debug)]
pub struct Compass {
    config: Config,
    settings: Settings,
    generations: Generations,
    sensor: Option<Identity>,
    collector: Collector,
    recent: Recent,
    phase: Phase,
    pending: Option<Pending>,
    last: Option<Outcome>,
    advice: Option<Advice>,
}

impl Compass {
    /// The machine at start, with what flash held. Not inlined: what it is made of would lie on the stack beside all that
    /// follows.
    #[must_use]
    #[inline(never)]
    pub const fn new(config: Config, settings: Settings, generations: Generations) -> Self {
        Self {
            config,
            settings,
            generations,
            sensor: None,
            collector: Collector::new(),
            recent: Recent::new(),
            phase: Phase::Idle,
            pending: None,
            last: None,
            advice: None,
        }
    }

    /// Whether [`Event::Advance`] is wanted.
    #[must_use]
    pub fn is_busy(&self) -> bool {
        matches!(self.phase, Phase::Solving(_) | Phase::Verifying(_))
    }

    /// Whether samples are wanted although no attitude is known.
    #[must_use]
    pub fn tumbles(&self) -> bool {
        matches!(self.phase, Phase::Collecting) && self.collector.procedure() == Procedure::Tumble
    }

    /// The record in use: the stored one, if it is for this sensor and mounting.
    #[must_use]
    pub fn in_use(&self) -> Option<&Record> {
        let record = self.generations.current.as_ref()?;
        let fits = Some(record.sensor) == self.sensor && record.mount == self.settings.mount;
        fits.then_some(record)
    }

    /// Settings in force.
    #[must_use]
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// The state, as people see it.
    #[must_use]
    pub fn state(&self) -> State {
        match self.phase {
            Phase::Collecting => State::Collecting,
            Phase::Solving(_) => State::Solving,
            Phase::Verifying(_) | Phase::Saving(_) => State::Verifying,
            Phase::Idle if self.in_use().is_some() => State::Calibrated,
            Phase::Idle => State::Uncalibrated,
        }
    }

    /// What is to be written; none unless [`Effect::Save`] was the last effect.
    #[must_use]
    pub fn to_save(&self) -> Option<Change<'_>> {
        let Generations { current, previous } = &self.generations;
        Some(match (self.pending.as_ref()?, &self.phase) {
            (Pending::Settings(settings), _) => Change::Settings(settings),
            (Pending::Undo, _) => Change::Generations { current: previous.as_ref(), previous: current.as_ref() },
            (Pending::Clear, _) => Change::Generations { current: None, previous: None },
            (Pending::Calibration, Phase::Saving(record)) => {
                Change::Generations { current: Some(record), previous: current.as_ref() }
            }
            (Pending::Calibration, _) => return None,
        })
    }

    /// Takes an event; says what is to be done.
    ///
    /// The paths below are never inlined: each has large values of its own, and in one frame they would all lie on the
    /// board's stack at once, beside the solver's.
    pub fn step(&mut self, event: Event) -> Effect {
        match event {
            Event::SensorFound(identity) => {
                self.sensor = Some(identity);
                Effect::None
            }
            Event::Sample(sample) => self.sample(sample),
            Event::Command(command, now) => match self.command(command, now) {
                Ok(effect) => effect,
                Err(refusal) => Effect::Reply(Err(refusal)),
            },
            Event::Advance => self.advance(),
            Event::Saved(result) => self.saved(result),
        }
    }

    #[inline(never)]
    fn sample(&mut self, sample: Sample) -> Effect {
        self.recent.push(sample);
        if !matches!(self.phase, Phase::Collecting) {
            return Effect::None;
        }
        self.collector.push(sample);
        if !self.collector.progress().is_complete() {
            return Effect::None;
        }
        match self.start_solving(None) {
            Ok(()) => Effect::None,
            Err(refusal) => self.end(Err(refusal)),
        }
    }

    #[inline(never)]
    fn command(&mut self, command: Command, now: WrappingMillis) -> Result<Effect, Refusal> {
        let runs = self.is_busy() || matches!(self.phase, Phase::Saving(_));
        let asks_only = matches!(command, Command::Report | Command::CalAbort | Command::CalAdvise);
        if runs && !asks_only {
            return Err(Refusal::Busy);
        }
        match command {
            Command::CalStart(procedure) => {
                self.sensor.ok_or(Refusal::NoSensor)?;
                self.collector.begin(procedure);
                self.recent = Recent::new();
                self.phase = Phase::Collecting;
            }
            Command::CalMark(heading_deg) => return self.mark(heading_deg, now),
            Command::CalStop => match self.phase {
                Phase::Collecting => self.phase = Phase::Idle,
                _ => return Err(Refusal::NotCollecting),
            },
            Command::CalSolve(method) => self.start_solving(method)?,
            Command::CalAdvise => {
                return self.advice.map(|advice| Effect::Reply(Ok(Reply::Advice(advice)))).ok_or(Refusal::NotSolved);
            }
            // A save that has begun is finished: half a save is nobody's wish.
            Command::CalAbort if matches!(self.phase, Phase::Saving(_)) => return Err(Refusal::Busy),
            Command::CalAbort => {
                self.collector.begin(Procedure::Turns);
                self.phase = Phase::Idle;
            }
            Command::CalClear => return Ok(self.save(Pending::Clear)),
            Command::CalUndo => return self.undo(),
            Command::Report => return Ok(Effect::Reply(Ok(Reply::Report(self.report())))),
            Command::SetAlign(heading_deg) => return self.align(heading_deg, now),
            Command::StreamOn(_)
            | Command::StreamRate(_)
            | Command::SetDeclination(_)
            | Command::SetMount(_)
            | Command::SetInclination(_) => return self.change(command),
        }
        Ok(Effect::Reply(Ok(Reply::Done(self.state()))))
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
    fn align(&mut self, heading_deg: Option<f32>, now: WrappingMillis) -> Result<Effect, Refusal> {
        let mut settings = self.settings;
        settings.align_deg = 0.0;
        if let Some(heading_deg) = heading_deg {
            in_circle(heading_deg)?;
            let calibration = &self.in_use().ok_or(Refusal::NoCalibration)?.calibration;
            let now = self.recent.steady(now).ok_or(Refusal::NotSteady)?;
            let shown_rad = now.attitude.level(calibration.apply(now.field)).heading_rad();
            settings.align_deg = wrap_pi(heading_deg.to_radians() - shown_rad).to_degrees();
        }
        Ok(self.save(Pending::Settings(settings)))
    }

    fn undo(&mut self) -> Result<Effect, Refusal> {
        self.generations.previous.as_ref().ok_or(Refusal::NothingToUndo)?;
        Ok(self.save(Pending::Undo))
    }

    /// A settings command, as a change to be saved.
    fn change(&mut self, command: Command) -> Result<Effect, Refusal> {
        let mut settings = self.settings;
        let range = match command {
            Command::StreamRate(hz) => {
                settings.stream_rate_hz = hz;
                "a rate is 1 to 80 sentences a second"
            }
            Command::SetDeclination(deg) => {
                settings.declination_deg = deg;
                "a declination is -180 to 180 degrees"
            }
            Command::SetMount(mount) => {
                settings.mount = mount;
                "a mounting is one of the 24 right-angle ones"
            }
            Command::SetInclination(deg) => {
                settings.inclination_deg = deg;
                "an inclination is -90 to 90 degrees, positive down"
            }
            Command::StreamOn(on) => {
                settings.stream_on = on;
                "on or off"
            }
            _ => "not a setting",
        };
        if settings.is_valid() { Ok(self.save(Pending::Settings(settings))) } else { Err(Refusal::OutOfRange(range)) }
    }

    fn save(&mut self, what: Pending) -> Effect {
        self.pending = Some(what);
        Effect::Save
    }

    fn start_solving(&mut self, method: Option<Method>) -> Result<(), Refusal> {
        self.sensor.ok_or(Refusal::NoSensor)?;
        if self.collector.fit().all().next().is_none() {
            return Err(Refusal::NoSamples);
        }
        let inclination_rad = self.settings.inclination_deg.map(f32::to_radians);
        let prior = Prior { mount: self.settings.mount, inclination_rad, readings_per_sample: averager::READINGS };
        let supported = || ladder::choose(self.collector.fit(), self.collector.procedure(), &prior);
        let method = method.map_or_else(supported, Ok).map_err(Refusal::Solve)?;
        let solver = Solver::new(method, to_fit(&self.collector), &prior).map_err(Refusal::Solve)?;
        self.phase = Phase::Solving(solver);
        Ok(())
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
                Solving::Finished(Err(error)) => self.end(Err(Refusal::Solve(error))),
            },
            Phase::Verifying(_) => self.judge(),
            Phase::Idle | Phase::Collecting | Phase::Saving(_) => Effect::None,
        }
    }

    #[inline(never)]
    fn judge(&mut self) -> Effect {
        let Phase::Verifying(candidate) = &self.phase else { return Effect::None };
        match self.verify(candidate) {
            Ok(record) => {
                self.phase = Phase::Saving(record);
                self.save(Pending::Calibration)
            }
            Err(refusal) => self.end(Err(refusal)),
        }
    }

    /// Whether a candidate may replace the calibration in use; its record if it may.
    #[inline(never)]
    fn verify(&self, candidate: &Solution) -> Result<Record, Refusal> {
        let sensor = self.sensor.ok_or(Refusal::NoSensor)?;
        let selection = Selection::of(self.collector.fit(), self.collector.procedure());
        let held_back = selection.from(self.collector.held_back());
        let (have, need) = (fewest(&to_fit(&self.collector), &held_back), self.config.min_held_back);
        if have < need {
            return Err(Refusal::TooFewHeldBack { have, need });
        }
        let expected_rms_deg = candidate.quality.expected_rms_deg;
        // What is not a number is not accurate either.
        if expected_rms_deg.is_nan() || expected_rms_deg > self.config.max_expected_rms_deg {
            return Err(Refusal::NotAccurate { expected_rms_deg });
        }
        let in_use = self.in_use();
        let incumbent =
            in_use.map_or_else(|| Calibration::uncalibrated(self.settings.mount), |record| record.calibration);
        let knows_attitude = self.collector.procedure() != Procedure::Tumble;
        let scores = verification::verify(held_back, knows_attitude, &candidate.calibration, &incumbent);
        let better = scores.candidate < scores.incumbent;
        if !better {
            return Err(Refusal::NotBetter { candidate: scores.candidate, incumbent: scores.incumbent });
        }
        if let Some(in_use) = in_use {
            self.not_thinner(candidate, in_use, scores)?;
        }
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

    /// Thin data never make the heading worse than the calibration in use: held-back samples of a thin flight show no
    /// more than those it was fitted to.
    fn not_thinner(&self, candidate: &Solution, in_use: &Record, scores: Scores) -> Result<(), Refusal> {
        let (new, old) = (candidate.quality, in_use.quality);
        let thinner = new.expected_rms_deg > self.config.thinner_by * old.expected_rms_deg
            || (old.is_of_everything() && !new.is_of_everything());
        let contradicted = scores.incumbent > self.config.contradicted_by * scores.candidate;
        if thinner && !contradicted {
            let (expected_rms_deg, incumbent_rms_deg) = (new.expected_rms_deg, old.expected_rms_deg);
            return Err(Refusal::Thinner { expected_rms_deg, incumbent_rms_deg });
        }
        Ok(())
    }

    #[inline(never)]
    fn saved(&mut self, result: Result<(), StoreError>) -> Effect {
        match (self.pending.take(), result) {
            (Some(Pending::Calibration), Ok(())) => match &self.phase {
                Phase::Saving(record) => {
                    self.generations.push(record);
                    let quality = record.quality;
                    self.end(Ok(quality))
                }
                _ => Effect::None,
            },
            (Some(Pending::Calibration), Err(error)) => self.end(Err(Refusal::Store(error))),
            (Some(_), Err(error)) => Effect::Reply(Err(Refusal::Store(error))),
            (Some(Pending::Undo), Ok(())) => {
                self.generations.undo();
                self.done()
            }
            (Some(Pending::Clear), Ok(())) => {
                self.generations.clear();
                self.done()
            }
            (Some(Pending::Settings(settings)), Ok(())) => {
                self.settings = settings;
                self.done()
            }
            (None, _) => Effect::None,
        }
    }

    fn done(&self) -> Effect {
        Effect::Reply(Ok(Reply::Done(self.state())))
    }

    /// A solve has ended; the samples stay for another with other settings.
    fn end(&mut self, outcome: Outcome) -> Effect {
        self.phase = Phase::Idle;
        self.last = Some(outcome.clone());
        Effect::Notify(outcome)
    }

    fn report(&self) -> Report {
        Report {
            state: self.state(),
            progress: self.collector.progress(),
            settings: self.settings,
            current: self.generations.current.as_ref().map(Summary::from),
            has_previous: self.generations.previous.is_some(),
            last: self.last.clone(),
        }
    }
}

/// The samples that a solve uses.
fn to_fit(collector: &Collector) -> Samples<'_> {
    Selection::of(collector.fit(), collector.procedure()).from(collector.fit())
}

/// How many samples were held back of the part with the fewest, of those that were fitted to. Marks have none of their
/// own: what was seen between them is held back.
fn fewest(fitted: &Samples<'_>, held_back: &Samples<'_>) -> u16 {
    let parts = [(fitted.left, held_back.left), (fitted.right, held_back.right), (fitted.level, held_back.level)];
    let counts = parts.iter().filter(|(fitted, _)| !fitted.is_empty()).map(|(_, held_back)| held_back.len());
    counts.min().unwrap_or(0) as u16
}

fn in_circle(heading_deg: f32) -> Result<(), Refusal> {
    if (0.0..=360.0).contains(&heading_deg) {
        Ok(())
    } else {
        Err(Refusal::OutOfRange("a magnetic heading is 0 to 360 degrees"))
    }
}
