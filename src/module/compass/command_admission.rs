//! Admission of commands: the only place that refuses them because of the armed state, a solve or a save.

use super::activity::{Activity, Solve, SolvePurpose};
use crate::compass::events::{AutopilotAction, Command};
use crate::compass::state::Compass;
use crate::messages::Refusal;
use crate::settings::DependentState;
use autoswing::calibration::method_selection::Procedure;
use autoswing::time::WrappingMillis;

impl Compass<'_> {
    /// Refuses a command that the present state does not allow. Ends a trial solve that the command would wait for.
    pub(super) fn admit_command(&mut self, command: Command, now: WrappingMillis) -> Result<(), Refusal> {
        let is_armed = self.armed_state.reported_state() == Some(true);
        // A restart, which a port may send, is refused in flight, even if the vehicle is reported disarmed.
        if (is_armed && self.requires_disarmed(command))
            || (command == Command::Restart && self.armed_state.is_in_flight(now))
        {
            return Err(Refusal::Armed);
        }
        let waits_for_solve = match command {
            Command::Status | Command::StatusAll | Command::CalShow | Command::CalAdvise | Command::Autopilot(_) => {
                return Ok(());
            }
            Command::CalAbort | Command::KeepReplacedNumber(_) | Command::Restart => false,
            Command::Set(setting) | Command::SetFromBus(setting) => setting.affects(DependentState::Solve),
            _ => true,
        };
        // A save is always completed.
        if self.pending_change().is_some() {
            return Err(Refusal::Busy);
        }
        match self.activity {
            Activity::Solving(Solve { purpose: SolvePurpose::Trial(starter), .. }) if waits_for_solve => {
                self.resume_collection(starter);
                Ok(())
            }
            Activity::Solving(_) if waits_for_solve => Err(Refusal::Busy),
            _ => Ok(()),
        }
    }

    /// Whether a command would interrupt the heading in flight, or needs a stationary vehicle.
    fn requires_disarmed(&self, command: Command) -> bool {
        match command {
            Command::CalStart(procedure) | Command::CalStartNew(Some(procedure)) => procedure == Procedure::Swing,
            Command::CalStartNew(None) => self.collector.procedure() == Procedure::Swing,
            Command::CalMark(_)
            | Command::CalClear
            | Command::CalUndo
            | Command::SetFromBus(_)
            | Command::ResetSettings
            | Command::Autopilot(AutopilotAction::Setup | AutopilotAction::Undo | AutopilotAction::Restart)
            | Command::Restart => true,
            Command::Set(change) => change.affects(DependentState::Calibration),
            Command::CalStop
            | Command::CalSolve(_)
            | Command::CalAdvise
            | Command::CalAbort
            | Command::CalShow
            | Command::Status
            | Command::StatusAll
            | Command::KeepReplacedNumber(_)
            | Command::Autopilot(AutopilotAction::Check)
            | Command::Align(_)
            | Command::AlignConfirmed(_) => false,
        }
    }
}
