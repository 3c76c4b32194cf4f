//! Integration tests, one binary.
#![allow(clippy::unwrap_used, clippy::expect_used, unreachable_pub)]

mod behaviours;
mod cli;
mod eyes;
mod faults;
mod floors;
mod frames;
mod hostile;
mod link;
mod pilot;
mod rig;
mod run;
mod safety;
mod secrets;
mod sim;
mod vision;
mod world;
