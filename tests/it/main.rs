//! Integration tests, one binary.
#![allow(clippy::unwrap_used, clippy::expect_used, unreachable_pub)]

mod behaviours;
mod calibrate;
mod check;
mod cli;
mod config;
mod delivery;
mod distress;
mod doctor;
mod explore;
mod eyes;
mod fast;
mod faults;
mod floors;
mod frames;
mod guardian;
mod guide;
mod hostile;
mod intruders;
mod lessons;
mod link;
mod new;
mod pilot;
#[path = "../fuzz/poster.rs"]
mod poster;
mod posters;
mod priorities;
mod repl;
mod rescue;
mod rig;
mod run;
mod safety;
mod scenarios;
mod secrets;
mod sim;
mod slow_reader;
mod slow_system;
mod soak;
mod stdlib;
mod supervision;
mod tools;
mod type_checker;
mod vision;
mod world;
