//! Buffer of the bytes to write to a line.

/// Bytes to write. A message that does not fit is dropped whole.
#[derive(Debug)]
pub struct TransmitBuffer {
    bytes: [u8; TRANSMIT_CAPACITY],
    pending_begin: usize,
    pending_end: usize,
    /// Number of messages since the start; wraps, as the other counters do.
    pub message_count: u32,
    /// Number of sent messages that have no valid heading.
    pub headingless_message_count: u32,
    /// Number of dropped or lost messages.
    pub lost_message_count: u32,
}

/// Capacity, bytes, for the longest simultaneous messages: a STATUSTEXT, a VISION_POSITION_ESTIMATE and some smaller
/// ones; or twice three NMEA sentences.
pub(super) const TRANSMIT_CAPACITY: usize = 384;

impl Default for TransmitBuffer {
    fn default() -> Self {
        Self {
            bytes: [0; TRANSMIT_CAPACITY],
            pending_begin: 0,
            pending_end: 0,
            message_count: 0,
            headingless_message_count: 0,
            lost_message_count: 0,
        }
    }
}

impl TransmitBuffer {
    /// Appends a message given in parts; returns whether there was room.
    pub fn append_message(&mut self, parts: &[&[u8]]) -> bool {
        self.message_count = self.message_count.wrapping_add(1);
        let length: usize = parts.iter().map(|part| part.len()).sum();
        if self.pending_end + length > TRANSMIT_CAPACITY {
            self.bytes.copy_within(self.pending_begin..self.pending_end, 0);
            (self.pending_begin, self.pending_end) = (0, self.pending_end - self.pending_begin);
        }
        if self.pending_end + length > TRANSMIT_CAPACITY {
            self.lost_message_count = self.lost_message_count.wrapping_add(1);
            return false;
        }
        for part in parts {
            let end = self.pending_end + part.len();
            if let Some(target) = self.bytes.get_mut(self.pending_end..end) {
                target.copy_from_slice(part);
                self.pending_end = end;
            }
        }
        true
    }

    /// Bytes not written yet.
    #[must_use]
    pub fn pending_bytes(&self) -> &[u8] {
        self.bytes.get(self.pending_begin..self.pending_end).unwrap_or_default()
    }

    /// Removes bytes that were written.
    pub fn consume_bytes(&mut self, count: usize) {
        self.pending_begin += count.min(self.pending_end - self.pending_begin);
        if self.pending_begin == self.pending_end {
            self.clear();
        }
    }

    fn clear(&mut self) {
        (self.pending_begin, self.pending_end) = (0, 0);
    }

    /// Drops the pending bytes after a line error.
    pub fn drop_after_line_error(&mut self) {
        self.clear();
        self.lost_message_count = self.lost_message_count.wrapping_add(1);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_message_is_written_whole_or_not_at_all() {
        let mut out = TransmitBuffer::default();
        assert!(out.append_message(&[&[1; TRANSMIT_CAPACITY - 2], &[1]]));
        assert!(!out.append_message(&[&[2], &[2]]));
        assert_eq!(out.pending_bytes(), [1; TRANSMIT_CAPACITY - 1]);
        assert!(out.append_message(&[&[3]]));
        assert_eq!((out.message_count, out.lost_message_count), (3, 1));
        out.consume_bytes(TRANSMIT_CAPACITY - 2);
        assert_eq!(out.pending_bytes(), [1, 3]);
        out.drop_after_line_error();
        assert!(out.pending_bytes().is_empty());
        assert_eq!(out.lost_message_count, 2);
        assert!(out.append_message(&[&[4; TRANSMIT_CAPACITY]]));
        out.consume_bytes(usize::MAX);
        assert!(out.pending_bytes().is_empty());
    }

    /// Written bytes free their room also while others are pending.
    #[test]
    fn room_of_sent_bytes_is_reused() {
        let mut out = TransmitBuffer::default();
        assert!(out.append_message(&[&[1; TRANSMIT_CAPACITY]]));
        out.consume_bytes(100);
        assert_eq!(out.pending_bytes(), [1; TRANSMIT_CAPACITY - 100]);
        assert!(!out.append_message(&[&[2; 101]]));
        assert_eq!(out.pending_bytes(), [1; TRANSMIT_CAPACITY - 100]);
        assert!(out.append_message(&[&[2; 60], &[3; 40]]));
        assert_eq!(out.pending_bytes(), [vec![1; TRANSMIT_CAPACITY - 100], vec![2; 60], vec![3; 40]].concat());
    }
}
