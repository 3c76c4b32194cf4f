//! The file that records the runs that the timetable has under way, so that the next service can
//! resume them after a power cut. A separate thread writes it; a slow or full disk blocks nothing.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::time::Duration;

use crate::files::Folder;
use crate::timetable::Record;

/// Name of the file, in the data folder.
const NAME: &str = "schedule.json";
/// Maximum length of a file that is read.
const MAX_LEN: u64 = 1 << 16;
/// Capacity of the queue to the writing thread, which writes the newest record.
const WAITING: usize = 4;
/// Time until a failed write is retried.
const AGAIN: Duration = Duration::from_secs(10);

/// The record of the previous service, and the file for new ones.
#[derive(Debug, Default)]
pub struct OpenedRecord {
    /// What was under way when the previous service ended.
    pub record: Record,
    /// Without a file nothing is recorded.
    pub file: Option<RecordFile>,
}

#[derive(Debug)]
pub struct RecordFile(Writer);

#[derive(Debug)]
enum Writer {
    Thread(SyncSender<Record>),
    Here(Disk),
}

impl RecordFile {
    /// Reads the record in this data folder, and opens the file for new ones. If the file cannot be
    /// read, this is logged and the record is empty.
    pub fn open(data: &Path) -> OpenedRecord {
        let Some((record, disk)) = Disk::open(data) else {
            return OpenedRecord::default();
        };
        let (records, received) = sync_channel(WAITING);
        let writing = std::thread::Builder::new().name("record".into());
        let started = writing.spawn(move || write_all(&disk, &received));
        let file = started.map(|_| RecordFile(Writer::Thread(records)));
        OpenedRecord {
            record,
            file: file.ok(),
        }
    }

    /// Same as [`RecordFile::open`] for a simulation, whose time stands still while the disk works:
    /// records are written at once, on the caller's thread.
    pub fn open_in_simulation(data: &Path) -> OpenedRecord {
        match Disk::open(data) {
            Some((record, disk)) => OpenedRecord {
                record,
                file: Some(RecordFile(Writer::Here(disk))),
            },
            None => OpenedRecord::default(),
        }
    }

    /// Queues a record to be written; returns whether it was accepted. Does not wait for the disk:
    /// if the queue is full, the record is dropped, and the caller has to pass it again.
    pub(super) fn save(&self, record: Record) -> bool {
        match &self.0 {
            Writer::Thread(records) => records.try_send(record).is_ok(),
            Writer::Here(disk) => disk.write(&record),
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
        let path = data.join(NAME);
        let failed = AtomicBool::new(false);
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

/// Writes records until the queue is closed. A failed write is retried, unless a newer record has
/// arrived.
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
        unwritten = if disk.write(&record) {
            None
        } else {
            Some(record)
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
        assert!(opened.file.unwrap().save(record.clone()));
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
        let file = RecordFile::open_in_simulation(home.path()).file;
        let record = Record {
            looked: Some(8),
            under_way: Vec::new(),
        };
        assert!(file.unwrap().save(record.clone()));
        assert_eq!(RecordFile::open_in_simulation(home.path()).record, record);
    }

    #[test]
    fn a_failed_write_can_be_repeated() {
        let home = tempfile::tempdir().unwrap();
        let file = RecordFile::open_in_simulation(home.path()).file;
        // A folder in the file's place takes no record.
        std::fs::create_dir(home.path().join(NAME)).unwrap();
        let file = file.unwrap();
        assert!(!file.save(Record::default()));
        std::fs::remove_dir(home.path().join(NAME)).unwrap();
        assert!(file.save(Record::default()));
    }
}
