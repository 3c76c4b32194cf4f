//! How long a script may run without waiting.
//!
//! One *slice* is the time from a task's resumption to its next wait. A watcher thread, one per
//! process, checks the slice of each thread when it may have reached its limit, and sets a flag byte
//! if it has. The VM's [interrupt](super::interrupt) reads that byte at every safepoint and
//! decides whether the slice is over. If so, the flag is latched: the interrupt raises an error at
//! every further safepoint, so that a `pcall` cannot let the script continue.
//!
//! This is the only module that uses the system's clock instead of the runtime's: a budget is real
//! time, even when the time of a simulation is virtual. A slice must not be blamed for time in
//! which the machine did not run it. It is therefore over when it took the budget by the wall clock
//! *and* half of it by the thread's CPU clock, or many times the budget by the wall clock alone.
//! That multiple is much larger where only a simulated robot waits, because a busy machine must not
//! change the result of a simulation.
//!
//! Code that passes no safepoint, within one call of a C library function, cannot be interrupted.
//! In a host process, the agent ends the process. Where a script runs in a command's own process,
//! [`when_stuck`] reports which script it is, so that the command can end.

mod watcher;

use std::cell::{Cell, RefCell};
use std::ffi::CStr;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use rustix::time::{ClockId, clock_gettime};

use self::watcher::{CHECK_CLOCKS, CHECK_INTERVAL, STUCK, Slot, Stuck, WITHIN_BUDGET, Watcher};
use super::failure::SourceLocation;

/// A slice that took this many budgets by the wall clock is over, whatever the CPU clock says.
const WALL_FACTOR: u32 = 5;
/// The same where only a simulated robot waits.
const SIMULATED_WALL_FACTOR: u32 = 100;

/// The running task was cancelled and tried to wait again: it must not continue.
const CANCELLED: u8 = 2;
/// Over the budget.
const OVER_BUDGET: u8 = 3;
/// The script has called `script.stop`.
const STOPPED: u8 = 4;

/// The error texts that a script's `pcall` returns.
const OVER_BUDGET_TEXT: &CStr = c"ran too long without waiting";
const CANCELLED_TEXT: &CStr = c"cancelled";
const STOPPED_TEXT: &CStr = c"the script has stopped itself";

/// Calls `report`, on the watcher's thread, with the file of a script that runs for `after` beyond
/// its budget and cannot be interrupted. Only the first call of this function has an effect.
pub(crate) fn when_stuck(after: Duration, report: impl Fn(&str) + Send + Sync + 'static) {
    let checks = after.as_millis() / CHECK_INTERVAL.as_millis();
    let stuck = Stuck {
        checks: u32::try_from(checks).unwrap_or(u32::MAX).max(1),
        report: Box::new(report),
    };
    let _ = STUCK.set(stuck);
}

/// The message about a script that is stuck.
pub(crate) fn stuck(file: &str) -> String {
    format!("{file}: the script is stuck in one call that cannot be interrupted; split its work")
}

/// The files of the scripts that are running a slice now, on all threads.
pub(crate) fn running() -> Vec<String> {
    let slots = Watcher::get().slots().all.clone();
    let running = slots.iter().filter(|slot| slot.is_running());
    running.map(|slot| slot.script().clone()).collect()
}

