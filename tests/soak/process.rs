//! How large this process is.

use std::fmt;

use super::Ledger;

/// Memory, threads and descriptors.
#[derive(Debug, Clone, Copy)]
pub struct Size {
    resident_kib: u64,
    threads: u64,
    descriptors: u64,
}

impl Size {
    /// As the kernel has it.
    pub fn now() -> Size {
        let status = std::fs::read_to_string("/proc/self/status").unwrap();
        let field = |name: &str| {
            let line = status.lines().find_map(|line| line.strip_prefix(name));
            let number = line.and_then(|line| line.split_whitespace().next());
            number.and_then(|number| number.parse().ok()).unwrap_or(0)
        };
        Size {
            resident_kib: field("VmRSS:"),
            threads: field("Threads:"),
            descriptors: std::fs::read_dir("/proc/self/fd").unwrap().count() as u64,
        }
    }

    /// Notes whether it has grown since. Threads that write pictures and stores come and go, so threads
    /// and descriptors get some room, and memory a quarter and 16 MiB.
    pub fn compare(&self, later: &Size, ledger: &mut Ledger) {
        let mut compare = |promise, unit: &str, from: u64, to: u64, most: u64| {
            let grown = format!("{unit}: {from} after the warm-up, {to} at the end");
            ledger.note(promise, (to > most).then_some(grown));
        };
        let before = self.resident_kib;
        let room = self.resident_kib / 4 + 16 * 1024;
        compare(
            "memory does not grow",
            "KiB",
            before,
            later.resident_kib,
            before + room,
        );
        let before = self.threads;
        compare(
            "threads do not pile up",
            "threads",
            before,
            later.threads,
            before + 4,
        );
        let before = self.descriptors;
        let after = later.descriptors;
        compare(
            "descriptors do not pile up",
            "descriptors",
            before,
            after,
            before + 16,
        );
    }
}

impl fmt::Display for Size {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Size {
            resident_kib,
            threads,
            descriptors,
        } = self;
        write!(
            f,
            "{resident_kib:>6} KiB  {threads:>3} threads  {descriptors:>3} descriptors"
        )
    }
}
