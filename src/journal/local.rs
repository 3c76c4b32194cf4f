//! The journal in a simulation. Its time stands still while the disk works, so the journal needs no
//! thread: events are written at the moment of virtual time at which they are due.

use std::path::Path;

use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;

use super::options::{Options, RunInfo};
use super::recorder::Recorder;
use crate::clock::Clock;
use crate::robot::Bus;

/// A journal that is written on the simulation's own thread. Dropping it simulates a power cut:
/// rows that are not written yet are lost, and the session has no end.
#[derive(Debug)]
pub struct SimulationJournal {
    stop: CancellationToken,
    task: JoinHandle<()>,
}

impl SimulationJournal {
    /// Records the bus's events from now on in this data folder. Must be called within a
    /// simulation. Problems with the file are logged, and the write is retried.
    pub fn start(bus: &Bus, data: &Path, options: Options, about: RunInfo) -> SimulationJournal {
        let stop = CancellationToken::new();
        let recorder = Recorder::new(data, options, about, Clock::default());
        let task = tokio::spawn(recorder.run(bus.subscribe(), stop.clone()));
        SimulationJournal { stop, task }
    }

    /// Waits until all events on the bus are written and the file is closed.
    pub async fn finish(mut self) {
        self.stop.cancel();
        // A panic of the task was already reported.
        let _ = (&mut self.task).await;
    }
}

impl Drop for SimulationJournal {
    fn drop(&mut self) {
        self.task.abort();
    }
}
