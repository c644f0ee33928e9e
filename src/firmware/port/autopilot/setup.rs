//! Check and setup of the autopilot's parameters: finds the compass that is the module, then compares each parameter of
//! the table with its wanted number, and writes it if asked to. An undo writes the numbers of before the setup.
//!
//! Parameters of other compasses are read only as far as their ids. A parameter is written while the autopilot reports
//! that it is disarmed, and after its number is kept in flash. A report waits until it was taken, and the next parameter
//! waits for it.

use libm::roundf;

use super::parameter_client::{ParameterClient, ParameterError, is_same_number};
use super::wanted_parameters::{
    COMPASS_COUNT, CalibrationStage, PARAMETER_ROWS, ParameterRow, SetupLink, device_id_count, device_id_name,
};
use autoswing::frames::{Body, Field};
use autoswing::time::Timestamp;
use autoswing::trig::VectorLength as _;
use autoswing_module::compass::{AutopilotAction, Command};
use autoswing_module::messages::{
    AutopilotReport, CompassPriority, ParameterCounts, ParameterName, ParameterReport, ParameterState,
    RegisteredCompass, WantedNumber,
};
use autoswing_module::replaced_numbers::{AutopilotKind, ParameterOwner, ReplacedNumber, ReplacedNumbers};

/// INAV's `mag_hardware` without a compass.
const NO_COMPASS_CHOICE: f32 = 0.0;

/// Difference of a gain from the field strength that changes nothing, relative.
const MAX_STRENGTH_DIFFERENCE: f32 = 0.02;

/// Time after which a number that is not kept yet is passed on again, microseconds; a save takes 50 ms.
const KEEP_TIMEOUT_US: u64 = 1_000_000;

/// Attempts to keep a number, until the setup ends.
const KEEP_ATTEMPTS: u8 = 5;

/// What a line knows of its autopilot.
#[derive(Clone, Copy, Debug)]
pub struct AutopilotState {
    pub kind: AutopilotKind,
    /// Whether it reports that it is disarmed.
    pub is_disarmed: bool,
    /// Trims of roll and pitch that are removed from its attitude, degrees.
    pub trims_deg: [f32; 2],
    /// Number of the choice `MSP` in the setting that was read last.
    pub msp_choice: Option<f32>,
}

/// What check and setup depend on.
#[derive(Clone, Copy, Debug)]
pub(super) struct SetupContext<'a> {
    pub now: Timestamp,
    pub autopilot: AutopilotState,
    /// Number of the module's node on a CAN bus.
    pub can_node: Option<u8>,
    pub sends_vision_yaw: bool,
    pub is_calibrated: bool,
    /// Magnetic heading of a calibrated module, degrees, if there is one now.
    pub heading_deg: Option<f32>,
    /// Field that the module sends as a compass.
    pub field: Option<Field<Body>>,
    /// Numbers that are kept in flash.
    pub replaced_numbers: &'a ReplacedNumbers,
}

/// A number that is to be kept, or forgotten, before the next step.
#[derive(Debug)]
struct Keeping {
    replaced: ReplacedNumber,
    /// Number to write afterwards; none if one is forgotten.
    next_number: Option<f32>,
    attempts: u8,
    requested_at: Timestamp,
}

/// Check, setup or undo in progress.
#[derive(Debug, Default)]
pub(super) struct AutopilotSetup {
    /// What is in progress.
    action: Option<AutopilotAction>,
    kind: Option<AutopilotKind>,
    /// Index of the id, then of the row of the table.
    step: u8,
    /// ArduPilot's device ids by priority.
    priority_ids: [u32; COMPASS_COUNT as usize],
    /// Slot and priority of the module, counted from 1; PX4 has no priority, 0, INAV's one compass neither.
    module_compass: Option<(u8, u8)>,
    /// Whether INAV was told to save its settings.
    is_saved: bool,
    /// First slot of PX4 without a compass, counted from 1.
    free_slot: Option<u8>,
    /// Whether the autopilot has answered.
    has_reply: bool,
    /// Number before the write in progress.
    number_before: Option<f32>,
    keeping: Option<Keeping>,
    /// Command for the state machine.
    command: Option<Command>,
    counts: ParameterCounts,
    report: Option<AutopilotReport>,
}

impl AutopilotSetup {
    /// Begins a check, a setup or an undo.
    pub fn begin(&mut self, action: AutopilotAction, kind: AutopilotKind) {
        let step = if action == AutopilotAction::Undo { device_id_count(kind) } else { 0 };
        let module_compass = (kind == AutopilotKind::Inav).then_some((0, 0));
        *self = Self { action: Some(action), kind: Some(kind), step, module_compass, ..Self::default() };
    }

