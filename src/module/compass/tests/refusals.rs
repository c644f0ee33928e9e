//! Problems of a flight that a refusal reports.

use super::*;

#[test]
fn a_refusal_reports_the_problem_of_the_flight() {
    let mut bed = TestBed::new();
    bed.start(Procedure::Turns);
    assert_eq!(bed.expect_refusal(Command::CalSolve(None)), Refusal::NoSamples);
    for (roll_deg, code, text) in [
        (6.0, "no-samples", "too little bank, 6.0 deg at most; fly turns at 15 deg of bank or more each way"),
        (-25.0, "too-few-samples", "only left turns were flown; fly right turns, too"),
    ] {
        (0..60).for_each(|_| bed.process_sample(test_field(), RollPitch::from_deg(roll_deg, 0.0)));
        let refused = bed.expect_refusal(Command::CalSolve(None));
        assert_eq!((refused.stable_code(), refused.to_string().as_str()), (code, text));
    }
    bed.expect_done(Command::CalStartNew(None));
    assert_eq!(bed.expect_refusal(Command::CalSolve(None)), Refusal::NoSamples);
}
