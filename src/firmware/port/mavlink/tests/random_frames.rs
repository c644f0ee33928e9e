//! Random frames from random senders.

use super::*;
use testkit::random::Random;

/// Valid frame of a supported message from one of a few senders; often from the autopilot, and often to the module.
fn random_frame(random: &mut Random) -> Vec<u8> {
    const MESSAGE_LAYOUTS: [(u8, u8, usize); 7] =
        [(0, 50, 9), (30, 39, 28), (33, 104, 28), (2, 137, 12), (76, 152, 33), (75, 158, 35), (77, 143, 10)];
    let (id, extra, length) = MESSAGE_LAYOUTS[usize::from(random.byte()) % MESSAGE_LAYOUTS.len()];
    let sender =
        [AUTOPILOT, AUTOPILOT, AUTOPILOT, SECOND_AUTOPILOT, GIMBAL, GROUND_STATION, [1, 158], [random.byte(), 1]]
            [usize::from(random.byte()) % 8];
    let mut payload = random.bytes(length);
    if id == 76 || id == 75 {
        let command = [42_424, 42_425, 42_426, 246, 511, 0][usize::from(random.byte()) % 6_usize];
        payload[28..30].copy_from_slice(&u16::to_le_bytes(command));
        payload[30..32].copy_from_slice(&[random.byte() % 2, 158]);
    }
    if id == 77 {
        payload[..3].copy_from_slice(&[0xFF, 1, random.byte() % 6]);
        payload[8..].copy_from_slice(&[random.byte() % 2, 158]);
    }
    if id == 30 {
        // Small angles, and a clock that sometimes goes back.
        payload[4..].fill(0);
    }
    frame_from(sender, id, extra, &payload)
}

/// 100,000 frames: nothing panics, whole frames are sent, requests are a second apart, and no command has more than one
/// acknowledgement.
#[test]
fn random_frames_cause_neither_panic_nor_unbounded_output() {
    let mut random = Random(3);
    let mut bench = MavlinkBench::new();
    let (mut commands, mut answers, mut requests) = (0, 0, 0);
    let mut last_request_ms = 0;
    for _ in 0..100_000 {
        let bytes = random_frame(&mut random);
        commands += usize::from([75, 76].contains(&bytes[7]));
        for message in bench.receive(&bytes) {
            if let ReceivedMessage::Command(command) = message
                && random.byte() < 200
            {
                bench
                    .mavlink
                    .complete_command(command, if random.byte() < 128 { Ok(()) } else { Err(&Refusal::Armed) });
            }
        }
        bench.indicator_state = [
            IndicatorState::Idle,
            IndicatorState::Collecting(random.byte() % 101),
            IndicatorState::Calibrated,
            IndicatorState::Refused,
        ][usize::from(random.byte()) % 4];
        bench.settings.sends_vision_yaw = random.byte() < 128;
        bench.free_output_bytes = (random.byte() < 64).then(|| usize::from(random.byte()));
        bench.now_ms += u64::from(random.byte() % 32);
        bench.poll();
        for sent in bench.sent_messages.drain(..) {
            match sent.message_id {
                76 | 66 => {
                    assert!(sent.sent_at_ms >= last_request_ms + 1_000);
                    last_request_ms = sent.sent_at_ms;
                    requests += 1;
                }
                77 => answers += 1,
                _ => {}
            }
        }
    }
    assert!(answers <= commands, "{answers} to {commands}");
    assert!(answers > 1_000 && requests > 100, "{answers} {requests}");
}
