//! The thread that checks how long the slices of scripts run, and the flags through which it reaches
//! their VMs.

use std::sync::atomic::{AtomicU8, AtomicU32, AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};
use std::thread::Thread;
use std::time::{Duration, Instant};

/// Shortest interval of the watcher's checks.
pub(super) const CHECK_INTERVAL: Duration = Duration::from_millis(10);

/// The slice is within its budget.
pub(super) const WITHIN_BUDGET: u8 = 0;
/// Set by the watcher: the interrupt must check the clocks.
pub(super) const CHECK_CLOCKS: u8 = 1;

/// Shared between the thread of a VM and the watcher.
#[derive(Default)]
pub(super) struct Slot {
    /// When to check, in nanoseconds since the watcher's start; 0 if no slice is running.
    pub(super) check_at: AtomicU64,
    pub(super) flag: AtomicU8,
    /// How many checks in a row found the flag unanswered by the VM.
    pub(super) unanswered: AtomicU32,
    /// The file of the script whose slice is running.
    script: Mutex<String>,
}

impl Slot {
    /// One check by the watcher.
    pub(super) fn check(&self, now: u64) {
        let check_at = self.check_at.load(Ordering::Acquire);
        if check_at == 0 || now < check_at {
            return self.unanswered.store(0, Ordering::Relaxed);
        }
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

    pub(super) fn is_running(&self) -> bool {
        self.check_at.load(Ordering::Acquire) != 0
    }

    pub(super) fn script(&self) -> MutexGuard<'_, String> {
        self.script.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The thread that checks all slots, and what it knows.
pub(super) struct Watcher {
    start: Instant,
    slots: Mutex<Slots>,
    /// The smallest limit of any slice so far, in nanoseconds.
    smallest_limit: AtomicU64,
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
    /// The process's watcher, started at the first call. If the system refuses to start the thread,
    /// slices are only checked when they end.
    pub(super) fn get() -> &'static Watcher {
        static WATCHER: OnceLock<&'static Watcher> = OnceLock::new();
        WATCHER.get_or_init(|| {
            let watcher: &'static Watcher = Box::leak(Box::new(Watcher {
                start: Instant::now(),
                slots: Mutex::default(),
                smallest_limit: AtomicU64::new(u64::MAX),
                thread: OnceLock::new(),
            }));
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
            std::thread::park_timeout(pause);
            let now = self.nanoseconds(Instant::now());
            let slots = self.slots().all.clone();
            for slot in &slots {
                slot.check(now);
            }
            if let Some(stuck) = STUCK.get() {
                let is_stuck =
                    |slot: &&&Slot| slot.unanswered.load(Ordering::Relaxed) == stuck.checks;
                if let Some(slot) = slots.iter().find(is_stuck) {
                    let script = slot.script().clone();
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

    /// Takes in the limit of a slice that begins.
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

    pub(super) fn nanoseconds(&self, at: Instant) -> u64 {
        let since = at.saturating_duration_since(self.start).as_nanos();
        u64::try_from(since).unwrap_or(u64::MAX).max(1)
    }

    pub(super) fn slots(&self) -> MutexGuard<'_, Slots> {
        self.slots.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn take_slot(&self) -> &'static Slot {
        let mut slots = self.slots();
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
