//! Faults of the field: hard-iron changes, currents, passing objects, moving iron, hysteresis, another place.

use std::cell::Cell;
use std::f64::consts::PI;

use nalgebra::{Matrix3, Rotation3, Vector3};

use crate::faults::fault_switch::FaultSwitch;
use crate::random::{RandomStream, StreamPurpose};
use crate::world::TrueState;
use crate::world::airframe::Airframe;
use crate::world::earth::Earth;
pub use crate::world::fault_interfaces::FieldFault;
use crate::world::rotation::Euler;

/// Permanent hard-iron change, or zero drift of a warming sensor: at once or while the switch is on, then constant;
/// microtesla, chip axes.
#[must_use]
pub fn hard_iron_change(switch: FaultSwitch, change_ut: Vector3<f64>) -> impl FieldFault {
    move |truth: &TrueState| change_ut * switch.changed_fraction(truth.time_us)
}

/// Hard iron that relaxes to a new value, as of a magnetised part that warms; microtesla, chip axes.
#[must_use]
pub fn hard_iron_drift(switch: FaultSwitch, change_ut: Vector3<f64>, time_constant_s: f64) -> impl FieldFault {
    move |truth: &TrueState| {
        let on_for_s = switch.active_for_s(truth.time_us).unwrap_or(0.0);
        change_ut * (1.0 - libm::exp(-on_for_s / time_constant_s))
    }
}

/// Passing magnetic object: a raised cosine over the active time; its peak in microtesla, chip axes.
#[must_use]
pub fn passing_object(switch: FaultSwitch, peak_ut: Vector3<f64>) -> impl FieldFault {
    move |&TrueState { time_us, .. }: &TrueState| {
        let proximity = if switch.is_on(time_us) {
            (1.0 - libm::cos(2.0 * PI * switch.elapsed_fraction(time_us))) / 2.0
        } else {
            0.0
        };
        peak_ut * proximity
    }
}

/// Interference in proportion to throttle, which is constant before the onset; then it changes every few seconds
/// within 0.5 s. `full_throttle_ut`: change from cruise to full throttle, microtesla, chip axes.
#[must_use]
pub fn throttle_interference(switch: FaultSwitch, full_throttle_ut: Vector3<f64>, seed: u64) -> impl FieldFault {
    let mut random = RandomStream::new(seed, StreamPurpose::Throttle);
    // Times since the onset (seconds) and new throttle values, -1..1 relative to cruise.
    let mut throttle_changes = vec![(0.0, 0.0)];
    let mut at_s = 0.0;
    while at_s < 3600.0 {
        at_s += random.uniform(3.0, 12.0);
        throttle_changes.push((at_s, random.uniform(-1.0, 1.0)));
    }
    move |truth: &TrueState| {
        let Some(active_s) = switch.active_for_s(truth.time_us) else { return Vector3::zeros() };
        let next = throttle_changes.partition_point(|&(from_s, _)| from_s <= active_s);
        let (from_s, new_throttle) = throttle_changes[next - 1];
        let old_throttle = throttle_changes[next.saturating_sub(2)].1;
        let fraction = ((active_s - from_s) / 0.5).min(1.0);
        full_throttle_ut * (old_throttle + (new_throttle - old_throttle) * fraction)
    }
}

/// Bank at which an elevator linkage reaches the end of its range, degrees: that of the calibration turns.
const FULL_DEFLECTION_BANK_DEG: f64 = 25.0;

/// Iron in the linkage of the elevator, which deflects in turns by the load factor less one (W. F. Phillips, Mechanics
/// of Flight, 2010, 6.4). `full_deflection_ut`: field at 25 deg of bank and above, microtesla, chip axes.
#[must_use]
pub fn elevator_linkage(full_deflection_ut: Vector3<f64>) -> impl FieldFault {
    move |truth: &TrueState| full_deflection_ut * elevator_deflection(truth)
}

