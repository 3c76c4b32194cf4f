//! How long a script may run without waiting. A *slice* is the time from a task's resumption to its
//! next wait. A watcher thread, one per process, sets a flag byte when a slice may have reached its
//! limit; the VM's [interrupt](super::interrupt) reads it at every safepoint and decides.
//!
//! A budget is real time, even when the time of a simulation is virtual, and a slice is not blamed
//! for time in which the machine did not run it: it is over when it took the budget by the wall
//! clock *and* half of it by the thread's CPU clock, or many times the budget by the wall clock
//! alone (much more where only a simulated robot waits). A virtual machine may stall, and its CPU
//! clock counts that too: the watcher subtracts what it was itself late, and must find the slice
//! running several times.
//!
//! Code that passes no safepoint cannot be interrupted: the agent ends a host's process; elsewhere
//! [`when_stuck`] reports the script, so that the command can end.

use std::cell::{Cell, RefCell};
use std::ffi::CStr;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU8, AtomicU32, AtomicU64, Ordering};
use std::thread::Thread;
use std::time::{Duration, Instant};

use parking_lot::Mutex;
use rustix::time::{ClockId, clock_gettime};

use super::failure::SourceLocation;

/// A slice that took this many budgets by the wall clock is over, whatever the CPU clock says.
const WALL_FACTOR: u32 = 5;
/// The same where only a simulated robot waits.
const SIMULATED_WALL_FACTOR: u32 = 100;

/// A watcher that is this much late has stalled.
const STALL: Duration = Duration::from_millis(50);

/// How often the watcher must find a slice running after its limit.
const CONFIRMATIONS: u32 = 5;

/// The running task was cancelled and tried to wait again: it must not continue.
const CANCELLED: u8 = 2;
const OVER_BUDGET: u8 = 3;
/// The script has called `script.stop`.
const STOPPED: u8 = 4;

/// The error texts that a script's `pcall` returns.
const OVER_BUDGET_TEXT: &CStr = c"ran too long without waiting";
const CANCELLED_TEXT: &CStr = c"cancelled";
const STOPPED_TEXT: &CStr = c"the script has stopped itself";

pub(super) const CHECK_INTERVAL: Duration = Duration::from_millis(10);
pub(super) const WITHIN_BUDGET: u8 = 0;
/// Set by the watcher: the interrupt must check the clocks.
pub(super) const CHECK_CLOCKS: u8 = 1;

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

pub(crate) fn stuck(file: &str) -> String {
    format!("{file}: the script is stuck in one call that cannot be interrupted; split its work")
}

/// The files of the scripts that are running a slice now, on all threads.
pub(crate) fn running() -> Vec<String> {
    let slots = Watcher::get().slots.lock().all.clone();
    let running = slots.iter().filter(|slot| slot.is_running());
    running.map(|slot| slot.script.lock().clone()).collect()
}

