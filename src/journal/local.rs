//! A journal in a laboratory. Its time stands still while the disk works, so that journal needs no thread:
//! what happened at a moment of virtual time is written at that moment.

use std::path::Path;

use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;

use super::options::{About, Options};
use super::recorder::Recorder;
use crate::clock::Clock;
use crate::robot::Bus;

/// A journal that is being written on the laboratory's own thread. Dropping it is a power cut: what
/// waits to be written then is lost, and the session has no end.
#[derive(Debug)]
pub struct LabJournal {
    stop: CancellationToken,
    task: JoinHandle<()>,
}

impl LabJournal {
    /// Remembers in this data folder all that is said on the bus from now on. To be called within a
    /// laboratory. Whatever is wrong with the file is said in the log, and tried again.
    pub fn start(bus: &Bus, data: &Path, options: Options, about: About) -> LabJournal {
        let stop = CancellationToken::new();
        let recorder = Recorder::new(data, options, about, Clock::default());
        let task = tokio::spawn(recorder.live(bus.listen(), stop.clone()));
        LabJournal { stop, task }
    }

    /// Waits until all that was said on the bus is written and the file is closed.
    pub async fn finish(mut self) {
        self.stop.cancel();
        // One that has panicked has said so.
        let _ = (&mut self.task).await;
    }
}

impl Drop for LabJournal {
    fn drop(&mut self) {
        self.task.abort();
    }
}
