//! What outlives a restart: a collection that is under way, and what is remembered in flash.

use testkit::random::Random as Bits;

use super::*;
use crate::calibration::tests::synthetic::hovered;
use crate::settings::{PORTS, PortNumber, ProtocolKind};

const SILENT: [ProtocolKind; PORTS] = [ProtocolKind::Auto; PORTS];
const FOUND: [ProtocolKind; PORTS] = [ProtocolKind::Mavlink, ProtocolKind::Nmea];

/// A module's memory and flash, with the clock of its samples.
struct Module {
    kept: Kept,
    stored: Stored,
    now: u32,
    writes: u32,
}

impl Module {
    fn new() -> Self {
        Self { kept: Kept::EMPTY, stored: Stored::default(), now: 0, writes: 0 }
    }

    /// Starts it, with a clock that begins anew, armed, and does something with it.
    fn run<T>(&mut self, run: impl FnOnce(&mut Run<'_>) -> T) -> T {
        let mut compass = Compass::new(Policy::DEFAULT, &self.stored, &mut self.kept);
        compass.step(Event::SensorFound(SENSOR, READINGS));
        compass.step(Event::Armed(Some(true)));
        self.now = 100;
        let mut started = Run { compass, stored: &mut self.stored, now: &mut self.now, writes: &mut self.writes };
        let result = run(&mut started);
        started.look(SILENT);
        result
    }

    /// Loses its power: memory holds anything.
    fn lose_power(&mut self) {
        let mut random = Bits(1);
        self.kept.change(|_| random.bits() as u32);
    }
}

struct Run<'a> {
    compass: Compass<'a>,
    stored: &'a mut Stored,
    now: &'a mut u32,
    writes: &'a mut u32,
}

impl Run<'_> {
    fn command(&mut self, command: Command) -> Effect {
        self.compass.step(Event::Command(command, WrappingMillis::new(*self.now)))
    }

    /// Looks at what the ports speak, as is done between two events, and writes what is to be written.
    fn look(&mut self, spoken: [ProtocolKind; PORTS]) {
        if let Effect::Save = self.compass.step(Event::Spoken(spoken, WrappingMillis::new(*self.now))) {
            let Some(Change::Remembered(remembered)) = self.compass.to_save() else { panic!() };
            self.stored.remembered = remembered;
            *self.writes += 1;
            assert!(matches!(self.compass.step(Event::Saved(Ok(()))), Effect::None));
        }
    }

    /// Flies these, with every trial to its end, until the collection is over: how it ended.
    fn fly(&mut self, samples: &[Sample]) -> Option<Outcome> {
        for sample in samples {
            *self.now += 250;
            let sample = Sample { time: WrappingMillis::new(*self.now), ..*sample };
            assert!(matches!(self.compass.step(Event::Sample(sample)), Effect::None));
            self.look(SILENT);
            while self.compass.is_busy() {
                match self.compass.step(Event::Advance) {
                    Effect::None => self.look(SILENT),
                    Effect::Save => {
                        let Some(Change::Generations { current, .. }) = self.compass.to_save() else { panic!() };
                        self.stored.generations.current = current.copied();
                        self.stored.remembered.is_collecting = false;
                        let Effect::Notify(outcome) = self.compass.step(Event::Saved(Ok(()))) else { panic!() };
                        return Some(outcome);
                    }
                    Effect::Notify(outcome) => return Some(outcome),
                    Effect::Reply(_) => panic!("nobody asked"),
                }
            }
        }
        None
    }

    fn report(&mut self) -> Report {
        let Effect::Reply(Ok(Reply::Report(report))) = self.command(Command::Report) else { panic!() };
        report
    }
}

fn hover() -> Vec<Sample> {
    hovered(&airframe(), 0.3, &mut Random(1))
}

/// A flight that is restarted after any number of samples, once or every fifteen seconds, is calibrated by the same flying,
/// and as well: within a quarter of a degree, half of the accuracy that is wanted, of the one that is not.
#[test]
fn a_collection_that_is_restarted_ends_as_one_that_is_not() {
    let flown = hover();
    let ends = |cuts: &[usize]| {
        let mut module = Module::new();
        let mut rest = &flown[..];
        let mut began = 0;
        for &cut in cuts {
            let (now, later) = rest.split_at(cut - began);
            assert!(module.run(|run| run.fly(now)).is_none(), "{cuts:?}");
            (rest, began) = (later, cut);
        }
        let outcome = module.run(|run| run.fly(rest)).unwrap_or_else(|| panic!("{cuts:?}: no end"));
        assert!(outcome.is_ok(), "{cuts:?}: {outcome:?}");
        let calibration = module.stored.generations.current.unwrap().calibration;
        rms(&airframe().errors_deg(&calibration))
    };
    let uninterrupted = ends(&[]);
    for cuts in [vec![1], vec![39], vec![60], vec![120], vec![200], (60..240).step_by(60).collect()] {
        let restarted = ends(&cuts);
        assert!((restarted - uninterrupted).abs() < 0.25, "{cuts:?}: {restarted} {uninterrupted}");
    }
}