/// Holds a thread's slot; returns it when the thread ends.
struct SlotGuard(&'static Slot);

impl Drop for SlotGuard {
    fn drop(&mut self) {
        self.0.check_at.store(0, Ordering::Release);
        Watcher::get().slots.lock().free.push(self.0);
    }
}

thread_local! {
    static SLOT_GUARD: SlotGuard = SlotGuard(Watcher::get().take_slot());
    /// The guard's slot while a slice runs; it has no destructor, so that reading it is cheap.
    static SLOT: Cell<Option<&'static Slot>> = const { Cell::new(None) };
    static WALL_TIME_FACTOR: Cell<u32> = const { Cell::new(WALL_FACTOR) };
    static RUNNING: RefCell<Option<Running>> = const { RefCell::new(None) };
}

struct Running {
    began: Instant,
    processor: Duration,
    stalled: u64,
    limit: Duration,
    location: Option<SourceLocation>,
}

impl Running {
    fn begin(limit: Duration) -> Running {
        Running {
            began: Instant::now(),
            processor: processor_time(),
            stalled: Watcher::get().stalled(),
            limit,
            location: None,
        }
    }

    /// The time since its beginning without the machine's stalls.
    fn wall(&self) -> Duration {
        let stalled = Watcher::get().stalled().saturating_sub(self.stalled);
        self.began
            .elapsed()
            .saturating_sub(Duration::from_nanos(stalled))
    }

    /// `late_checks`: how often the watcher has found it running after its limit.
    fn is_over(&self, late_checks: u32) -> bool {
        let wall = self.wall();
        // In this order, because reading the CPU clock costs a system call.
        wall >= self.limit && late_checks >= CONFIRMATIONS && {
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

fn processor_time() -> Duration {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    Duration::new(
        u64::try_from(time.tv_sec).unwrap_or(0),
        u32::try_from(time.tv_nsec).unwrap_or(0),
    )
}

#[derive(Debug, Default)]
pub(super) struct SliceCost {
    pub(super) wall: Duration,
    pub(super) over: bool,
    /// Where the slice was when it was found over its budget.
    pub(super) location: Option<SourceLocation>,
}

pub(super) fn begin(limit: Duration, script: &str) {
    let slot = SLOT_GUARD.with(|guard| guard.0);
    {
        let mut last = slot.script.lock();
        if *last != script {
            script.clone_into(&mut last);
        }
    }
    let watcher = Watcher::get();
    watcher.note_limit(limit);
    let check_at = watcher.nanoseconds(Instant::now() + limit);
    RUNNING.with_borrow_mut(|running| *running = Some(Running::begin(limit)));
    slot.flag.store(WITHIN_BUDGET, Ordering::Release);
    slot.late_checks.store(0, Ordering::Relaxed);
    slot.check_at.store(check_at, Ordering::Release);
    SLOT.set(Some(slot));
}

pub(super) fn end() -> SliceCost {
    let (Some(slot), Some(running)) = (SLOT.take(), RUNNING.with_borrow_mut(Option::take)) else {
        return SliceCost::default();
    };
    slot.check_at.store(0, Ordering::Release);
    let flag = slot.flag.swap(WITHIN_BUDGET, Ordering::AcqRel);
    SliceCost {
        wall: running.began.elapsed(),
        over: flag == OVER_BUDGET || running.is_over(slot.late_checks()),
        location: running.location,
    }
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

#[inline]
pub(super) fn is_flagged() -> bool {
    SLOT.get()
        .is_some_and(|slot| slot.flag.load(Ordering::Relaxed) != WITHIN_BUDGET)
}

pub(super) enum BudgetVerdict {
    Continue,
    Raise(&'static CStr),
    /// Raise, and record where.
    RaiseFirst(&'static CStr),
}

pub(super) fn verdict() -> BudgetVerdict {
    let Some(slot) = SLOT.get() else {
        return BudgetVerdict::Continue;
    };
    match slot.flag.load(Ordering::Acquire) {
        CANCELLED => BudgetVerdict::Raise(CANCELLED_TEXT),
        STOPPED => BudgetVerdict::Raise(STOPPED_TEXT),
        OVER_BUDGET => BudgetVerdict::Raise(OVER_BUDGET_TEXT),
        CHECK_CLOCKS if is_over(slot) => {
            slot.flag.store(OVER_BUDGET, Ordering::Release);
            BudgetVerdict::RaiseFirst(OVER_BUDGET_TEXT)
        }
        CHECK_CLOCKS => {
            slot.unanswered.store(0, Ordering::Relaxed);
            slot.flag.store(WITHIN_BUDGET, Ordering::Release);
            BudgetVerdict::Continue
        }
        _ => BudgetVerdict::Continue,
    }
}

fn is_over(slot: &Slot) -> bool {
    let late_checks = slot.late_checks();
    RUNNING.with_borrow(|running| {
        let running = running.as_ref();
        running.is_some_and(|running| running.is_over(late_checks))
    })
}

pub(super) fn record_place(file: String, line: u32) {
    RUNNING.with_borrow_mut(|running| {
        if let Some(running) = running {
            running.location = Some(SourceLocation { file, line });
        }
    });
}

/// Shared between the thread of a VM and the watcher.
#[derive(Default)]
pub(super) struct Slot {
    /// When to check, in nanoseconds since the watcher's start; 0 if no slice is running.
    pub(super) check_at: AtomicU64,
    pub(super) flag: AtomicU8,
    /// How many checks in a row found the flag unanswered by the VM.
    pub(super) unanswered: AtomicU32,
    /// How many checks found the slice running after its limit.
    late_checks: AtomicU32,
    /// The file of the script whose slice is running.
    script: Mutex<String>,
}

impl Slot {
    pub(super) fn check(&self, now: u64) {
        let check_at = self.check_at.load(Ordering::Acquire);
        if check_at == 0 || now < check_at {
            return self.unanswered.store(0, Ordering::Relaxed);
        }
        self.late_checks.fetch_add(1, Ordering::Relaxed);
        // A flag that is already latched stays.
        let _ = self.flag.compare_exchange(
            WITHIN_BUDGET,
            CHECK_CLOCKS,
            Ordering::AcqRel,
            Ordering::Relaxed,
        );
        // Counted, not timed: time in which the whole process is stopped must not count.
        let count = self.unanswered.load(Ordering::Relaxed).saturating_add(1);
        self.unanswered.store(count, Ordering::Relaxed);
    }

    fn late_checks(&self) -> u32 {
        self.late_checks.load(Ordering::Relaxed)
    }

    pub(super) fn is_running(&self) -> bool {
        self.check_at.load(Ordering::Acquire) != 0
    }
}

/// The thread that checks all slots, and what it knows.
pub(super) struct Watcher {
    start: Instant,
    slots: Mutex<Slots>,
    /// The smallest limit of any slice so far, in nanoseconds.
    smallest_limit: AtomicU64,
    /// How long it has stalled so far, in nanoseconds.
    stalled: AtomicU64,
    thread: OnceLock<Thread>,
}

/// All slots. A slot lives as long as the process, so that the interrupt can read it without
/// reference counting; a thread returns its slot when it ends.
#[derive(Default)]
pub(super) struct Slots {
    pub(super) all: Vec<&'static Slot>,
    pub(super) free: Vec<&'static Slot>,
}

impl Watcher {
    fn new() -> Watcher {
        Watcher {
            start: Instant::now(),
            slots: Mutex::default(),
            smallest_limit: AtomicU64::new(u64::MAX),
            stalled: AtomicU64::new(0),
            thread: OnceLock::new(),
        }
    }

    /// The process's watcher, started at the first call. If the system refuses to start the thread,
    /// no slice is ended here; the agent still ends a silent host.
    pub(super) fn get() -> &'static Watcher {
        static WATCHER: OnceLock<&'static Watcher> = OnceLock::new();
        WATCHER.get_or_init(|| {
            let watcher: &'static Watcher = Box::leak(Box::new(Watcher::new()));
            let spawned = std::thread::Builder::new()
                .name("script-budget".to_owned())
                .spawn(|| watcher.watch());
            if let Ok(handle) = spawned {
                let _ = watcher.thread.set(handle.thread().clone());
            }
            watcher
        })
    }

    fn watch(&self) {
        let mut pause = CHECK_INTERVAL;
        loop {
            let due = Instant::now() + pause;
            std::thread::park_timeout(pause);
            self.note_stall(due.elapsed(), pause);
            let now = self.nanoseconds(Instant::now());
            let slots = self.slots.lock().all.clone();
            for slot in &slots {
                slot.check(now);
            }
            if let Some(stuck) = STUCK.get() {
                let is_stuck =
                    |slot: &&&Slot| slot.unanswered.load(Ordering::Relaxed) == stuck.checks;
                if let Some(slot) = slots.iter().find(is_stuck) {
                    let script = slot.script.lock().clone();
                    (stuck.report)(&script);
                }
            }
            let checks = slots
                .iter()
                .map(|slot| slot.check_at.load(Ordering::Acquire));
            let smallest_limit = self.smallest_limit.load(Ordering::Acquire);
            pause = pause_until_next_check(checks, smallest_limit, now);
        }
    }

    pub(super) fn note_limit(&self, limit: Duration) {
        let limit = u64::try_from(limit.as_nanos()).unwrap_or(u64::MAX);
        let before = self.smallest_limit.fetch_min(limit, Ordering::AcqRel);
        // It may be in a pause that is too long for this slice.
        if limit < before
            && let Some(thread) = self.thread.get()
        {
            thread.unpark();
        }
    }

    /// A stall may have begun at any time of the pause: all of it counts as stalled.
    fn note_stall(&self, late: Duration, pause: Duration) {
        if late > STALL {
            let stalled = u64::try_from((late + pause).as_nanos()).unwrap_or(u64::MAX);
            self.stalled.fetch_add(stalled, Ordering::Relaxed);
        }
    }

    fn stalled(&self) -> u64 {
        self.stalled.load(Ordering::Relaxed)
    }

    pub(super) fn nanoseconds(&self, at: Instant) -> u64 {
        let since = at.saturating_duration_since(self.start).as_nanos();
        u64::try_from(since).unwrap_or(u64::MAX).max(1)
    }

    pub(super) fn take_slot(&self) -> &'static Slot {
        let mut slots = self.slots.lock();
        slots.free.pop().unwrap_or_else(|| {
            let slot: &'static Slot = Box::leak(Box::default());
            slots.all.push(slot);
            slot
        })
    }
}

/// How long no slice can reach its limit: one that is running reaches it at its time in `checks` (0
/// if none is running), one that begins later not before the smallest limit has passed.
pub(super) fn pause_until_next_check(
    checks: impl Iterator<Item = u64>,
    smallest_limit: u64,
    now: u64,
) -> Duration {
    let running = checks.filter(|check_at| *check_at != 0);
    let pauses = running.map(|check_at| check_at.saturating_sub(now));
    let pause = pauses.min().unwrap_or(u64::MAX).min(smallest_limit);
    Duration::from_nanos(pause).max(CHECK_INTERVAL)
}

/// How to report a script that passes no safepoint.
pub(super) struct Stuck {
    pub(super) checks: u32,
    pub(super) report: Box<dyn Fn(&str) + Send + Sync>,
}

pub(super) static STUCK: OnceLock<Stuck> = OnceLock::new();

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slice_that_ends_when_a_stalled_machine_continues_is_not_over() {
        let limit = Duration::from_millis(1);
        let running = Running::begin(limit);
        while processor_time() < running.processor + limit {}
        assert!(!running.is_over(CONFIRMATIONS - 1));
        assert!(running.is_over(CONFIRMATIONS));
    }

    #[test]
    fn only_a_watcher_that_is_very_late_has_stalled() {
        let watcher = Watcher::new();
        watcher.note_stall(STALL, CHECK_INTERVAL);
        assert_eq!(watcher.stalled(), 0);
        watcher.note_stall(2 * STALL, CHECK_INTERVAL);
        let stalled = 2 * STALL + CHECK_INTERVAL;
        assert_eq!(u128::from(watcher.stalled()), stalled.as_nanos());
    }

    #[test]
    fn checks_are_counted_from_the_limit_on() {
        let slot = Slot::default();
        slot.check(1000);
        slot.check_at.store(1000, Ordering::Release);
        slot.check(999);
        assert_eq!(slot.late_checks(), 0);
        slot.check(1000);
        slot.check(1001);
        assert_eq!(slot.late_checks(), 2);
    }

    #[test]
    fn a_slice_without_cpu_time_is_over_late_and_in_a_simulation_later() {
        let limit = Duration::from_millis(100);
        let is_over = |wall: u64, processor: u64, wall_factor| {
            let [wall, processor] = [wall, processor].map(Duration::from_millis);
            is_too_long(wall, processor, limit, wall_factor)
        };
        for wall_factor in [WALL_FACTOR, SIMULATED_WALL_FACTOR] {
            assert!(is_over(100, 50, wall_factor));
            assert!(!is_over(499, 49, wall_factor));
        }
        assert!(is_over(500, 0, WALL_FACTOR));
        assert!(!is_over(9_999, 49, SIMULATED_WALL_FACTOR));
        assert!(is_over(10_000, 0, SIMULATED_WALL_FACTOR));
    }

    #[test]
    fn checks_without_an_answer_are_counted_until_the_vm_answers() {
        let slot = Slot::default();
        slot.script.lock().push_str("stuck.lua");
        let checks = |count: u64, from: u64| (from..from + count).for_each(|now| slot.check(now));
        checks(100, 1);
        assert_eq!(slot.unanswered.load(Ordering::Relaxed), 0, "nothing runs");
        slot.check_at.store(150, Ordering::Release);
        checks(50, 100);
        assert_eq!(
            slot.unanswered.load(Ordering::Relaxed),
            0,
            "within its budget"
        );
        checks(20, 150);
        assert_eq!(slot.unanswered.load(Ordering::Relaxed), 20);
        // The VM has answered and may go on for a while.
        slot.check_at.store(180, Ordering::Release);
        slot.flag.store(WITHIN_BUDGET, Ordering::Release);
        checks(10, 170);
        assert_eq!(slot.unanswered.load(Ordering::Relaxed), 0);
    }

    #[test]
    fn a_stuck_slice_is_reported_with_its_file() {
        let (sender, reports) = std::sync::mpsc::channel();
        when_stuck(Duration::from_millis(100), move |file| {
            let _ = sender.send((file.to_owned(), running()));
        });
        begin(Duration::from_millis(1), "stuck.lua");
        let (file, running) = reports.recv_timeout(Duration::from_secs(60)).unwrap();
        let _ = end();
        assert_eq!(file, "stuck.lua");
        assert!(running.contains(&file), "{running:?}");
    }

    #[test]
    fn a_thread_of_simulations_uses_the_larger_factor() {
        assert_eq!(WALL_TIME_FACTOR.get(), WALL_FACTOR);
        set_simulated_wall_factor();
        assert_eq!(WALL_TIME_FACTOR.get(), SIMULATED_WALL_FACTOR);
    }

    #[test]
    fn the_watcher_pauses_while_no_slice_can_reach_its_limit() {
        let [limit, now] = [100, 5000].map(|millis| millis * 1_000_000);
        let pause = |checks: &[u64], smallest| {
            let checks = checks.iter().map(|millis| millis * 1_000_000);
            pause_until_next_check(checks, smallest, now).as_millis()
        };
        assert_eq!(pause(&[0, 0], limit), 100, "none is running");
        assert_eq!(pause(&[0, 5040], limit), 40);
        assert_eq!(pause(&[5900, 5600], limit), 100, "another may begin");
        for reached in [5003, 5000, 4000] {
            assert_eq!(pause(&[reached], limit), 10);
        }
        assert!(pause(&[0], u64::MAX) > 1_000_000, "there was none yet");
    }
}