/// Elevator deflection, relative to that at 25 deg of bank.
fn elevator_deflection(truth: &TrueState) -> f64 {
    let deflection = |bank_rad: f64| 1.0 / libm::cos(bank_rad) - 1.0;
    (deflection(truth.roll_rad) / deflection(FULL_DEFLECTION_BANK_DEG.to_radians())).clamp(0.0, 1.0)
}

/// Iron in the linkage of the elevator whose field follows the deflection with a time constant, as iron that the
/// linkage magnetises.
pub struct LaggingLinkage {
    full_deflection_ut: Vector3<f64>,
    time_constant_s: f64,
    /// Time of the newest state, microseconds, and its deflection with the lag.
    newest_deflection: Cell<(u64, f64)>,
}

impl LaggingLinkage {
    /// `full_deflection_ut`: field in a long turn at 25 deg of bank, microtesla, chip axes.
    #[must_use]
    pub fn new(full_deflection_ut: Vector3<f64>, time_constant_s: f64) -> Self {
        Self { full_deflection_ut, time_constant_s, newest_deflection: Cell::new((0, 0.0)) }
    }
}

impl FieldFault for LaggingLinkage {
    fn added_field_ut(&self, truth: &TrueState) -> Vector3<f64> {
        let (newest_us, mut deflection) = self.newest_deflection.get();
        if truth.time_us > newest_us {
            let step_s = (truth.time_us - newest_us) as f64 / 1e6;
            deflection += (elevator_deflection(truth) - deflection) * (1.0 - libm::exp(-step_s / self.time_constant_s));
            self.newest_deflection.set((truth.time_us, deflection));
        }
        self.full_deflection_ut * deflection
    }

    fn steady_field_ut(&self, truth: &TrueState) -> Vector3<f64> {
        self.full_deflection_ut * elevator_deflection(truth)
    }
}

/// Hysteresis of the soft iron: its magnetisation turns with the field only after a play (the play operator of M. A.
/// Krasnosel'skii and A. V. Pokrovskii, Systems with Hysteresis, 1989), so that it lags in a turn, and in the following
/// straight flight remains as the turn left it.
pub struct SoftIronHysteresis {
    /// Field of the soft iron in chip axes per unit of field in body axes.
    soft_iron: Matrix3<f64>,
    earth: Earth,
    play_rad: f64,
    /// Heading at which the soft iron would have its present magnetisation without hysteresis; `None` at the start.
    magnetisation_heading_rad: Cell<Option<f64>>,
}

impl SoftIronHysteresis {
    /// Hysteresis of an airframe's soft iron.
    #[must_use]
    pub fn new(airframe: &Airframe, earth: Earth, play_deg: f64) -> Self {
        Self {
            soft_iron: airframe.soft_iron(),
            earth,
            play_rad: play_deg.to_radians(),
            magnetisation_heading_rad: Cell::new(None),
        }
    }

    pub(super) fn lag_field_ut(&self, truth: &TrueState, magnetisation_heading_rad: f64) -> Vector3<f64> {
        let body_ut = |heading_rad| self.earth.body_field_ut(Euler { heading_rad, ..truth.euler_angles() });
        self.soft_iron * (body_ut(magnetisation_heading_rad) - body_ut(truth.heading_rad))
    }
}

impl FieldFault for SoftIronHysteresis {
    fn added_field_ut(&self, truth: &TrueState) -> Vector3<f64> {
        let heading_rad = truth.heading_rad;
        let before_rad = self.magnetisation_heading_rad.get().unwrap_or(heading_rad);
        let now_rad = before_rad.clamp(heading_rad - self.play_rad, heading_rad + self.play_rad);
        self.magnetisation_heading_rad.set(Some(now_rad));
        self.lag_field_ut(truth, now_rad)
    }

    /// Field in a long turn; in level flight, the mean of the fields after a left and after a right turn.
    fn steady_field_ut(&self, truth: &TrueState) -> Vector3<f64> {
        let lag_rad = if truth.roll_rad == 0.0 { 0.0 } else { self.play_rad.copysign(truth.roll_rad) };
        self.lag_field_ut(truth, truth.heading_rad - lag_rad)
    }
}

