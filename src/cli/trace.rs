//! `run --trace FILE.png`: draws a run when it has ended.

use std::path::{Path, PathBuf};

use super::Failure;
use super::world::save;
use crate::sim::Handle;

/// A picture file for the path of a robot.
#[derive(Debug)]
pub(super) struct TraceFile(PathBuf);

impl TraceFile {
    /// Creates the file, so that an invalid name is reported before the robot moves.
    ///
    /// # Errors
    /// The file cannot be created.
    pub(super) fn create(path: &Path) -> Result<TraceFile, Failure> {
        let made = std::fs::File::create(path);
        made.map_err(|error| Failure::unwritable(path, error))?;
        Ok(TraceFile(path.to_owned()))
    }

    /// Draws this robot's path and events so far.
    ///
    /// # Errors
    /// The file cannot be written.
    pub(super) fn write(&self, sim: &Handle) -> Result<(), Failure> {
        save(&sim.trace().draw(sim.world()), &self.0)?;
        tracing::info!("the robot's path is drawn in {}", self.0.display());
        Ok(())
    }
}
