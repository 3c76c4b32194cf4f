//! What a behaviour may write per day, whatever host it has: the accounts outlive hosts and restarts.
//! The agent weighs the pictures in its folders itself; it believes no host. The store is not
//! weighed: its size is limited, and its host writes it more and more rarely.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use parking_lot::{Mutex, MutexGuard};
use tokio::task::spawn_blocking;
use tokio::time::{Instant, sleep};

use super::limiter::HostLimiter;
use super::store_writer;
use crate::files::{Folder, Item};
use crate::rate_limit::TokenBucket;
use crate::script::{Limits, Options};

/// Bytes beyond the budget for which no behaviour is ended: the clocks of agent and host differ, and a
/// file may be weighed under two names.
const SLACK: f64 = (4 << 20) as f64;
/// Shortest interval between two weighings; a longer one, so that they take a hundredth of the time.
const PACE: Duration = Duration::from_secs(1);
/// What was written this long before the first weighing counts too: the program was restarted.
const RECENT: Duration = Duration::from_secs(3600);

/// The accounts of an agent's behaviours, by name.
#[derive(Debug, Clone, Default)]
pub struct Accounts(Arc<Mutex<BTreeMap<String, Account>>>);

impl Accounts {
    /// The account of a behaviour; a new one if its limits or folders are others than before.
    pub(super) fn open(&self, options: &Options) -> Account {
        let mut accounts = self.0.lock();
        let kept = accounts.get(&options.name);
        if let Some(kept) = kept.filter(|kept| kept.is_for(options)) {
            return kept.clone();
        }
        let account = Account::new(options);
        accounts.insert(options.name.clone(), account.clone());
        account
    }
}

/// The account of one behaviour. All clones are one.
#[derive(Debug, Clone)]
pub(super) struct Account {
    limits: Limits,
    folders: Vec<PathBuf>,
    /// Of what it says.
    limiter: Arc<Mutex<HostLimiter>>,
    /// Of what it writes.
    disk: Arc<Mutex<Disk>>,
}

#[derive(Debug)]
struct Disk {
    day: TokenBucket,
    /// The files at the last weighing, by folder and name. One that is written again with its old length
    /// and time does not count: it fills no disk.
    files: Option<BTreeMap<(usize, String), Item>>,
}

impl Account {
    fn new(options: &Options) -> Account {
        let folders = options.folders().into_iter().map(PathBuf::from);
        let folders: Vec<PathBuf> = folders.collect();
        let name = options.name.clone();
        let limiter = HostLimiter::new(name, options.data_dir.clone(), &options.limits);
        let day = TokenBucket::a_day(options.limits.bytes_a_day * folders.len().max(1) as u64);
        Account {
            limiter: Arc::new(Mutex::new(limiter)),
            disk: Arc::new(Mutex::new(Disk { day, files: None })),
            limits: options.limits.clone(),
            folders,
        }
    }

    fn is_for(&self, options: &Options) -> bool {
        self.limits == options.limits && self.folders == options.folders()
    }