    pub const fn is_running(&self) -> bool {
        self.action.is_some()
    }

    pub const fn has_report(&self) -> bool {
        self.report.is_some()
    }

    /// Takes the next report; the check goes on afterwards.
    pub const fn take_report(&mut self) -> Option<AutopilotReport> {
        self.report.take()
    }

    /// Takes a command for the state machine.
    pub const fn take_command(&mut self) -> Option<Command> {
        self.command.take()
    }

    /// Continues: processes the result of the last read or write, and begins the next. On a line that has got another
    /// kind of autopilot it ends.
    pub fn advance(&mut self, context: SetupContext<'_>, client: &mut ParameterClient) {
        if self.kind != Some(context.autopilot.kind) {
            return self.end(AutopilotReport::NoReply);
        }
        if self.report.is_some() || self.awaits_keeping(context, client) {
            return;
        }
        if let Some(result) = client.take_result() {
            self.has_reply |= result != Err(ParameterError::NoReply);
            self.process_result(context, client, result);
        }
        if self.is_running() && self.keeping.is_none() && self.report.is_none() && client.is_idle() {
            self.begin_next_read(context, client);
        }
    }

    /// Passes a number on until it is kept, then writes the parameter; or until it is forgotten, then goes on.
    fn awaits_keeping(&mut self, context: SetupContext<'_>, client: &mut ParameterClient) -> bool {
        let Some(keeping) = &mut self.keeping else { return false };
        let ReplacedNumber { owner, row, number } = keeping.replaced;
        if context.replaced_numbers.number(owner, row) == number {
            match keeping.next_number {
                Some(number) => client.begin_write(number),
                None => self.step += 1,
            }
            self.keeping = None;
            return false;
        }
        if keeping.attempts > 0 && context.now.us_since(keeping.requested_at) < KEEP_TIMEOUT_US {
            return true;
        }
        if keeping.attempts == KEEP_ATTEMPTS {
            self.end(AutopilotReport::NotKept);
        } else {
            (keeping.attempts, keeping.requested_at) = (keeping.attempts + 1, context.now);
            self.command = Some(Command::KeepReplacedNumber(keeping.replaced));
        }
        true
    }

    fn owner(&self, row: &ParameterRow) -> ParameterOwner {
        ParameterOwner { kind: row.kind, compass: self.module_compass.unwrap_or_default() }
    }

    fn keep_number(&mut self, row: &ParameterRow, number: Option<f32>, next_number: Option<f32>) {
        let replaced = ReplacedNumber { owner: self.owner(row), row: row.position(), number };
        self.keeping = Some(Keeping { replaced, next_number, attempts: 0, requested_at: Timestamp::from_us(0) });
    }

    fn begin_next_read(&mut self, context: SetupContext<'_>, client: &mut ParameterClient) {
        if self.action == Some(AutopilotAction::Undo) {
            self.module_compass = Some(context.replaced_numbers.owner().compass);
        }
        if self.step == self.device_id_count() && self.module_compass.is_none() && !context.sends_vision_yaw {
            return self.end(AutopilotReport::NoCompass);
        }
        let rows_end = usize::from(self.device_id_count()) + PARAMETER_ROWS.len();
        while usize::from(self.step) < rows_end {
            if let Some(name) = self.name_of_step(context) {
                client.begin_read(name);
                return;
            }
            self.step += 1;
        }
        if context.autopilot.kind == AutopilotKind::Inav && self.counts.changed > 0 && !self.is_saved {
            self.is_saved = true;
            return client.begin_save();
        }
        if self.action == Some(AutopilotAction::Undo) {
            return self.end(if self.counts != ParameterCounts::default() {
                AutopilotReport::Summary(self.counts)
            } else if context.replaced_numbers.is_empty() {
                AutopilotReport::NothingReplaced
            } else {
                AutopilotReport::OtherAutopilot
            });
        }
        let has_trims = context.autopilot.trims_deg.iter().any(|trim_deg| *trim_deg != 0.0);
        let later_reports = [
            has_trims.then_some(AutopilotReport::Trims(context.autopilot.trims_deg)),
            context.heading_deg.filter(|_| self.action == Some(AutopilotAction::Check)).map(AutopilotReport::Heading),
        ];
        self.report = later_reports.into_iter().skip(usize::from(self.step) - rows_end).find_map(|report| {
            self.step += 1;
            report
        });
        if self.report.is_none() {
            self.end(AutopilotReport::Summary(self.counts));
        }
    }

