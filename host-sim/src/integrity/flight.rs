//! One flight of a case: calibrate, then fly on and listen.

use autoswing::calibration::Calibration;
use autoswing::settings::HeadingKind;
use nalgebra::Vector3;

use super::Plan;
use super::case::{Case, Drawn, Onset};
use super::tally::{Judged, Tally};
use super::usage;
use crate::module::{Module, Ran};
use crate::nmea::{Reader, Received};
use crate::random::{Purpose, Random};
use crate::rig::Rig;
use crate::score::{Errors, wrap_180};
use crate::transcript::{self, Notice};
use crate::world::WorldConfig;
use crate::world::aircraft::Carried;
use crate::world::autopilot::Leg;
use crate::world::far_end::FarEnd;

/// An accepted calibration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Calibrated {
    /// What the module expects of it, degrees RMS.
    pub expected_deg: f64,
    /// What it is: RMS heading error at exact field and true attitude, with the iron there is at the end of the
    /// calibration.
    pub true_deg: f64,
    /// From its beginning until it was accepted, seconds.
    pub took_s: f64,
}

impl Calibrated {
    /// True over expected.
    #[must_use]
    pub fn ratio(&self) -> f64 {
        self.true_deg / self.expected_deg
    }
}

/// How far what the module says of iron that moved is from what did, of its size. It is asked after a full turn each way;
/// 1 if it says nothing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IronError(pub f64);

/// What came of a flight.
#[derive(Clone, Debug, PartialEq)]
pub struct Flown {
    /// The calibration, or the code of the refusal.
    pub calibrated: Result<Calibrated, String>,
    /// What was sent with it.
    pub tally: Tally,
    /// Where iron moved in use, what was said of it.
    pub iron: Option<IronError>,
}

/// The flight is flown in pieces of this length, seconds.
const PIECE_S: f64 = 0.5;

/// Time between two sentences, seconds.
const SENTENCE_S: f64 = 0.1;

/// From the end of the turns until the module must have said how its solve ended, seconds.
const PATIENCE_S: f64 = 10.0;

/// Flies the flight of a seed with a plan's aircraft, source of attitude and heading that is sent.
#[must_use]
pub fn fly(case: &Case, seed: u64, plan: &Plan) -> Flown {
    let Drawn { world, routine, faults, switch, onset, stands_s, use_s } = case.draw(seed, plan.aircraft);
    let fields = faults.field.clone();
    let mut rig = Rig::wired(world, faults, [plan.source.far_end(), FarEnd::Nobody]);
    rig.world.set_armed(true);
    if onset == Onset::Always {
        switch.act(0, u64::MAX);
    }
    rig.run_for_s(2.0);
    rig.type_line(&format!("stream heading {}", plan.heading.name()));
    rig.type_line(routine.command);
    if let Onset::Calibrating { after_s, until_s } = onset {
        switch.act(later_us(rig.now_us(), after_s), later_us(rig.now_us(), until_s));
    }
    let began_us = rig.now_us();
    let calibration = calibrate(&mut rig, &routine.legs());
    let calibrated = calibration.map(|(shown, at_us)| Calibrated {
        expected_deg: shown.expected_rms_deg,
        true_deg: true_deg(&shown.calibration, &world, fields.iter().map(|fault| fault.added_ut(at_us)).sum()),
        took_s: (at_us - began_us) as f64 / 1e6,
    });
    let mut tally = Tally::default();
    if calibrated.is_ok() {
        if let Onset::InUse { after_s, for_s } = onset {
            let from_us = later_us(rig.now_us(), after_s);
            switch.act(from_us, later_us(from_us, for_s));
        }
        let counts_from_us = if let Onset::InUse { after_s, .. } = onset { later_us(rig.now_us(), after_s) } else { 0 };
        listen(&mut rig, [stands_s, use_s], seed, &mut |at_us, judged| {
            // Iron that has moved while calibrating is part of the airframe that is used.
            let faulty = match onset {
                Onset::Never => false,
                Onset::Always | Onset::Calibrating { .. } => true,
                Onset::InUse { .. } => switch.is_on(at_us),
            };
            tally.take(at_us, SENTENCE_S, judged, at_us >= counts_from_us, faulty);
        });
    }
    let iron = (calibrated.is_ok() && case.moves_iron()).then(|| {
        let added_ut = fields.iter().map(|fault| fault.added_ut(rig.now_us())).sum();
        iron_error(&mut rig, &world, added_ut)
    });
    Flown { calibrated, tally, iron }
}

