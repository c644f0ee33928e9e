//! Restarts: the collection in RAM, and stored values.

use testkit::random::Random as Bits;

use super::*;

const DETECTED_PROTOCOLS: [ProtocolKind; PORT_COUNT] = [ProtocolKind::Mavlink, ProtocolKind::Nmea];

/// RAM and flash, which restarts retain.
struct Module {
    memory: RetainedSamples,
    flash: StoredValues,
    startup_save_count: u32,
}

impl Module {
    fn new() -> Self {
        Self { memory: RetainedSamples::EMPTY, flash: StoredValues::default(), startup_save_count: 0 }
    }

    /// A module that has collected these samples in an automatic collection, and whose flash contains that it collects.
    fn after_collecting(samples: &[Sample]) -> Self {
        let mut module = Self::new();
        module.restart(|bed| bed.collect(samples));
        assert!(module.flash.startup_values.is_collecting);
        module
    }

    /// Starts the module at clock zero on an armed vehicle, and runs it until the end of a test.
    fn restart<T>(&mut self, test: impl FnOnce(&mut TestBed<'_>) -> T) -> T {
        let mut bed = TestBed::start_module(&self.flash, &mut self.memory);
        (bed.now_ms, bed.startup_save_count) = (100, self.startup_save_count);
        bed.report_armed(Some(true));
        let result = test(&mut bed);
        bed.process_idle_time(NO_PROTOCOLS);
        (self.flash, self.startup_save_count) = (bed.flash, bed.startup_save_count);
        result
    }

    fn lose_power(&mut self) {
        let mut random = Bits(1);
        self.memory.transform_words(|_| random.bits() as u32);
    }

    /// Outcome that the module reports after a restart, and saves without a command so far.
    fn outcome_after_restart(&mut self) -> (Option<Message>, u32) {
        self.restart(|bed| (bed.compass.last_collection_outcome().cloned(), bed.startup_save_count))
    }
}

#[test]
fn control_of_a_collection_survives_restarts() {
    let samples = hover_samples(1);
    let mut module = Module::after_collecting(&samples[..60]);
    let kept = module.restart(|bed| {
        let kept = bed.state_and_fit_count();
        assert!(kept.0 == ModuleState::Collecting && bed.status_report().is_automatic);
        bed.report_armed(Some(false));
        bed.collect(&samples[60..100]);
        assert!(bed.status_report().awaits_arming);
        kept
    });
    module.restart(|bed| {
        assert_eq!(bed.state_and_fit_count(), kept);
        bed.start(Procedure::Flight);
    });
    module.restart(|bed| {
        let refusal = bed.expect_refusal(Command::CalStart(Procedure::Flight));
        assert!(matches!(refusal, Refusal::Collecting { .. }), "the user's: {refusal:?}");
        bed.compass.collector.reset_restart_count();
        bed.expect_done(Command::CalStop);
    });
    module.restart(|bed| {
        bed.collect(&samples[100..160]);
        assert_eq!(bed.state_and_fit_count(), (ModuleState::Uncalibrated, kept.1), "no automatic start");
        assert_eq!(bed.expect_done(Command::CalSolve(None)), ModuleState::Solving);
    });
}

#[test]
fn samples_survive_a_restart_in_a_solve_but_not_its_end() {
    let samples = hover_samples(1);
    let mut module = Module::new();
    module.restart(|bed| {
        bed.start(Procedure::Flight);
        bed.collect_until_trial(&samples[..60]);
        bed.expect_none(Event::AdvanceSolve);
    });
    module.restart(|bed| {
        assert_eq!((bed.state(), bed.status_report().is_automatic), (ModuleState::Collecting, false));
        bed.expect_done(Command::CalSolve(Some(Method::TwoPlane)));
        assert!(bed.finish_solve().is_err(), "no turns");
        bed.collect(&samples[60..62]);
        assert_eq!(bed.state(), ModuleState::Uncalibrated, "the user remains in control");
    });
    module.restart(|bed| {
        assert_eq!(bed.state_and_fit_count(), (ModuleState::Uncalibrated, 0));
        assert_eq!(bed.compass.last_collection_outcome(), None, "the failure was reported before");
        bed.start(Procedure::Flight);
        bed.collect(&samples[..30]);
        bed.expect_done(Command::CalAbort);
    });
    module.restart(|bed| assert_eq!(bed.state_and_fit_count(), (ModuleState::Uncalibrated, 0)));
}

/// Two writes per collection, at its first samples and its end; one if it ends with a calibration. A loss is reported
/// once.
#[test]
fn a_collection_lost_with_the_power_is_reported() {
    let samples = hover_samples(1);
    let mut module = Module::new();
    module.restart(|bed| {
        bed.collect(&samples[..4]);
        assert_eq!(bed.startup_save_count, 0, "nothing to lose yet");
        bed.collect(&samples[4..80]);
        assert_eq!(bed.startup_save_count, 1);
    });
    assert_eq!(module.outcome_after_restart(), (None, 1), "it is not lost");
    module.lose_power();
    module.restart(|bed| {
        assert_eq!(bed.compass.last_collection_outcome(), Some(&Message::CollectionLost));
        assert_eq!(bed.compass.indicator_state(), IndicatorState::Idle, "no trouble");
    });
    assert_eq!(module.flash.startup_values, StartupValues::DEFAULT);
    module.lose_power();
    assert_eq!(module.outcome_after_restart(), (None, 2), "the loss is reported once");
    module.restart(|bed| assert!(bed.collect_until_end(&samples).is_some_and(|end| end.is_ok())));
    module.lose_power();
    assert_eq!(module.outcome_after_restart(), (None, 3), "stored with the calibration");
}

/// The samples are a possible cause of unexpected restarts; not of requested ones, nor if a trial solve completed.
#[test]
fn only_repeated_unexpected_restarts_lose_the_collection() {
    let samples = hover_samples(1);
    let mut module = Module::after_collecting(&samples[..60]);
    for _ in 0..6 {
        module.restart(|bed| {
            assert_eq!(bed.state(), ModuleState::Collecting);
            bed.report_armed(Some(false));
            bed.expect_done(Command::Restart);
        });
    }
    for _ in 0..6 {
        module.restart(|bed| {
            assert_eq!(bed.state(), ModuleState::Collecting);
            bed.collect(&samples[60..62]);
            assert!(bed.status_report().last_trial.is_some(), "a trial");
        });
    }
    for _ in 0..3 {
        assert_eq!(module.outcome_after_restart().0, None);
    }
    assert_eq!(module.outcome_after_restart().0, Some(Message::CollectionLost));
}

/// A protocol is written after 5 s of detection; silence and configured protocols are not written.
#[test]
fn detected_protocols_are_written_once() {
    let mut module = Module::new();
    let other = [ProtocolKind::Msp, ProtocolKind::Nmea];
    let [nothing, mavlink, msp] = [ProtocolKind::Auto, ProtocolKind::Mavlink, ProtocolKind::Msp];
    let expect_written = |bed: &mut TestBed, cases: &[(u32, [ProtocolKind; PORT_COUNT], ProtocolKind, u32)]| {
        for &(time_ms, detected, protocol, save_count) in cases {
            bed.now_ms = time_ms;
            bed.process_idle_time(detected);
            // The other port may be NMEA, or detecting in a firmware without NMEA.
            let [found, _] = bed.flash.startup_values.detected_protocols;
            assert_eq!((found, bed.startup_save_count), (protocol, save_count), "at {time_ms} ms");
        }
    };
    module.restart(|bed| {
        expect_written(
            bed,
            &[
                (1000, NO_PROTOCOLS, nothing, 0),
                (9000, DETECTED_PROTOCOLS, nothing, 0),
                (13_999, DETECTED_PROTOCOLS, nothing, 0),
                (14_000, DETECTED_PROTOCOLS, mavlink, 1),
                (19_000, DETECTED_PROTOCOLS, mavlink, 1),
                (30_000, NO_PROTOCOLS, mavlink, 1),
                // Silence.
                (40_000, NO_PROTOCOLS, mavlink, 1),
                (41_000, other, mavlink, 1),
                // Not for long enough.
                (42_000, DETECTED_PROTOCOLS, mavlink, 1),
                (46_500, other, mavlink, 1),
                (51_500, other, msp, 2),
            ],
        );
    });
    module.restart(|bed| {
        expect_written(bed, &[(1000, other, msp, 2), (9000, other, msp, 2)]);
        bed.set(setting_change("PORT1", f32::from(ProtocolKind::Mavlink as u8)));
        expect_written(bed, &[(10_000, DETECTED_PROTOCOLS, msp, 2), (20_000, DETECTED_PROTOCOLS, msp, 2)]);
    });
}
