//! List of messages: stable code, what happened, and what to do.
//!
//! Each entry calls `show` with these three; the advice is empty if no action is required. Scripts depend on the codes,
//! so they do not change. Texts are plain, at most 200 characters in all.

use core::fmt::{self, Arguments, Display};

use crate::messages::autopilot_report::{AutopilotReport, ParameterCounts, ParameterState};
use crate::messages::message::Message;
use crate::messages::refusal::{Refusal, RefusalCause};
use crate::store::StoreError;
use autoswing::acceptance::Rejection;
use autoswing::calibration::{CollectionPart, DetectedHardIronChange, HardIronTimeCourse, SolveError};
use autoswing::collection::CollectionProblem;
use autoswing::decimal::{Decimal, ShortestDecimal};
use autoswing::instrument::{HardIronChange, InstallationChange, MountTurn};
use autoswing::trig::VectorLength as _;

/// Callback that receives an entry's code, what happened, and what to do.
type EntryWriter<'a> = &'a mut dyn FnMut(&'static str, Arguments<'_>, Arguments<'_>) -> fmt::Result;

/// Callback that receives what happened and what to do, for an entry with the code of its container.
type TextWriter<'a> = &'a mut dyn FnMut(Arguments<'_>, Arguments<'_>) -> fmt::Result;

const NO_ADVICE: Arguments<'_> = format_args!("");
const FIRMWARE_FAULT_ADVICE: Arguments<'_> = format_args!("this is a fault of the firmware, please report it");
const FLASH_FAULT_ADVICE: Arguments<'_> = format_args!("try again, then replace the board");

impl Message {
    fn show_entry(&self, show: EntryWriter<'_>) -> fmt::Result {
        match self {
            Self::Solved(Ok(verdict)) => show("calibrated", format_args!("{verdict}"), NO_ADVICE),
            Self::Solved(Err(refusal)) | Self::CommandRejected(refusal) => refusal.show_entry(show),
            Self::StoreFailed(error) => store_error_entry(*error, show),
            Self::CollectionLost => show(
                "collection-lost",
                format_args!("the power failed during a collection, and its samples are lost"),
                format_args!("collect again"),
            ),
            Self::Collecting(percent) => show("collecting", format_args!("{percent} %"), NO_ADVICE),
            Self::CollectionEnded => show("collection-ended", format_args!("no more samples"), NO_ADVICE),
            Self::InstallationChanged(InstallationChange::HardIron(change)) => show(
                "iron-moved",
                format_args!("{}", HardIronChangeText(change)),
                format_args!("headings are corrected for it; fix what moved, or calibrate again"),
            ),
            Self::InstallationChanged(InstallationChange::Mount(turn)) => show(
                "mount-moved",
                format_args!("{}", MountTurnText(turn)),
                format_args!("headings are corrected for it; fasten the module and calibrate again"),
            ),
            Self::InstallationRestored => show("iron-back", format_args!("as calibrated again"), NO_ADVICE),
            Self::TurnRequested { sigma_rad } => show(
                "turn-wanted",
                format_args!("headings have a sigma of {} deg by now", Decimal::<1>(sigma_rad.to_degrees())),
                format_args!("turn once each way, so that a drift of iron is determined"),
            ),
            Self::TrimsAmbiguous => show(
                "trims-ambiguous",
                format_args!("the pitch trim in a quadplane's attitude depends on its mode, and is not removed"),
                format_args!("set bit 8 of FLIGHT_OPTIONS, and Q_TRIM_PITCH=0"),
            ),
            Self::ComponentTaken { taken, component } => show(
                "component-taken",
                format_args!("another module is component {taken}; this one is component {component} from now on"),
                format_args!("to change it: set component"),
            ),
            Self::NodeNumberConflict { number, is_given_up } => {
                let effect = if *is_given_up { "this one takes another" } else { "no field is sent" };
                show(
                    "node-number-conflict",
                    format_args!("another node on the CAN bus has number {number}, too; {effect}"),
                    format_args!("give that node another number, or set can-node"),
                )
            }
            Self::Autopilot(report) => autopilot_entry(report, show),
            Self::SafeMode => safe_mode_entry(show),
        }
    }
}

fn autopilot_entry(report: &AutopilotReport, show: EntryWriter<'_>) -> fmt::Result {
    match report {
        AutopilotReport::NoAutopilot => show(
            "no-autopilot",
            format_args!("no ArduPilot or PX4 is known by MAVLink, and no INAV by MSP"),
            format_args!("connect MAVLink, or the CAN bus with its tunnel"),
        ),
        AutopilotReport::NoReply => show(
            "no-parameters",
            format_args!("the autopilot does not answer for its parameters"),
            format_args!("check that the module's TX reaches it, and signatures"),
        ),
        AutopilotReport::Armed => Refusal::Armed.show_entry(show),
        AutopilotReport::NotKept => show(
            "number-not-kept",
            format_args!("the old number of a parameter cannot be stored; it was not written"),
            format_args!("see status all"),
        ),
        AutopilotReport::NothingReplaced => {
            show("nothing-replaced", format_args!("no setup has replaced a number of the autopilot's"), NO_ADVICE)
        }
        AutopilotReport::OtherAutopilot => show(
            "other-autopilot",
            format_args!("a setup has replaced numbers of another autopilot, and none of this one"),
            format_args!("connect that one for an undo"),
        ),
        AutopilotReport::NoCompass => show(
            "no-compass",
            format_args!("the autopilot has no compass that is this module"),
            format_args!("power both together, or restart the autopilot"),
        ),
        AutopilotReport::Compass(compass) => show("compass", format_args!("{compass}"), NO_ADVICE),
        AutopilotReport::CorrectedTwice { slot, offset_mg } => show(
            "corrected-twice",
            format_args!(
                "the autopilot's offsets of compass slot {slot}, {} mG, correct the field of the module a second time",
                Decimal::<0>(*offset_mg)
            ),
            format_args!("to remove them: autopilot setup yes"),
        ),
        AutopilotReport::Trims(trims_deg) => {
            let [roll_deg, pitch_deg] = trims_deg.map(Decimal::<1>);
            show(
                "trims",
                format_args!("the autopilot's attitude lacks {roll_deg} deg of roll, {pitch_deg} of pitch; removed"),
                NO_ADVICE,
            )
        }
        AutopilotReport::Heading(heading_deg) => show(
            "heading",
            format_args!("{} deg magnetic now", Decimal::<1>(*heading_deg)),
            format_args!("compare it with a known one before the autopilot uses it"),
        ),
        AutopilotReport::Parameter(report) => {
            let code = match report.state {
                ParameterState::Wrong => "parameter-wrong",
                ParameterState::Changed => "parameter-set",
                ParameterState::NotChanged => "parameter-refused",
                ParameterState::Missing => "parameter-missing",
            };
            show(code, format_args!("{report}"), NO_ADVICE)
        }
        AutopilotReport::Summary(counts) => {
            let advice = match counts {
                ParameterCounts { needs_restart: true, .. } => format_args!("restart it: autopilot restart"),
                ParameterCounts { wrong: 1.., .. } => format_args!("to write them: autopilot setup yes"),
                _ => NO_ADVICE,
            };
            show("autopilot", format_args!("{counts}"), advice)
        }
    }
}

impl Refusal {
    fn show_entry(&self, show: EntryWriter<'_>) -> fmt::Result {
        match self {
            Self::Armed => show(
                "armed",
                format_args!("the autopilot is armed or the vehicle still moves, and this command is for the ground"),
                format_args!("land, disarm and wait for 5 s"),
            ),
            Self::Busy => show("busy", format_args!("a solve is running"), format_args!("wait for it, or cal abort")),
            Self::Collecting { present_procedure, requested_procedure: wanted } => show(
                "collecting",
                format_args!("a collection of {} is in progress", present_procedure.procedure_name()),
                format_args!("to discard it: cal start {} again", wanted.procedure_name()),
            ),
            Self::NotCollecting => show(
                "not-collecting",
                format_args!("no collection is in progress"),
                format_args!("cal start begins one"),
            ),
            Self::NotSwinging => show(
                "not-swinging",
                format_args!("no compass swing is in progress"),
                format_args!("cal start swing begins one"),
            ),
            Self::NotStationary => show(
                "not-steady",
                format_args!("the vehicle moves, or no attitude is received"),
                format_args!("keep it still for a second"),
            ),
            Self::TooManyMarks => {
                show("too-many-marks", format_args!("there is no room for another mark"), format_args!("cal solve"))
            }
            Self::NotSolved => {
                show("not-solved", format_args!("nothing was solved since the start"), format_args!("cal solve first"))
            }
            Self::NoCalibration => {
                show("no-calibration", format_args!("there is no active calibration"), format_args!("calibrate first"))
            }
            Self::NoStoredCalibration => show(
                "no-calibration",
                format_args!("no calibration is stored"),
                format_args!("cal start, then fly; status shows what is missing"),
            ),
            Self::NoSamples => show(
                "no-samples",
                format_args!("there are no samples"),
                format_args!("cal start, then fly, turning and tilting to all sides"),
            ),
            Self::InsufficientSamples { code, expected_rms_deg, cause } => {
                cause.show_entry(&mut |fact, advice| match *expected_rms_deg {
                    Some(deg) => show(code, format_args!("expected error {} deg; {fact}", Decimal::<1>(deg)), advice),
                    None => show(code, fact, advice),
                })
            }
            Self::LargeAlignment { heading_deg, align_deg } => show(
                "needs-word",
                format_args!(
                    "every heading would be turned by {} deg, more than a mounting is usually off",
                    Decimal::<1>(*align_deg)
                ),
                format_args!("if that is right: set align {} yes", ShortestDecimal(*heading_deg, 0)),
            ),
            Self::NoSensor => show(
                "no-sensor",
                format_args!("the magnetometer does not answer"),
                format_args!("check its wiring, see status"),
            ),
            Self::NoInertialSensor => show(
                "no-gyro",
                format_args!("no gyro and accelerometer of the board answers"),
                format_args!("set attitude autopilot"),
            ),
            Self::NoPreviousCalibration => {
                show("nothing-to-undo", format_args!("there is no previous calibration"), NO_ADVICE)
            }
            Self::OutOfRange(error) => show("out-of-range", format_args!("{error}"), NO_ADVICE),
            Self::Solve(error) => solve_error_entry(error, show),
            Self::Rejected(rejection) => rejection_entry(rejection, show),
            Self::Store(error) => store_error_entry(*error, show),
            Self::SafeMode => safe_mode_entry(show),
        }
    }
}

fn safe_mode_entry(show: EntryWriter<'_>) -> fmt::Result {
    show(
        "safe-mode",
        format_args!("three starts in a row ended in a panic, so only the console runs"),
        format_args!("report the panic shown by status; to erase all stored data: cal clear all, then reboot"),
    )
}

fn solve_error_entry(error: &SolveError, show: EntryWriter<'_>) -> fmt::Result {
    let description = format_args!("{error}");
    match error {
        SolveError::TooFewSamples { part, .. } => {
            let verb = if CollectionPart::TURNS.contains(part) { "fly" } else { "take" };
            show("too-few-samples", description, format_args!("{verb} more {}", part.part_name()))
        }
        SolveError::NotFinite => show("not-finite", description, FIRMWARE_FAULT_ADVICE),
        SolveError::TooFewHeadings { .. } => {
            show("too-few-headings", description, format_args!("turn through all of them"))
        }
        SolveError::AxisStuck { .. } => {
            show("axis-stuck", description, format_args!("move the sensor away from magnets, or replace it"))
        }
        SolveError::NotAnEllipse(_) => show("not-an-ellipse", description, format_args!("turn all the way round")),
        SolveError::NotDetermined(_) => show("not-determined", description, format_args!("turn all the way round")),
        SolveError::SamePlane => show("same-plane", description, format_args!("bank 15 deg or more each way")),
        SolveError::HardIronChanged(change) => hard_iron_changed_entry(change, show),
        SolveError::NotConverged => {
            show("not-converged", description, format_args!("move the sensor away from iron and wires, then fly again"))
        }
        SolveError::TurnsReversed => {
            show("turns-reversed", description, format_args!("check the sign of the attitude source's roll"))
        }
        SolveError::InclinationContradicted { found_deg } => show(
            "inclination-contradicted",
            description,
            format_args!("set inclination {found_deg} or none, then cal solve"),
        ),
        SolveError::MountContradicted { found } => show(
            "mount-contradicted",
            description,
            format_args!("set mount {}, then cal solve", found.orientation_name()),
        ),
    }
}

fn rejection_entry(rejection: &Rejection, show: EntryWriter<'_>) -> fmt::Result {
    let description = format_args!("{rejection}");
    match rejection {
        Rejection::TooFewHeldBack { .. } => {
            show("too-few-held-back", description, format_args!("fly longer turns each way"))
        }
        Rejection::IronChanged(change) => hard_iron_changed_entry(change, show),
        Rejection::Unobservable => show(
            "unobservable",
            description,
            format_args!("tilt by 15 deg or more ahead, back, right and left on four headings"),
        ),
        Rejection::AttitudeContradicted { .. } => {
            show("attitude-contradicted", description, format_args!("calibrate the attitude source and fly again"))
        }
        Rejection::NotAccurate { .. } => {
            show("not-accurate", description, format_args!("cal advise shows what to fly"))
        }
        Rejection::NotBetter { .. } => show("not-better", description, format_args!("the active one stays")),
        Rejection::LessInformative { .. } => {
            show("thinner", description, format_args!("the active one stays; cal advise shows what to fly"))
        }
    }
}

fn hard_iron_changed_entry(change: &DetectedHardIronChange, show: EntryWriter<'_>) -> fmt::Result {
    let advice = match change.time_course {
        HardIronTimeCourse::Step { .. } => format_args!("fix what moved and fly again"),
        HardIronTimeCourse::Drift => format_args!("wait until temperatures settle and fly again"),
        HardIronTimeCourse::LoadFactor => {
            format_args!("remove the iron of the linkage, or move the module away from it, and fly again")
        }
        HardIronTimeCourse::Hysteresis => format_args!("move the module away from steel and fly again"),
    };
    show("iron-changed", format_args!("{change}"), advice)
}

fn store_error_entry(error: StoreError, show: EntryWriter<'_>) -> fmt::Result {
    let description = format_args!("{error}");
    match error {
        StoreError::Flash => show("store-flash", description, FLASH_FAULT_ADVICE),
        StoreError::Timeout => show("store-timeout", description, FLASH_FAULT_ADVICE),
        StoreError::Corrupt => show("store-corrupt", description, format_args!("calibrate again")),
        StoreError::OtherFormat(_) => {
            show("store-version", description, format_args!("install that firmware, or delete them: cal clear all"))
        }
        StoreError::Full => show("store-full", description, FIRMWARE_FAULT_ADVICE),
        StoreError::ReadBackDiffers => show("store-verify", description, FLASH_FAULT_ADVICE),
        StoreError::Invalid => show("store-invalid", description, NO_ADVICE),
    }
}

impl RefusalCause {
    fn show_entry(&self, show: TextWriter<'_>) -> fmt::Result {
        match self {
            Self::CollectionProblem(problem) => {
                let description = format_args!("{problem}");
                match problem {
                    CollectionProblem::SampleIntervalTooLong { .. } => {
                        show(description, format_args!("send field and attitude ten times a second"))
                    }
                    CollectionProblem::NoTilt { .. } => show(
                        description,
                        format_args!(
                            "tilt by 15 deg or more to both sides, or if that was flown, check the unit of the \
                             attitude: radians for degrees?"
                        ),
                    ),
                    CollectionProblem::InsufficientBank { .. } => {
                        show(description, format_args!("fly turns at 15 deg of bank or more each way"))
                    }
                    CollectionProblem::OneSideOnly(part) => {
                        let missing =
                            if *part == CollectionPart::LEFT { CollectionPart::RIGHT } else { CollectionPart::LEFT };
                        show(description, format_args!("fly {}, too", missing.part_name()))
                    }
                    CollectionProblem::ArcOnly { .. } => show(description, format_args!("fly full circles")),
                    CollectionProblem::MissingManoeuvre(_) => show(description, NO_ADVICE),
                }
            }
            Self::SampleLoss(loss) => show(format_args!("{loss}"), format_args!("{}", loss.advice())),
        }
    }
}

struct MountTurnText<'a>(&'a MountTurn);

