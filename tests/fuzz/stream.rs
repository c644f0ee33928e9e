//! Random byte streams of frames, damaged frames and noise, and the properties of their decoders.

use std::fmt::Debug;

use proptest::collection::vec;
use proptest::prelude::*;

use crate::PropertyResult;

/// Damage to a frame.
#[derive(Clone, Debug, PartialEq)]
pub enum Damage {
    /// No damage.
    None,
    /// A flipped bit: byte index modulo the length, bit index.
    Flip(usize, u8),
    /// Truncated end: remaining bytes modulo the length.
    TruncatedEnd(usize),
    /// Truncated beginning: missing bytes modulo the length.
    TruncatedStart(usize),
}

/// Frame or noise with its damage.
#[derive(Clone, Debug, PartialEq)]
pub struct Piece {
    original_bytes: Vec<u8>,
    damage: Damage,
}

impl Piece {
    fn append(&self, stream: &mut Vec<u8>) {
        let start = stream.len();
        stream.extend_from_slice(&self.original_bytes);
        let length = self.original_bytes.len().max(1);
        match self.damage {
            Damage::None => {}
            Damage::Flip(byte, bit) => {
                if let Some(byte) = stream.get_mut(start + byte % length) {
                    *byte ^= 1 << (bit % 8);
                }
            }
            Damage::TruncatedEnd(bytes) => stream.truncate(start + bytes % length),
            Damage::TruncatedStart(bytes) => drop(stream.drain(start..start + bytes % length)),
        }
    }
}

fn any_damage() -> impl Strategy<Value = Damage> {
    prop_oneof![
        4 => Just(Damage::None),
        2 => (any::<usize>(), any::<u8>()).prop_map(|(byte, bit)| Damage::Flip(byte, bit)),
        2 => any::<usize>().prop_map(Damage::TruncatedEnd),
        1 => any::<usize>().prop_map(Damage::TruncatedStart),
    ]
}

/// Up to six pieces: frames with random damage, and noise with frequent start-of-frame bytes.
pub fn any_pieces(
    frames: impl Strategy<Value = Vec<u8>> + 'static,
    begins: &'static [u8],
) -> impl Strategy<Value = Vec<Piece>> {
    let frame = (frames, any_damage()).prop_map(|(sent, damage)| Piece { original_bytes: sent, damage });
    let byte = prop_oneof![4 => any::<u8>(), 1 => proptest::sample::select(begins)];
    let noise = vec(byte, 0..40).prop_map(|sent| Piece { original_bytes: sent, damage: Damage::None });
    vec(prop_oneof![5 => frame, 1 => noise], 0..6)
}

/// Bytes of all pieces after damage.
pub fn joined_bytes(pieces: &[Piece]) -> Vec<u8> {
    let mut bytes = Vec::new();
    for piece in pieces {
        piece.append(&mut bytes);
    }
    bytes
}

/// Intact frame found independently of the decoder.
pub trait IntactFrame<M> {
    fn end(&self) -> usize;

    fn matches_message(&self, message: &M) -> bool;
}

/// Decoder properties: each decoded message is an intact frame, at most once and in order; CRC calculations, which
/// dominate the cost, number at most one per received byte in total and at most `max_frame_length` for one byte; after noise a
/// good frame is decoded within the length of the longest frame.
///
/// `push` decodes a byte and returns a message and the number of rejected candidates since the start.
pub fn assert_decoder_properties<M: Debug, F: IntactFrame<M>>(
    wire: &NoiseAndGoodFrames<'_>,
    intact: &[F],
    mut push: impl FnMut(u8) -> (Option<M>, u32),
    is_good: impl Fn(&M) -> bool,
) -> PropertyResult {
    let (mut next, mut checks, mut rejected_before, mut recovered) = (0, 0, 0, false);
    for (byte_index, &byte) in wire.bytes.iter().enumerate() {
        let (message, rejected) = push(byte);
        let now = rejected - rejected_before + u32::from(message.is_some());
        rejected_before = rejected;
        checks += now as usize;
        prop_assert!(
            now as usize <= wire.max_frame_length && checks <= byte_index + 1,
            "{now} and {checks} checks at {byte_index}"
        );
        let Some(message) = message else { continue };
        let it_is =
            intact.iter().skip(next).position(|frame| frame.end() <= byte_index + 1 && frame.matches_message(&message));
        prop_assert!(it_is.is_some(), "{message:?} at {byte_index} is in no intact frame");
        next += it_is.map_or(0, |skipped| skipped + 1);
        recovered |= byte_index >= wire.noise_length && is_good(&message);
    }
    prop_assert!(recovered, "nothing good is understood");
    Ok(())
}

/// Random bytes followed by good frames.
pub struct NoiseAndGoodFrames<'a> {
    pub bytes: &'a [u8],
    noise_length: usize,
    /// Length of the longest frame, bytes.
    max_frame_length: usize,
}

impl<'a> NoiseAndGoodFrames<'a> {
    /// Appends good frames: one more than the longest frame can contain.
    pub fn new(bytes: &'a mut Vec<u8>, good: &[u8], longest: usize) -> Self {
        let noise = bytes.len();
        (0..=longest.div_ceil(good.len())).for_each(|_| bytes.extend_from_slice(good));
        Self { bytes, noise_length: noise, max_frame_length: longest }
    }
}
