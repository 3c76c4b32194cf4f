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
//! | 2 | `safety` | watchdog, arbiter, docking: pure rules |
//! | 2 | `link` | connect, log in, reconnect, discover |
//! | 2 | `script` | the VM: sandbox, tasks, the Lua API |
//! | 3 | `pilot` | the task that owns the socket |
//! | 3 | `behaviour` | a behaviour's host process and its supervisor |
//! | 4 | `agent` | wiring and lifetimes |
//! | 4 | `config` | the YAML file, composed of each module's own options |
//! | 5 | `lab` | a whole run in virtual time: agent, hosts and simulator on one thread |
//! | 5 | `control` | the socket by which a run that is on can be asked |
//! | 6 | `scenario` | worlds, behaviours and what must become true: plays `*_test.lua` files |
//! | 7 | `cli` | one file per subcommand |
//! | side | `sim` | the simulated robot and its world; imports `wire` only |
//!
//! `tests/it/floors.rs` holds every `use crate::` line against this table.
#![cfg_attr(test, allow(clippy::unwrap_used, clippy::expect_used))]

pub mod agent;
pub mod behaviour;
pub mod cli;
pub mod config;
pub mod control;
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
