//! `run --trace FILE.png`: the picture of a run, written when it is over.

use std::path::{Path, PathBuf};

use super::Failure;
use super::world::save;
use crate::sim::Handle;

/// A file for the way that a robot went.
#[derive(Debug)]
pub(super) struct TraceFile(PathBuf);

impl TraceFile {
    /// Makes the file, so that a wrong name is told before the robot moves.
    ///
    /// # Errors
    /// If the system does not let us.
    pub(super) fn create(path: &Path) -> Result<TraceFile, Failure> {
        let made = std::fs::File::create(path);
        made.map_err(|error| {
            Failure::usage(format_args!("cannot write {}: {error}", path.display()))
        })?;
        Ok(TraceFile(path.to_owned()))
    }

    /// Draws what this robot did so far.
    ///
    /// # Errors
    /// If the system does not let us.
    pub(super) fn write(&self, sim: &Handle) -> Result<(), Failure> {
        save(&sim.trace().draw(sim.world()), &self.0)?;
        tracing::info!("the robot's path is drawn in {}", self.0.display());
        Ok(())
    }
}
