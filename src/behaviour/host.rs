//! The host (child side): one VM with its scheduler and vision, and a pipe to the agent. It has no
//! robot socket, no secrets and few rights. It takes [`ToHost`] and sends [`FromHost`]; a message
//! that cannot be decoded ends it.

use std::ffi::OsString;
use std::io;
use std::marker::PhantomData;
use std::os::fd::AsFd;
use std::process::ExitCode;
use std::time::Duration;

use bytes::Bytes;
use futures_util::{SinkExt, StreamExt};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::sync::mpsc;
use tokio::time::{Instant, MissedTickBehavior, interval};
use tokio_util::codec::{FramedRead, FramedWrite, LengthDelimitedCodec};
use tracing::debug;

use super::gallery::Gallery;
use super::library::Library;
use super::store_writer::StoreWriter;
use crate::check;
use crate::clock::until;
use crate::robot::{Detection, EndReason, Event, Frame, ParamValue};
use crate::sandbox;
use crate::script::{
    AnnotatedFrame, FromHost, LabelledBlob, Level, LogLine, ModuleFile, ModuleName, NoModule,
    Options, Script, ScriptExit,
};

/// Longest interval between messages to the agent while a setpoint of the script is active; a
/// quarter of what the watchdog allows.
const HEARTBEAT_INTERVAL: Duration = Duration::from_millis(50);
/// The same interval otherwise; a tenth of what the supervisor allows.
const IDLE_BEAT: Duration = Duration::from_millis(500);
/// Stack size of a thread that runs a VM, in bytes. Luau's deepest legal recursion needs 2.1 MiB in
/// a debug build.
pub const STACK: usize = 8 << 20;

/// Runs a host process; the arguments describe its `SandboxPolicy`.
pub fn host_main(arguments: impl Iterator<Item = OsString>) -> ExitCode {
    sandbox::confined_main(arguments, "vm", STACK, over_stdin)
}

fn over_stdin() -> io::Result<()> {
    let stdin = io::stdin().as_fd().try_clone_to_owned()?;
    let stream = std::os::unix::net::UnixStream::from(stdin);
    stream.set_nonblocking(true)?;
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()?;
    runtime.block_on(async {
        let (reader, writer) = tokio::net::UnixStream::from_std(stream)?.into_split();
        host(reader, writer).await
    })
}