/// Hysteresis of soft iron along each body axis: the field of the iron follows that of the Earth only after a play, as
/// the play operator does.
pub struct AxisHysteresis {
    /// Field of the iron in chip axes per field of its magnetisation in body axes.
    iron: Matrix3<f64>,
    earth: Earth,
    play_ut: f64,
    /// Field in body axes that has magnetised the iron, microtesla; `None` at the start.
    magnetising_ut: Cell<Option<Vector3<f64>>>,
}

impl AxisHysteresis {
    /// Iron with this susceptibility beside the airframe's own. `play_ut`: half width of the loop.
    #[must_use]
    pub fn new(airframe: &Airframe, earth: Earth, susceptibility: f64, play_ut: f64) -> Self {
        let mounting = Rotation3::from_matrix(&airframe.field_matrix).into_inner();
        Self { iron: mounting * susceptibility, earth, play_ut, magnetising_ut: Cell::new(None) }
    }

    fn play_output_ut(&self, before_ut: Vector3<f64>, truth: &TrueState) -> Vector3<f64> {
        let now_ut = self.earth.body_field_ut(truth.euler_angles());
        before_ut.zip_map(&now_ut, |before, now| before.clamp(now - self.play_ut, now + self.play_ut))
    }
}

impl FieldFault for AxisHysteresis {
    fn added_field_ut(&self, truth: &TrueState) -> Vector3<f64> {
        let output_ut = self.play_output_ut(self.magnetising_ut.get().unwrap_or_default(), truth);
        self.magnetising_ut.set(Some(output_ut));
        self.iron * output_ut
    }

    /// Field after two circles to the side of the bank, or to the right in level flight.
    fn steady_field_ut(&self, truth: &TrueState) -> Vector3<f64> {
        const STEPS: i32 = 144;
        let step_rad = 2.0 * PI / f64::from(STEPS / 2) * if truth.roll_rad < 0.0 { -1.0 } else { 1.0 };
        let output_ut = (0..=STEPS).rev().fold(Vector3::zeros(), |output_ut, steps_to_go| {
            let heading_rad = truth.heading_rad - f64::from(steps_to_go) * step_rad;
            self.play_output_ut(output_ut, &TrueState { heading_rad, ..*truth })
        });
        self.iron * output_ut
    }
}

/// A module that turns about the body's z axis in its mount, within an airframe whose iron stays or turns with it.
pub struct MountTurnFault {
    /// Active while the module turns.
    pub fault_switch: FaultSwitch,
    /// Airframe of the module.
    pub airframe: Airframe,
    /// Share of the hard iron that turns with the module.
    pub turning_iron_share: f64,
    /// Earth's field at the place of the flight.
    pub earth: Earth,
    /// Final turn, degrees, clockwise as seen from above.
    pub turn_deg: f64,
}

impl FieldFault for MountTurnFault {
    fn added_field_ut(&self, truth: &TrueState) -> Vector3<f64> {
        let Airframe { field_matrix: a, hard_iron_ut: b_ut } = self.airframe;
        let field_ut = a * self.earth.body_field_ut(truth.euler_angles()) + b_ut * (1.0 - self.turning_iron_share);
        let axis = Rotation3::from_matrix(&a) * Vector3::z_axis();
        let turn_rad = self.turn_deg.to_radians() * self.fault_switch.changed_fraction(truth.time_us);
        // The field turns the other way in the module's axes.
        Rotation3::from_axis_angle(&axis, -turn_rad) * field_ut - field_ut
    }
}

/// Another place with another field.
pub struct OtherPlace {
    /// Time in which the aircraft is at the other place.
    pub fault_switch: FaultSwitch,
    /// Earth's field at that place.
    pub earth: Earth,
}

impl FieldFault for OtherPlace {
    fn replacement_earth(&self, at_us: u64) -> Option<Earth> {
        self.fault_switch.is_on(at_us).then_some(self.earth)
    }
}
