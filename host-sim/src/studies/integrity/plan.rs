//! Extent of a run, and its attitude source.

use autoswing::settings::HeadingKind;
use simulator::world::aircraft::VehicleKind;
use simulator::world::far_end::FarEnd;
use simulator::world::msp_autopilot::{self, AnswerFaults};

/// Extent of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct IntegrityPlan {
    /// Flights per case.
    pub flights: u64,
    /// Seed of the first flight; later flights use consecutive seeds.
    pub seed: u64,
    /// Heading selected for output.
    pub heading: HeadingKind,
    /// Vehicle kind.
    pub aircraft: VehicleKind,
    /// Attitude source.
    pub source: AttitudeProtocol,
}

/// Protocol of the attitude source.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum AttitudeProtocol {
    /// MAVLink autopilot with body rates.
    #[default]
    Mavlink,
    /// ArduPilot with MSP: polled attitude in tenths of a degree, without body rates.
    Msp,
}

impl AttitudeProtocol {
    pub(super) const fn far_end(self) -> FarEnd {
        match self {
            Self::Mavlink => FarEnd::Talker,
            Self::Msp => FarEnd::Msp(
                msp_autopilot::MspFirmware::ArduPilot,
                AnswerFaults { dropped: 0.0, rejected: 0.0, truncated: 0.0, delayed: 0.0 },
            ),
        }
    }
}
