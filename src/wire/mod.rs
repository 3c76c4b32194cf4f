//! The robot's wire protocol: encodes and decodes messages in both directions, and the discovery
//! datagrams. Uses no socket and no clock. Every fact cites its section of the specification below.
//!
//! [`Decoder`] splits a byte stream into [`Packet`]s; [`Report`] and [`Command`] interpret a
//! packet. Anything that the protocol does not define becomes a value (`Unknown`), never an error.
#![doc = ""]
#![doc = include_str!("PROTOCOL.md")]

mod command;
mod debug;
pub mod discovery;
mod listing;
mod packet;
#[cfg(test)]
mod protocol;
mod report;
mod text;
mod values;

pub use command::{Command, Engage, FileChunk, Login, Secret};
pub use listing::{Network, Setting, join_settings, latin1, parse_networks, parse_settings};
pub use packet::{Decoder, FramingError, HEADER_LEN, MAX_PACKET_LEN, MAX_PAYLOAD_LEN, Packet};
pub use report::{Accepted, EngineReport, Power, Refusal, Report};
pub use values::{Led, Sound, Stream};

/// TCP and UDP port of the robot (`PROTOCOL.md`, *Network*).
pub const PORT: u16 = 9000;

/// The message types (`PROTOCOL.md`, *TCP messages*).
pub mod kind {
    /// No content.
    pub const NONE: u8 = 0;
    /// Samples of microphone or speaker.
    pub const AUDIO: u8 = 1;
    /// One JPEG frame.
    pub const VIDEO: u8 = 2;
    /// Battery level.
    pub const POWER: u8 = 3;
    /// Switch a light.
    pub const LED: u8 = 4;
    /// Track power.
    pub const MOVE: u8 = 5;
    /// File upload.
    pub const FILE: u8 = 6;
    /// Play a sound.
    pub const PLAY: u8 = 7;
    /// Stop the music, or the music has ended.
    pub const STOP: u8 = 8;
    /// Speaker volume.
    pub const VOLUME: u8 = 9;
    /// Log in.
    pub const AUTH_REQUEST: u8 = 10;
    /// The reply to a login.
    pub const AUTH_REPLY: u8 = 11;
    /// Meaning unknown.
    pub const MUTE: u8 = 12;
    /// Configuration text.
    pub const CONFIG: u8 = 13;
    /// Scan of wireless networks.
    pub const WIRELESS_NETWORKS: u8 = 14;
    /// Switch a stream.
    pub const STREAMCTL: u8 = 15;
    /// Docking and undocking.
    pub const ENGINE: u8 = 16;
    /// The robot's log.
    pub const LOG: u8 = 17;
    /// Stored in the robot's memory, meaning unknown.
    pub const MOTOR_SPEED: u8 = 18;
}