    pub(super) fn limiter(&self) -> MutexGuard<'_, HostLimiter> {
        self.limiter.lock()
    }

    /// Weighs what was written since the last time. Returns how many bytes of pictures the behaviour
    /// may still save at once in each folder; the error says that it has written too much. Blocks on the
    /// disk.
    pub(super) fn weigh(&self, now: Instant) -> Result<u64, String> {
        let mut files = BTreeMap::new();
        for (number, folder) in self.folders.iter().enumerate() {
            // What cannot be read cannot be written.
            let items = Folder::open(folder).and_then(|folder| folder.items());
            let items = items.unwrap_or_default().into_iter();
            let items = items.filter(|item| !store_writer::is_store(item));
            files.extend(items.map(|item| ((number, item.name.clone()), item)));
        }
        let recent = SystemTime::now().checked_sub(RECENT).unwrap_or(UNIX_EPOCH);
        let recent = recent.duration_since(UNIX_EPOCH).unwrap_or_default();
        let mut disk = self.disk.lock();
        let is_new = |(name, item): &(&(usize, String), &Item)| match &disk.files {
            Some(before) => before.get(*name) != Some(*item),
            None => u64::try_from(item.written.0).is_ok_and(|at| at > recent.as_secs()),
        };
        let new = files.iter().filter(is_new);
        let written: u64 = new.map(|(_, item)| item.bytes).sum();
        let is_first = disk.files.replace(files).is_none();
        let left = disk.day.spend(written as f64, now);
        if left >= -SLACK || is_first {
            return Ok((left.max(0.0) / self.folders.len().max(1) as f64) as u64);
        }
        Err(format!(
            "it has written more to its folder than the limit of {} bytes a day (`bytes_a_day`) \
             permits; it may start again when as much time has passed",
            self.limits.bytes_a_day
        ))
    }

    /// Weighs again and again while a host runs; returns why it must end.
    pub(super) async fn watch(self) -> String {
        loop {
            let account = self.clone();
            let began = Instant::now();
            let weighed = spawn_blocking(move || account.weigh(began)).await;
            if let Ok(Err(why)) = weighed {
                return why;
            }
            sleep(PACE.max(began.elapsed() * 100)).await;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    const MIB: u64 = 1 << 20;

    fn options(root: &std::path::Path) -> Options {
        let mut options = Options::new("go", "go.lua");
        options.data_dir = Some(root.to_owned());
        options.limits.bytes_a_day = 24 * MIB;
        options
    }

    fn write(root: &std::path::Path, name: &str, bytes: u64) {
        fs::write(root.join(name), vec![0; bytes as usize]).unwrap();
    }

    /// How many MiB may still be written at once.
    fn left(accounts: &Accounts, options: &Options, now: Instant) -> f64 {
        let left = accounts.open(options).weigh(now).unwrap();
        (100.0 * left as f64 / MIB as f64).round() / 100.0
    }

    #[test]
    fn what_earlier_hosts_and_programs_have_written_counts() {
        let root = tempfile::tempdir().unwrap();
        let options = options(root.path());
        let accounts = Accounts::default();
        let mut now = Instant::now();
        assert_eq!(left(&accounts, &options, now), 1.0);
        write(root.path(), "a.jpg", MIB / 2);
        write(root.path(), "store.json", MIB);
        assert_eq!(left(&accounts, &options, now), 0.5);
        assert_eq!(left(&accounts, &options, now), 0.5, "each file counts once");
        // Of another length: the disk's clock is coarse.
        write(root.path(), "a.jpg", MIB / 2 + 1);
        assert_eq!(left(&accounts, &options, now), 0.0);
        now += Duration::from_secs(2 * 3600);
        assert_eq!(left(&accounts, &options, now), 1.0);
        // The next program finds what was written lately.
        assert_eq!(left(&Accounts::default(), &options, now), 0.5);
    }

    #[test]
    fn a_folder_that_grows_faster_than_its_budget_is_noticed_and_remembered() {
        let root = tempfile::tempdir().unwrap();
        let options = options(root.path());
        let accounts = Accounts::default();
        let mut now = Instant::now();
        left(&accounts, &options, now);
        write(root.path(), "huge", 16 * MIB);
        for _ in 0..2 {
            let why = accounts.open(&options).weigh(now).unwrap_err();
            assert!(why.contains("bytes_a_day"), "{why}");
        }
        now += Duration::from_secs(24 * 3600);
        assert_eq!(left(&accounts, &options, now), 1.0);
    }

    #[test]
    fn other_limits_open_another_account() {
        let root = tempfile::tempdir().unwrap();
        let accounts = Accounts::default();
        let mut options = options(root.path());
        let now = Instant::now();
        assert_eq!(left(&accounts, &options, now), 1.0);
        options.limits.bytes_a_day = 48 * MIB;
        assert_eq!(left(&accounts, &options, now), 2.0);
    }
}
