//! How large this process is.

use super::Ledger;

/// Memory, threads and descriptors.
#[derive(Debug, Clone, Copy)]
pub struct Size {
    pub resident_kib: u64,
    pub threads: u64,
    pub descriptors: u64,
}

fn descriptors() -> u64 {
    std::fs::read_dir("/proc/self/fd").unwrap().count() as u64
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
            descriptors: descriptors(),
        }
    }

    /// Notes whether it has grown since. Threads that write pictures and stores come and go, so threads
    /// and descriptors get some room, and memory a quarter and 16 MiB.
    pub fn compare(&self, later: &Size, ledger: &mut Ledger) {
        let grown = |what: &str, from: u64, to: u64, most: u64| {
            (to > most).then(|| format!("{what}: {from} after the warm-up, {to} at the end"))
        };
        ledger.note(
            "memory does not grow",
            grown(
                "KiB",
                self.resident_kib,
                later.resident_kib,
                self.resident_kib * 5 / 4 + 16 * 1024,
            ),
        );
        ledger.note(
            "threads do not pile up",
            grown("threads", self.threads, later.threads, self.threads + 4),
        );
        ledger.note(
            "descriptors do not pile up",
            grown(
                "descriptors",
                self.descriptors,
                later.descriptors,
                self.descriptors + 16,
            ),
        );
    }
}
