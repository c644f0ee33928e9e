//! The one state machine of the module: uncalibrated -> collecting -> solving -> verifying -> calibrated.
//!
//! [`Compass::step`] takes an [`Event`] and says what is to be done ([`Effect`]); it waits for nothing and touches no
//! hardware. A solve is cut into [`Event::Advance`] steps, so that whoever drives the machine can do other work between
//! them. The calibration in use is replaced only by one that was verified on held-back samples, beats it there, and is
//! completely written.

mod messages;
mod refusal;

pub use messages::{Command, Effect, Event, Outcome, Reply, Report, Save, State};
pub use refusal::Refusal;

use crate::calibration::{Calibration, Method, Prior, Progress as Solving, Sample, Solution, Solver, verification};
use crate::magnetometer::Identity;
use crate::store::{Generations, Record, Settings, StoreError};
use crate::turns::Collector;

/// Fixed numbers of the machine.
#[derive(Clone, Copy, Debug)]
pub struct Config {
    /// A calibration expected to be worse than this is refused, degrees RMS: an uncalibrated compass in a clean
    /// airframe is about as good.
    pub max_expected_rms_deg: f32,
    /// Held-back samples needed on each side: one for every sector but a few.
    pub min_held_back: u16,
}

impl Config {
    /// Numbers for every vehicle.
    pub const DEFAULT: Self = Self { max_expected_rms_deg: 3.0, min_held_back: 8 };
}

/// What runs now.
#[allow(clippy::large_enum_variant, reason = "there is one of it, and no heap to put it on")]
#[derive(Debug)]
enum Phase {
    Idle,
    Collecting,
    Solving(Solver),
    Verifying(Solution),
    Saving,
}

/// The state machine. About 20 KB, most of it samples.
#[derive(Debug)]
pub struct Compass {
    config: Config,
    settings: Settings,
    generations: Generations,
    sensor: Option<Identity>,
    collector: Collector,
    phase: Phase,
    last: Option<Outcome>,
}

impl Compass {
    /// The machine at start, with what flash held.
    #[must_use]
    pub const fn new(config: Config, settings: Settings, generations: Generations) -> Self {
        Self {
            config,
            settings,
            generations,
            sensor: None,
            collector: Collector::new(),
            phase: Phase::Idle,
            last: None,
        }
    }

