//! The journal in a laboratory. Its time stands still while the disk works, so the journal needs no
//! thread: events are written at the moment of virtual time at which they are due.

use std::path::Path;

use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;

use super::options::{About, Options};
use super::recorder::Recorder;
use crate::clock::Clock;
use crate::robot::Bus;

/// A journal that is written on the laboratory's own thread. Dropping it simulates a power cut:
/// rows that are not written yet are lost, and the session has no end.
#[derive(Debug)]
pub struct LabJournal {
    stop: CancellationToken,
    task: JoinHandle<()>,
}

impl LabJournal {
    /// Records the bus's events from now on in this data folder. Must be called within a
    /// laboratory. Problems with the file are logged, and the write is retried.
    pub fn start(bus: &Bus, data: &Path, options: Options, about: About) -> LabJournal {
        let stop = CancellationToken::new();
        let recorder = Recorder::new(data, options, about, Clock::default());
        let task = tokio::spawn(recorder.run(bus.subscribe(), stop.clone()));
        LabJournal { stop, task }
    }

    /// Waits until all events on the bus are written and the file is closed.
    pub async fn finish(mut self) {
        self.stop.cancel();
        // A panic of the task was already reported.
        let _ = (&mut self.task).await;
    }
}

impl Drop for LabJournal {
    fn drop(&mut self) {
        self.task.abort();
    }
}