    /// Name of the parameter of this step, if it concerns this autopilot and module.
    fn name_of_step(&self, context: SetupContext<'_>) -> Option<ParameterName> {
        if self.step < self.device_id_count() {
            return self.kind.map(|kind| device_id_name(kind, self.step));
        }
        let (slot, priority) = self.module_compass.unwrap_or_default();
        self.row().filter(|row| self.is_applicable(row, context)).map(|row| row.wanted.parameter_name(slot, priority))
    }

    fn device_id_count(&self) -> u8 {
        self.kind.map_or(0, device_id_count)
    }

    fn row(&self) -> Option<&'static ParameterRow> {
        PARAMETER_ROWS.get(usize::from(self.step.checked_sub(self.device_id_count())?))
    }

    fn is_applicable(&self, row: &'static ParameterRow, context: SetupContext<'_>) -> bool {
        let has_link = match row.link {
            SetupLink::Compass => self.module_compass.is_some(),
            SetupLink::Vision => context.sends_vision_yaw,
        };
        let is_stage = match row.stage {
            CalibrationStage::Always => true,
            CalibrationStage::Uncalibrated => !context.is_calibrated,
            CalibrationStage::Calibrated => context.is_calibrated,
        };
        let is_replaced = context.replaced_numbers.number(self.owner(row), row.position()).is_some();
        row.kind == context.autopilot.kind
            && if self.action == Some(AutopilotAction::Undo) { is_replaced } else { has_link && is_stage }
    }

    fn process_result(
        &mut self,
        context: SetupContext<'_>,
        client: &mut ParameterClient,
        result: Result<f32, ParameterError>,
    ) {
        if !self.has_reply {
            self.end(AutopilotReport::NoReply);
        } else if let Some(row) = self.row() {
            self.process_row(row, context, client, result);
        } else if self.step < self.device_id_count() {
            self.process_id(context, result.unwrap_or(0.0) as u32);
        }
    }

    fn process_id(&mut self, context: SetupContext<'_>, device_id: u32) {
        let is_px4 = context.autopilot.kind == AutopilotKind::Px4;
        let step = self.step;
        self.step += 1;
        let slot = (if is_px4 { step } else { step % COMPASS_COUNT }) + 1;
        match self.priority_ids.get_mut(usize::from(step)) {
            Some(priority_id) if !is_px4 => *priority_id = device_id,
            _ if device_id != 0 => self.process_compass(slot, device_id, context),
            _ => self.free_slot = self.free_slot.or(Some(slot)),
        }
        let has_all_ids = self.step == self.device_id_count();
        if is_px4 && has_all_ids && self.module_compass.is_none() && context.can_node.is_some() {
            self.module_compass = self.free_slot.map(|slot| (slot, 0));
        }
    }

    fn process_compass(&mut self, slot: u8, device_id: u32, context: SetupContext<'_>) {
        let is_module = is_device_of_module(device_id, context.can_node);
        let index = self.priority_ids.iter().position(|priority_id| *priority_id == device_id);
        let (priority, priority_number) = if context.autopilot.kind == AutopilotKind::Px4 {
            (CompassPriority::Px4, Some(0))
        } else {
            let number = index.map(|index| index as u8 + 1);
            (CompassPriority::ArduPilot(number), number)
        };
        if is_module {
            self.module_compass = priority_number.map(|priority| (slot, priority)).or(self.module_compass);
        }
        let compass = RegisteredCompass { slot, priority, device_id, is_module };
        self.report = Some(AutopilotReport::Compass(compass));
    }

    fn process_row(
        &mut self,
        row: &'static ParameterRow,
        context: SetupContext<'_>,
        client: &mut ParameterClient,
        result: Result<f32, ParameterError>,
    ) {
        let is_undo = self.action == Some(AutopilotAction::Undo);
        let read_number = result.unwrap_or(0.0);
        let replaced_number = context.replaced_numbers.number(self.owner(row), row.position());
        let wanted = match row.wanted.number {
            _ if is_undo => replaced_number.unwrap_or(read_number),
            WantedNumber::Fixed(number) => number,
            WantedNumber::AtLeast(least) => read_number.max(least),
            WantedNumber::Present => self.number_before.unwrap_or(read_number),
            WantedNumber::CanDevice if is_device_of_module(read_number as u32, context.can_node) => read_number,
            WantedNumber::CanDevice => context.can_node.map_or(read_number, px4_device_id),
            WantedNumber::MspCompass => context.autopilot.msp_choice.unwrap_or(read_number),
            WantedNumber::NoMspCompass => {
                let is_msp = context.autopilot.msp_choice.is_some_and(|choice| is_same_number(choice, read_number));
                if is_msp { NO_COMPASS_CHOICE } else { read_number }
            }
            WantedNumber::FieldStrength => {
                let strength_mg = context.field.map_or(read_number, |field| roundf(10.0 * field.ut.vector_length()));
                let is_near = (read_number - strength_mg).abs() <= MAX_STRENGTH_DIFFERENCE * strength_mg;
                if is_near { read_number } else { strength_mg }
            }
        };
        let is_rewritten = row.wanted.number == WantedNumber::Present;
        let is_right = is_same_number(read_number, wanted);
        let (number, state) = match (result, self.number_before) {
            (Ok(number), None) if self.is_to_write(row, context) && (!is_right || is_rewritten) => {
                self.number_before = Some(number);
                if !context.autopilot.is_disarmed {
                    self.end(AutopilotReport::Armed);
                } else if is_undo || is_rewritten || replaced_number.is_some() {
                    client.begin_write(wanted);
                } else {
                    self.keep_number(row, Some(number), Some(wanted));
                }
                return;
            }
            (Ok(number), None) => (number, (!is_right).then_some(ParameterState::Wrong)),
            (Ok(_), Some(before)) => {
                (before, (before.to_bits() != wanted.to_bits()).then_some(ParameterState::Changed))
            }
            (Err(ParameterError::NotChanged(number)), _) => (number, Some(ParameterState::NotChanged)),
            (Err(_), _) => (read_number, Some(ParameterState::Missing)),
        };
        match state {
            None => self.counts.right += 1,
            Some(ParameterState::Changed) => {
                self.counts.right += 1;
                self.counts.changed += 1;
                let is_inav = row.kind == AutopilotKind::Inav;
                self.counts.needs_restart |= is_inav || row.stage != CalibrationStage::Calibrated;
            }
            Some(ParameterState::Missing) => self.counts.missing += 1,
            Some(ParameterState::Wrong | ParameterState::NotChanged) => self.counts.wrong += 1,
        }
        self.report = state.map(|state| {
            let (slot, priority) = self.module_compass.unwrap_or_default();
            let report = ParameterReport { row: &row.wanted, slot, priority, state, number, wanted, is_undo };
            AutopilotReport::Parameter(report)
        });
        self.number_before = None;
        if is_undo && !matches!(state, Some(ParameterState::NotChanged | ParameterState::Missing)) {
            self.keep_number(row, None, None);
        } else {
            self.step += 1;
        }
    }

    /// Whether a parameter is written if it is wrong. A heading that is not trusted on the ground is not used in flight.
    fn is_to_write(&self, row: &ParameterRow, context: SetupContext<'_>) -> bool {
        match self.action {
            Some(AutopilotAction::Undo) => true,
            Some(AutopilotAction::Setup) => row.stage != CalibrationStage::Calibrated || context.heading_deg.is_some(),
            _ => false,
        }
    }

    /// Ends with a report.
    pub const fn end(&mut self, report: AutopilotReport) {
        (self.action, self.keeping) = (None, None);
        self.report = Some(report);
    }
}

/// Kind of bus in a device id: DroneCAN.
const DRONECAN_BUS: u32 = 3;

/// PX4's device id of a compass on the first CAN bus (mag.cpp and sensor_bridge.cpp of uavcan, drv_sensor.h).
fn px4_device_id(can_node: u8) -> f32 {
    const UAVCAN_MAGNETOMETER: u32 = 0x88;
    // Exact: 24 bits.
    (UAVCAN_MAGNETOMETER << 16 | u32::from(can_node) << 8 | DRONECAN_BUS) as f32
}

/// Whether a device id (ArduPilot's `AP_HAL::Device`, PX4's `device::Device`) is that of a compass by MSP, or of this
/// node's on a CAN bus.
pub fn is_device_of_module(device_id: u32, can_node: Option<u8>) -> bool {
    const MSP_BUS: u32 = 5;
    let (bus_kind, address) = (device_id & 7, device_id >> 8 & 0xFF);
    match bus_kind {
        MSP_BUS => true,
        DRONECAN_BUS => can_node.is_some_and(|node| u32::from(node) == address),
        _ => false,
    }
}
