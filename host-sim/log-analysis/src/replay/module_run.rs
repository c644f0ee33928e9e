//! Drives the module's state machine with the samples of a log, as its tasks do, and takes its result.

use autoswing::calibration::method_selection::Procedure;
use autoswing::calibration::{Sample, Solution};
use autoswing::collection::{Collector, RetainedSamples};
use autoswing::reading::{Identity, MagnetometerModel};
use autoswing::time::WrappingMillis;
use autoswing_module::compass::{Command, Compass, Effect, Event};
use autoswing_module::messages::{Message, Refusal};
use autoswing_module::settings::Settings;
use autoswing_module::store::StoredValues;

use super::result::{CalibrationOutcome, EarthFieldPrior};
use super::row_solve::sample_time_s;

/// Arbitrary sensor identity, since samples are already averaged and nothing is stored.
const PLACEHOLDER_SENSOR: Identity = Identity { model: MagnetometerModel::Lis3mdl, address: 0x1E };

/// An uncalibrated module that collects samples by one procedure.
pub struct ModuleRun<'a> {
    compass: Compass<'a>,
    /// Last solution that was verified, accepted or not.
    candidate: Option<Solution>,
    /// Result of the collection, once it has ended.
    outcome: Option<Result<(), Refusal>>,
    ended_s: Option<f64>,
    /// The last collection that ended and was refused.
    refused_run: Option<CalibrationOutcome>,
}

impl<'a> ModuleRun<'a> {
    /// A module at the start of a collection.
    pub fn new(
        procedure: Procedure,
        prior: &EarthFieldPrior,
        readings_per_sample: u16,
        retained: &'a mut RetainedSamples,
    ) -> Self {
        let inclination_deg = prior.inclination_deg.map(|degrees| degrees as f32);
        let settings = Settings { inclination_deg, ..Settings::DEFAULT };
        let stored = StoredValues { settings, ..StoredValues::default() };
        let compass = Compass::new(&stored, retained);
        let mut module = Self { compass, candidate: None, outcome: None, ended_s: None, refused_run: None };
        module.process_event(Event::SensorDetected(PLACEHOLDER_SENSOR, readings_per_sample));
        if let Some((place, day)) = prior.place_and_day {
            module.process_event(Event::Position(place, WrappingMillis::default()));
            module.process_event(Event::Date(day));
        }
        module.process_event(command_event(Command::CalStart(procedure)));
        module
    }

    /// Collects samples until the module is calibrated. An uncalibrated module in flight collects again after a
    /// refusal.
    pub fn collect_samples(&mut self, samples: &[Sample]) {
        for &sample in samples {
            self.process_event(Event::Sample(sample));
            let Some(outcome) = &self.outcome else { continue };
            let is_calibrated = outcome.is_ok();
            self.ended_s = Some(sample_time_s(&sample));
            if is_calibrated {
                return;
            }
            self.refused_run = Some(self.run_outcome());
            (self.candidate, self.outcome, self.ended_s) = (None, None, None);
            self.process_event(command_event(Command::CalStart(self.collector().procedure())));
        }
    }

    /// Samples of the collection.
    #[must_use]
    pub const fn collector(&self) -> &Collector<'a> {
        self.compass.collector()
    }

    /// Time of the automatic end of the collection, seconds after the first row.
    #[must_use]
    pub const fn ended_s(&self) -> Option<f64> {
        self.ended_s
    }

    /// The module's result; a collection that has not ended is solved by command. If that is refused, too, the result
    /// is the last refusal of a collection that ended.
    pub(super) fn into_outcome(mut self) -> CalibrationOutcome {
        if self.outcome.is_none() {
            self.candidate = None;
            self.process_event(command_event(Command::CalSolve(None)));
        }
        let outcome = self.run_outcome();
        self.refused_run.take().filter(|_| outcome.acceptance.is_err()).unwrap_or(outcome)
    }

    fn run_outcome(&self) -> CalibrationOutcome {
        let [fit_samples, _] = self.compass.collector().selected_samples();
        CalibrationOutcome {
            solution: self.candidate,
            acceptance: self.outcome.clone().unwrap_or(Err(Refusal::NoSamples)),
            fitted_count: fit_samples.all_samples().count(),
            collection_end_s: self.ended_s,
        }
    }

    /// Processes an event, and all steps of the solve and the save that it starts.
    fn process_event(&mut self, event: Event) {
        let mut effect = self.compass.process_event(event);
        loop {
            if let Some(candidate) = self.compass.candidate_solution() {
                self.candidate = Some(*candidate);
            }
            let next = match effect {
                Effect::Save => Event::Saved(Ok(())),
                _ if self.compass.needs_solve_step() => Event::AdvanceSolve,
                _ => break,
            };
            effect = self.compass.process_event(next);
        }
        match effect {
            Effect::Notify(Message::Solved(outcome)) => self.outcome = Some(outcome.map(|_| ())),
            Effect::Reply(Err(refusal)) => self.outcome = Some(Err(refusal)),
            _ => {}
        }
    }
}

fn command_event(command: Command) -> Event {
    Event::Command(command, WrappingMillis::default())
}