impl Display for MountTurnText<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let MountTurn { turn_rad, sigma_rad } = self.0;
        let direction = if *turn_rad < 0.0 { "counterclockwise" } else { "clockwise" };
        let [turn_deg, sigma_deg] = [turn_rad.abs(), *sigma_rad].map(|rad| Decimal::<1>(rad.to_degrees()));
        write!(f, "{turn_deg} deg {direction} since the calibration, from above (sigma {sigma_deg})")
    }
}

/// Text of a hard-iron change: size, main direction, components in body axes.
struct HardIronChangeText<'a>(&'a HardIronChange);

impl Display for HardIronChangeText<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let HardIronChange { change_ut, sigma_ut } = self.0;
        let axes = [("forward", "aft"), ("to the right", "to the left"), ("down", "up")];
        let (axis, &most) = change_ut
            .iter()
            .enumerate()
            .fold((0, &0.0), |most, next| if next.1.abs() > f32::abs(*most.1) { next } else { most });
        let direction = axes.get(axis).map_or("", |(ahead, back)| if most < 0.0 { *back } else { *ahead });
        let [x, y, z] = [change_ut.x, change_ut.y, change_ut.z].map(Decimal::<1>);
        let (size, sigma) = (Decimal::<1>(change_ut.vector_length()), Decimal::<1>(*sigma_ut));
        write!(f, "{size} uT since the calibration, mostly {direction} (x {x}, y {y}, z {z}, sigma {sigma})")
    }
}