/// Flies a full turn each way, and asks for the iron that has moved by so much in the chip's axes.
fn iron_error(rig: &mut Rig, world: &WorldConfig, added_ut: Vector3<f64>) -> IronError {
    for heading_change_deg in [360.0, -360.0] {
        rig.world.fly(Leg::Turn { bank_deg: 25.0, heading_change_deg });
    }
    while rig.world.legs_left() > 0 && rig.run_for_s(PIECE_S) == Ran::Time {}
    let told_ut = transcript::iron_ut(&rig.type_line("status")).map_or_else(Vector3::zeros, Vector3::from);
    // `m = A h + b`: what is added to the reading m is this much more of the field h. An airframe without an inverse
    // measures nothing.
    let true_ut = world.airframe.a.try_inverse().map_or_else(Vector3::zeros, |inverse| inverse * added_ut);
    IronError((told_ut - true_ut).norm() / true_ut.norm())
}

fn later_us(from_us: u64, by_s: f64) -> u64 {
    // The cast saturates: what never ends, ends never.
    from_us.saturating_add((by_s * 1e6) as u64)
}

/// Flies the routine until the module says how its solve ended; and when it said so.
fn calibrate(rig: &mut Rig, legs: &[Leg]) -> Result<(transcript::Shown, u64), String> {
    for &leg in legs {
        rig.world.fly(leg);
    }
    let mut session = String::new();
    let mut waited_s = 0.0;
    let mut asked = false;
    let notice = loop {
        if let Some(notice) = transcript::notice(&session) {
            break notice;
        }
        if rig.run_for_s(PIECE_S) != Ran::Time {
            return Err("no-power".to_owned());
        }
        session.push_str(&rig.printed());
        if rig.world.legs_left() > 0 {
            continue;
        }
        waited_s += PIECE_S;
        if waited_s > PATIENCE_S && !asked {
            // It solves by itself when it has enough; if it does not, the pilot asks for it.
            asked = true;
            waited_s = 0.0;
            let printed = rig.type_line("cal solve");
            if let Some(error) = transcript::error(&printed) {
                break error;
            }
            session.push_str(&printed);
        } else if waited_s > PATIENCE_S {
            return Err("silent".to_owned());
        }
    };
    let at_us = rig.now_us();
    match notice {
        Notice::Calibrated(_) => {
            // The plan is flown to its end.
            while rig.world.legs_left() > 0 && rig.run_for_s(PIECE_S) == Ran::Time {}
            let shown = transcript::shown(&rig.type_line("cal show")).ok_or_else(|| "not-shown".to_owned())?;
            Ok((shown, at_us))
        }
        Notice::Refused { code, .. } => Err(code),
    }
}

/// With the current that it needs to hover or to fly on, and the iron that there is now.
fn true_deg(calibration: &Calibration, world: &WorldConfig, added_ut: Vector3<f64>) -> f64 {
    let mut now = *world;
    now.airframe.b_ut += added_ut;
    Errors::of(calibration, &now).figures().rms_deg
}

/// Stands on the ground for a time, as it came, and flies legs for a time; every sentence is judged.
fn listen(rig: &mut Rig, [stands_s, use_s]: [f64; 2], seed: u64, judge: &mut dyn FnMut(u64, &Judged)) {
    let mut random = Random::new(seed, Purpose::Legs);
    if stands_s > 0.0 {
        // As it was flying, whole turns of its heading included: nothing real jumps.
        let now = rig.world.true_state(rig.now_us());
        let [roll_deg, pitch_deg, heading_deg] = [now.roll_rad, now.pitch_rad, now.heading_rad].map(f64::to_degrees);
        rig.world.carry(Carried { roll_deg, pitch_deg, heading_deg, ..Carried::default() });
    }
    let flies_us = later_us(rig.now_us(), stands_s);
    let end_us = later_us(flies_us, use_s);
    let kind = rig.world.config().aircraft.kind;
    for leg in usage::first(kind, &mut random) {
        rig.world.fly(leg);
    }
    let mut reader = Reader::default();
    let _ = rig.instrument.receive();
    while rig.now_us() < end_us {
        if stands_s > 0.0 && rig.now_us() >= flies_us {
            rig.world.let_go();
        }
        if rig.world.legs_left() < 2 {
            for leg in usage::next(kind, &mut random) {
                rig.world.fly(leg);
            }
        }
        if rig.run_for_s(PIECE_S) != Ran::Time {
            return;
        }
        for timed in rig.instrument.receive_timed() {
            if let Some(received) = reader.push(timed.at_us, timed.byte).filter(|r| r.kind == "PASWH") {
                let true_deg = rig.world.true_state(timed.at_us).heading_deg();
                judge(timed.at_us, &judged(received, true_deg));
            }
        }
    }
}

fn judged(received: Received, true_deg: f64) -> Judged {
    match (received.heading_deg, received.sigma_deg) {
        (Some(sent_deg), Some(sigma_deg)) => {
            let is_smooth = received.told.as_deref() == Some(HeadingKind::Smooth.name());
            Judged::Heading { error_deg: wrap_180(sent_deg - true_deg), sigma_deg, is_smooth }
        }
        _ => Judged::Empty(received.status.unwrap_or_default()),
    }
}
