//! What the timetable has under way, kept in a file: after a power cut the next service goes on with
//! it. Written off the caller's thread; a disk that is slow or full blocks nothing.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::time::Duration;

use crate::files::Folder;
use crate::timetable::Record;

/// Its name, in the data folder.
const NAME: &str = "schedule.json";
/// The longest that is read.
const MAX_LEN: u64 = 1 << 16;
/// Records that may wait for the disk; the newest is written.
const WAITING: usize = 4;
/// After this a record that could not be written is tried again.
const AGAIN: Duration = Duration::from_secs(10);

/// See the module.
#[derive(Debug, Clone)]
pub struct RecordFile(Writer);

#[derive(Debug, Clone)]
enum Writer {
    Thread(SyncSender<Record>),
    Here(Arc<Disk>),
}

impl RecordFile {
    /// Reads what there is in this data folder, and keeps what comes there. What cannot be read is said
    /// in the log, and nothing is known then.
    pub fn open(data: &Path) -> (Record, Option<RecordFile>) {
        let Some((record, disk)) = Disk::open(data) else {
            return (Record::default(), None);
        };
        let (records, received) = sync_channel(WAITING);
        let writing = std::thread::Builder::new().name("record".into());
        let started = writing.spawn(move || write_all(&disk, &received));
        let file = RecordFile(Writer::Thread(records));
        (record, started.is_ok().then_some(file))
    }

    /// The same for a laboratory, whose time stands still while the disk works: what is kept is written
    /// at once, by the caller's thread.
    pub fn open_in_lab(data: &Path) -> (Record, Option<RecordFile>) {
        match Disk::open(data) {
            Some((record, disk)) => (record, Some(RecordFile(Writer::Here(Arc::new(disk))))),
            None => (Record::default(), None),
        }
    }

    /// Keeps this from now on, and says whether it does. Never waits: when the disk takes nothing, this
    /// one is left out, to be given again.
    pub(super) fn keep(&self, record: Record) -> bool {
        match &self.0 {
            Writer::Thread(records) => records.try_send(record).is_ok(),
            Writer::Here(disk) => disk.write(&record),
        }
    }
}

/// Whether a record is to be written: when something begins or ends, and every hour.
pub(super) fn is_news(old: Option<&Record>, record: &Record) -> bool {
    old.is_none_or(|old| {
        let passed = record.looked.zip(old.looked);
        let lately = passed.is_none_or(|(now, then)| (0..3600).contains(&(now - then)));
        old.under_way != record.under_way || !lately
    })
}

/// Where it is kept.
#[derive(Debug)]
struct Disk {
    folder: Folder,
    path: PathBuf,
    failed: AtomicBool,
}

impl Disk {
    /// Also what is there.
    fn open(data: &Path) -> Option<(Record, Disk)> {
        let folder = match Folder::make(data) {
            Ok(folder) => folder,
            Err(error) => {
                let data = data.display();
                tracing::warn!(
                    "after a power cut nothing will resume: cannot write to {data}: {error}"
                );
                return None;
            }
        };
        let (path, failed) = (data.join(NAME), AtomicBool::new(false));
        let disk = Disk {
            folder,
            path,
            failed,
        };
        Some((disk.read(), disk))
    }

    fn read(&self) -> Record {
        let read = self.folder.read(NAME, MAX_LEN);
        let parsed = read.map_err(|error| error.to_string()).and_then(|bytes| {
            let parse = |bytes: Vec<u8>| serde_json::from_slice(&bytes);
            bytes
                .map(parse)
                .transpose()
                .map_err(|error| error.to_string())
        });
        parsed.map(Option::unwrap_or_default).unwrap_or_else(|why| {
            let path = self.path.display();
            tracing::warn!("an interrupted run cannot resume: {path}: {why}");
            Record::default()
        })
    }

    /// Whether it is written.
    fn write(&self, record: &Record) -> bool {
        // A record has no key that JSON could not have.
        let Ok(bytes) = serde_json::to_vec(record) else {
            return true;
        };
        let written = self.folder.replace_durably(NAME, &bytes);
        let failed = self.failed.swap(written.is_err(), Ordering::Relaxed);
        if let (Err(error), false) = (&written, failed) {
            let path = self.path.display();
            tracing::warn!("after a power cut nothing will resume: {path}: {error}");
        }
        written.is_ok()
    }
}

/// Until nobody has records any more. One that could not be written is tried again unless a newer one
/// has come.
fn write_all(disk: &Disk, records: &Receiver<Record>) {
    let mut unwritten: Option<Record> = None;
    loop {
        let next = match &unwritten {
            None => records.recv().ok(),
            Some(_) => match records.recv_timeout(AGAIN) {
                Ok(newer) => Some(newer),
                Err(RecvTimeoutError::Timeout) => unwritten.take(),
                Err(RecvTimeoutError::Disconnected) => None,
            },
        };
        let Some(mut record) = next else { return };
        while let Ok(newer) = records.try_recv() {
            record = newer;
        }
        unwritten = (!disk.write(&record)).then_some(record);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::timetable::UnderWay;

    #[test]
    fn what_is_kept_is_there_for_the_next_one_and_garbage_is_nothing() {
        let home = tempfile::tempdir().unwrap();
        let (none, file) = RecordFile::open(home.path());
        assert_eq!(none, Record::default());
        let record = Record {
            looked: Some(7),
            under_way: vec![UnderWay {
                run: "patrol".to_owned(),
                planned: 7,
                until: Some(9),
            }],
        };
        assert!(file.unwrap().keep(record.clone()));
        let path = home.path().join(NAME);
        while !path.exists() {
            std::thread::yield_now();
        }
        assert_eq!(RecordFile::open(home.path()).0, record);
        std::fs::write(&path, "{").unwrap();
        assert_eq!(RecordFile::open(home.path()).0, Record::default());
    }

    #[test]
    fn in_a_laboratory_it_is_written_before_time_goes_on() {
        let home = tempfile::tempdir().unwrap();
        let (_, file) = RecordFile::open_in_lab(home.path());
        let record = Record {
            looked: Some(8),
            under_way: Vec::new(),
        };
        assert!(file.unwrap().keep(record.clone()));
        assert_eq!(RecordFile::open_in_lab(home.path()).0, record);
    }

    #[test]
    fn what_a_full_disk_did_not_take_is_given_again() {
        let home = tempfile::tempdir().unwrap();
        let (_, file) = RecordFile::open_in_lab(home.path());
        // A folder in the file's place takes no record.
        std::fs::create_dir(home.path().join(NAME)).unwrap();
        let file = file.unwrap();
        assert!(!file.keep(Record::default()));
        std::fs::remove_dir(home.path().join(NAME)).unwrap();
        assert!(file.keep(Record::default()));
    }
}
