//! Commands and their acknowledgements.

use super::*;
use autoswing::calibration::method_selection::Procedure;

const REJECTED: u8 = 1;

const START_NUMBER: u16 = 42_424;
const ABORT_NUMBER: u16 = 42_426;
const REBOOT_NUMBER: u16 = 246;
const START: Command = Command::CalStart(Procedure::Flight);
const MODULE_ADDRESS: MavlinkAddress = [1, 158];

impl MavlinkBench {
    /// Receives a command of the ground station; returns the command to execute.
    fn send_command(&mut self, number: u16, confirmation: u8) -> Option<Command> {
        self.receive_command(&mavlink_command(GROUND_STATION, MODULE_ADDRESS, number, confirmation, [0.0; 4]))
    }

    fn send_reboot_command(&mut self, parameters: [f32; 4]) -> Option<Command> {
        self.receive_command(&mavlink_command(GROUND_STATION, MODULE_ADDRESS, REBOOT_NUMBER, 0, parameters))
    }

    fn receive_command(&mut self, frame: &[u8]) -> Option<Command> {
        match self.receive(frame)[..] {
            [] => None,
            [ReceivedMessage::Command(command)] => Some(command),
            ref received => panic!("{received:?}"),
        }
    }

    /// Removes and returns the sent acknowledgements to the ground station: command and result.
    fn take_acknowledgements(&mut self) -> Vec<(u16, u8)> {
        self.poll();
        let acknowledgement = |ack: &SentMessage| {
            assert_eq!(ack.payload[8..10], GROUND_STATION);
            (u16::from_le_bytes([ack.payload[0], ack.payload[1]]), ack.payload[2])
        };
        self.take_messages(77).iter().map(acknowledgement).collect()
    }
}

#[test]
fn calibration_commands_are_executed_and_acknowledged() {
    for (number, command) in
        [(START_NUMBER, START), (42_425, Command::CalSolve(None)), (ABORT_NUMBER, Command::CalAbort)]
    {
        for (result, acknowledged) in [
            (Ok(()), ACCEPTED),
            (Err(&Refusal::Armed), REJECTED),
            (Err(&Refusal::Busy), REJECTED),
            (Err(&Refusal::NoSamples), DENIED),
        ] {
            let mut bench = MavlinkBench::with_autopilot();
            assert_eq!(bench.send_command(number, 0), Some(command));
            assert_eq!(bench.take_acknowledgements(), [], "not before the result");
            bench.mavlink.complete_command(command, result);
            assert_eq!(bench.take_acknowledgements(), [(number, acknowledged)]);
            bench.mavlink.complete_command(command, result);
            assert_eq!(bench.take_acknowledgements(), [], "once");
        }
    }
}

/// Component 158 of this system or of all; commands to all components are for the autopilot's own compass.
#[test]
fn only_commands_addressed_to_the_module_are_accepted() {
    for (target, is_accepted) in
        [(MODULE_ADDRESS, true), ([0, 158], true), ([1, 0], false), ([0, 0], false), ([1, 1], false), ([2, 158], false)]
    {
        let mut bench = MavlinkBench::with_autopilot();
        let start = mavlink_command(GROUND_STATION, target, START_NUMBER, 0, [0.0; 4]);
        assert_eq!(bench.receive_command(&start), is_accepted.then_some(START), "{target:?}");
        bench.receive(&mavlink_command(GROUND_STATION, target, 512, 0, [0.0; 4]));
        assert_eq!(bench.take_acknowledgements().len(), usize::from(is_accepted), "{target:?}");
    }
}

#[test]
fn a_reboot_command_must_be_for_the_module() {
    for (parameters, restarts) in [
        ([1.0, 0.0, 0.0, 0.0], true),
        ([0.0, 0.0, 1.0, 158.0], true),
        ([0.0, 0.0, 1.0, 0.0], true),
        ([0.0, 0.0, 1.0, 157.0], false),
        ([0.0, 1.0, 0.0, 158.0], false),
        ([0.0, 0.0, 2.0, 158.0], false),
        ([2.0, 0.0, 0.0, 0.0], false),
        ([3.0, 0.0, 0.0, 0.0], false),
        ([0.0; 4], false),
        ([f32::NAN; 4], false),
    ] {
        let mut bench = MavlinkBench::with_autopilot();
        assert_eq!(bench.send_reboot_command(parameters), restarts.then_some(Command::Restart), "{parameters:?}");
        bench.mavlink.complete_command(Command::Restart, Ok(()));
        let acknowledged = if restarts { ACCEPTED } else { DENIED };
        assert_eq!(bench.take_acknowledgements(), [(REBOOT_NUMBER, acknowledged)], "{parameters:?}");
        assert_eq!(bench.send_command(START_NUMBER, 0), Some(START), "the next command");
    }
}