    /// Whether [`Event::Advance`] is wanted.
    #[must_use]
    pub fn is_busy(&self) -> bool {
        matches!(self.phase, Phase::Solving(_) | Phase::Verifying(_))
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
            Phase::Verifying(_) | Phase::Saving => State::Verifying,
            Phase::Idle if self.in_use().is_some() => State::Calibrated,
            Phase::Idle => State::Uncalibrated,
        }
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
            Event::Command(command) => match self.command(command) {
                Ok(effect) => effect,
                Err(refusal) => Effect::Reply(Err(refusal)),
            },
            Event::Advance => self.advance(),
            Event::Saved(save, result) => self.saved(save, result),
        }
    }

    #[inline(never)]
    fn sample(&mut self, sample: Sample) -> Effect {
        if !matches!(self.phase, Phase::Collecting) {
            return Effect::None;
        }
        self.collector.push(sample);
        if !self.collector.progress().is_complete() {
            return Effect::None;
        }
        match self.start_solving() {
            Ok(()) => Effect::None,
            Err(refusal) => self.end(Err(refusal)),
        }
    }

    #[inline(never)]
    fn command(&mut self, command: Command) -> Result<Effect, Refusal> {
        let runs = self.is_busy() || matches!(self.phase, Phase::Saving);
        let asks_only = matches!(command, Command::Report | Command::CalAbort);
        if runs && !asks_only {
            return Err(Refusal::Busy);
        }
        match command {
            Command::CalStart => {
                self.sensor.ok_or(Refusal::NoSensor)?;
                self.collector.clear();
                self.phase = Phase::Collecting;
            }
            Command::CalStop => match self.phase {
                Phase::Collecting => self.phase = Phase::Idle,
                _ => return Err(Refusal::NotCollecting),
            },
            Command::CalSolve => self.start_solving()?,
            // A save that has begun is finished: half a save is nobody's wish.
            Command::CalAbort if matches!(self.phase, Phase::Saving) => return Err(Refusal::Busy),
            Command::CalAbort => {
                self.collector.clear();
                self.phase = Phase::Idle;
            }
            Command::CalClear => return Ok(Effect::Save(Save::Clear(Generations::default()))),
            Command::CalUndo => return self.undo(),
            Command::Report => return Ok(Effect::Reply(Ok(Reply::Report(self.report())))),
            Command::StreamOn(_) | Command::StreamRate(_) | Command::SetDeclination(_) | Command::SetMount(_) => {
                return self.change(command);
            }
        }
        Ok(Effect::Reply(Ok(Reply::Done(self.state()))))
    }

    fn undo(&self) -> Result<Effect, Refusal> {
        self.generations.previous.as_ref().ok_or(Refusal::NothingToUndo)?;
        let mut generations = self.generations;
        generations.undo();
        Ok(Effect::Save(Save::Undo(generations)))
    }

    /// A settings command, as a change to be saved.
    fn change(&self, command: Command) -> Result<Effect, Refusal> {
        let mut settings = self.settings;
        let range = match command {
            Command::StreamRate(hz) => {
                settings.stream_rate_hz = hz;
                "a rate is 1 to 80 sentences a second"
            }
            Command::SetDeclination(deg) => {
                settings.declination_deg = Some(deg);
                "a declination is -180 to 180 degrees"
            }
            Command::SetMount(mount) => {
                settings.mount = mount;
                "a mounting is one of the 24 right-angle ones"
            }
            Command::StreamOn(on) => {
                settings.stream_on = on;
                "on or off"
            }
            _ => "not a setting",
        };
        if settings.is_valid() { Ok(Effect::Save(Save::Settings(settings))) } else { Err(Refusal::OutOfRange(range)) }
    }

    fn start_solving(&mut self) -> Result<(), Refusal> {
        self.sensor.ok_or(Refusal::NoSensor)?;
        let turns = self.collector.dataset().fit();
        if turns.left.is_empty() && turns.right.is_empty() {
            return Err(Refusal::NoSamples);
        }
        let prior = Prior { mount: self.settings.mount, inclination_rad: None };
        match Solver::new(Method::MaximumLikelihood, turns, &prior) {
            Ok(solver) => self.phase = Phase::Solving(solver),
            Err(error) => return Err(Refusal::Solve(error)),
        }
        Ok(())
    }

    /// One step of a solve or the verification.
    #[inline(never)]
    fn advance(&mut self) -> Effect {
        match &mut self.phase {
            Phase::Solving(solver) => match solver.step(self.collector.dataset().fit()) {
                Solving::Continue => Effect::None,
                Solving::Finished(Ok(solution)) => {
                    self.phase = Phase::Verifying(solution);
                    Effect::None
                }
                Solving::Finished(Err(error)) => self.end(Err(Refusal::Solve(error))),
            },
            Phase::Verifying(solution) => {
                let solution = *solution;
                match self.verify(&solution) {
                    Ok(generations) => {
                        self.phase = Phase::Saving;
                        Effect::Save(Save::Calibration(generations))
                    }
                    Err(refusal) => self.end(Err(refusal)),
                }
            }
            Phase::Idle | Phase::Collecting | Phase::Saving => Effect::None,
        }
    }

    /// Whether a candidate may replace the calibration in use; what is to be stored if it may.
    fn verify(&self, solution: &Solution) -> Result<Generations, Refusal> {
        let Solution { calibration: candidate, quality, uncertainty, .. } = solution;
        let sensor = self.sensor.ok_or(Refusal::NoSensor)?;
        let held_back = self.collector.dataset().held_back();
        let have = held_back.left.len().min(held_back.right.len()) as u16;
        if have < self.config.min_held_back {
            return Err(Refusal::TooFewHeldBack { have, need: self.config.min_held_back });
        }
        let expected_rms_deg = quality.expected_rms_deg;
        // What is not a number is not accurate either.
        if expected_rms_deg.is_nan() || expected_rms_deg > self.config.max_expected_rms_deg {
            return Err(Refusal::NotAccurate { expected_rms_deg });
        }
        let incumbent =
            self.in_use().map_or(Calibration::uncalibrated(self.settings.mount), |record| record.calibration);
        let scores = verification::verify(held_back, candidate, &incumbent);
        let better = scores.candidate < scores.incumbent;
        if !better {
            return Err(Refusal::NotBetter { candidate: scores.candidate, incumbent: scores.incumbent });
        }
        let mut generations = self.generations;
        generations.push(Record {
            calibration: *candidate,
            quality: *quality,
            uncertainty: *uncertainty,
            sensor,
            mount: self.settings.mount,
            serial: generations.current.as_ref().map_or(1, |current| current.serial.wrapping_add(1)),
        });
        Ok(generations)
    }

    fn saved(&mut self, save: Save, result: Result<(), StoreError>) -> Effect {
        match (save, result) {
            (Save::Calibration(generations), Ok(())) => {
                let outcome = generations.current.as_ref().map(|record| record.quality).ok_or(Refusal::NoSamples);
                self.generations = generations;
                self.end(outcome)
            }
            (Save::Calibration(_), Err(error)) => self.end(Err(Refusal::Store(error))),
            (Save::Undo(generations) | Save::Clear(generations), Ok(())) => {
                self.generations = generations;
                self.done()
            }
            (Save::Settings(settings), Ok(())) => {
                self.settings = settings;
                self.done()
            }
            (_, Err(error)) => Effect::Reply(Err(Refusal::Store(error))),
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
            current: self.generations.current,
            previous: self.generations.previous,
            last: self.last.clone(),
        }
    }
}
