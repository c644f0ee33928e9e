//! What comes on a wire: frames, damaged ones, and noise; and what a decoder of it promises.

use std::fmt::Debug;

use proptest::collection::vec;
use proptest::prelude::*;

use crate::Promise;

/// What has happened to a frame on its way.
#[derive(Clone, Debug, PartialEq)]
pub enum Damage {
    /// Nothing.
    None,
    /// A bit has tipped: of which byte, counted around, and which.
    Flip(usize, u8),
    /// Only so many of its bytes have come, counted around.
    Cut(usize),
    /// So many of its last bytes have come, counted around.
    Torn(usize),
}

/// Something on a wire.
#[derive(Clone, Debug, PartialEq)]
pub struct Piece {
    /// As it was sent.
    sent: Vec<u8>,
    damage: Damage,
}

impl Piece {
    fn append(&self, to: &mut Vec<u8>) {
        let begin = to.len();
        to.extend_from_slice(&self.sent);
        let length = self.sent.len().max(1);
        match self.damage {
            Damage::None => {}
            Damage::Flip(byte, bit) => {
                if let Some(byte) = to.get_mut(begin + byte % length) {
                    *byte ^= 1 << (bit % 8);
                }
            }
            Damage::Cut(bytes) => to.truncate(begin + bytes % length),
            Damage::Torn(bytes) => drop(to.drain(begin..begin + bytes % length)),
        }
    }
}

fn damage() -> impl Strategy<Value = Damage> {
    prop_oneof![
        4 => Just(Damage::None),
        2 => (any::<usize>(), any::<u8>()).prop_map(|(byte, bit)| Damage::Flip(byte, bit)),
        2 => any::<usize>().prop_map(Damage::Cut),
        1 => any::<usize>().prop_map(Damage::Torn),
    ]
}

/// Up to six pieces: frames of a kind, each with its damage, and noise, in which bytes that begin a frame are frequent.
pub fn of(
    frames: impl Strategy<Value = Vec<u8>> + 'static,
    begins: &'static [u8],
) -> impl Strategy<Value = Vec<Piece>> {
    let frame = (frames, damage()).prop_map(|(sent, damage)| Piece { sent, damage });
    let byte = prop_oneof![4 => any::<u8>(), 1 => proptest::sample::select(begins)];
    let noise = vec(byte, 0..40).prop_map(|sent| Piece { sent, damage: Damage::None });
    vec(prop_oneof![5 => frame, 1 => noise], 0..6)
}

/// What comes of it.
pub fn bytes(pieces: &[Piece]) -> Vec<u8> {
    let mut bytes = Vec::new();
    for piece in pieces {
        piece.append(&mut bytes);
    }
    bytes
}

/// A frame that has come whole, by another way than the decoder's.
pub trait Intact<M> {
    /// Where it ends.
    fn end(&self) -> usize;

    /// Whether a message is what it says.
    fn says(&self, message: &M) -> bool;
}

/// Each message that is understood of a wire is a frame that has come intact, each of them at most once and in order. A CRC,
/// which is what costs time, is calculated at most once for each byte that has come, and for one byte at most as often as the
/// longest frame has bytes. When good frames follow, one is understood by the end of the first that begins after what the
/// longest frame can take of them.
///
/// `push` is the decoder: of a byte, the message that it completes, and how many candidates for frames it has rejected since
/// the start.
pub fn holds<M: Debug, F: Intact<M>>(
    wire: &Wire<'_>,
    intact: &[F],
    mut push: impl FnMut(u8) -> (Option<M>, u32),
    is_good: impl Fn(&M) -> bool,
) -> Promise {
    let (mut next, mut checks, mut rejected_before, mut recovered) = (0, 0, 0, false);
    for (at, &byte) in wire.bytes.iter().enumerate() {
        let (message, rejected) = push(byte);
        let now = rejected - rejected_before + u32::from(message.is_some());
        rejected_before = rejected;
        checks += now as usize;
        prop_assert!(now as usize <= wire.longest && checks <= at + 1, "{now} and {checks} checks at {at}");
        let Some(message) = message else { continue };
        let it_is = intact.iter().skip(next).position(|frame| frame.end() <= at + 1 && frame.says(&message));
        prop_assert!(it_is.is_some(), "{message:?} at {at} is in no intact frame");
        next += it_is.map_or(0, |skipped| skipped + 1);
        recovered |= at >= wire.noise && is_good(&message);
    }
    prop_assert!(recovered, "nothing good is understood");
    Ok(())
}

/// What comes on a wire, and good frames behind it.
pub struct Wire<'a> {
    pub bytes: &'a [u8],
    /// So many bytes of it are whatever has come.
    noise: usize,
    /// Bytes of the longest frame.
    longest: usize,
}

impl<'a> Wire<'a> {
    /// Puts good frames behind what has come: as many as the longest frame can take, and one.
    pub fn of(bytes: &'a mut Vec<u8>, good: &[u8], longest: usize) -> Self {
        let noise = bytes.len();
        (0..=longest.div_ceil(good.len())).for_each(|_| bytes.extend_from_slice(good));
        Self { bytes, noise, longest }
    }
}
