//! Search for frames in a stream of bytes.

/// Bytes that are not yet known to be a frame, or not to be one. It never skips by the length of a frame that fails its
/// check, so that garbage costs at most the frame that contains it.
#[derive(Debug, Default)]
pub(super) struct FrameBuffer<const CAPACITY: usize> {
    bytes: heapless::Vec<u8, CAPACITY>,
    /// Buffered bytes below which a scan finds nothing new.
    required_length: usize,
    /// Number of frames with a supported header that were not decoded; wraps.
    pub rejected_count: u32,
}

impl<const CAPACITY: usize> FrameBuffer<CAPACITY> {
    /// Buffers a received byte; returns the message of the frame that it completes.
    ///
    /// `frame_length` returns the length of the frame at the start of bytes, or of a header while that is incomplete, and
    /// none without a supported header. `decode` returns none for a frame that fails its check.
    #[inline]
    pub fn push_byte<M>(
        &mut self,
        byte: u8,
        frame_length: fn(&[u8]) -> Option<usize>,
        decode: impl FnMut(&[u8]) -> Option<M>,
    ) -> Option<M> {
        // The buffer is never full: `scan` leaves less than one frame.
        let _ = self.bytes.push(byte);
        if self.bytes.len() < self.required_length { None } else { self.scan(frame_length, decode) }
    }

    /// Drops a partly received frame.
    pub fn clear(&mut self) {
        self.bytes.clear();
        self.required_length = 0;
    }

    /// Decodes frames at the start of the buffer until more bytes are needed.
    fn scan<M>(
        &mut self,
        frame_length: fn(&[u8]) -> Option<usize>,
        mut decode: impl FnMut(&[u8]) -> Option<M>,
    ) -> Option<M> {
        loop {
            let Some(required_length) = frame_length(&self.bytes) else {
                self.drop_first_bytes(1);
                continue;
            };
            self.required_length = required_length;
            let message = decode(self.bytes.get(..required_length)?);
            if message.is_some() {
                self.drop_first_bytes(required_length);
                return message;
            }
            // A valid frame may start inside the invalid one: skip one byte only.
            self.rejected_count = self.rejected_count.wrapping_add(1);
            self.drop_first_bytes(1);
        }
    }

    fn drop_first_bytes(&mut self, count: usize) {
        self.required_length = 0;
        let count = count.min(self.bytes.len());
        self.bytes.copy_within(count.., 0);
        self.bytes.truncate(self.bytes.len() - count);
    }
}
