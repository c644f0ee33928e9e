//! Random bytes.

use super::*;

fn random_frame(random: &mut Random) -> Vec<u8> {
    let wanted = &SUPPORTED_MESSAGES[usize::from(random.byte()) % SUPPORTED_MESSAGES.len()];
    let id = if random.byte() < 32 { random.byte() } else { wanted.message_id as u8 };
    let length = usize::from(random.byte()) % (wanted.extended_length + 2);
    let payload = random.bytes(length);
    let head = if random.byte() < 128 {
        vec![0xFE, length as u8, 0, 12, 34, id]
    } else {
        vec![0xFD, length as u8, random.byte() & 1, 0, 0, 12, 34, id, 0, 0]
    };
    with_crc_of(wanted.extra_crc, [head, payload].concat())
}

/// 100,000 inputs of valid frames, broken frames and noise: nothing panics, the buffer stays within its capacity, and
/// after zeros of the longest frame's length, which end any pending frame, a valid frame is received.
#[test]
fn after_random_bytes_the_next_frame_is_decoded() {
    let mut random = Random(7);
    let mut receiver = Receiver::new();
    let good = &attitude_frames(0.7)[1];
    let mut received = 0;
    for input in 0..100_000 {
        let mut bytes = random_frame(&mut random);
        match random.byte() % 4 {
            0 => {
                let bit = random.bits() as usize % (8 * bytes.len());
                bytes[bit / 8] ^= 1 << (bit % 8);
            }
            1 => bytes.truncate(usize::from(random.byte()) % bytes.len()),
            2 => bytes = random.bytes(30),
            _ => {}
        }
        for &byte in bytes.iter().chain(&[0; MAX_FRAME_LENGTH]) {
            received += usize::from(receiver.push_byte(byte).is_some());
            assert!(receiver.buffer.len() < MAX_FRAME_LENGTH, "{input}");
        }
        let found = good.iter().filter_map(|&byte| receiver.push_byte(byte)).count();
        assert_eq!(found, 1, "{input}: {bytes:02X?}");
    }
    // A quarter of the inputs is valid; most are supported messages, and most of version 2 have an allowed length.
    assert!((5_000..20_000).contains(&received), "{received}");
}
