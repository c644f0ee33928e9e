//! Extent of a run, and its sources of attitude.

use autoswing::attitude::AttitudeSource;
use autoswing_module::settings::HeadingKind;
use serde::Deserialize;
use simulator::world::aircraft::VehicleKind;
use simulator::world::cable_far_end::FarEnd;
use simulator::world::msp_autopilot::{AnswerFaults, MspFirmware};

/// Extent of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct IntegrityPlan {
    /// Flights per case.
    pub flights_per_case: u64,
    /// Seed of the first flight; later flights use consecutive seeds.
    pub seed: u64,
    /// Heading selected for output.
    pub heading: HeadingKind,
    /// Vehicle kind.
    pub aircraft: VehicleKind,
    /// Protocol of the autopilot.
    pub attitude_protocol: AttitudeProtocol,
    /// Attitude of the module in cases that do not choose it.
    pub attitude: AttitudeSource,
}

/// Protocol of the autopilot.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum AttitudeProtocol {
    /// MAVLink autopilot with body rates.
    #[default]
    Mavlink,
    /// ArduPilot with MSP: polled attitude in tenths of a degree, heading in degrees, without body rates.
    Msp,
    /// INAV with MSP: also polled body rates in degrees per second.
    MspInav,
}

impl AttitudeProtocol {
    pub(super) const fn far_end(self) -> FarEnd {
        match self {
            Self::Mavlink => FarEnd::SendOnly,
            Self::Msp => FarEnd::Msp(MspFirmware::ArduPilot, AnswerFaults::NO_FAULTS),
            Self::MspInav => FarEnd::Msp(MspFirmware::Inav, AnswerFaults::NO_FAULTS),
        }
    }
}
