//! What comes on a wire: frames, damaged ones, and noise.

use proptest::collection::vec;
use proptest::prelude::*;

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
