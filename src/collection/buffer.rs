//! Fixed-capacity buffer on borrowed memory.

/// Items in order of insertion.
#[derive(Debug)]
pub(super) struct BorrowedBuffer<'a, T> {
    memory: &'a mut [T],
    length: usize,
}

impl<'a, T: Copy> BorrowedBuffer<'a, T> {
    /// Buffer of the first `length` items, limited to the capacity.
    pub fn new(room: &'a mut [T], length: usize) -> Self {
        let length = length.min(room.len());
        Self { memory: room, length }
    }

    pub fn as_slice(&self) -> &[T] {
        self.memory.get(..self.length).unwrap_or_default()
    }

    pub fn is_full(&self) -> bool {
        self.length == self.memory.len()
    }

    pub fn clear(&mut self) {
        self.length = 0;
    }

    /// Appends an item; returns false if the buffer is full.
    pub fn push(&mut self, item: T) -> bool {
        let index = self.memory.get_mut(self.length);
        let has_room = index.is_some();
        if let Some(place) = index {
            *place = item;
            self.length += 1;
        }
        has_room
    }

    pub fn remove_at(&mut self, place: usize) {
        if let Some(rest @ [_, ..]) = self.memory.get_mut(place..self.length) {
            rest.copy_within(1.., 0);
            self.length -= 1;
        }
    }

    pub fn remove_and_push(&mut self, place: usize, item: T) {
        self.remove_at(place);
        // Infallible after a removal.
        let _ = self.push(item);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keeps_items_in_order_up_to_the_capacity() {
        let mut room = [9; 3];
        let mut buffer = BorrowedBuffer::new(&mut room, 0);
        assert!(buffer.as_slice().is_empty() && !buffer.is_full());
        assert!(buffer.push(1) && buffer.push(2) && !buffer.is_full());
        assert!(buffer.push(3) && buffer.is_full() && !buffer.push(4));
        buffer.remove_at(1);
        assert_eq!(buffer.as_slice(), [1, 3]);
        buffer.remove_at(2);
        assert_eq!(buffer.as_slice(), [1, 3], "there is none");
        buffer.remove_and_push(0, 5);
        assert_eq!(buffer.as_slice(), [3, 5]);
        assert!(buffer.push(6));
        buffer.remove_and_push(2, 7);
        assert_eq!(buffer.as_slice(), [3, 5, 7]);
        buffer.clear();
        buffer.remove_at(0);
        assert!(buffer.as_slice().is_empty());
    }

    #[test]
    fn the_initial_length_is_limited_to_the_capacity() {
        assert_eq!(BorrowedBuffer::new(&mut [1, 2, 3], 2).as_slice(), [1, 2]);
        assert_eq!(BorrowedBuffer::new(&mut [1, 2, 3], 4).as_slice(), [1, 2, 3]);
    }
}
