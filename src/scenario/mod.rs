//! Scenarios: tests of behaviours in a world, written in Luau in `*_test.lua` files and run in a
//! [`simulation`](crate::simulation). The script of a scenario has its own VM, with `scenario`,
//! `expect` and `sim` in place of `robot`. [`ScenarioFile`] runs in this process, where only the VM
//! confines the scripts; [`ScenarioProcess`] in processes confined by the kernel.

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