impl Message {
    /// Stable code, kebab-case.
    #[must_use]
    pub fn stable_code(&self) -> &'static str {
        entry_code(|show| self.show_entry(show))
    }

    /// Text of the message: what happened, then what to do.
    #[must_use]
    pub fn message_text(&self) -> impl Display {
        fmt::from_fn(|f| entry_text(f, |show| self.show_entry(show)))
    }
}

/// Line for the user: `<code>: what happened; what to do`, with `refused ` in front of a refusal.
impl Display for Message {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let refused = if self.is_refusal() { "refused " } else { "" };
        write!(f, "{refused}{}: {}", self.stable_code(), self.message_text())
    }
}

impl Refusal {
    /// Stable code, kebab-case.
    #[must_use]
    pub fn stable_code(&self) -> &'static str {
        entry_code(|show| self.show_entry(show))
    }
}

impl Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        entry_text(f, |show| self.show_entry(show))
    }
}

fn entry_code(entry: impl FnOnce(EntryWriter<'_>) -> fmt::Result) -> &'static str {
    let mut found = "";
    // Infallible: the closure only copies the code.
    let _ = entry(&mut |code, _, _| {
        found = code;
        Ok(())
    });
    found
}

fn entry_text(f: &mut fmt::Formatter<'_>, entry: impl FnOnce(EntryWriter<'_>) -> fmt::Result) -> fmt::Result {
    entry(&mut |_, fact, advice| {
        f.write_fmt(fact)?;
        if advice.as_str() == Some("") { Ok(()) } else { write!(f, "; {advice}") }
    })
}
