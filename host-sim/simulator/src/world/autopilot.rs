//! Minimal autopilot: flies a plan of legs or holds a command.

use std::collections::VecDeque;

use super::state::TrueState;

/// Bank per heading error on a straight leg, dimensionless; settles in about 5 s without overshoot.
const BANK_PER_HEADING_ERROR: f64 = 1.0;
/// Largest bank that corrects a heading error on a straight leg, degrees.
const MAX_CORRECTION_BANK_DEG: f64 = 25.0;
/// Bank of an aeroplane in a yaw leg, degrees.
const YAW_LEG_BANK_DEG: f64 = 20.0;

/// Leg of a flight plan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Leg {
    /// Turn to a magnetic heading by the shorter direction and hold it, wings level.
    Straight {
        /// Heading in degrees.
        heading_deg: f64,
        /// Duration including the turn, seconds.
        seconds: f64,
    },
    /// Turn at a constant bank.
    Turn {
        /// Bank magnitude in degrees; the sign of the heading change selects the side.
        bank_deg: f64,
        /// Heading change in degrees, positive to the right; 360 is a full circle.
        heading_change_deg: f64,
    },
    /// Turn at a constant rate: in hover if possible, otherwise while moving. An aeroplane turns at a fixed bank
    /// instead.
    Yaw {
        /// Turn rate magnitude in degrees per second; the sign of the heading change selects the side.
        rate_deg_s: f64,
        /// Heading change in degrees, positive to the right; 360 is a full circle.
        heading_change_deg: f64,
    },
    /// Hover at the present heading; vehicles that cannot hover continue straight.
    Hover {
        /// Duration in seconds.
        seconds: f64,
    },
    /// Tilt to a side at the present heading for the whole leg; the next leg cancels the velocity. Vehicles that cannot
    /// hover continue straight.
    Tilt {
        /// Direction of the tilt, degrees clockwise from the nose.
        toward_deg: f64,
        /// Tilt in degrees.
        tilt_deg: f64,
        /// Duration in seconds.
        seconds: f64,
    },
}

/// Commanded horizontal motion. Vehicles that cannot hover always move forward.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum TranslationMode {
    /// Move forward at cruise speed.
    #[default]
    Forward,
    /// Hold the position.
    HoldPosition,
    /// Hold a constant tilt in a direction (multirotor).
    HoldTilt {
        /// Direction, radians clockwise from the nose.
        toward_rad: f64,
        /// Tilt in radians.
        tilt_rad: f64,
    },
}

/// Command to the vehicle model.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct VehicleCommand {
    /// Bank in radians, right wing down positive.
    pub bank_rad: f64,
    /// Pitch in radians, nose up positive.
    pub pitch_rad: f64,
    /// Turn rate of vehicles that turn without banking, radians per second.
    pub turn_rate_rad_s: f64,
    /// Horizontal motion that a hovering vehicle is commanded.
    pub translation_mode: TranslationMode,
}

impl VehicleCommand {
    /// Turn rate of vehicles that cannot bank, rad/s: the commanded rate in yaw legs, otherwise numerically the
    /// commanded bank in radians.
    pub(super) fn flat_turn_rate_rad_s(&self) -> f64 {
        if self.translation_mode == TranslationMode::Forward { self.bank_rad } else { self.turn_rate_rad_s }
    }
}

#[derive(Clone, Copy, Debug)]
struct ActiveLeg {
    leg: Leg,
    began_us: u64,
    began_heading_rad: f64,
}

/// Executes legs in order; without legs holds the last command, initially straight and level, or
/// hover.
#[derive(Clone, Debug, Default)]
pub struct Autopilot {
    plan: VecDeque<Leg>,
    active_leg: Option<ActiveLeg>,
    held_command: VehicleCommand,
    command_without_plan: VehicleCommand,
}

impl Autopilot {
    /// An autopilot that hovers (`hovers`) or moves straight ahead when its plan is empty.
    #[must_use]
    pub fn new(hovers: bool) -> Self {
        let translation_mode = if hovers { TranslationMode::HoldPosition } else { TranslationMode::Forward };
        let command_without_plan = VehicleCommand { translation_mode, ..VehicleCommand::default() };
        Self { held_command: command_without_plan, command_without_plan, ..Self::default() }
    }

