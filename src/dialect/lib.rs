//! The MAVLink messages that Autoswing, its simulator and its analysis of logs use.
//!
//! `messages.rs` is a table, a row for each message; `enumerations.rs` is one of their numbers and flags. Frames, their
//! checksum and the traits [`Message`] and [`MessageData`] are those of `mavlink-core`. The crate `mavlink` has all
//! messages, generated from the protocol's definitions by a build script, and takes half a minute to compile; a test
//! here compares every row with it.
//!
//! Fields have the names of the protocol's definition (<https://mavlink.io/en/messages/common.html>), which gives their
//! units, except that `type` is `mavtype`. By default a field is zero, as is a field that MAVLink 2 truncates. An
//! enumeration is its number, so that a number of a later version of the protocol is received like any other.
#![no_std]
#![forbid(unsafe_code)]

#[macro_use]
mod enumerations;
mod extra_crc;
mod field;
#[macro_use]
mod messages;

pub use enumerations::*;
pub use mavlink_core::error::ParserError;
pub use mavlink_core::types::CharArray;
pub use mavlink_core::{
    MAVLinkV1MessageRaw, MAVLinkV2MessageRaw, MavHeader, MavlinkVersion, Message, MessageData, calculate_crc,
};
pub use messages::*;

#[cfg(test)]
mod tests;
