//! The read half: receives from the robot.

use std::time::Duration;

use tokio::io::{AsyncRead, AsyncReadExt};
use tokio::task::coop;

use super::LinkError;
use crate::wire::{Decoder, Report};

/// A large part of a frame in one read, but small next to the robot's 64 KiB messages.
const CHUNK_LEN: usize = 16 * 1024;

/// Progress of an incomplete message is reported after this many more bytes.
const GROWTH: usize = 1024;

/// The read half of a [`super::Session`]. Holds one message and one chunk, never more.
pub struct Reader {
    io: Box<dyn AsyncRead + Send + Unpin>,
    decoder: Decoder,
    chunk: Box<[u8]>,
    unread: std::ops::Range<usize>,
    /// Bytes of the incomplete message when its progress was last reported.
    reported: usize,
    dead_after: Duration,
}

impl Reader {
    pub(super) fn new(io: Box<dyn AsyncRead + Send + Unpin>, dead_after: Duration) -> Reader {
        Reader {
            io,
            decoder: Decoder::new(),
            chunk: vec![0; CHUNK_LEN].into_boxed_slice(),
            unread: 0..0,
            reported: 0,
            dead_after,
        }
    }

    /// Waits for the next report. Cancel-safe: a dropped wait loses nothing.
    pub async fn next(&mut self) -> Result<Report, LinkError> {
        loop {
            if let Some(report) = self.receive().await? {
                return Ok(report);
            }
        }
    }

    /// Waits for the next report; `None`: at least `GROWTH` further bytes of a message whose rest is
    /// still arriving. Cancel-safe.
    ///
    /// # Errors
    /// [`LinkError::Closed`] at the end of the stream, also within a message;
    /// [`LinkError::Framing`] once the framing is invalid, and on every later call;
    /// [`LinkError::Dead`] when the system has given up the connection.
    pub async fn receive(&mut self) -> Result<Option<Report>, LinkError> {
        // Thousands of small messages fit into one chunk: timers must run between them.
        coop::consume_budget().await;
        loop {
            if let Some(report) = self.decode()? {
                self.reported = 0;
                return Ok(Some(report));
            }
            let buffered = self.decoder.buffered();
            if buffered >= self.reported + GROWTH {
                self.reported = buffered;
                return Ok(None);
            }
            let read = self.io.read(&mut self.chunk).await;
            let count = read.map_err(|error| LinkError::from_io(error, self.dead_after))?;
            if count == 0 {
                return Err(LinkError::Closed);
            }
            self.unread = 0..count;
        }
    }

    /// Reads and discards all data, garbage too, until the robot closes its half. Cancel-safe.
    pub(super) async fn discard(&mut self) -> Result<(), LinkError> {
        loop {
            let read = self.io.read(&mut self.chunk).await;
            if read.map_err(|error| LinkError::from_io(error, self.dead_after))? == 0 {
                return Ok(());
            }
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

#[cfg(test)]
mod tests {
    use bytes::Bytes;
    use tokio::io::AsyncWriteExt;

    use super::*;

    /// A reader of a robot that writes these pieces, each after the previous one was read.
    fn reader(pieces: Vec<Vec<u8>>) -> Reader {
        let (near, mut far) = tokio::io::duplex(64 * 1024);
        tokio::spawn(async move {
            for piece in pieces {
                far.write_all(&piece).await.unwrap();
                tokio::task::yield_now().await;
            }
        });
        Reader::new(Box::new(near), Duration::from_secs(3))
    }

    fn pieces(report: &Report, len: usize) -> Vec<Vec<u8>> {
        let bytes = report.to_bytes();
        bytes.chunks(len).map(<[u8]>::to_vec).collect()
    }

    #[tokio::test]
    async fn progress_of_a_long_message_is_reported_as_it_grows() {
        let jpeg: Bytes = (0..5000).map(|index| index as u8).collect();
        let mut reader = reader(pieces(&Report::Video(jpeg.clone()), 700));
        let mut times = 0;
        let report = loop {
            match reader.receive().await.unwrap() {
                None => times += 1,
                Some(report) => break report,
            }
        };
        assert_eq!(report, Report::Video(jpeg));
        assert!((2..=5000 / GROWTH).contains(&times), "{times} times");
    }

    #[tokio::test]
    async fn next_returns_only_whole_reports() {
        let jpeg = Bytes::from(vec![7; 9000]);
        let mut reader = reader(pieces(&Report::Video(jpeg.clone()), 1500));
        assert_eq!(reader.next().await.unwrap(), Report::Video(jpeg));
    }
}
