//! Table of all cases.

use std::f64::consts::TAU;

use super::{Case, FaultKind};
use crate::world::attitude_source::SenderKind as Sender;

const DEG: f64 = 360.0 / TAU;

const fn case(name: &'static str, what: FaultKind, says: &'static str) -> Case {
    Case { name, description: says, fault: what }
}

/// All cases in the order of the report.
pub static CASES: &[Case] = &[
    case("clean", FaultKind::Nothing, "nothing"),
    case("ten-hours", FaultKind::TenHours, "nothing, one flight of ten hours"),
    case("stuck-x", FaultKind::Stuck([true, false, false]), "the sensor's x axis repeats"),
    case("stuck-y", FaultKind::Stuck([false, true, false]), "the sensor's y axis repeats"),
    case("stuck-z", FaultKind::Stuck([false, false, true]), "the sensor's z axis repeats"),
    case("stuck-all", FaultKind::Stuck([true; 3]), "all axes of the sensor repeat"),
    case("stuck-noisy", FaultKind::StuckNoisy, "all axes of the sensor repeat, but for their noise"),
    case("sensor-spikes", FaultKind::SensorSpikes, "1 % of readings off by 30 uT"),
    case("sensor-noise", FaultKind::SensorNoise, "five times the sensor's noise"),
    case("sensor-clipped", FaultKind::SensorClipped, "an axis ends within the circle"),
    case("upset-scale", FaultKind::Upset { register: 0x21, bits: 0x20 }, "a full-scale bit flips"),
    case("upset-self-test", FaultKind::Upset { register: 0x20, bits: 0x01 }, "the self-test bit flips"),
    case("upset-byte-order", FaultKind::Upset { register: 0x23, bits: 0x02 }, "the byte-order bit flips"),
    case("frozen-level", FaultKind::FrozenLevel, "attitude repeats from level flight on"),
    case("frozen-turn", FaultKind::FrozenTurning, "attitude repeats from a turn on"),
    case("frozen-coarse", FaultKind::FrozenCoarse, "attitude in tenths of a degree repeats from a turn on"),
    case("coarse", FaultKind::Coarse, "attitude in tenths of a degree, nothing wrong"),
    case("spikes", FaultKind::AttitudeSpikes, "1 % of attitude frames wrong by 45 deg"),
    case("foreign", FaultKind::Foreign(Some(Sender::Other)), "a gimbal sends attitude, too, 5 deg off"),
    case("foreign-silent", FaultKind::Foreign(None), "another sends attitude, too, 5 deg off, and no heartbeat"),
    case("bias-2", FaultKind::Bias(2.0), "attitude bias of 2 deg"),
    case("bias-5", FaultKind::Bias(5.0), "attitude bias of 5 deg"),
    case("aligning", FaultKind::Aligning, "attitude swings on the ground, as of a filter that aligns"),
    case("lean-70", FaultKind::Lean(0.7), "attitude reads 70 % of the bank"),
    case("lean-30", FaultKind::Lean(0.3), "attitude reads 30 % of the bank"),
    case("late-200", FaultKind::Late(200), "attitude 200 ms later"),
    case("late-300", FaultKind::Late(300), "attitude 300 ms later"),
    case("late-500", FaultKind::Late(500), "attitude 500 ms later"),
    case("rates-zero", FaultKind::Rates(0.0), "body rates are sent as nothing"),
    case("rates-small", FaultKind::Rates(1.0 / DEG), "body rates in radians are sent as degrees, 57 times too slow"),
    case("rates-degrees", FaultKind::Rates(DEG), "body rates are sent in degrees, 57 times too fast"),
    case("rates-sign", FaultKind::Rates(-1.0), "body rates are sent with the wrong sign"),
    case("moved-2", FaultKind::Moved(2.0), "hard iron moved by 2 uT"),
    case("moved-3", FaultKind::Moved(3.0), "hard iron moved by 3 uT"),
    case("moved-5", FaultKind::Moved(5.0), "hard iron moved by 5 uT"),
    case("moved-10", FaultKind::Moved(10.0), "hard iron moved by 10 uT"),
    case("throttle-5", FaultKind::Throttle(5.0), "a current of 5 uT follows the throttle"),
    case("throttle-10", FaultKind::Throttle(10.0), "a current of 10 uT follows the throttle"),
    case("warming", FaultKind::Warming, "the sensor's zero drifts from 0 to 10 uT"),
    case("passing-10-1s", FaultKind::Passing { peak_ut: 10.0, for_s: 1.0 }, "iron of 10 uT passes within 1 s"),
    case("passing-10-5s", FaultKind::Passing { peak_ut: 10.0, for_s: 5.0 }, "iron of 10 uT passes within 5 s"),
    case("passing-10-30s", FaultKind::Passing { peak_ut: 10.0, for_s: 30.0 }, "iron of 10 uT passes within 30 s"),
    case("passing-50-30s", FaultKind::Passing { peak_ut: 50.0, for_s: 30.0 }, "iron of 50 uT passes within 30 s"),
    case("ferry", FaultKind::Ferry, "used 1,000 km away"),
    case("cal-moved-2", FaultKind::CalibrationMoved(2.0), "payload of 2 uT moved while calibrating"),
    case("cal-moved-5", FaultKind::CalibrationMoved(5.0), "payload of 5 uT moved while calibrating"),
    case("cal-moved-10", FaultKind::CalibrationMoved(10.0), "payload of 10 uT moved while calibrating"),
    case("cal-warming", FaultKind::CalibrationWarming, "the zero drifts from 0 to 10 uT while calibrating"),
    case("cal-bank-5", FaultKind::ShallowTurns, "calibration turns at 5 deg of bank"),
    case("cal-clipped", FaultKind::CalibrationClipped, "an axis ends within the circles"),
    case("cal-lean-90", FaultKind::CalibrationLean(0.9), "attitude always reads 90 % of the bank"),
    case("cal-hover", FaultKind::Hover, "calibration by yaw turns in hover alone"),
    case("pushed", FaultKind::Pushed(2.0), "attitude always twice as wrong while it is pushed about"),
    case(
        "current-5",
        FaultKind::Current { ut: 5.0, is_reported: false },
        "a current of 5 uT in hover follows the thrust, always",
    ),
    case(
        "current-20",
        FaultKind::Current { ut: 20.0, is_reported: false },
        "a current of 20 uT in hover follows the thrust, always",
    ),
    case(
        "current-5-told",
        FaultKind::Current { ut: 5.0, is_reported: true },
        "the same, and the autopilot reports the current",
    ),
    case(
        "current-20-told",
        FaultKind::Current { ut: 20.0, is_reported: true },
        "20 uT, and the autopilot reports the current",
    ),
];
