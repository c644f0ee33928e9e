//! All cases, in words.

use std::f64::consts::TAU;

use super::{Case, What};
use crate::world::attitude_source::Kind as Sender;

/// Degrees of a radian.
const DEG: f64 = 360.0 / TAU;

const fn case(name: &'static str, what: What, says: &'static str) -> Case {
    Case { name, says, what }
}

/// All of them, in the order of the table.
pub static CASES: &[Case] = &[
    case("clean", What::Nothing, "nothing"),
    case("ten-hours", What::TenHours, "nothing, one flight of ten hours"),
    case("stuck-x", What::Stuck([true, false, false]), "the sensor's x axis repeats"),
    case("stuck-y", What::Stuck([false, true, false]), "the sensor's y axis repeats"),
    case("stuck-z", What::Stuck([false, false, true]), "the sensor's z axis repeats"),
    case("stuck-all", What::Stuck([true; 3]), "all axes of the sensor repeat"),
    case("stuck-noisy", What::StuckNoisy, "all axes of the sensor repeat, but for their noise"),
    case("sensor-spikes", What::SensorSpikes, "1 % of readings off by 30 uT"),
    case("sensor-noise", What::SensorNoise, "five times the sensor's noise"),
    case("sensor-clipped", What::SensorClipped, "an axis ends within the circle"),
    case("upset-scale", What::Upset { register: 0x21, bits: 0x20 }, "a full-scale bit flips"),
    case("upset-self-test", What::Upset { register: 0x20, bits: 0x01 }, "the self-test bit flips"),
    case("upset-byte-order", What::Upset { register: 0x23, bits: 0x02 }, "the byte-order bit flips"),
    case("frozen-level", What::FrozenLevel, "attitude repeats from level flight on"),
    case("frozen-turn", What::FrozenTurning, "attitude repeats from a turn on"),
    case("frozen-coarse", What::FrozenCoarse, "attitude in tenths of a degree repeats from a turn on"),
    case("coarse", What::Coarse, "attitude in tenths of a degree, nothing wrong"),
    case("spikes", What::AttitudeSpikes, "1 % of attitude frames wrong by 45 deg"),
    case("foreign", What::Foreign(Some(Sender::Other)), "a gimbal sends attitude, too, 5 deg off"),
    case("foreign-silent", What::Foreign(None), "another sends attitude, too, 5 deg off, and no heartbeat"),
    case("bias-2", What::Bias(2.0), "attitude bias of 2 deg"),
    case("bias-5", What::Bias(5.0), "attitude bias of 5 deg"),
    case("aligning", What::Aligning, "attitude swings on the ground, as of a filter that aligns"),
    case("lean-70", What::Lean(0.7), "attitude reads 70 % of the bank"),
    case("lean-30", What::Lean(0.3), "attitude reads 30 % of the bank"),
    case("late-200", What::Late(200), "attitude 200 ms later"),
    case("late-300", What::Late(300), "attitude 300 ms later"),
    case("late-500", What::Late(500), "attitude 500 ms later"),
    case("rates-zero", What::Rates(0.0), "body rates are sent as nothing"),
    case("rates-small", What::Rates(1.0 / DEG), "body rates in radians are sent as degrees, 57 times too slow"),
    case("rates-degrees", What::Rates(DEG), "body rates are sent in degrees, 57 times too fast"),
    case("rates-sign", What::Rates(-1.0), "body rates are sent with the wrong sign"),
    case("moved-2", What::Moved(2.0), "hard iron moved by 2 uT"),
    case("moved-3", What::Moved(3.0), "hard iron moved by 3 uT"),
    case("moved-5", What::Moved(5.0), "hard iron moved by 5 uT"),
    case("moved-10", What::Moved(10.0), "hard iron moved by 10 uT"),
    case("throttle-5", What::Throttle(5.0), "a current of 5 uT follows the throttle"),
    case("throttle-10", What::Throttle(10.0), "a current of 10 uT follows the throttle"),
    case("warming", What::Warming, "the sensor's zero drifts from 0 to 10 uT"),
    case("passing-10-1s", What::Passing { peak_ut: 10.0, for_s: 1.0 }, "iron of 10 uT passes within 1 s"),
    case("passing-10-5s", What::Passing { peak_ut: 10.0, for_s: 5.0 }, "iron of 10 uT passes within 5 s"),
    case("passing-10-30s", What::Passing { peak_ut: 10.0, for_s: 30.0 }, "iron of 10 uT passes within 30 s"),
    case("passing-50-30s", What::Passing { peak_ut: 50.0, for_s: 30.0 }, "iron of 50 uT passes within 30 s"),
    case("ferry", What::Ferry, "used 1,000 km away"),
    case("cal-moved-2", What::CalibrationMoved(2.0), "payload of 2 uT moved while calibrating"),
    case("cal-moved-5", What::CalibrationMoved(5.0), "payload of 5 uT moved while calibrating"),
    case("cal-moved-10", What::CalibrationMoved(10.0), "payload of 10 uT moved while calibrating"),
    case("cal-warming", What::CalibrationWarming, "the zero drifts from 0 to 10 uT while calibrating"),
    case("cal-bank-5", What::ShallowTurns, "calibration turns at 5 deg of bank"),
    case("cal-clipped", What::CalibrationClipped, "an axis ends within the circles"),
    case("cal-lean-90", What::CalibrationLean(0.9), "attitude always reads 90 % of the bank"),
    case("cal-hover", What::Hover, "calibration by yaw turns in hover alone"),
    case("pushed", What::Pushed(2.0), "attitude always twice as wrong while it is pushed about"),
    case(
        "current-5",
        What::Current { ut: 5.0, is_told: false },
        "a current of 5 uT in hover follows the thrust, always",
    ),
    case(
        "current-20",
        What::Current { ut: 20.0, is_told: false },
        "a current of 20 uT in hover follows the thrust, always",
    ),
    case("current-5-told", What::Current { ut: 5.0, is_told: true }, "the same, and the autopilot tells the current"),
    case("current-20-told", What::Current { ut: 20.0, is_told: true }, "20 uT, and the autopilot tells the current"),
];
