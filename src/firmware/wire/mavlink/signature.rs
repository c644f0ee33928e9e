//! Signatures of MAVLink 2 frames (<https://mavlink.io/en/guide/message_signing.html>).
//!
//! A signature has the number of the link, the time in units of 10 us, and the first six bytes of the SHA-256 of the
//! key, the frame, link and time. With a key, frames without a valid signature are rejected, and so are repeated ones:
//! the time of each stream (link and sender) must increase, and a new stream must not be older than a minute.
//!
//! The module has no clock: its own time is that of the newest received frame. After a start, frames recorded before it
//! are accepted until the first valid one of that stream.
//!
//! The library's signatures need an operating system (`HashMap`, `Mutex`, `SystemTime`).

use sha2::{Digest, Sha256};

use autoswing::attitude::SenderId;
use autoswing_module::settings::SigningKey;

/// Length of a signature, bytes.
pub(super) const SIGNATURE_SIZE: usize = 13;

/// Bytes of the hash in a signature.
const HASH_LENGTH: usize = 6;

/// Flag of a signed frame, among the flags which a receiver must know.
pub(super) const SIGNED_FLAG: u8 = 0x01;

/// Largest age of a new stream's first frame, units of 10 us: one minute.
pub(super) const MAX_NEW_STREAM_AGE_10US: u64 = 6_000_000;

/// Largest number of streams whose last time is stored.
const MAX_STREAMS: usize = 8;

/// Link id in the frames that the module signs; it signs on one link for each key.
const OWN_LINK_ID: u8 = 0;

/// Key of a passphrase, as ground stations derive it.
#[must_use]
pub fn key_from_passphrase(passphrase: &str) -> SigningKey {
    SigningKey(Sha256::digest(passphrase).into())
}

/// Signed frames of a sender on a link.
#[derive(Clone, Copy, Debug)]
struct SignedStream {
    link: u8,
    source: SenderId,
    /// Time of the last frame.
    last_time_10us: u64,
}

/// Key, and times of the received streams.
#[derive(Debug, Default)]
pub struct Signatures {
    key: Option<SigningKey>,
    /// Time of the newest frame, received or sent.
    pub(super) newest_time_10us: u64,
    streams: heapless::Vec<SignedStream, MAX_STREAMS>,
}

impl Signatures {
    /// Sets or removes the key.
    pub fn set_key(&mut self, key: Option<SigningKey>) {
        if self.key != key {
            *self = Self { key, ..Self::default() };
        }
    }

    /// Whether frames are signed.
    pub(super) const fn has_key(&self) -> bool {
        self.key.is_some()
    }

    /// Whether a frame with a valid CRC is accepted; `is_signed`: it ends with a signature.
    pub(super) fn accept_frame(&mut self, frame: &[u8], source: SenderId, is_signed: bool) -> bool {
        let Some(key) = &self.key else { return true };
        let Some((signed, hash)) = frame.split_last_chunk::<HASH_LENGTH>().filter(|_| is_signed) else { return false };
        let Some(&[link, t0, t1, t2, t3, t4, t5]) = signed.last_chunk() else { return false };
        let time = u64::from_le_bytes([t0, t1, t2, t3, t4, t5, 0, 0]);
        let known_stream = self.streams.iter_mut().find(|stream| (stream.link, stream.source) == (link, source));
        let is_new = known_stream
            .as_ref()
            .map_or(time + MAX_NEW_STREAM_AGE_10US >= self.newest_time_10us, |stream| time > stream.last_time_10us);
        if !is_new || signature_hash(key, signed) != *hash {
            return false;
        }
        self.newest_time_10us = self.newest_time_10us.max(time);
        match known_stream {
            Some(stream) => {
                stream.last_time_10us = time;
                true
            }
            None => self.streams.push(SignedStream { link, source, last_time_10us: time }).is_ok(),
        }
    }

    /// Appends a signature to a frame with its CRC, if there is a key.
    pub(super) fn sign_frame<const CAPACITY: usize>(&mut self, frame: &mut heapless::Vec<u8, CAPACITY>) {
        let Some(key) = &self.key else { return };
        self.newest_time_10us += 1;
        let [t0, t1, t2, t3, t4, t5, ..] = self.newest_time_10us.to_le_bytes();
        // A frame's capacity includes the signature.
        let _ = frame.extend_from_slice(&[OWN_LINK_ID, t0, t1, t2, t3, t4, t5]);
        let _ = frame.extend_from_slice(&signature_hash(key, frame));
    }
}

fn signature_hash(key: &SigningKey, signed: &[u8]) -> [u8; HASH_LENGTH] {
    let digest: [u8; 32] = Sha256::new().chain_update(key.0).chain_update(signed).finalize().into();
    // Infallible: the digest is longer than the hash.
    digest.first_chunk().copied().unwrap_or_default()
}
