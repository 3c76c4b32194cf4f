//! `robot.dock`, `robot.undock`, `robot.cancel_dock`.

use super::super::task::Wait;
use super::motion::{may_move, refused};
use super::{Call, NativeResult, Natives};
use crate::robot::{DockPlan, Intent};

pub(super) const CALLS: &Natives = &[
    ("robot.dock", dock),
    ("robot.undock", undock),
    ("robot.cancel_dock", cancel_dock),
];

/// `robot.dock{timeout=180, retries=2, charge_timeout=30}` returns `ok, code, {attempts, seconds}`.
fn dock(call: &mut Call<'_>) -> NativeResult {
    let options = call.args.options(0)?;
    let plan = DockPlan {
        timeout: options.get("timeout")?,
        retries: options.get("retries")?,
        charge_timeout: options.get("charge_timeout")?,
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
fn undock(call: &mut Call<'_>) -> NativeResult {
    let timeout = call.args.options(0)?.get("timeout")?;
    if !may_move(call) {
        return refused(call, true);
    }
    call.may_wait()?;
    let id = call.state.next_call();
    call.send(Intent::Undock { call: id, timeout })?;
    call.wait(Wait::Undock(id), None)
}

/// `robot.cancel_dock()`
fn cancel_dock(call: &mut Call<'_>) -> NativeResult {
    call.send(Intent::CancelDock)?;
    call.reply(())
}