/// Who began it, whether it is stopped, and that another start needs the same words as before.
#[test]
fn it_is_whose_it_was() {
    let flown = hover();
    let mut module = Module::new();
    module.run(|run| assert!(run.fly(&flown[..60]).is_none() && run.report().is_auto));
    let samples = module.run(|run| {
        let report = run.report();
        assert!(report.is_auto && report.state == State::Collecting);
        // It rests on the ground, over a restart too.
        run.compass.step(Event::Armed(Some(false)));
        assert!(run.fly(&flown[60..100]).is_none() && run.report().awaits_arming);
        report.progress.left.samples
    });
    module.run(|run| {
        assert_eq!(run.report().progress.left.samples, samples);
        assert!(matches!(run.command(Command::CalStart(Procedure::Flight)), Effect::Reply(Ok(_))), "taken over");
    });
    module.run(|run| {
        let refusal = run.command(Command::CalStart(Procedure::Flight));
        assert!(matches!(refusal, Effect::Reply(Err(Refusal::Collecting { .. }))), "a person's: {refusal:?}");
        run.compass.collector.forgive_restarts();
        run.command(Command::CalStop);
    });
    module.run(|run| {
        assert!(run.fly(&flown[100..160]).is_none());
        let report = run.report();
        assert_eq!((report.state, report.progress.left.samples), (State::Uncalibrated, samples), "nor does it begin");
        assert!(matches!(run.command(Command::CalSolve(None)), Effect::Reply(Ok(Reply::Done(State::Solving)))));
    });
}

/// A restart in a solve that was asked for, or in a trial, finds the samples; after the end of one, whatever came of it, there
/// is nothing, and the module begins by itself as at any start.
#[test]
fn a_solve_does_not_take_the_samples_with_it_and_its_end_does() {
    let flown = hover();
    let mut module = Module::new();
    module.run(|run| {
        run.command(Command::CalStart(Procedure::Flight));
        for (i, sample) in flown[..60].iter().enumerate() {
            run.compass.step(Event::Sample(Sample { time: WrappingMillis::new(250 * i as u32), ..*sample }));
            if run.compass.is_busy() {
                run.compass.step(Event::Advance);
                return;
            }
        }
        panic!("a trial after forty samples");
    });
    module.run(|run| {
        assert_eq!((run.compass.state(), run.report().is_auto), (State::Collecting, false));
        run.command(Command::CalSolve(Some(Method::TwoPlane)));
        let mut steps = 0;
        while run.compass.is_busy() && steps < 1000 {
            run.compass.step(Event::Advance);
            steps += 1;
        }
        assert!(matches!(run.compass.last(), Some(Err(_))), "no turns: {:?}", run.compass.last());
    });
    module.run(|run| {
        assert_eq!((run.compass.state(), run.report().progress.left.samples), (State::Uncalibrated, 0));
        assert_eq!(run.compass.last(), None, "it was told");
    });
    module.run(|run| {
        run.command(Command::CalStart(Procedure::Flight));
        run.fly(&flown[..30]);
        run.command(Command::CalAbort);
    });
    module.run(|run| assert_eq!(run.report().progress.left.samples, 0));
}

/// A calibration was stored, and the restart came before the samples were given up: they are not solved again.
#[test]
fn what_has_been_calibrated_is_not_collected_on() {
    let mut module = Module::new();
    module.run(|run| assert!(run.fly(&hover()[..60]).is_none()));
    module.stored.generations.current = Some(Record { sensor: SENSOR, ..record(1) });
    module.run(|run| {
        assert_eq!((run.compass.state(), run.report().progress.left.samples), (State::Calibrated, 0));
        assert_eq!(run.compass.last(), None);
    });
}

/// It is noted once that there is something to lose, and once that there is not: two writes a collection, and one where a
/// calibration is written at its end. When the power goes between, it is told, once.
#[test]
fn a_collection_that_went_with_the_power_is_told() {
    let flown = hover();
    let mut module = Module::new();
    module.run(|run| {
        run.fly(&flown[..4]);
        assert_eq!(*run.writes, 0, "nothing to lose yet");
        run.fly(&flown[4..80]);
        assert_eq!(*run.writes, 1);
    });
    module.run(|run| assert_eq!((run.compass.last(), *run.writes), (None, 1), "it is not lost"));
    module.lose_power();
    module.run(|run| {
        assert_eq!(run.compass.last(), Some(&Err(Refusal::CollectionLost)));
        assert_eq!(run.compass.glance(), Glance::Waiting, "no trouble");
        run.look(SILENT);
        assert_eq!((run.stored.remembered, *run.writes), (Remembered::NOTHING, 2));
    });
    module.lose_power();
    module.run(|run| assert_eq!((run.compass.last(), *run.writes), (None, 2), "told once"));
    module.run(|run| assert!(run.fly(&flown).is_some_and(|end| end.is_ok())));
    module.lose_power();
    module.run(|run| assert_eq!((run.compass.last(), *run.writes), (None, 3), "stored with the calibration"));
}

