//! Samples, or marks, in memory that is lent.

/// What has been put into some memory, in the order of time. What the memory holds beyond that is of no meaning.
#[derive(Debug)]
pub(super) struct Buffer<'a, T> {
    room: &'a mut [T],
    length: usize,
}

impl<'a, T: Copy> Buffer<'a, T> {
    /// The first so many of what the memory holds; as many as it has room for, at the most.
    pub fn new(room: &'a mut [T], length: usize) -> Self {
        let length = length.min(room.len());
        Self { room, length }
    }

    /// What is in it.
    pub fn as_slice(&self) -> &[T] {
        self.room.get(..self.length).unwrap_or_default()
    }

    pub fn is_full(&self) -> bool {
        self.length == self.room.len()
    }

    pub fn clear(&mut self) {
        self.length = 0;
    }

    /// Puts one behind the others; whether there was room.
    pub fn push(&mut self, item: T) -> bool {
        let place = self.room.get_mut(self.length);
        let has_room = place.is_some();
        if let Some(place) = place {
            *place = item;
            self.length += 1;
        }
        has_room
    }

    /// Takes the one at a place out, if there is one.
    pub fn remove(&mut self, place: usize) {
        if let Some(rest @ [_, ..]) = self.room.get_mut(place..self.length) {
            rest.copy_within(1.., 0);
            self.length -= 1;
        }
    }

    /// Takes the one at a place out, if there is one, and puts another behind the others.
    pub fn replace(&mut self, place: usize, item: T) {
        self.remove(place);
        // There is room now, or was before.
        let _ = self.push(item);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_holds_what_it_has_room_for_in_order() {
        let mut room = [9; 3];
        let mut buffer = Buffer::new(&mut room, 0);
        assert!(buffer.as_slice().is_empty() && !buffer.is_full());
        assert!(buffer.push(1) && buffer.push(2) && !buffer.is_full());
        assert!(buffer.push(3) && buffer.is_full() && !buffer.push(4));
        buffer.remove(1);
        assert_eq!(buffer.as_slice(), [1, 3]);
        buffer.remove(2);
        assert_eq!(buffer.as_slice(), [1, 3], "there is none");
        buffer.replace(0, 5);
        assert_eq!(buffer.as_slice(), [3, 5]);
        assert!(buffer.push(6));
        buffer.replace(2, 7);
        assert_eq!(buffer.as_slice(), [3, 5, 7]);
        buffer.clear();
        buffer.remove(0);
        assert!(buffer.as_slice().is_empty());
    }

    #[test]
    fn what_the_memory_holds_is_taken_as_far_as_there_is_memory() {
        assert_eq!(Buffer::new(&mut [1, 2, 3], 2).as_slice(), [1, 2]);
        assert_eq!(Buffer::new(&mut [1, 2, 3], 4).as_slice(), [1, 2, 3]);
    }
}