#[test]
fn a_user_command_acts_on_the_autopilot() {
    use AutopilotAction::{Check, Restart, Setup, Undo};
    for (parameter, action) in [
        (1.0, Some(Check)),
        (2.0, Some(Setup)),
        (3.0, Some(Restart)),
        (4.0, Some(Undo)),
        (0.0, None),
        (5.0, None),
        (f32::NAN, None),
    ] {
        let mut bench = MavlinkBench::with_autopilot();
        let frame = mavlink_command(GROUND_STATION, MODULE_ADDRESS, 31_010, 0, [parameter, 0.0, 0.0, 0.0]);
        assert_eq!(bench.receive_command(&frame), action.map(Command::Autopilot), "{parameter}");
        assert_eq!(bench.take_acknowledgements(), if action.is_some() { vec![] } else { vec![(31_010, DENIED)] });
    }
}

/// A repetition has the same command and sender, and comes while the result is pending, or within a second.
#[test]
fn a_repeated_command_is_answered_and_not_executed_again() {
    let mut bench = MavlinkBench::with_autopilot();
    bench.send_command(START_NUMBER, 0);
    for (pause_ms, confirmation) in [(0, 1), (1_500, 2)] {
        bench.now_ms += pause_ms;
        assert_eq!(bench.send_command(START_NUMBER, confirmation), None);
        assert_eq!(bench.take_acknowledgements(), [(START_NUMBER, IN_PROGRESS)]);
    }
    for (result, acknowledged) in [(Ok(()), ACCEPTED), (Err(&Refusal::NoSamples), DENIED)] {
        bench.mavlink.complete_command(START, result);
        assert_eq!(bench.take_acknowledgements(), [(START_NUMBER, acknowledged)]);
        bench.now_ms += 5_000;
        assert_eq!(bench.send_command(START_NUMBER, 1), Some(START), "too late for a repetition");
        bench.mavlink.complete_command(START, result);
        bench.take_acknowledgements();
        bench.now_ms += 1_000;
        assert_eq!(bench.send_command(START_NUMBER, 1), None);
        assert_eq!(bench.take_acknowledgements(), [(START_NUMBER, acknowledged)]);
        assert_eq!(bench.send_command(START_NUMBER, 0), Some(START), "no repetition");
    }
    bench.mavlink.complete_command(START, Ok(()));
    assert_eq!(bench.send_command(ABORT_NUMBER, 1), Some(Command::CalAbort), "another command");
    bench.mavlink.complete_command(Command::CalAbort, Ok(()));
    let of_other_sender = mavlink_command([254, 190], MODULE_ADDRESS, ABORT_NUMBER, 1, [0.0; 4]);
    assert_eq!(bench.receive_command(&of_other_sender), Some(Command::CalAbort), "another sender");
}

/// One command is executed at a time, with a timeout of five seconds: a missing result must not block later commands.
#[test]
fn commands_are_rejected_while_another_is_pending() {
    let mut bench = MavlinkBench::with_autopilot();
    bench.send_command(START_NUMBER, 0);
    bench.now_ms += 5_000;
    assert_eq!(bench.send_command(ABORT_NUMBER, 0), None);
    assert_eq!(bench.take_acknowledgements(), [(ABORT_NUMBER, REJECTED)]);
    bench.now_ms += 1;
    assert_eq!(bench.send_command(ABORT_NUMBER, 0), Some(Command::CalAbort));
    bench.mavlink.complete_command(START, Ok(()));
    assert_eq!(bench.take_acknowledgements(), [], "the result is that of the previous command");
    bench.mavlink.complete_command(Command::CalAbort, Ok(()));
    assert_eq!(bench.take_acknowledgements(), [(ABORT_NUMBER, ACCEPTED)]);
}

/// Accepted, unknown and repeated commands have no text.
#[test]
fn a_rejected_command_sends_a_text_with_the_reason() {
    let mut bench = MavlinkBench::with_autopilot();
    bench.send_command(START_NUMBER, 0);
    bench.send_command(ABORT_NUMBER, 0);
    bench.mavlink.complete_command(START, Err(&Refusal::NoSensor));
    bench.send_command(START_NUMBER, 1);
    bench.send_command(511, 0);
    bench.run_ms(2_000);
    let rejected = |refusal| (4, format!("autoswing: {}", Notice::CommandRejected(refusal)));
    assert_eq!(bench.take_texts(), [rejected(Refusal::Busy), rejected(Refusal::NoSensor)]);
    bench.send_reboot_command([2.0, 0.0, 0.0, 0.0]);
    bench.send_command(START_NUMBER, 0);
    bench.mavlink.complete_command(START, Ok(()));
    bench.run_ms(2_000);
    let texts = bench.take_texts();
    assert_eq!(texts.len(), 1, "{texts:?}");
    assert!(texts[0].1.starts_with("autoswing: refused out-of-range: the module can restart"), "{texts:?}");
}
