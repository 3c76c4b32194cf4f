//! The rules by example, with facts and times in and acts out; and their promises over random
//! histories.

mod battery;
mod dock_state;
mod docking;
mod handover;
mod histories;
mod hosts;
mod link;
mod priorities;
mod recovery;
mod rescue;
mod rig;
mod run_end;

use super::*;
use crate::robot::CallId;