/// Holds a thread's slot; returns it when the thread ends.
struct SlotGuard(&'static Slot);

impl Drop for SlotGuard {
    fn drop(&mut self) {
        self.0.check_at.store(0, Ordering::Release);
        Watcher::get().slots().free.push(self.0);
    }
}

thread_local! {
    static SLOT_GUARD: SlotGuard = SlotGuard(Watcher::get().take_slot());
    /// The guard's slot while a slice runs; it has no destructor, so that reading it is cheap.
    static SLOT: Cell<Option<&'static Slot>> = const { Cell::new(None) };
    static WALL_TIME_FACTOR: Cell<u32> = const { Cell::new(WALL_FACTOR) };
    static RUNNING: RefCell<Option<Running>> = const { RefCell::new(None) };
}

/// The slice that this thread is running.
struct Running {
    began: Instant,
    processor: Duration,
    limit: Duration,
    location: Option<SourceLocation>,
}

impl Running {
    fn begin(limit: Duration) -> Running {
        Running {
            began: Instant::now(),
            processor: processor_time(),
            limit,
            location: None,
        }
    }

    fn is_over(&self) -> bool {
        let wall = self.began.elapsed();
        // In this order, because reading the CPU clock costs a system call.
        wall >= self.limit && {
            let processor = processor_time().saturating_sub(self.processor);
            is_too_long(wall, processor, self.limit, WALL_TIME_FACTOR.get())
        }
    }
}

/// Whether a slice that took its budget by the wall clock is over.
fn is_too_long(wall: Duration, processor: Duration, limit: Duration, wall_factor: u32) -> bool {
    wall >= limit * wall_factor || processor >= limit / 2
}

/// Declares that the scripts of this thread drive only a simulated robot from now on.
pub(crate) fn set_simulated_wall_factor() {
    WALL_TIME_FACTOR.set(SIMULATED_WALL_FACTOR);
}

/// The CPU time that this thread has used so far.
fn processor_time() -> Duration {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    Duration::new(
        u64::try_from(time.tv_sec).unwrap_or(0),
        u32::try_from(time.tv_nsec).unwrap_or(0),
    )
}

/// The cost of a slice.
#[derive(Debug, Default)]
pub(super) struct SliceCost {
    /// By the wall clock.
    pub(super) wall: Duration,
    /// Over the budget.
    pub(super) over: bool,
    /// Where the slice was when it was found over its budget.
    pub(super) location: Option<SourceLocation>,
}

/// Begins a slice of the script of this file on this thread.
pub(super) fn begin(limit: Duration, script: &str) {
    let slot = SLOT_GUARD.with(|guard| guard.0);
    {
        let mut last = slot.script();
        if *last != script {
            script.clone_into(&mut last);
        }
    }
    let watcher = Watcher::get();
    watcher.note_limit(limit);
    let check_at = watcher.nanoseconds(Instant::now() + limit);
    RUNNING.with_borrow_mut(|running| *running = Some(Running::begin(limit)));
    slot.flag.store(WITHIN_BUDGET, Ordering::Release);
    slot.check_at.store(check_at, Ordering::Release);
    SLOT.set(Some(slot));
}

/// Ends the slice of this thread.
pub(super) fn end() -> SliceCost {
    let flag = match SLOT.take() {
        Some(slot) => {
            slot.check_at.store(0, Ordering::Release);
            slot.flag.swap(WITHIN_BUDGET, Ordering::AcqRel)
        }
        None => WITHIN_BUDGET,
    };
    let running = RUNNING.with_borrow_mut(Option::take);
    running.map_or_else(SliceCost::default, |running| SliceCost {
        wall: running.began.elapsed(),
        over: flag == OVER_BUDGET || running.is_over(),
        location: running.location,
    })
}

/// The running task was cancelled and still tries to wait: it must not continue until it has ended.
pub(super) fn latch_cancelled() {
    latch(CANCELLED);
}

/// The script has called `script.stop`: the rest of this slice must not run.
pub(super) fn latch_stopped() {
    latch(STOPPED);
}

fn latch(flag: u8) {
    if let Some(slot) = SLOT.get() {
        slot.flag.store(flag, Ordering::Release);
    }
}

/// Whether the interrupt has to call [`verdict`].
#[inline]
pub(super) fn is_flagged() -> bool {
    SLOT.get()
        .is_some_and(|slot| slot.flag.load(Ordering::Relaxed) != WITHIN_BUDGET)
}

/// What the interrupt must do.
pub(super) enum BudgetVerdict {
    Continue,
    Raise(&'static CStr),
    /// Raise, and record where.
    RaiseFirst(&'static CStr),
}

/// Whether the running slice may go on.
pub(super) fn verdict() -> BudgetVerdict {
    let Some(slot) = SLOT.get() else {
        return BudgetVerdict::Continue;
    };
    match slot.flag.load(Ordering::Acquire) {
        CANCELLED => BudgetVerdict::Raise(CANCELLED_TEXT),
        STOPPED => BudgetVerdict::Raise(STOPPED_TEXT),
        OVER_BUDGET => BudgetVerdict::Raise(OVER_BUDGET_TEXT),
        CHECK_CLOCKS if is_over() => {
            slot.flag.store(OVER_BUDGET, Ordering::Release);
            BudgetVerdict::RaiseFirst(OVER_BUDGET_TEXT)
        }
        CHECK_CLOCKS => {
            let watcher = Watcher::get();
            let again = watcher.nanoseconds(Instant::now() + CHECK_INTERVAL);
            slot.check_at.store(again, Ordering::Release);
            slot.flag.store(WITHIN_BUDGET, Ordering::Release);
            BudgetVerdict::Continue
        }
        _ => BudgetVerdict::Continue,
    }
}

fn is_over() -> bool {
    RUNNING.with_borrow(|running| running.as_ref().is_some_and(Running::is_over))
}

/// Records where the slice was when it was found over its budget.
pub(super) fn record_place(file: String, line: u32) {
    RUNNING.with_borrow_mut(|running| {
        if let Some(running) = running {
            running.location = Some(SourceLocation { file, line });
        }
    });
}

#[cfg(test)]
mod tests;
