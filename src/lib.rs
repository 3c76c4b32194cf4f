//! `spykee`: Lua behaviours for the Spykee robot.
//!
//! A script can only *ask*. One task, the [`pilot`], owns the write half of the robot's socket and
//! with it the watchdog, so no other code can move the robot.
//!
//! # Processes
//!
//! ```text
//!  robot                    agent: `spykee run`                     behaviour hosts, one per script
//! +---------+     TCP      +--------------------------------+ pipe +-----------------------------+
//! | camera, |  reports     | driving core, a thread:        | ---> | VM, scheduler, JPEG decoder |
//! | tracks, | -----------> |   link, pilot with watchdog,   |      | (landlock, seccomp, limits) |
//! | battery | <----------- |   agent's side of the pipes    | <--- |                             |
//! +---------+   commands   | other threads: files, logs     | pipe +-----------------------------+
//!      ^                   +--------------------------------+
//!      |                        | last words, heartbeat
//!      |   stop, BASE_FIND      v
//!      +------------------ guardian, a process: acts when the agent no longer can
//! ```
//!
//! Nothing on the driving core waits for a disk, a process or a name lookup. A host that hangs,
//! crashes or breaks the rules is killed, and its motion ends with it. In virtual time
//! ([`simulation`]) everything, including the simulated robot of [`sim`], runs on one thread over
//! pipes in memory, with the same code and messages.
//!
//! # The two data paths
//!
//! A frame becomes a setpoint of the tracks:
//!
//! 1. [`link`]: the reader cuts the stream into messages; a `Report` carries the frame;
//! 2. [`pilot`] makes it a `Frame` with a number and a time, and stores it, still encoded, as the
//!    newest one: older frames that no reader has taken are dropped;
//! 3. [`behaviour`]: the supervisor sends it through the pipe as `ToHost::Frame` when its host asks
//!    for one;
//! 4. [`script`]: the VM validates its markers (only here) and queues it for the script's handler;
//! 5. `frame:find_blobs` has [`vision`] decode it, once and on demand, and find its blobs;
//! 6. `robot.move` makes a `Setpoint` and, with its number, an `Intent`, which goes back through the
//!    pipe as `FromHost::Intent`;
//! 7. [`pilot`] requests it of the watchdog of [`safety`]: its `Arbiter` decides which behaviour may
//!    drive, its `Tracks` when a command is sent;
//! 8. [`pilot`] hands the watchdog's `Command` to the writer of [`link`], which writes it.
//!
//! A low battery sends the robot home; this path involves no VM, no decoder and none of their
//! locks: the reader receives POWER, `pilot.rs` gives it to the watchdog (`safety/watchdog.rs`),
//! `safety/battery.rs` decides that the level is low, `safety/homing.rs` what the robot does until it
//! is home, and the writer sends `MOVE 0 0` and `BASE_FIND` at once, ahead of queued speech.
//!
//! `behaviours/guide/inside/architecture.md` lists the files and functions of both.
//!
//! # How to add
//!
//! - **A call for scripts**: its row in the table of the API ([`api`], `api/namespaces.luau`: name,
//!   arguments, bounds, results, an example), its native in [`script`], and, if the robot
//!   has to do something, an `Intent` that `pilot/requests.rs` serves. `spykee api`, the editor's
//!   definitions and the book's reference come from the table; a native without a row does not load.
//! - **A command to the robot**, or **a report of it**: its section in `wire/PROTOCOL.md` with a byte
//!   vector, its variant of `Command` or `Report` with `parse` and `emit`, what the simulated robot
//!   does with it or when it sends it. `pilot.rs` handles a report; if a command can move the robot,
//!   only the watchdog may make it.
//! - **A fault**: its variant of [`sim::FaultKind`], its name and keys in YAML, its effect on bytes or
//!   on the robot, and its row in the table of `tests/it/faults`.
//! - **An event to be published**: its variant of [`robot::AgentEvent`], published on the agent's
//!   `Bus` where it happens, and its text in `spykee history`. All listeners then receive it.
//! - **A lesson**: a folder in `behaviours/lessons/` with `README.md`, `starter.lua`, `solution.lua`
//!   and `check.lua`, its line in the catalogue of `spykee lesson`, its row in
//!   `behaviours/guide/teach/lessons.md`.
//!
//! # Words
//!
//! | word | means |
//! | --- | --- |
//! | agent | the process that `spykee run` starts: link, watchdog, supervisors |
//! | behaviour, host | a script of the user; the process that runs it |
//! | intent | what a behaviour asks of the robot |
//! | setpoint | the power of both tracks last requested |
//! | lease | how long a host may move the robot without a new sign of life |
//! | claim | a behaviour's request for the tracks, which the arbiter keeps until it ends |
//! | act, fact | an output of the watchdog; an input, besides the requests of behaviours |
//! | deferred | accepted as a fact, with its acts postponed to the end of the turn |
//! | dock state | the robot's position relative to its station, as far as it has reported |
//! | `Options` | a module's settings, its part of the config; written with the module's name |
//! | last words | the commands that are sent to the robot if the agent dies now |
//! | session | what the pilot keeps of one behaviour: its rights, its streams, its queue of events |
//! | station, docked | the charging station; the robot stands on its contacts |
//! | beacon | the station's infrared light, which the robot's own search follows |
//! | rescue | a behaviour that drives a robot that cannot find its station to where it can |
//! | report, command | a message from the robot; a message to it |
//! | world | a simulated place, read from YAML |
//! | fault | something that goes wrong in a simulation: its kind and its time |
//! | scenario | a test of behaviours in a world, in a `*_test.lua` file |
//!
//! # Floors: a module imports only what stands below it
//!
//! | floor | module | purpose |
//! | --- | --- | --- |
//! | 0 | `wire` | a crate of its own: messages to bytes and back, discovery datagrams; knows no socket |
//! | 0 | `vision` | a crate of its own: JPEG to pixels to blobs, and the simulator's JPEG encoder; knows no robot |
//! | 0 | `sandbox` | the kernel's confinement of processes that handle people's scripts |
//! | 0 | `files` | a crate of its own: regular files of bounded length, folders without links |
//! | 0 | `yaml` | a crate of its own: refuses texts that nest too deeply; numbers in ranges; errors with positions, in plain words, and "did you mean" |
//! | 0 | `sanitize` | text from outside, harmless for terminals, logs, XML and JSON |
//! | 0 | `rate_limit` | token buckets, bytes per day, growing pauses, lines that are logged once a minute |
//! | 0 | `side_thread` | threads for work that waits for a disk, a network or another program |
//! | 0 | `clock` | the time of day, time zones, durations as people write them |
//! | 0 | `robot_socket` | how a socket to the robot is opened, also in place of a lost one |
//! | 0 | `socket_outq` | how much of what was written a robot has not acknowledged yet |
//! | 1 | `http` | a bounded server and its check of who may ask; knows no robot |
//! | 1 | `timetable` | when behaviours start, and quiet hours: pure rules |
//! | 1 | `robot` | the data types that tasks and processes exchange |
//! | 1 | `guardian` | the process that stops the robot when the agent cannot |
//! | 2 | `api` | the one table of what scripts can call and read |
//! | 2 | `safety` | watchdog, arbiter, docking: pure rules |
//! | 2 | `odometry` | pose and "blocked" from tracks and frames; knows no scripts |
//! | 2 | `link` | connect, log in, reconnect, discover |
//! | 2 | `journal` | what has happened, in a SQLite file |
//! | 2 | `notify` | notifications of it, by webhooks, topics and commands |
//! | 3 | `script` | the VM: sandbox, tasks, the natives behind the API |
//! | 3 | `pilot` | the task that owns the socket |
//! | 4 | `check` | what is wrong in a script, before it runs and when it failed |
//! | 5 | `behaviour` | a behaviour's host process and its supervisor |
//! | 6 | `agent` | wiring and lifetimes |
//! | 6 | `config` | the YAML file, composed of each module's own options |
//! | 7 | `simulation` | a whole run in virtual time: agent, hosts and simulator on one thread |
//! | 7 | `control` | requests to an active run: by its socket, or remotely by its API |
//! | 8 | `live` | the page in the browser, the JSON API, health and metrics |
//! | 8 | `service` | an agent that runs permanently: timetable, idle robot, systemd |
//! | 8 | `mqtt` | the broker through which others see and command the robot, and find a fleet |
//! | 8 | `scenario` | worlds, behaviours and expectations: runs `*_test.lua` files |
//! | 9 | `class` | a class in the browser: learners' files and runs, the wall |
//! | 10 | `cli` | one file per subcommand |
//! | side | `sim` | a crate of its own: the simulated robot and its world; imports floor 0 only |
#![cfg_attr(test, allow(clippy::unwrap_used, clippy::expect_used))]

pub mod agent;
pub mod api;
pub mod behaviour;
pub mod check;
pub mod class;
pub mod cli;
pub mod clock;
pub mod config;
pub mod control;
pub mod guardian;
pub mod http;
pub mod journal;
pub mod link;
pub mod live;
pub mod mqtt;
pub mod notify;
mod odometry;
pub mod pilot;
pub mod rate_limit;
pub mod robot;
pub mod robot_socket;
pub mod safety;
pub mod sandbox;
pub mod sanitize;
pub mod scenario;
pub mod script;
pub mod service;
pub mod side_thread;
pub mod simulation;
pub mod socket_outq;
pub mod timetable;

pub use {files, sim, vision, wire, yaml};
