//! The messages on the socket: a 4-byte length, then the version and the message in postcard's
//! encoding.

use std::io;

use bytes::Bytes;
use futures_util::{SinkExt, StreamExt};
use serde::Serialize;
use serde::de::DeserializeOwned;
use tokio::net::UnixStream;
use tokio_util::codec::{Framed, LengthDelimitedCodec};

use super::request::MAX_SPEECH;

/// Protocol version, incremented with every change of the messages; the two ends may be different
/// builds.
const VERSION: u16 = 3;
/// Maximum length of a message: speech, and some bytes.
const MAX_MESSAGE_LEN: usize = MAX_SPEECH + 1024;

pub(super) struct Pipe(Framed<UnixStream, LengthDelimitedCodec>);

impl Pipe {
    pub(super) fn new(stream: UnixStream) -> Pipe {
        let codec = LengthDelimitedCodec::builder()
            .max_frame_length(MAX_MESSAGE_LEN)
            .new_codec();
        Pipe(Framed::new(stream, codec))
    }

    /// The user ID of the other end, if the system knows it.
    pub(super) fn user(&self) -> Option<u32> {
        self.0.get_ref().peer_cred().ok().map(|peer| peer.uid())
    }

    /// Sends a message.
    ///
    /// # Errors
    /// If the message is too long, or the other end has disconnected.
    pub(super) async fn send<M: Serialize>(&mut self, message: &M) -> io::Result<()> {
        let bytes = postcard::to_allocvec(&(VERSION, message)).map_err(io::Error::other)?;
        self.0.send(Bytes::from(bytes)).await
    }

    /// Waits for a message; `None` if the other end has disconnected. Cancel-safe.
    ///
    /// # Errors
    /// If the message is too long, invalid, or of another version.
    pub(super) async fn receive<M: DeserializeOwned>(&mut self) -> io::Result<Option<M>> {
        let Some(bytes) = self.0.next().await.transpose()? else {
            return Ok(None);
        };
        let (version, rest) = postcard::take_from_bytes::<u16>(&bytes).map_err(io::Error::other)?;
        if version != VERSION {
            return Err(io::Error::new(
                io::ErrorKind::Unsupported,
                "the other program is a different version",
            ));
        }
        postcard::from_bytes(rest)
            .map(Some)
            .map_err(io::Error::other)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::request::{RunRequest, RunResponse};

    #[tokio::test]
    async fn messages_arrive_and_garbage_is_an_error() {
        let (near, far) = UnixStream::pair().unwrap();
        let mut near = Pipe::new(near);
        let mut far = Pipe::new(far);
        near.send(&RunRequest::Overview).await.unwrap();
        assert_eq!(far.receive().await.unwrap(), Some(RunRequest::Overview));
        for garbage in [&[0xff; 40][..], &[], &[2], &[1, 0]] {
            near.0.send(Bytes::copy_from_slice(garbage)).await.unwrap();
            assert!(far.receive::<RunResponse>().await.is_err(), "{garbage:?}");
        }
        drop(near);
        assert_eq!(far.receive::<RunResponse>().await.unwrap(), None);
    }

    #[tokio::test]
    async fn a_message_that_is_too_long_is_refused_before_it_is_read() {
        use tokio::io::AsyncWriteExt;
        let (mut near, far) = UnixStream::pair().unwrap();
        near.write_all(&u32::MAX.to_be_bytes()).await.unwrap();
        assert!(Pipe::new(far).receive::<RunRequest>().await.is_err());
    }
}
