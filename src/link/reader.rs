//! The half that hears the robot.

use std::time::Duration;

use tokio::io::{AsyncRead, AsyncReadExt};
use tokio::task::coop;

use super::LinkError;
use crate::wire::{Decoder, Report};

/// A good part of a frame in one read, and nothing beside the robot's 64 KiB messages.
const CHUNK_LEN: usize = 16 * 1024;

/// The read half of a [`super::Session`]. Holds one message and one chunk, never more.
pub struct Reader {
    io: Box<dyn AsyncRead + Send + Unpin>,
    decoder: Decoder,
    chunk: Box<[u8]>,
    unread: std::ops::Range<usize>,
    dead_after: Duration,
}

impl Reader {
    pub(super) fn new(io: Box<dyn AsyncRead + Send + Unpin>, dead_after: Duration) -> Reader {
        Reader {
            io,
            decoder: Decoder::new(),
            chunk: vec![0; CHUNK_LEN].into_boxed_slice(),
            unread: 0..0,
            dead_after,
        }
    }

    /// Waits for the next report. Cancel-safe: a dropped wait loses nothing.
    ///
    /// # Errors
    /// [`LinkError::Closed`] at the end of the stream, also within a message;
    /// [`LinkError::Framing`] when it is out of step, from then on always; [`LinkError::Dead`] when
    /// the system gave the connection up.
    pub async fn next(&mut self) -> Result<Report, LinkError> {
        // Thousands of small messages fit into one chunk: timers must get their turn between them.
        coop::consume_budget().await;
        loop {
            if let Some(report) = self.decode()? {
                return Ok(report);
            }
            let read = self.io.read(&mut self.chunk).await;
            let count = read.map_err(|error| LinkError::from_io(error, self.dead_after))?;
            if count == 0 {
                return Err(LinkError::Closed);
            }
            self.unread = 0..count;
        }
    }

    fn decode(&mut self) -> Result<Option<Report>, LinkError> {
        let mut input = &self.chunk[self.unread.clone()];
        let packet = self.decoder.decode(&mut input);
        self.unread.start = self.unread.end - input.len();
        Ok(packet?.map(Report::parse))
    }
}

impl std::fmt::Debug for Reader {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Reader").finish_non_exhaustive()
    }
}
