//! Integration tests, one binary.
#![allow(clippy::unwrap_used, clippy::expect_used, unreachable_pub)]

mod behaviours;
mod calibrate;
mod cli;
mod doctor;
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
mod tools;
mod vision;
