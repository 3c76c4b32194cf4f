//! Scenarios: tests of behaviours in a world, with expectations. Written in Luau, in `*_test.lua`
//! files, and played in a [`lab`](crate::lab): in virtual time, with the same result for the same
//! seed.
//!
//! ```no_run
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use spykee::scenario::{Book, Setting};
//! let book = Book::read("behaviours/patrol_test.lua".as_ref())?;
//! for scenario in book.scenarios() {
//!     for seed in scenario.seeds() {
//!         let played = book.play(scenario, seed, &Setting::default())?;
//!         assert!(played.failure.is_none(), "{}: {:?}", scenario.name, played.failure);
//!     }
//! }
//! # Ok(()) }
//! ```
//!
//! The script of a scenario has its own VM, with `scenario`, `expect` and `sim` in place of
//! `robot`. Behaviours have separate VMs and cannot access that of the scenario. If the script
//! hangs, the scenario's limit ends it in virtual time, or the script's CPU budget in real time.
//! [`Book`] plays in this process, where only the VM confines the scripts; [`Trials`] plays in
//! processes confined by the kernel.

mod arguments;
mod book;
mod calls;
mod cast;
mod options;
mod play;
mod refusal;
mod run_record;
mod stage;
mod trial;

pub use book::{Book, BookError, Scenario};
pub use options::Options;
pub use play::{Cause, Failure, Played, Scene, Setting};
pub use trial::{TRIAL, Trials, trial_main};
