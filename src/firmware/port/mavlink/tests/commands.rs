//! Commands and their acknowledgements.

use super::*;
use autoswing::calibration::method_selection::Procedure;

const ACCEPTED: u8 = 0;
const REJECTED: u8 = 1;
const DENIED: u8 = 2;
const UNSUPPORTED: u8 = 3;
const IN_PROGRESS: u8 = 5;

const START_COMMAND: u16 = 42_424;
const REBOOT_COMMAND: u16 = 246;
const MODULE_ADDRESS: SenderAddress = [1, 158];

impl MavlinkBench {
    fn send_command(&mut self, number: u16, confirmation: u8) -> Vec<ReceivedMessage> {
        self.receive(&command_frame(GROUND_STATION, MODULE_ADDRESS, number, confirmation, [0.0; 4]))
    }

    fn send_reboot_command(&mut self, parameters: [f32; 4]) -> Vec<ReceivedMessage> {
        self.receive(&command_frame(GROUND_STATION, MODULE_ADDRESS, REBOOT_COMMAND, 0, parameters))
    }

    /// Removes and returns the sent acknowledgements: command, result and addressee.
    fn take_acknowledgements(&mut self) -> Vec<(u16, u8, SenderAddress)> {
        self.poll();
        let answers = self.take_messages(77);
        answers
            .iter()
            .map(|ack| {
                let number = u16::from_le_bytes([ack.payload[0], ack.payload[1]]);
                (number, ack.payload[2], [ack.payload[8], ack.payload[9]])
            })
            .collect()
    }
}

#[test]
fn calibration_commands_are_executed_and_acknowledged() {
    for (number, order) in [
        (START_COMMAND, Command::CalStart(Procedure::Flight)),
        (42_425, Command::CalSolve(None)),
        (42_426, Command::CalAbort),
    ] {
        for (result, acknowledged) in [
            (Ok(()), ACCEPTED),
            (Err(&Refusal::Armed), REJECTED),
            (Err(&Refusal::Busy), REJECTED),
            (Err(&Refusal::NoSamples), DENIED),
        ] {
            let mut bed = MavlinkBench::with_autopilot();
            assert_eq!(bed.send_command(number, 0), [ReceivedMessage::Command(order)]);
            assert_eq!(bed.take_acknowledgements(), [], "not before it is known");
            bed.mavlink.complete_command(order, result);
            assert_eq!(bed.take_acknowledgements(), [(number, acknowledged, GROUND_STATION)]);
            bed.mavlink.complete_command(order, result);
            assert_eq!(bed.take_acknowledgements(), [], "once");
        }
    }
}

/// Component 158 of this system or of all; commands to all components are for the autopilot's own compass.
#[test]
fn only_commands_addressed_to_the_module_are_accepted() {
    for (target, is_taken) in
        [(MODULE_ADDRESS, true), ([0, 158], true), ([1, 0], false), ([0, 0], false), ([1, 1], false), ([2, 158], false)]
    {
        let mut bed = MavlinkBench::with_autopilot();
        let heard = bed.receive(&command_frame(GROUND_STATION, target, START_COMMAND, 0, [0.0; 4]));
        assert_eq!(
            heard,
            if is_taken { vec![ReceivedMessage::Command(Command::CalStart(Procedure::Flight))] } else { vec![] },
            "{target:?}"
        );
        bed.receive(&command_frame(GROUND_STATION, target, 512, 0, [0.0; 4]));
        assert_eq!(bed.take_acknowledgements().len(), usize::from(is_taken), "{target:?}");
    }
}

#[test]
fn unknown_commands_are_answered_as_unsupported() {
    let mut bed = MavlinkBench::with_autopilot();
    for number in [511, 400, 42_423, 42_427] {
        assert_eq!(bed.send_command(number, 0), []);
        assert_eq!(bed.take_acknowledgements(), [(number, UNSUPPORTED, GROUND_STATION)]);
    }
}

#[test]
fn a_reboot_command_must_be_for_the_module_and_is_rejected_while_armed() {
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
        let mut bed = MavlinkBench::with_autopilot();
        if restarts {
            assert_eq!(
                bed.send_reboot_command(parameters),
                [ReceivedMessage::Command(Command::Restart)],
                "{parameters:?}"
            );
            bed.mavlink.complete_command(Command::Restart, Ok(()));
            assert_eq!(bed.take_acknowledgements(), [(REBOOT_COMMAND, ACCEPTED, GROUND_STATION)]);
        } else {
            assert_eq!(bed.send_reboot_command(parameters), [], "{parameters:?}");
            assert_eq!(bed.take_acknowledgements(), [(REBOOT_COMMAND, DENIED, GROUND_STATION)]);
        }
        let mut bed = MavlinkBench::with_autopilot();
        bed.receive(&heartbeat_frame(AUTOPILOT, true, true));
        let expected = if restarts { vec![ReceivedMessage::Command(Command::Restart)] } else { vec![] };
        assert_eq!(bed.send_reboot_command(parameters), expected);
        bed.mavlink.complete_command(Command::Restart, Err(&Refusal::Armed));
        assert_eq!(
            bed.take_acknowledgements(),
            [(REBOOT_COMMAND, if restarts { REJECTED } else { DENIED }, GROUND_STATION)]
        );
        assert_eq!(
            bed.send_command(START_COMMAND, 0),
            [ReceivedMessage::Command(Command::CalStart(Procedure::Flight))]
        );
    }
}

