//! The messages between agent and host: [`ToHost`], and `FromHost` of the script. A message has at
//! most [`MAX_MESSAGE_LEN`] bytes in either direction, and a message that cannot be decoded ends the
//! host.

use std::io;
use std::marker::PhantomData;

use bytes::Bytes;
use futures_util::{SinkExt, StreamExt};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::sync::mpsc;
use tokio_util::codec::{FramedRead, FramedWrite, LengthDelimitedCodec};
use tracing::debug;

use super::library::Library;
use crate::robot::{EndReason, Event, Frame, ParamValue};
use crate::script::{ModuleFile, ModuleName, NoModule, Options};

/// A script and everything it needs to run, without secrets.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Launch {
    /// The script's text, exactly as in its file.
    pub source: Vec<u8>,
    pub options: Options,
    /// Where `require` finds files. Not sent to the host.
    #[serde(skip)]
    pub library: Library,
}

#[derive(Debug, Clone, Serialize, Deserialize)]
pub enum ToHost {
    /// Load this script; answered by `FromHost::Ready` or `FromHost::Ended`.
    Load(Box<Launch>),
    Run,
    Event(Event),
    /// A frame, in answer to `FromHost::WantFrame`.
    Frame(Frame),
    Prompt(PromptCommand),
    /// A user changes the value of a parameter.
    SetParam {
        name: String,
        value: ParamValue,
    },
    /// In answer to `FromHost::Module`: the module's file, or why it cannot be loaded.
    Module(ModuleName, Result<ModuleFile, NoModule>),
    /// End within half a second.
    Stop(EndReason),
}

/// What a user at a prompt wants.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub enum PromptCommand {
    /// Run this text; answered by `FromHost::Evaluated`.
    Evaluate {
        text: String,
        /// Whether further lines may follow.
        more: bool,
    },
    /// Stop the tracks, tasks and handlers that typed lines have started.
    Interrupt,
}

/// Maximum length of a message: a script of 256 KiB or a frame of 64 KiB fits easily.
pub(super) const MAX_MESSAGE_LEN: usize = 512 * 1024;

/// Size of a receiver's buffer, bytes: a frame fits, so that it is received in one read.
const BUFFER_LEN: usize = 64 * 1024;

fn codec() -> LengthDelimitedCodec {
    LengthDelimitedCodec::builder()
        .max_frame_length(MAX_MESSAGE_LEN)
        .new_codec()
}

pub(super) struct Sender<M> {
    sink: FramedWrite<Box<dyn AsyncWrite + Send + Unpin>, LengthDelimitedCodec>,
    message: PhantomData<fn(M)>,
}

impl<M: Serialize> Sender<M> {
    pub(super) fn new(io: impl AsyncWrite + Send + Unpin + 'static) -> Sender<M> {
        let io: Box<dyn AsyncWrite + Send + Unpin> = Box::new(io);
        Sender {
            sink: FramedWrite::new(io, codec()),
            message: PhantomData,
        }
    }

    /// Puts a message into the buffer; [`Sender::flush`] sends the buffer's content.
    pub(super) async fn feed(&mut self, message: &M) -> io::Result<()> {
        let bytes = postcard::to_allocvec(message).map_err(io::Error::other)?;
        self.sink.feed(Bytes::from(bytes)).await
    }

    pub(super) async fn flush(&mut self) -> io::Result<()> {
        SinkExt::<Bytes>::flush(&mut self.sink).await
    }

    pub(super) async fn send(&mut self, message: &M) -> io::Result<()> {
        self.feed(message).await?;
        self.flush().await
    }

    /// Sends the messages of a queue at the reader's pace, so that a host that does not read blocks
    /// no other task. Returns when the queue is closed or the pipe breaks.
    pub(super) async fn pump(mut self, mut queue: mpsc::Receiver<M>) {
        while let Some(message) = queue.recv().await {
            if let Err(error) = self.send(&message).await {
                debug!("cannot send to a host: {error}");
                return;
            }
        }
    }
}

pub(super) struct Receiver<M> {
    stream: FramedRead<Box<dyn AsyncRead + Send + Unpin>, LengthDelimitedCodec>,
    message: PhantomData<fn() -> M>,
}

impl<M> std::fmt::Debug for Receiver<M> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Receiver").finish_non_exhaustive()
    }
}

impl<M: DeserializeOwned> Receiver<M> {
    pub(super) fn new(io: impl AsyncRead + Send + Unpin + 'static) -> Receiver<M> {
        let io: Box<dyn AsyncRead + Send + Unpin> = Box::new(io);
        Receiver {
            stream: FramedRead::with_capacity(io, codec(), BUFFER_LEN),
            message: PhantomData,
        }
    }

    /// Returns the next message; `None` at the end of the stream. Cancel-safe.
    pub(super) async fn next(&mut self) -> io::Result<Option<M>> {
        let Some(bytes) = self.stream.next().await.transpose()? else {
            return Ok(None);
        };
        postcard::from_bytes(&bytes)
            .map(Some)
            .map_err(io::Error::other)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use tokio::io::AsyncWriteExt;
    use tokio::time::Instant;

    use super::*;
    use crate::behaviour::ToHost;
    use crate::robot::Frame;
    use crate::script::FromHost;

    #[tokio::test]
    async fn a_long_message_arrives_complete() {
        let (left, right) = tokio::io::duplex(100);
        let mut sender = Sender::new(left);
        let mut receiver = Receiver::<ToHost>::new(right);
        let jpeg = Bytes::from(vec![7; 60_000]);
        let at = Instant::now();
        let frame = ToHost::Frame(Frame { seq: 3, at, jpeg });
        let (sent, received) = tokio::join!(sender.send(&frame), receiver.next());
        sent.unwrap();
        let Some(ToHost::Frame(Frame { seq, jpeg, .. })) = received.unwrap() else {
            panic!("no frame")
        };
        assert_eq!((seq, jpeg.len()), (3, 60_000));
    }

    #[tokio::test]
    async fn a_length_beyond_the_limit_ends_the_stream_without_allocating_it() {
        let (mut left, right) = tokio::io::duplex(100);
        left.write_all(&[0xFF, 0xFF, 0xFF, 0xFF, 1]).await.unwrap();
        assert!(Receiver::<FromHost>::new(right).next().await.is_err());
    }

    proptest! {
        #[test]
        fn random_bytes_from_a_host_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..80)) {
            let _ = postcard::from_bytes::<FromHost>(&bytes);
            let _ = postcard::from_bytes::<ToHost>(&bytes);
        }
    }
}
