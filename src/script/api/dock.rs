//! `robot.dock`, `robot.undock`, `robot.cancel_dock`.

use std::time::Duration;

use super::super::arguments::Bounds;
use super::super::task::Wait;
use super::motion::{may_move, refused};
use super::{Answered, Call, Entry, plain, waiting};
use crate::robot::{DockPlan, Intent};

pub(super) const CALLS: [Entry; 3] = [
    waiting("robot.dock", dock),
    waiting("robot.undock", undock),
    plain("robot.cancel_dock", cancel_dock),
];

/// Limits of the times in the options, in seconds.
pub(super) const TIME: Bounds = Bounds::Between(1.0, 3600.0);
/// How long `robot.undock` waits unless it says, in seconds.
const UNDOCK_TIME: f64 = 20.0;
/// Tries after the first.
const MAX_RETRIES: u32 = 20;

/// `robot.dock{timeout=180, retries=2, charge_timeout=30}` returns `ok, code, {attempts, seconds}`.
fn dock(call: &mut Call<'_>) -> Answered {
    let usual = DockPlan::default();
    let options = call
        .args
        .options(0, &["timeout", "retries", "charge_timeout"])?;
    let seconds = |key, time: Duration| options.number(key, time.as_secs_f64(), TIME);
    let plan = DockPlan {
        timeout: Duration::from_secs_f64(seconds("timeout", usual.timeout)?),
        retries: options.count("retries", usual.retries, MAX_RETRIES)?,
        charge_timeout: Duration::from_secs_f64(seconds("charge_timeout", usual.charge_timeout)?),
    };
    if !may_move(call) {
        return refused(call, true);
    }
    call.may_wait()?;
    let id = call.state.next_call();
    call.send(Intent::Dock { call: id, plan })?;
    call.wait(Wait::Dock(id), None)
}

/// `robot.undock{timeout=20}` returns `ok, code`.
fn undock(call: &mut Call<'_>) -> Answered {
    let options = call.args.options(0, &["timeout"])?;
    let timeout = options.number("timeout", UNDOCK_TIME, TIME)?;
    if !may_move(call) {
        return refused(call, true);
    }
    call.may_wait()?;
    let id = call.state.next_call();
    call.send(Intent::Undock {
        call: id,
        timeout: Duration::from_secs_f64(timeout),
    })?;
    call.wait(Wait::Undock(id), None)
}

/// `robot.cancel_dock()`
fn cancel_dock(call: &mut Call<'_>) -> Answered {
    call.send(Intent::CancelDock)?;
    call.reply(())
}
