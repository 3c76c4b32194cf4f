//! The file that records the runs that the timetable has under way, so that the next service can
//! resume them after a power cut. A separate thread writes it; a slow or full disk blocks nothing.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use tokio::sync::watch;
use tokio::time::Instant;

use crate::clock::until;
use crate::files::Folder;
use crate::side_thread::SideThread;
use crate::timetable::Record;

/// Name of the file, in the data folder.
const NAME: &str = "schedule.json";
/// Maximum length of a file that is read.
const MAX_LEN: u64 = 1 << 16;
/// Time until a failed write is retried.
const AGAIN: Duration = Duration::from_secs(10);

/// The record of the previous service, and the file for new ones.
#[derive(Debug, Default)]
pub struct RecordFile {
    /// What was under way when the previous service ended.
    pub(super) record: Record,
    /// Without one nothing is recorded.
    writer: Option<Writer>,
}

#[derive(Debug)]
enum Writer {
    /// The newest record, for the thread that writes it.
    Thread(watch::Sender<Option<Record>>),
    Here(Disk),
}

impl RecordFile {
    /// Reads the record in this data folder, and opens the file for new ones. If the file cannot be
    /// read, this is logged and the record is empty.
    pub fn open(data: &Path) -> RecordFile {
        RecordFile::open_with(data, |disk| {
            let (newest, records) = watch::channel(None);
            let started = SideThread::start("record", |_| write_all(disk, records));
            started.ok().map(|_| Writer::Thread(newest))
        })
    }

    /// Same as [`RecordFile::open`] for a simulation, whose time stands still while the disk works:
    /// records are written at once, on the caller's thread.
    pub fn open_in_simulation(data: &Path) -> RecordFile {
        RecordFile::open_with(data, |disk| Some(Writer::Here(disk)))
    }

    fn open_with(data: &Path, writer: impl FnOnce(Disk) -> Option<Writer>) -> RecordFile {
        match Disk::open(data) {
            Some(disk) => RecordFile {
                record: disk.read(),
                writer: writer(disk),
            },
            None => RecordFile::default(),
        }
    }

    /// Has a record written, in place of older ones that still wait; returns whether it was
    /// accepted. Does not wait for the disk, except in a simulation.
    pub(super) fn save(&self, record: Record) -> bool {
        match &self.writer {
            Some(Writer::Thread(newest)) => newest.send(Some(record)).is_ok(),
            Some(Writer::Here(disk)) => disk.write(&record),
            None => true,
        }
    }
}

/// Whether a record must be written: when something starts or ends, and every hour.
pub(super) fn is_news(old: Option<&Record>, record: &Record) -> bool {
    old.is_none_or(|old| {
        let passed = record.looked.zip(old.looked);
        let lately = passed.is_none_or(|(now, then)| (0..3600).contains(&(now - then)));
        old.under_way != record.under_way || !lately
    })
}

#[derive(Debug)]
struct Disk {
    folder: Folder,
    path: PathBuf,
    failed: AtomicBool,
}

impl Disk {
    fn open(data: &Path) -> Option<Disk> {
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
        Some(Disk {
            folder,
            path: data.join(NAME),
            failed: AtomicBool::new(false),
        })
    }

    fn read(&self) -> Record {
        let parsed = match self.folder.read(NAME, MAX_LEN) {
            Ok(Some(bytes)) => serde_json::from_slice(&bytes).map_err(io::Error::from),
            Ok(None) => Ok(Record::default()),
            Err(error) => Err(error.into()),
        };
        parsed.unwrap_or_else(|why| {
            let path = self.path.display();
            tracing::warn!("an interrupted run cannot resume: {path}: {why}");
            Record::default()
        })
    }

    fn write(&self, record: &Record) -> bool {
        // Serialisation cannot fail: all keys of a record are strings.
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

/// Writes the newest record until there will be no more. A failed write is retried.
async fn write_all(disk: Disk, mut newest: watch::Receiver<Option<Record>>) {
    let mut retry = None;
    loop {
        tokio::select! {
            changed = newest.changed() => if changed.is_err() { return },
            () = until(retry) => {}
        }
        let record = newest.borrow_and_update().clone();
        let written = record.is_none_or(|record| disk.write(&record));
        retry = if written {
            None
        } else {
            Some(Instant::now() + AGAIN)
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::timetable::UnderWay;

    #[test]
    fn a_record_survives_a_restart_and_an_invalid_file_is_ignored() {
        let home = tempfile::tempdir().unwrap();
        let opened = RecordFile::open(home.path());
        assert_eq!(opened.record, Record::default());
        let record = Record {
            looked: Some(7),
            under_way: vec![UnderWay {
                run: "patrol".to_owned(),
                planned: 7,
                until: Some(9),
                waits: false,
            }],
        };
        assert!(opened.save(record.clone()));
        let path = home.path().join(NAME);
        while !path.exists() {
            std::thread::yield_now();
        }
        assert_eq!(RecordFile::open(home.path()).record, record);
        std::fs::write(&path, "{").unwrap();
        assert_eq!(RecordFile::open(home.path()).record, Record::default());
    }

    #[test]
    fn in_a_laboratory_records_are_written_at_once() {
        let home = tempfile::tempdir().unwrap();
        let file = RecordFile::open_in_simulation(home.path());
        let record = Record {
            looked: Some(8),
            under_way: Vec::new(),
        };
        assert!(file.save(record.clone()));
        assert_eq!(RecordFile::open_in_simulation(home.path()).record, record);
    }

    #[test]
    fn a_failed_write_can_be_repeated() {
        let home = tempfile::tempdir().unwrap();
        let file = RecordFile::open_in_simulation(home.path());
        // A folder in the file's place takes no record.
        std::fs::create_dir(home.path().join(NAME)).unwrap();
        assert!(!file.save(Record::default()));
        std::fs::remove_dir(home.path().join(NAME)).unwrap();
        assert!(file.save(Record::default()));
    }
}