    /// Appends a leg. After the last leg the vehicle continues wings level, or hovers.
    pub fn append_leg(&mut self, leg: Leg) {
        self.held_command = self.command_without_plan;
        self.plan.push_back(leg);
    }

    /// Clears the plan and holds a bank and a pitch.
    pub fn hold_bank_and_pitch(&mut self, bank_deg: f64, pitch_deg: f64) {
        self.clear_plan();
        let (bank_rad, pitch_rad) = (bank_deg.to_radians(), pitch_deg.to_radians());
        self.held_command = VehicleCommand { bank_rad, pitch_rad, ..VehicleCommand::default() };
    }

    /// Clears the plan; the vehicle continues wings level, or hovers.
    pub fn clear_plan(&mut self) {
        self.plan.clear();
        self.active_leg = None;
        self.held_command = self.command_without_plan;
    }

    /// Number of unfinished legs, the present one included.
    #[must_use]
    pub fn unfinished_leg_count(&self) -> usize {
        self.plan.len() + usize::from(self.active_leg.is_some())
    }

    pub(super) fn next_command(&mut self, state: &TrueState) -> VehicleCommand {
        if self.active_leg.is_some_and(|active| active.is_done(state)) {
            self.active_leg = None;
        }
        if self.active_leg.is_none() {
            self.active_leg = self.plan.pop_front().map(|leg| ActiveLeg {
                leg,
                began_us: state.time_us,
                began_heading_rad: state.heading_rad,
            });
        }
        self.active_leg.map_or(self.held_command, |active| active.vehicle_command(state))
    }
}

impl ActiveLeg {
    fn is_done(&self, state: &TrueState) -> bool {
        match self.leg {
            Leg::Straight { seconds, .. } | Leg::Hover { seconds } | Leg::Tilt { seconds, .. } => {
                (state.time_us - self.began_us) as f64 >= seconds * 1e6
            }
            Leg::Turn { heading_change_deg, .. } | Leg::Yaw { heading_change_deg, .. } => {
                let turned_deg = (state.heading_rad - self.began_heading_rad).to_degrees();
                turned_deg * heading_change_deg.signum() >= heading_change_deg.abs()
            }
        }
    }

    fn vehicle_command(&self, state: &TrueState) -> VehicleCommand {
        let banked = |bank_deg: f64| VehicleCommand { bank_rad: bank_deg.to_radians(), ..VehicleCommand::default() };
        match self.leg {
            Leg::Straight { heading_deg, .. } => {
                let error_deg = (heading_deg - state.heading_deg() + 180.0).rem_euclid(360.0) - 180.0;
                banked((BANK_PER_HEADING_ERROR * error_deg).clamp(-MAX_CORRECTION_BANK_DEG, MAX_CORRECTION_BANK_DEG))
            }
            Leg::Turn { bank_deg, heading_change_deg } => banked(bank_deg.abs() * heading_change_deg.signum()),
            Leg::Yaw { rate_deg_s, heading_change_deg } => {
                let side_sign = heading_change_deg.signum();
                let turn_rate_rad_s = rate_deg_s.abs().to_radians() * side_sign;
                VehicleCommand {
                    turn_rate_rad_s,
                    translation_mode: TranslationMode::HoldPosition,
                    ..banked(YAW_LEG_BANK_DEG * side_sign)
                }
            }
            Leg::Hover { .. } => {
                VehicleCommand { translation_mode: TranslationMode::HoldPosition, ..VehicleCommand::default() }
            }
            Leg::Tilt { toward_deg, tilt_deg, .. } => {
                let [toward_rad, tilt_rad] = [toward_deg, tilt_deg].map(f64::to_radians);
                VehicleCommand {
                    translation_mode: TranslationMode::HoldTilt { toward_rad, tilt_rad },
                    ..VehicleCommand::default()
                }
            }
        }
    }
}
