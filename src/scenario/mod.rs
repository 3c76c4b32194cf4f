//! Scenarios: tests of behaviours in a world, with expectations. Written in Luau, in `*_test.lua`
//! files, and run in a [`simulation`](crate::simulation): in virtual time, with the same result
//! for the same seed.
//!
//! ```no_run
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use spykee::scenario::{ScenarioFile, RunSettings};
//! let scenario_file = ScenarioFile::read("behaviours/patrol_test.lua".as_ref())?;
//! for scenario in scenario_file.scenarios() {
//!     for seed in scenario.seeds() {
//!         let result = scenario_file.run(scenario, seed, &RunSettings::default())?;
//!         assert!(result.failure.is_none(), "{}: {:?}", scenario.name, result.failure);
//!     }
//! }
//! # Ok(()) }
//! ```
//!
//! The script of a scenario has its own VM, with `scenario`, `expect` and `sim` in place of
//! `robot`. Behaviours have separate VMs and cannot access that of the scenario. If the script
//! hangs, the scenario's limit ends it in virtual time, or the script's CPU budget in real time.
//! [`ScenarioFile`] runs in this process, where only the VM confines the scripts;
//! [`ScenarioProcess`] runs in processes confined by the kernel.

mod behaviours;
mod process;
mod refusal;
mod run_record;
mod running_api;
mod scenario_file;
mod scenario_run;

pub use process::{SCENARIO_PROCESS, ScenarioProcess, scenario_process_main};
pub use scenario_file::{Options, Scenario, ScenarioFile, ScenarioFileError};
pub use scenario_run::{Cause, Failure, RunSettings, ScenarioResult, Snapshot};
