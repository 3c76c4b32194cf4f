//! The modules that come with the runtime and are documented for scripts: `require("@spykee/bt")`
//! and its like.

mod bt;
mod easy;
mod floor;
mod fsm;
mod pid;
mod shapes;

use self::bt::BT;
use self::easy::{EASY, SEEN};
use self::floor::{BESIDE, FLOOR, FREE, FREE_AROUND, MEMORY};
use self::fsm::{FSM, MACHINE};
use self::pid::{CONTROLLER, PID};
use super::terms::{Namespace, Object};

/// Those that are documented. What they are made of, such as `@spykee/compass`, is not.
pub(super) const MODULES: [&Namespace; 5] = [&EASY, &FSM, &BT, &PID, &FLOOR];

pub(super) const OBJECTS: [&Object; 7] = [
    &SEEN,
    &MACHINE,
    &CONTROLLER,
    &FREE,
    &MEMORY,
    &FREE_AROUND,
    &BESIDE,
];