/// Serves one script over any byte streams. Returns when the script has ended or the agent has
/// closed the stream.
pub async fn host(
    reader: impl AsyncRead + Send + Unpin + 'static,
    writer: impl AsyncWrite + Send + Unpin + 'static,
) -> io::Result<()> {
    serve(reader, writer, Time::Real).await
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Time {
    Real,
    Virtual,
}

/// Same as [`host`]. In virtual time the speed of other threads must not affect the result.
pub(super) async fn serve(
    reader: impl AsyncRead + Send + Unpin + 'static,
    writer: impl AsyncWrite + Send + Unpin + 'static,
    time: Time,
) -> io::Result<()> {
    let mut inbox = Receiver::<ToHost>::new(reader);
    let mut outbox = Sender::<FromHost>::new(writer);
    let Some(ToHost::Load(launch)) = inbox.next().await? else {
        return Ok(());
    };
    let Launch {
        source, options, ..
    } = *launch;
    let detections = options.detections;
    let gallery = open_gallery(&options, time)?;
    let store = open_store(&options, time);
    match Script::load(&source, options, Instant::now()) {
        Ok(mut script) => {
            script.explain_with(check::explain);
            outbox.send(&FromHost::Ready).await?;
            if let Some(damage) = store.as_ref().and_then(|one| restore(&mut script, one)) {
                outbox.send(&warning(damage)).await?;
            }
            let mut host = Host {
                script,
                inbox,
                outbox,
                frame_asked: false,
                damaged: false,
                gallery,
                detections,
                store,
                time,
            };
            if host.prepare().await? {
                host.run().await
            } else {
                Ok(())
            }
        }
        Err(failure) => {
            let reason = EndReason::Error;
            let message = Some(failure.to_string());
            outbox
                .send(&FromHost::Ended(ScriptExit { reason, message }))
                .await
        }
    }
}

fn open_gallery(options: &Options, time: Time) -> io::Result<Option<Gallery>> {
    let Some(folder) = options.annotate_dir.clone() else {
        return Ok(None);
    };
    let blocking = time == Time::Virtual;
    Gallery::open(folder, &options.limits, options.bytes_left, blocking).map(Some)
}

fn open_store(options: &Options, time: Time) -> Option<StoreWriter> {
    let folder = options.data_dir.clone()?;
    let write_at_end = time == Time::Virtual;
    Some(StoreWriter::new(folder, &options.limits, write_at_end))
}

struct Host {
    script: Script,
    inbox: Receiver<ToHost>,
    outbox: Sender<FromHost>,
    frame_asked: bool,
    damaged: bool,
    gallery: Option<Gallery>,
    detections: bool,
    store: Option<StoreWriter>,
    /// In virtual time no idle sign of life is sent.
    time: Time,
}

/// Loads the script's store from its file. Returns a warning if the file is damaged.
fn restore(script: &mut Script, store: &StoreWriter) -> Option<String> {
    let restored = match store.read() {
        Ok(Some(file)) => script.restore(&file).map_err(io::Error::from),
        Ok(None) => Ok(()),
        Err(error) => Err(error),
    };
    restored
        .err()
        .map(|error| store.set_aside(&error.to_string()))
}

fn warning(text: String) -> FromHost {
    FromHost::Log(LogLine::new(Level::Warn, &text))
}

impl Host {
    /// Handles messages until the agent sends `Run`; false if the agent has closed the stream.
    async fn prepare(&mut self) -> io::Result<bool> {
        while let Some(message) = self.inbox.next().await? {
            if let ToHost::Run = message {
                return Ok(true);
            }
            self.handle(message);
        }
        Ok(false)
    }

    async fn run(mut self) -> io::Result<()> {
        let mut heartbeat = interval(HEARTBEAT_INTERVAL);
        heartbeat.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut idle = interval(IDLE_BEAT);
        idle.set_missed_tick_behavior(MissedTickBehavior::Delay);
        self.script.run_ready(Instant::now());
        let exit = loop {
            self.send_output().await?;
            self.report_sighting().await?;
            self.save_store().await?;
            if let Some(exit) = self.script.ended() {
                break exit;
            }
            let ready = self.script.is_ready();
            let moving = self.script.has_motion();
            let writes_at = self.writes_at();
            if !ready {
                self.script.collect_garbage_step();
            }
            tokio::select! {
                biased;
                message = self.inbox.next() => match message? {
                    Some(message) => self.handle(message),
                    None => return Ok(()),
                },
                () = std::future::ready(()), if ready => {}
                () = until(self.script.next_deadline()) => {}
                () = until(writes_at) => {}
                _ = heartbeat.tick(), if moving => self.outbox.send(&FromHost::Alive).await?,
                _ = idle.tick(), if !moving && self.time == Time::Real => {
                    self.outbox.send(&FromHost::Alive).await?;
                }
            }
            self.script.run_ready(Instant::now());
        };
        // The motion has already ended, so the disk delays nothing important.
        let last = self.script.take_store();
        if let Some(trouble) = self.store.as_mut().and_then(|one| one.finish(last)) {
            self.outbox.send(&unwritten(&trouble)).await?;
        }
        self.outbox.send(&FromHost::Ended(exit)).await
    }

    /// When the store can be written next; `None` if it has not changed.
    fn writes_at(&self) -> Option<Instant> {
        let store = self.store.as_ref()?;
        if self.script.has_store_changed() || store.is_behind() {
            return Some(store.next().unwrap_or_else(Instant::now));
        }
        None
    }

    async fn save_store(&mut self) -> io::Result<()> {
        let Some(store) = &mut self.store else {
            return Ok(());
        };
        let now = Instant::now();
        if store.is_due(now) {
            store.offer(self.script.take_store(), now);
        }
        match store.take_error() {
            Some(trouble) => self.outbox.send(&unwritten(&trouble)).await,
            None => Ok(()),
        }
    }

    fn handle(&mut self, message: ToHost) {
        let now = Instant::now();
        match message {
            ToHost::Event(event) => self.script.deliver(event, now),
            ToHost::Frame(frame) => {
                self.frame_asked = false;
                self.damaged = !self.script.deliver_frame(frame, now);
            }
            ToHost::Prompt(PromptCommand::Evaluate { text, more }) => {
                self.script.evaluate(&text, more, now);
            }
            ToHost::Prompt(PromptCommand::Interrupt) => self.script.interrupt(now),
            ToHost::SetParam { name, value } => self.script.set_live_param(&name, value, now),
            ToHost::Module(name, file) => self.script.deliver_module(&name, file, now),
            ToHost::Stop(reason) => self.script.stop(reason, now),
            ToHost::Load(_) | ToHost::Run => {}
        }
    }

    /// Runs after the output, which must not wait for pictures.
    async fn report_sighting(&mut self) -> io::Result<()> {
        let annotated = self.script.take_annotated_frame();
        if let Some(annotated) = &annotated
            && self.detections
        {
            self.outbox.send(&found(annotated)).await?;
        }
        let Some(gallery) = &mut self.gallery else {
            return Ok(());
        };
        if let Some(annotated) = annotated {
            gallery.offer(annotated);
        }
        let Some(trouble) = gallery.take_error() else {
            return Ok(());
        };
        let text = format!("a marked frame was not saved: {trouble}");
        self.outbox.send(&warning(text)).await
    }

    async fn send_output(&mut self) -> io::Result<()> {
        for output in self.script.take_output() {
            self.outbox.feed(&output).await?;
        }
        if self.script.wants_frames() && !self.frame_asked {
            self.frame_asked = true;
            let damaged = self.damaged;
            let want = FromHost::WantFrame { damaged };
            self.outbox.feed(&want).await?;
        }
        self.outbox.flush().await
    }
}

fn found(annotated: &AnnotatedFrame) -> FromHost {
    let detection = |seen: &LabelledBlob| Detection {
        x: seen.blob.x,
        y: seen.blob.y,
        w: seen.blob.w,
        h: seen.blob.h,
        text: seen.text.clone(),
    };
    let frame = annotated.frame.seq;
    let list = annotated.marks.iter().map(detection).collect();
    FromHost::Found { frame, list }
}

fn unwritten(trouble: &str) -> FromHost {
    warning(format!("problem writing the store: {trouble}"))
}

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

/// Maximum length of a message in either direction: a script of 256 KiB or a frame of 64 KiB fits easily.
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
