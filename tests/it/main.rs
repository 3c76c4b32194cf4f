//! All integration tests, in one binary.
#![allow(clippy::unwrap_used, clippy::expect_used, unreachable_pub)]

mod behaviours;
mod bus;
mod calibrate;
#[path = "../camera_truth/mod.rs"]
mod camera_truth;
mod charger;
mod check;
mod class;
mod cli;
mod clock;
mod colour;
mod config;
mod control;
mod delivery;
mod doctor;
mod fast;
mod faults;
mod firmware;
mod frames;
mod genuine;
mod guardian;
mod guide;
mod hostile;
mod in_the_way;
mod journal;
mod lessons;
mod link;
mod live;
#[path = "../long_runs.rs"]
#[allow(dead_code)]
mod long_runs;
mod low_out_of_reach;
mod metrics;
mod mqtt;
mod nearly_empty;
mod new;
mod notify;
mod outages;
mod pilot;
mod priorities;
mod qr_cost;
mod remote;
mod repl;
mod rig;
mod roster;
mod run;
mod safety;
mod sandbox;
mod scenarios;
mod secrets;
mod seeds;
mod sent_home;
mod serve;
mod sim;
mod slow_reader;
mod slow_system;
mod smoke;
mod stalled_robot;
mod stdlib;
mod stop;
mod stuck;
mod supervision;
mod terminal;
#[path = "../fuzz/test_pattern.rs"]
mod test_pattern;
mod tools;
mod untrusted_files;
mod untrusted_peers;
mod vision;
mod waiting;
mod world;
mod world_body;
