//! How accurate the methods are, against the bound of what is possible.

pub mod bound;
pub mod trial;
