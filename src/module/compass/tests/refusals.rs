//! Problems of a flight that a refusal reports.

use super::*;

#[test]
fn a_refusal_reports_the_problem_of_the_flight() {
    let mut bench = TestBed::new();
    bench.expect_done(Command::CalStart(Procedure::Turns));
    assert_eq!(bench.expect_refusal(Command::CalSolve(None)), Refusal::NoSamples);
    bench.now_ms = bench.now_ms.wrapping_add(STEP_MS);
    let hold = |bench: &mut TestBed, roll_deg: f32, samples: usize| {
        for _ in 0..samples {
            bench.process_sample(test_field(), Attitude::from_deg(roll_deg, 0.0));
        }
    };
    hold(&mut bench, 6.0, 60);
    let refused = bench.expect_refusal(Command::CalSolve(None));
    assert_eq!(refused.stable_code(), "no-samples");
    assert_eq!(refused.to_string(), "too little bank, 6.0 deg at most; fly turns at 15 deg of bank or more each way");
    hold(&mut bench, -25.0, 60);
    let refused = bench.expect_refusal(Command::CalSolve(None));
    assert_eq!(refused.stable_code(), "too-few-samples");
    assert_eq!(refused.to_string(), "only left turns were flown; fly right turns, too");
    bench.expect_done(Command::CalStartNew(None));
    assert_eq!(bench.expect_refusal(Command::CalSolve(None)), Refusal::NoSamples);
}

#[test]
fn collection_problems_explain_only_refusals_for_missing_samples() {
    let lack = Some(CollectionProblem::OneSideOnly(Side::Left));
    let too_few = SolveError::TooFewSamples { part: SamplePart::Turns(Side::Right), have: 3, need: 12 };
    for (refusal, code, words) in [
        (Refusal::NoSamples, "no-samples", "only left turns"),
        (Refusal::Solve(too_few), "too-few-samples", "only left turns"),
        (Refusal::Solve(SolveError::SamePlane), "same-plane", "only left turns"),
        (Refusal::Solve(SolveError::NotAnEllipse(SamplePart::Turns(Side::Left))), "not-an-ellipse", "only left turns"),
        (Refusal::Solve(SolveError::NotDetermined(SamplePart::All)), "not-determined", "only left turns"),
        (Refusal::Rejected(Rejection::TooFewHeldBack { have: 3, need: 8 }), "too-few-held-back", "only left turns"),
        (
            Refusal::Rejected(Rejection::NotAccurate { expected_rms_deg: 4.26 }),
            "not-accurate",
            "expected error 4.3 deg; only left turns",
        ),
    ] {
        assert_eq!(refusal.clone().with_cause(None::<CollectionProblem>), refusal);
        let explained = refusal.with_cause(lack);
        assert!(
            explained.stable_code() == code && explained.to_string().starts_with(words),
            "{explained:?}: {explained}"
        );
    }
    // Mounting or turn direction estimated from an arc are not reported.
    let found = Orientation::from_name("yaw90").unwrap();
    for error in [SolveError::NotConverged, SolveError::TurnsReversed, SolveError::MountContradicted { found }] {
        let arc = CollectionProblem::ArcOnly { side: Side::Left, sectors: 2 };
        let code = Refusal::Solve(error).stable_code();
        let explained = Refusal::Solve(error).with_cause(Some(arc));
        assert_eq!(explained, Refusal::InsufficientSamples { code, expected_rms_deg: None, cause: arc.into() });
        assert_eq!(Refusal::Solve(error).with_cause(lack), Refusal::Solve(error));
    }
    let marks = SolveError::TooFewSamples { part: SamplePart::Marks, have: 3, need: 4 };
    for other in [
        Refusal::Armed,
        Refusal::NoSensor,
        Refusal::Solve(marks),
        Refusal::Solve(SolveError::TurnsReversed),
        Refusal::Rejected(Rejection::NotBetter { candidate_score: 1.0, incumbent_score: 0.5 }),
        Refusal::Store(StoreError::Full),
    ] {
        assert_eq!(other.clone().with_cause(lack), other);
    }
}
