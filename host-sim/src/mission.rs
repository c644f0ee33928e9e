//! The main job: take off uncalibrated, fly the routine, calibrate, restart, fly on with a right heading.
//!
//! The pilot has what a person has: the console's cable to type on and the heading sentences to read. Only the score
//! looks at the truth.

use autoswing::calibration::{Calibration, Orientation};
use autoswing::frames::{Attitude, Field, Sensor};
use serde::Serialize;

use crate::module::{Module, Ran};
use crate::nmea::Reader;
use crate::rig::Rig;
pub use crate::routine::Plan;
use crate::routine::Routine;
use crate::score::{Errors, Figures, within_percent, wrap_180};
use crate::transcript::{self, Notice, Shown};
use crate::world::autopilot::Leg;
use crate::world::{TrueState, WorldConfig};

/// A part of the mission.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Boot and take-off, uncalibrated.
    TakeOff,
    /// A part of the calibration routine, of this name.
    Routine(&'static str),
    /// Solving, verifying, storing.
    Solve,
    /// Restart, then headings all round.
    Stream,
}

impl Stage {
    /// What it is called.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::TakeOff => "take-off, uncalibrated",
            Self::Routine(name) => name,
            Self::Solve => "solve, verify, store",
            Self::Stream => "restart, fly on",
        }
    }
}

/// A measurement taken in the routine: for the report's pictures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Glimpse {
    /// The field in the chip's axes.
    pub field: Field<Sensor>,
    /// The current as the autopilot tells it, amperes.
    pub current_a: Option<f32>,
    /// When and where.
    pub moment: Moment,
}

/// A moment of the flight, as it truly was: for the report's pictures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moment {
    /// Since the start, seconds.
    pub at_s: f64,
    /// The attitude.
    pub attitude: Attitude,
    /// Magnetic heading, degrees.
    pub heading_deg: f64,
    /// Metres magnetic east and north of the start.
    pub place_m: [f64; 2],
}

impl Moment {
    fn of(state: &TrueState) -> Self {
        Self {
            at_s: state.time_us as f64 / 1e6,
            attitude: state.attitude(),
            heading_deg: state.heading_deg(),
            place_m: [state.east_m, state.north_m],
        }
    }
}

/// A heading that was streamed after the restart, when its sentence had arrived.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Told {
    /// When and where.
    pub moment: Moment,
    /// Its error, degrees.
    pub error_deg: f64,
    /// The standard deviation that came with it, degrees.
    pub sigma_deg: f64,
}

/// Errors of streamed headings against the true heading at the instant each sentence had arrived: calibration,
/// attitude, noise and age together.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Streamed {
    /// Root mean square, degrees.
    pub rms_deg: f64,
    /// Largest, degrees.
    pub max_deg: f64,
    /// Percent of the errors within one and two of the standard deviations sent with them.
    pub within_percent: [f64; 2],
    /// Sentences with a heading.
    pub headings: usize,
    /// Sentences without one, the start included.
    pub empty: usize,
}

/// What came of a mission.
#[derive(Clone, Debug)]
pub struct Flown {
    /// The world's settings.
    pub world: WorldConfig,
    /// What the module stored, as its console shows it; or why it refused, as its console says it.
    pub result: Result<Shown, Notice>,
    /// Errors of an uncalibrated module.
    pub before: Errors,
    /// Errors with the stored calibration; of the uncalibrated module if there is none.
    pub after: Errors,
    /// Errors of the headings streamed after the restart; none when it refused.
    pub streamed: Option<Streamed>,
    /// What the chip saw in the routine.
    pub glimpses: Vec<Glimpse>,
    /// The headings streamed after the restart.
    pub told: Vec<Told>,
    /// When the solve had ended, seconds since the start.
    pub solved_s: f64,
    /// The console session, as the pilot saw it.
    pub session: String,
    /// How long it took, seconds of virtual time.
    pub duration_s: f64,
}

/// Flies a mission with the simulated module. `watch` hears the stage and how much of it is done, 0..1.
pub fn fly(world: WorldConfig, plan: Plan, watch: &mut dyn FnMut(Stage, f64)) -> Flown {
    fly_with(&mut Rig::new(world), plan, watch)
}

/// Flies a mission with a module that has just been switched on.
pub fn fly_with(module: &mut impl Module, plan: Plan, watch: &mut dyn FnMut(Stage, f64)) -> Flown {
    let world = module.world().config();
    let mut mission = Mission { module, session: String::new(), glimpses: Vec::new(), watch };
    let before = Errors::of(&Calibration::uncalibrated(Orientation::NONE), &world);
    let routine = Routine::of(world.aircraft.kind, plan, world.aircraft.heading_deg);
    let result = mission.calibrate(&routine);
    let solved_s = mission.module.now_us() as f64 / 1e6;
    let (streamed, told) = result.as_ref().map_or((None, Vec::new()), |_| {
        let (streamed, told) = mission.stream(&routine.mission);
        (Some(streamed), told)
    });
    let after = result.as_ref().map_or_else(|_| before.clone(), |shown| Errors::of(&shown.calibration, &world));
    Flown {
        world,
        result,
        before,
        after,
        streamed,
        glimpses: mission.glimpses,
        told,
        solved_s,
        session: mission.session,
        duration_s: mission.module.now_us() as f64 / 1e6,
    }
}

