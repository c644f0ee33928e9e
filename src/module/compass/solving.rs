//! Solve, verification and acceptance of a candidate calibration.

use super::activity::{Activity, CollectionStarter, Solve, SolvePurpose, SolveStage};
use crate::compass::events::Effect;
use crate::compass::state::Compass;
use crate::messages::{Message, Refusal, SolveOutcome};
use crate::store::CalibrationRecord;
use autoswing::acceptance::{self, AcceptanceSamples, Incumbent};
use autoswing::calibration::method_selection::{self, Procedure};
use autoswing::calibration::{Method, Prior, Solution, SolveProgress as Solving, Solver};
use autoswing::collection::{CollectionState, MIN_HELD_BACK_WHEN_COMPLETE};
use autoswing::reading::Identity;

const _: () = assert!(acceptance::MIN_HELD_BACK_SAMPLES <= MIN_HELD_BACK_WHEN_COMPLETE);

impl Compass<'_> {
    pub(super) fn start_solving(&mut self, method: Option<Method>, purpose: SolvePurpose) -> Result<(), Refusal> {
        self.samples_during_solve.clear();
        let sensor = self.sensor.ok_or(Refusal::NoSensor)?;
        if self.collector.fit_samples().all_samples().next().is_none() {
            return Err(Refusal::NoSamples);
        }
        let supported = || method_selection::select_method(self.collector.fit_samples(), self.collector.procedure());
        let method = method.map_or_else(supported, Ok).map_err(Refusal::Solve)?;
        let settings = self.stored_settings();
        let prior = Prior {
            mount: settings.mount,
            inclination_rad: self.effective_settings().inclination_deg.map(f32::to_radians),
            is_inclination_modelled: settings.inclination_deg.is_none(),
            readings_per_sample: sensor.readings_per_sample,
        };
        let consider = settings.attitude_error_sigmas();
        let solver = Solver::with_consider_sigmas(method, self.collector.selected_samples()[0], &prior, consider)
            .map_err(Refusal::Solve)?;
        self.activity = Activity::Solving(Solve { stage: SolveStage::Fitting(solver), purpose, sensor });
        Ok(())
    }

    #[inline(never)]
    pub(super) fn advance_solve(&mut self) -> Effect {
        let Activity::Solving(solve) = &mut self.activity else { return Effect::None };
        let purpose = solve.purpose;
        match &mut solve.stage {
            SolveStage::Fitting(solver) => match solver.solve_step(self.collector.selected_samples()[0]) {
                Solving::Continue => Effect::None,
                Solving::Finished(Ok(solution)) => {
                    self.advice = solution.advice;
                    solve.stage = SolveStage::Verifying(solution);
                    Effect::None
                }
                Solving::Finished(Err(error)) => self.end_solve(purpose, Err(Refusal::Solve(error))),
            },
            SolveStage::Verifying(_) => self.verify_candidate(),
            SolveStage::Saving(_) => Effect::None,
        }
    }

    #[inline(never)]
    fn verify_candidate(&mut self) -> Effect {
        let Activity::Solving(Solve { stage: SolveStage::Verifying(candidate), purpose, sensor }) = &self.activity
        else {
            return Effect::None;
        };
        let (mut purpose, sensor) = (*purpose, *sensor);
        let accepted = self.record_if_accepted(candidate, sensor.identity);
        if let SolvePurpose::Trial(starter) = purpose {
            let refusal = accepted.as_ref().err().cloned();
            self.collector.use_trial_solution(candidate);
            if !self.trial_solves.record_result(candidate, refusal, self.storage.values().settings.accuracy_deg) {
                self.resume_collection(starter);
                return Effect::None;
            }
            // A sufficient trial becomes the calibration, and ends an automatic collection, too, whether or not the
            // save succeeds.
            purpose = SolvePurpose::Calibration(None);
        }
        match accepted {
            Ok(record) => {
                self.activity = Activity::Solving(Solve { stage: SolveStage::Saving(record), purpose, sensor });
                Effect::Save
            }
            Err(refusal) => self.end_solve(purpose, Err(refusal)),
        }
    }

    /// The record to save if the candidate is accepted.
    #[inline(never)]
    fn record_if_accepted(&self, candidate: &Solution, sensor: Identity) -> Result<CalibrationRecord, Refusal> {
        let [fit_samples, held_back_samples] = self.collector.selected_samples();
        let grounds = AcceptanceSamples {
            fit_samples,
            held_back_samples,
            is_attitude_known: self.collector.procedure() != Procedure::Tumble,
        };
        acceptance::evaluate_candidate(candidate, grounds, &self.incumbent()).map_err(Refusal::Rejected)?;
        Ok(CalibrationRecord {
            calibration: candidate.calibration,
            quality: candidate.quality,
            uncertainty: candidate.uncertainty,
            sensor,
            mount: self.stored_settings().mount,
            serial_number: self.storage.calibration_serial().wrapping_add(1),
            sensor_offsets: self.sensor_offsets,
        })
    }

    fn incumbent(&self) -> Incumbent {
        self.active_record().map_or_else(
            || Incumbent::uncalibrated(self.stored_settings().mount),
            |record| Incumbent { calibration: record.calibration, quality: Some(record.quality) },
        )
    }

    /// Ends a solve; keeps the samples.
    pub(super) fn end_solve(&mut self, purpose: SolvePurpose, outcome: SolveOutcome) -> Effect {
        let outcome = outcome.map_err(|refusal| refusal.with_cause(self.sample_deficiency()));
        match (purpose, &outcome) {
            (SolvePurpose::Trial(starter), Err(refusal)) => {
                self.trial_solves.record_failure(refusal.clone());
                self.resume_collection(starter);
                return Effect::None;
            }
            (SolvePurpose::Calibration(Some(CollectionStarter::Module)), Err(_)) => {
                self.resume_collection(CollectionStarter::Module);
            }
            _ => {
                self.collector.reset_restart_count();
                self.collector.set_state(CollectionState::Inactive);
                self.activity = Activity::Idle;
            }
        }
        let message = Message::Solved(outcome);
        self.last_collection_outcome = Some(message.clone());
        Effect::Notify(message)
    }
}
