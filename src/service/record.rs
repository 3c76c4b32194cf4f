//! The file that records the runs that the timetable has under way, so that the next service can
//! resume them after a power cut, and what people have changed of the timetable. A separate thread
//! writes it; a slow or full disk blocks nothing.

use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use tokio::sync::watch;
use tokio::time::{Instant, timeout};

use crate::clock::until;
use crate::files::Folder;
use crate::side_thread::SideThread;
use crate::timetable::{Hold, Record};

/// Name of the file, in the data folder.
const NAME: &str = "schedule.json";
/// Maximum length of a file that is read.
const MAX_LEN: u64 = 1 << 16;
/// Longest wait for the disk before the answer to a person.
const KEEP_LIMIT: Duration = Duration::from_secs(1);
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
    Thread {
        /// The newest record and its number, for the thread that writes it.
        newest: watch::Sender<(u64, Record)>,
        /// The number of the record that was tried last, and what the disk said.
        tried: watch::Receiver<(u64, Result<(), String>)>,
    },
    Here(Disk),
}

impl RecordFile {
    /// Reads the record in this data folder, and opens the file for new ones. If the file cannot be
    /// read, this is logged and the record is empty.
    pub fn open(data: &Path) -> RecordFile {
        RecordFile::open_with(data, |disk| {
            let (newest, records) = watch::channel((0, Record::default()));
            let (told, tried) = watch::channel((0, Ok(())));
            let started = SideThread::start("record", |_| write_all(disk, records, told));
            started.ok().map(|_| Writer::Thread { newest, tried })
        })
    }

    /// Same as [`RecordFile::open`] for a simulation, whose time stands still while the disk works:
    /// records are written at once, on the caller's thread.
    pub fn open_in_simulation(data: &Path) -> RecordFile {
        RecordFile::open_with(data, |disk| Some(Writer::Here(disk)))
    }

    fn open_with(data: &Path, writer: impl FnOnce(Disk) -> Option<Writer>) -> RecordFile {
        let disk = Disk {
            data: data.to_owned(),
            failed: AtomicBool::new(false),
        };
        RecordFile {
            record: disk.read(),
            writer: writer(disk),
        }
    }

    /// What people have changed of the timetable in this data folder.
    pub fn hold(data: &Path) -> Hold {
        RecordFile::open_with(data, |_| None).record.hold
    }

    /// Has a record written, in place of older ones that still wait; returns whether it was
    /// accepted. Does not wait for the disk, except in a simulation.
    pub(super) fn save(&self, record: Record) -> bool {
        match &self.writer {
            Some(Writer::Thread { newest, .. }) => {
                let number = newest.borrow().0 + 1;
                newest.send((number, record)).is_ok()
            }
            Some(Writer::Here(disk)) => disk.write(&record).is_ok(),
            None => true,
        }
    }

    /// Waits, for a limited time, until the disk has what was saved last. The error says why the
    /// next program may not know it.
    pub(super) fn kept(&self) -> impl Future<Output = Result<(), String>> + Send + use<> {
        let waiting = match &self.writer {
            Some(Writer::Thread { newest, tried }) => Some((newest.borrow().0, tried.clone())),
            Some(Writer::Here(_)) | None => None,
        };
        async move {
            let Some((number, mut tried)) = waiting else {
                return Ok(());
            };
            let answer = timeout(KEEP_LIMIT, tried.wait_for(|tried| tried.0 >= number)).await;
            match answer {
                Ok(Ok(tried)) => tried.1.clone(),
                _ => Err("the disk does not answer".to_owned()),
            }
        }
    }
}

/// Whether a record must be written: when something starts or ends, and every hour.
pub(super) fn is_news(old: Option<&Record>, record: &Record) -> bool {
    old.is_none_or(|old| {
        let passed = record.looked.zip(old.looked);
        let lately = passed.is_none_or(|(now, then)| (0..3600).contains(&(now - then)));
        old.under_way != record.under_way || old.hold != record.hold || !lately
    })
}

#[derive(Debug)]
struct Disk {
    data: PathBuf,
    failed: AtomicBool,
}

impl Disk {
    fn read(&self) -> Record {
        let path = self.data.join(NAME);
        let bytes = Folder::open(&self.data).and_then(|folder| Ok(folder.read(NAME, MAX_LEN)?));
        let parsed = match bytes {
            Ok(Some(bytes)) => serde_json::from_slice(&bytes).map_err(io::Error::from),
            Ok(None) => Ok(Record::default()),
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(Record::default()),
            Err(error) => Err(error),
        };
        parsed.unwrap_or_else(|why| {
            let path = path.display();
            tracing::warn!(
                "an interrupted run cannot resume, and the timetable is not paused: {path}: {why}"
            );
            Record::default()
        })
    }

    fn write(&self, record: &Record) -> Result<(), String> {
        let written = serde_json::to_vec(record)
            .map_err(io::Error::from)
            .and_then(|bytes| Folder::make(&self.data)?.replace_durably(NAME, &bytes));
        let path = self.data.join(NAME);
        let written = written.map_err(|error| format!("cannot write {}: {error}", path.display()));
        let failed = self.failed.swap(written.is_err(), Ordering::Relaxed);
        if let (Err(error), false) = (&written, failed) {
            tracing::warn!("after a power cut nothing will resume: {error}");
        }
        written
    }
}

/// Writes the newest record until there will be no more. A failed write is retried.
async fn write_all(
    disk: Disk,
    mut newest: watch::Receiver<(u64, Record)>,
    told: watch::Sender<(u64, Result<(), String>)>,
) {
    let mut retry = None;
    loop {
        tokio::select! {
            changed = newest.changed() => if changed.is_err() { return },
            () = until(retry) => {}
        }
        let (number, record) = newest.borrow_and_update().clone();
        let written = disk.write(&record);
        retry = if written.is_ok() {
            None
        } else {
            Some(Instant::now() + AGAIN)
        };
        let _ = told.send_replace((number, written));
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
            ..Record::default()
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
            ..Record::default()
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
