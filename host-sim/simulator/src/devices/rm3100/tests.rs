//! Unit tests of the chip model.