struct Mission<'a, M> {
    module: &'a mut M,
    session: String,
    glimpses: Vec<Glimpse>,
    watch: &'a mut dyn FnMut(Stage, f64),
}

/// The mission is flown in pieces of this length, seconds.
const PIECE_S: f64 = 0.5;

/// By then the autopilot's next heartbeat has come: it sends one every second.
const HEARTBEAT_S: f64 = 1.2;

/// A solve, a verification and a save take a second; a module silent for longer has nothing to say.
const PATIENCE_S: f64 = 10.0;

impl<M: Module> Mission<'_, M> {
    fn calibrate(&mut self, routine: &Routine) -> Result<Shown, Notice> {
        (self.watch)(Stage::TakeOff, 0.0);
        self.module.world().set_armed(true);
        self.leg(Stage::TakeOff, routine.take_off);
        self.type_line("status");
        self.type_line(routine.command);
        for part in &routine.parts {
            for &leg in &part.legs {
                self.leg(Stage::Routine(part.name), leg);
            }
            self.type_line("status");
        }
        let notice = self.outcome();
        match notice {
            Notice::Calibrated(_) => transcript::shown(&self.type_line("cal show")).ok_or(notice),
            refused @ Notice::Refused { .. } => Err(refused),
        }
    }

    /// How the solve ended. The module solves by itself when it has enough; if it does not, the pilot asks for it.
    fn outcome(&mut self) -> Notice {
        let waits = (PATIENCE_S / PIECE_S) as usize;
        for piece in 0..2 * waits {
            if let Some(notice) = transcript::notice(&self.session) {
                return notice;
            }
            if piece == waits
                && let Some(error) = transcript::error(&self.type_line("cal solve"))
            {
                return error;
            }
            (self.watch)(Stage::Solve, piece as f64 / (2 * waits) as f64);
            self.piece();
            self.listen();
        }
        Notice::refused("silent", "the module did not say how its solve ended")
    }

    /// Restarts the module and flies all round the compass, comparing what it streams with the truth.
    fn stream(&mut self, legs: &[Leg]) -> (Streamed, Vec<Told>) {
        // It stands on the ground again: an armed module would not be restarted. The world flies on meanwhile.
        self.module.world().set_armed(false);
        self.module.run_for_s(HEARTBEAT_S);
        let _ = self.module.instrument().receive();
        self.type_line("reboot");
        self.module.world().set_armed(true);
        let mut told: Vec<Told> = Vec::new();
        let mut empty = 0;
        let mut reader = Reader::default();
        for (done, &leg) in legs.iter().enumerate() {
            self.module.world().fly(leg);
            while self.module.world().legs_left() > 0 && self.piece() {
                (self.watch)(Stage::Stream, done as f64 / legs.len() as f64);
                for timed in self.module.instrument().receive_timed() {
                    let Some(received) = reader.push(timed.at_us, timed.byte).filter(|r| r.kind == "PASWH") else {
                        continue;
                    };
                    match (received.heading_deg, received.sigma_deg) {
                        (Some(deg), Some(sigma_deg)) => {
                            let moment = Moment::of(&self.module.world().true_state(timed.at_us));
                            told.push(Told { moment, error_deg: wrap_180(deg - moment.heading_deg), sigma_deg });
                        }
                        _ => empty += 1,
                    }
                }
            }
        }
        (self.watch)(Stage::Stream, 1.0);
        self.listen();
        let errors_deg: Vec<f64> = told.iter().map(|told| told.error_deg).collect();
        let normalised: Vec<f64> = told.iter().map(|told| told.error_deg / told.sigma_deg).collect();
        let Figures { rms_deg, max_deg, .. } = Figures::of(&errors_deg);
        let (within_percent, headings) = (within_percent(&normalised), told.len());
        (Streamed { rms_deg, max_deg, within_percent, headings, empty }, told)
    }

    /// Flies a leg to its end, taking glimpses in the routine.
    fn leg(&mut self, stage: Stage, leg: Leg) {
        let began = self.module.world().true_state(self.module.now_us());
        self.module.world().fly(leg);
        while self.module.world().legs_left() > 0 && self.piece() {
            self.listen();
            let now = self.module.world().true_state(self.module.now_us());
            if matches!(stage, Stage::Routine(_)) {
                let field = self.module.world().sensor_field(now.time_us);
                let current_a = self.module.world().told_current_a(now.time_us).map(|amperes| amperes as f32);
                self.glimpses.push(Glimpse { field, current_a, moment: Moment::of(&now) });
            }
            let done = match leg {
                Leg::Straight { seconds, .. } | Leg::Hover { seconds } | Leg::Push { seconds, .. } => {
                    (now.time_us - began.time_us) as f64 / 1e6 / seconds
                }
                Leg::Turn { heading_change_deg, .. } | Leg::Yaw { heading_change_deg, .. } => {
                    (now.heading_rad - began.heading_rad).to_degrees() / heading_change_deg
                }
            };
            (self.watch)(stage, done.clamp(0.0, 1.0));
        }
    }

    /// Flies on; false when the module has failed.
    fn piece(&mut self) -> bool {
        self.module.run_for_s(PIECE_S) == Ran::Time
    }

    fn type_line(&mut self, line: &str) -> String {
        let printed = self.module.type_line(line);
        self.session.push_str(&printed);
        printed
    }

    fn listen(&mut self) {
        self.session.push_str(&self.module.printed());
    }
}