/// Commands repeated just before and after one second, and while the result is pending.
#[test]
fn a_repeated_command_is_answered_and_not_carried_out_again() {
    let mut bed = MavlinkBench::with_autopilot();
    bed.send_command(START_COMMAND, 0);
    assert_eq!(bed.send_command(START_COMMAND, 1), []);
    assert_eq!(bed.take_acknowledgements(), [(START_COMMAND, IN_PROGRESS, GROUND_STATION)]);
    bed.now_ms += 1_500;
    assert_eq!(bed.send_command(START_COMMAND, 2), []);
    assert_eq!(bed.take_acknowledgements(), [(START_COMMAND, IN_PROGRESS, GROUND_STATION)]);
    bed.mavlink.complete_command(Command::CalStart(Procedure::Flight), Ok(()));
    assert_eq!(bed.take_acknowledgements(), [(START_COMMAND, ACCEPTED, GROUND_STATION)]);
    for (result, acknowledged) in [(Ok(()), ACCEPTED), (Err(&Refusal::NoSamples), DENIED)] {
        assert_eq!(
            bed.send_command(START_COMMAND, 0),
            [ReceivedMessage::Command(Command::CalStart(Procedure::Flight))],
            "not a repetition"
        );
        bed.mavlink.complete_command(Command::CalStart(Procedure::Flight), result);
        bed.take_acknowledgements();
        bed.now_ms += 1_000;
        assert_eq!(bed.send_command(START_COMMAND, 1), []);
        assert_eq!(bed.take_acknowledgements(), [(START_COMMAND, acknowledged, GROUND_STATION)]);
        bed.now_ms += 1;
        assert_eq!(
            bed.send_command(START_COMMAND, 2),
            [ReceivedMessage::Command(Command::CalStart(Procedure::Flight))]
        );
        bed.mavlink.complete_command(Command::CalStart(Procedure::Flight), Ok(()));
        bed.take_acknowledgements();
    }
}

#[test]
fn a_repetition_has_the_same_command_and_sender() {
    let mut bed = MavlinkBench::with_autopilot();
    bed.send_command(START_COMMAND, 0);
    bed.mavlink.complete_command(Command::CalStart(Procedure::Flight), Ok(()));
    assert_eq!(bed.send_command(42_426, 1), [ReceivedMessage::Command(Command::CalAbort)]);
    bed.mavlink.complete_command(Command::CalAbort, Ok(()));
    let other = [254, 190];
    assert_eq!(
        bed.receive(&command_frame(other, MODULE_ADDRESS, 42_426, 1, [0.0; 4])),
        [ReceivedMessage::Command(Command::CalAbort)]
    );
    bed.mavlink.complete_command(Command::CalAbort, Ok(()));
    assert_eq!(bed.take_acknowledgements()[2], (42_426, ACCEPTED, other));
}

/// One command is executed at a time, with a timeout of five seconds: a missing result must not block later commands.
#[test]
fn commands_are_rejected_while_another_is_pending() {
    let mut bed = MavlinkBench::with_autopilot();
    bed.send_command(START_COMMAND, 0);
    bed.now_ms += 5_000;
    assert_eq!(bed.send_command(42_426, 0), []);
    assert_eq!(bed.take_acknowledgements(), [(42_426, REJECTED, GROUND_STATION)]);
    bed.now_ms += 1;
    assert_eq!(bed.send_command(42_426, 0), [ReceivedMessage::Command(Command::CalAbort)]);
    // The result of the previous command does not apply to this one.
    bed.mavlink.complete_command(Command::CalStart(Procedure::Flight), Ok(()));
    assert_eq!(bed.take_acknowledgements(), []);
    bed.mavlink.complete_command(Command::CalAbort, Ok(()));
    assert_eq!(bed.take_acknowledgements(), [(42_426, ACCEPTED, GROUND_STATION)]);
}

///  Unknown and repeated commands have no text.
#[test]
fn a_rejected_command_sends_a_text_with_the_reason() {
    let mut bed = MavlinkBench::with_autopilot();
    bed.send_command(START_COMMAND, 0);
    bed.send_command(42_426, 0);
    bed.mavlink.complete_command(Command::CalStart(Procedure::Flight), Err(&Refusal::NoSensor));
    bed.send_command(START_COMMAND, 1);
    bed.send_command(511, 0);
    bed.run_ms(2_000);
    let refused = |refusal| (4, format!("autoswing: {}", Notice::CommandRejected(refusal)));
    assert_eq!(bed.take_texts(), [refused(Refusal::Busy), refused(Refusal::NoSensor)]);
    bed.send_reboot_command([2.0, 0.0, 0.0, 0.0]);
    bed.receive(&heartbeat_frame(AUTOPILOT, true, true));
    bed.send_reboot_command([1.0, 0.0, 0.0, 0.0]);
    bed.mavlink.complete_command(Command::Restart, Err(&Refusal::Armed));
    bed.run_ms(2_000);
    let texts = bed.take_texts();
    assert!(texts[0].1.starts_with("autoswing: refused out-of-range: the module can restart"), "{texts:?}");
    assert_eq!(texts[1..], [refused(Refusal::Armed)]);
    bed.send_command(START_COMMAND, 0);
    bed.mavlink.complete_command(Command::CalStart(Procedure::Flight), Ok(()));
    bed.run_ms(2_000);
    assert_eq!(bed.take_texts(), [], "no text where it is accepted");
}

#[test]
fn at_most_four_acknowledgements_wait_for_room() {
    let mut bed = MavlinkBench::with_autopilot();
    bed.free_output_bytes = Some(0);
    for number in 0..6 {
        bed.send_command(500 + number, 0);
    }
    assert_eq!(bed.take_acknowledgements(), []);
    bed.free_output_bytes = None;
    assert_eq!(bed.take_acknowledgements(), [500, 501, 502, 503].map(|number| (number, UNSUPPORTED, GROUND_STATION)));
}
