//! Robots with a low battery far from home, beside a behaviour that does nothing: how many of them the
//! watchdog alone brings home, by strategy.

pub mod place;
mod play;
mod strategy;
mod table;

pub use place::{Name, Place};
pub use play::play_all;
pub use strategy::Strategy;
pub use table::{Row, heading};
