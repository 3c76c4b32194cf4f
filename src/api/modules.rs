//! The modules that come with the runtime and are documented for scripts, such as
//! `require("@spykee/bt")`.

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
use super::model::{Namespace, Object};

/// The documented modules. The modules that these use internally, such as `@spykee/compass`, are
/// not documented.
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