/// Memory that is not a collection's after all is lost as well, and is never solved; whatever restarts the module again and
/// again while it has this collection is the third time.
#[test]
fn a_collection_that_is_damaged_is_told() {
    let flown = hover();
    let mut module = Module::new();
    module.run(|run| assert!(run.fly(&flown[..80]).is_none()));
    let mut damaged = Module { kept: module.kept.clone(), stored: module.stored, now: 0, writes: 0 };
    let mut at = 0;
    damaged.kept.change(|word| {
        at += 1;
        if at == 100 { word ^ 1 } else { word }
    });
    damaged.run(|run| {
        assert_eq!(run.compass.last(), Some(&Err(Refusal::CollectionLost)));
        assert_eq!(run.report().progress.left.samples, 0);
    });
    for _ in 0..3 {
        module.run(|run| assert_eq!(run.compass.last(), None));
    }
    module.run(|run| assert_eq!(run.compass.last(), Some(&Err(Refusal::CollectionLost))));
}

/// A reboot that was asked for, and a trial that ended, are no sign of that.
#[test]
fn restarts_that_are_asked_for_do_not_count() {
    let flown = hover();
    let mut module = Module::new();
    module.run(|run| assert!(run.fly(&flown[..60]).is_none()));
    for _ in 0..6 {
        module.run(|run| {
            assert_eq!(run.compass.state(), State::Collecting);
            run.compass.step(Event::Armed(Some(false)));
            assert!(matches!(run.command(Command::Restart), Effect::Reply(Ok(_))));
        });
    }
    for _ in 0..6 {
        module.run(|run| {
            assert_eq!(run.compass.state(), State::Collecting);
            assert!(run.fly(&flown[60..62]).is_none() && run.report().prospect.is_some(), "a trial");
        });
    }
}

/// From both sides of five seconds; only what is another than before is written, of a port that is to find it; silence and
/// what somebody has chosen are not.
#[test]
fn what_ports_have_found_is_written_once() {
    let mut module = Module::new();
    let at = |run: &mut Run<'_>, ms: u32, spoken| {
        *run.now = ms;
        run.look(spoken);
        // The other port speaks sentences, or in a firmware without them searches, too.
        let [found, _] = run.stored.remembered.found;
        (found, *run.writes)
    };
    let other = [ProtocolKind::Msp, ProtocolKind::Nmea];
    let [nothing, mavlink, msp] = [ProtocolKind::Auto, ProtocolKind::Mavlink, ProtocolKind::Msp];
    module.run(|run| {
        assert_eq!(at(run, 1000, SILENT), (nothing, 0));
        assert_eq!(at(run, 9000, FOUND), (nothing, 0));
        assert_eq!(at(run, 13_999, FOUND), (nothing, 0));
        assert_eq!(at(run, 14_000, FOUND), (mavlink, 1));
        assert_eq!(at(run, 19_000, FOUND), (mavlink, 1));
        assert_eq!(at(run, 30_000, SILENT), (mavlink, 1));
        assert_eq!(at(run, 40_000, SILENT), (mavlink, 1), "silence");
        assert_eq!(at(run, 41_000, other), (mavlink, 1));
        assert_eq!(at(run, 42_000, FOUND), (mavlink, 1), "not for long enough");
        assert_eq!(at(run, 46_500, other), (mavlink, 1));
        assert_eq!(at(run, 51_500, other), (msp, 2));
    });
    module.run(|run| {
        assert_eq!((at(run, 1000, other), at(run, 9000, other)), ((msp, 2), (msp, 2)), "as it was stored");
        let chosen = Setting::Protocol(PortNumber::One, ProtocolKind::Mavlink);
        assert!(matches!(run.command(Command::Set(chosen)), Effect::Save));
        run.compass.step(Event::Saved(Ok(())));
        assert_eq!((at(run, 10_000, FOUND), at(run, 20_000, FOUND)), ((msp, 2), (msp, 2)), "chosen");
    });
}

/// Flash that refuses is asked once, not ten times a second.
#[test]
fn a_save_that_fails_is_not_tried_again() {
    let mut bed = Bed::new();
    let mut saves = 0;
    for second in 0..60 {
        let now = WrappingMillis::new(second * 1000);
        if let Effect::Save = bed.compass.step(Event::Spoken(FOUND, now)) {
            saves += 1;
            assert!(matches!(bed.compass.step(Event::Saved(Err(StoreError::Flash))), Effect::None));
        }
    }
    assert_eq!(saves, 1);
}

/// A solve is not held up by it.
#[test]
fn nothing_is_written_in_a_solve() {
    let mut bed = Bed::new();
    bed.done(Command::CalStart(Procedure::Turns));
    bed.fly(&turns(&airframe(), 1));
    assert!(bed.compass.is_busy());
    assert!(matches!(bed.compass.step(Event::Spoken(SILENT, WrappingMillis::new(0))), Effect::None));
    assert!(matches!(bed.compass.step(Event::Advance), Effect::None));
    let end = bed.solve();
    assert!(bed.settle(end).is_ok());
    // What was never noted needs no note that it is over.
    assert!(matches!(bed.compass.step(Event::Spoken(SILENT, WrappingMillis::new(0))), Effect::None));
}
