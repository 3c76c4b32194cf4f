//! What the timetable has under way, kept in a file: after a power cut the next service goes on with
//! it. Written off the caller's thread; a disk that is slow or full keeps nobody waiting.

use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

use crate::files::Folder;
use crate::timetable::Record;

/// Its name, in the data folder.
const NAME: &str = "schedule.json";
/// The longest that is read.
const MAX_LEN: u64 = 1 << 16;
/// Records that may wait for the disk; the newest is written.
const WAITING: usize = 4;

/// See the module.
#[derive(Debug, Clone)]
pub struct RecordFile {
    records: SyncSender<Record>,
}

impl RecordFile {
    /// Reads what there is in this data folder, and keeps what comes there. What cannot be read is said
    /// in the log, and nothing is known then.
    pub fn open(data: &Path) -> (Record, Option<RecordFile>) {
        let folder = match Folder::make(data) {
            Ok(folder) => folder,
            Err(error) => {
                let data = data.display();
                tracing::warn!("a power cut will be forgotten: cannot write to {data}: {error}");
                return (Record::default(), None);
            }
        };
        let record = read(&folder, data);
        let (records, received) = sync_channel(WAITING);
        let writing = std::thread::Builder::new().name("record".into());
        let path = data.to_owned();
        let started = writing.spawn(move || write(&folder, &path, &received));
        (record, started.is_ok().then_some(RecordFile { records }))
    }

    /// Keeps this from now on. Never waits: when the disk takes nothing, this one is left out.
    pub(super) fn keep(&self, record: Record) {
        let _ = self.records.try_send(record);
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

fn read(folder: &Folder, data: &Path) -> Record {
    let read = folder
        .read(NAME, MAX_LEN)
        .map_err(|error| error.to_string());
    let parsed = read.and_then(|bytes| {
        let parse = |bytes: Vec<u8>| serde_json::from_slice(&bytes);
        bytes
            .map(parse)
            .transpose()
            .map_err(|error| error.to_string())
    });
    parsed.map(Option::unwrap_or_default).unwrap_or_else(|why| {
        let path = data.join(NAME);
        tracing::warn!("what was under way is forgotten: {}: {why}", path.display());
        Record::default()
    })
}

fn write(folder: &Folder, data: &Path, records: &Receiver<Record>) {
    let mut failed = false;
    while let Ok(mut record) = records.recv() {
        while let Ok(newer) = records.try_recv() {
            record = newer;
        }
        let Ok(bytes) = serde_json::to_vec(&record) else {
            continue;
        };
        let written = folder.replace_durably(NAME, &bytes);
        if let (Err(error), false) = (&written, failed) {
            let path: PathBuf = data.join(NAME);
            tracing::warn!("a power cut will be forgotten: {}: {error}", path.display());
        }
        failed = written.is_err();
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
        file.unwrap().keep(record.clone());
        let path = home.path().join(NAME);
        while !path.exists() {
            std::thread::yield_now();
        }
        assert_eq!(RecordFile::open(home.path()).0, record);
        std::fs::write(&path, "{").unwrap();
        assert_eq!(RecordFile::open(home.path()).0, Record::default());
    }
}
