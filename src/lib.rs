//! `spykee`: Lua behaviours for the Spykee robot.
//!
//! A script can only *ask*. One task, the [`pilot`], owns the write half of the robot's socket and
//! with it the watchdog, so no other code can move the robot.
//!
//! # Floors: a module imports only what stands below it
//!
//! | floor | module | purpose |
//! | --- | --- | --- |
//! | 0 | `wire` | messages to bytes and back, discovery datagrams; knows no socket |
//! | 0 | `vision` | JPEG to pixels to blobs; knows no robot |
//! | 1 | `robot` | the words that cross between tasks and processes |
//! | 1 | `guardian` | the process that stops the robot when the agent cannot |
//! | 2 | `api` | the one table of what scripts can call and read |
//! | 2 | `safety` | watchdog, arbiter, docking: pure rules |
//! | 2 | `link` | connect, log in, reconnect, discover |
//! | 3 | `script` | the VM: sandbox, tasks, the natives behind the API |
//! | 3 | `pilot` | the task that owns the socket |
//! | 4 | `check` | what is wrong in a script, before it runs and when it failed |
//! | 5 | `behaviour` | a behaviour's host process and its supervisor |
//! | 6 | `agent` | wiring and lifetimes |
//! | 6 | `config` | the YAML file, composed of each module's own options |
//! | 7 | `lab` | a whole run in virtual time: agent, hosts and simulator on one thread |
//! | 8 | `scenario` | worlds, behaviours and what must become true: plays `*_test.lua` files |
//! | 9 | `cli` | one file per subcommand |
//! | side | `sim` | the simulated robot and its world; imports `wire` only |
//!
//! `tests/it/floors.rs` holds every `use crate::` line against this table.
#![cfg_attr(test, allow(clippy::unwrap_used, clippy::expect_used))]

pub mod agent;
pub mod api;
pub mod behaviour;
pub mod check;
pub mod cli;
pub mod config;
pub mod guardian;
pub mod lab;
pub mod link;
pub mod pilot;
pub mod robot;
pub mod safety;
pub mod scenario;
pub mod script;
pub mod sim;
pub mod vision;
pub mod wire;
