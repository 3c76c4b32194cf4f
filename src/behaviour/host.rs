//! The child side: one VM, its scheduler and its eyes, and a pipe to the agent. No robot socket, no
//! secrets, few rights.

use std::ffi::OsString;
use std::io;
use std::os::fd::AsFd;
use std::process::ExitCode;
use std::time::Duration;

use tokio::io::{AsyncRead, AsyncWrite};
use tokio::time::{Instant, MissedTickBehavior, interval, sleep_until};

use super::gallery::Gallery;
use super::keeper::Keeper;
use super::message::{FromHost, Launch, ToHost};
use super::pipe::{Receiver, Sender};
use crate::check;
use crate::robot::{EndReason, Finding, Frame};
use crate::script::{Ending, Level, LogLine, Output, Script, Seen, Sighting};
use crate::walls::{Room, confine};

/// While a setpoint of the script is on, the agent hears from the host at least this often; a
/// quarter of what the watchdog allows.
const BEAT: Duration = Duration::from_millis(50);
/// Otherwise at least this often; a quarter of the least that a config may allow.
const IDLE_BEAT: Duration = Duration::from_millis(500);
/// Stack of a thread that runs a VM, bytes: Luau's deepest legal recursion needs 2.1 MiB of it in a
/// debug build.
pub const STACK: usize = 8 << 20;

/// The life of a host process, from its confinement to its exit code. The arguments are its room.
pub fn host_main(arguments: impl Iterator<Item = OsString>) -> ExitCode {
    let life = std::thread::Builder::new()
        .name("vm".into())
        .stack_size(STACK);
    let room = Room::of_arguments(arguments).ok_or_else(|| io::ErrorKind::InvalidInput.into());
    let ended = room
        .and_then(|(parent, room)| confine(parent, &room))
        .and_then(|_| life.spawn(over_stdin))
        .and_then(|vm| {
            vm.join()
                .unwrap_or_else(|_| Err(io::Error::other("the host panicked")))
        });
    match ended {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("behaviour host: {error}");
            ExitCode::FAILURE
        }
    }
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

/// Serves one script over any byte streams. Returns when the script has ended, or when the agent is
/// gone.
///
/// # Errors
/// If the stream breaks or carries what is no message.
pub async fn host(
    reader: impl AsyncRead + Send + Unpin + 'static,
    writer: impl AsyncWrite + Send + Unpin + 'static,
) -> io::Result<()> {
    serve(reader, writer, Time::Real).await
}

/// Whether time waits for a disk.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Time {
    Real,
    Virtual,
}

/// As [`host`]. In virtual time no thread's pace may change what happens.
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
    let findings = options.findings;
    let gallery = options
        .annotate_dir
        .clone()
        .map(|folder| match time {
            Time::Real => Gallery::open(folder, &options.limits),
            Time::Virtual => Gallery::open(folder, &options.limits).map(Gallery::patient),
        })
        .transpose()?;
    let keeper = options.data_dir.clone().map(|folder| match time {
        Time::Real => Keeper::new(folder, &options.limits),
        Time::Virtual => Keeper::at_the_end(folder, &options.limits),
    });
    match Script::load(&source, options, Instant::now()) {
        Ok(mut script) => {
            script.explain_with(check::explain);
            outbox.send(&FromHost::Ready).await?;
            if let Some(damage) = keeper.as_ref().and_then(|one| restore(&mut script, one)) {
                outbox.send(&warning(damage)).await?;
            }
            let mut host = Host {
                script,
                inbox,
                outbox,
                frame_asked: false,
                coming: Vec::new(),
                gallery,
                findings,
                keeper,
                time,
            };
            if host.prepare().await? {
                host.run().await
            } else {
                Ok(())
            }
        }
        Err(failure) => {
            let (reason, message) = (EndReason::Error, Some(failure.to_string()));
            outbox
                .send(&FromHost::Ended(Ending { reason, message }))
                .await
        }
    }
}

struct Host {
    script: Script,
    inbox: Receiver<ToHost>,
    outbox: Sender<FromHost>,
    /// A frame was asked for and has not come yet.
    frame_asked: bool,
    /// What has come of the next frame.
    coming: Vec<u8>,
    /// Where a person can see what the script sees.
    gallery: Option<Gallery>,
    /// People look on.
    findings: bool,
    /// Where the script's store is kept.
    keeper: Option<Keeper>,
    /// In virtual time nobody waits for a sign of life.
    time: Time,
}

/// Gives the script what its store held; a warning if that is damaged.
fn restore(script: &mut Script, keeper: &Keeper) -> Option<String> {
    let restored = match keeper.read() {
        Ok(Some(file)) => script.restore(&file),
        Ok(None) => Ok(()),
        Err(error) => Err(error.to_string()),
    };
    restored.err().map(|why| keeper.set_aside(&why))
}

/// A line of ours in the script's log.
fn warning(text: String) -> FromHost {
    FromHost::Log(LogLine {
        level: Level::Warn,
        text,
        fields: Vec::new(),
        line: None,
    })
}

impl Host {
    /// Hears how things stand until it may go; false if there is nobody to go for.
    async fn prepare(&mut self) -> io::Result<bool> {
        while let Some(message) = self.inbox.next().await? {
            if let ToHost::Go = message {
                return Ok(true);
            }
            self.take(message);
        }
        Ok(false)
    }

    async fn run(mut self) -> io::Result<()> {
        let mut beat = interval(BEAT);
        beat.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut idle = interval(IDLE_BEAT);
        idle.set_missed_tick_behavior(MissedTickBehavior::Delay);
        self.script.run_ready(Instant::now());
        let ending = loop {
            self.send_output().await?;
            self.show().await?;
            self.keep().await?;
            if let Some(ending) = self.script.ended() {
                break ending;
            }
            let (ready, moving) = (self.script.is_ready(), self.script.has_motion());
            let keeps_at = self.keeps_at();
            tokio::select! {
                biased;
                message = self.inbox.next() => match message? {
                    Some(message) => self.take(message),
                    None => return Ok(()),
                },
                () = std::future::ready(()), if ready => {}
                () = until(self.script.next_deadline()) => {}
                () = until(keeps_at) => {}
                _ = beat.tick(), if moving => self.outbox.send(&FromHost::Alive).await?,
                _ = idle.tick(), if !moving && self.time == Time::Real => {
                    self.outbox.send(&FromHost::Alive).await?;
                }
            }
            self.script.run_ready(Instant::now());
        };
        // Its motion has ended already: nothing is held up by the disk.
        let last = self.script.take_store();
        if let Some(trouble) = self.keeper.as_mut().and_then(|one| one.finish(last)) {
            self.outbox.send(&unwritten(&trouble)).await?;
        }
        self.outbox.send(&FromHost::Ended(ending)).await
    }

    /// When the store can be written, if it has changed.
    fn keeps_at(&self) -> Option<Instant> {
        let keeper = self.keeper.as_ref()?;
        let waits = self.script.has_store_changed() || keeper.is_behind();
        waits.then(|| keeper.next().unwrap_or_else(Instant::now))
    }

    async fn keep(&mut self) -> io::Result<()> {
        let Some(keeper) = &mut self.keeper else {
            return Ok(());
        };
        let now = Instant::now();
        if keeper.is_due(now) {
            keeper.offer(self.script.take_store(), now);
        }
        match keeper.trouble() {
            Some(trouble) => self.outbox.send(&unwritten(&trouble)).await,
            None => Ok(()),
        }
    }

    fn take(&mut self, message: ToHost) {
        let now = Instant::now();
        match message {
            ToHost::Event(event) => self.script.deliver(event, now),
            ToHost::Frame { seq, age, jpeg } => {
                self.frame_asked = false;
                self.coming.clear();
                let at = now.checked_sub(age).unwrap_or(now);
                self.script.deliver_frame(Frame { seq, at, jpeg }, now);
            }
            ToHost::Ahead { at, jpeg } => self.look_ahead(at, &jpeg),
            ToHost::Evaluate { text, more } => self.script.evaluate(&text, more, now),
            ToHost::Turn { name, value } => self.script.turn_param(&name, value, now),
            ToHost::Interrupt => self.script.interrupt(now),
            ToHost::Module(name, file) => self.script.deliver_module(&name, file, now),
            ToHost::Stop(reason) => self.script.stop(reason, now),
            ToHost::Load(_) | ToHost::Go => {}
        }
    }

    /// After everything else: nothing waits for pictures.
    async fn show(&mut self) -> io::Result<()> {
        let sighting = self.script.take_sighting();
        if let Some(sighting) = sighting.as_ref().filter(|_| self.findings) {
            self.outbox.send(&found(sighting)).await?;
        }
        let Some(gallery) = &mut self.gallery else {
            return Ok(());
        };
        if let Some(sighting) = sighting {
            gallery.offer(sighting);
        }
        let Some(trouble) = gallery.trouble() else {
            return Ok(());
        };
        let text = format!("a marked frame is not kept: {trouble}");
        self.outbox.send(&warning(text)).await
    }

    fn look_ahead(&mut self, at: usize, part: &[u8]) {
        if at == 0 {
            self.coming.clear();
        }
        if at == self.coming.len() {
            self.coming.extend_from_slice(part);
            self.script.look_ahead(&self.coming);
        }
    }

    async fn send_output(&mut self) -> io::Result<()> {
        for output in self.script.take_output() {
            let message = match output {
                Output::Intent(intent) => FromHost::Intent(intent),
                Output::Log(line) => FromHost::Log(line),
                Output::Remark(remark) => FromHost::Remark(remark),
                Output::Params(knobs) => FromHost::Params(knobs),
                Output::Evaluated(evaluated) => FromHost::Evaluated(evaluated),
                Output::Module(name) => FromHost::Module(name),
            };
            self.outbox.feed(&message).await?;
        }
        if self.script.wants_frames() && !self.frame_asked {
            self.frame_asked = true;
            let ahead = self.script.looks_at_frames();
            self.outbox.feed(&FromHost::WantFrame { ahead }).await?;
        }
        self.outbox.flush().await
    }
}

fn found(sighting: &Sighting) -> FromHost {
    let finding = |seen: &Seen| Finding {
        x: seen.blob.x,
        y: seen.blob.y,
        w: seen.blob.w,
        h: seen.blob.h,
        text: seen.text.clone(),
    };
    let (frame, list) = (
        sighting.frame.seq,
        sighting.marks.iter().map(finding).collect(),
    );
    FromHost::Found { frame, list }
}

fn unwritten(trouble: &str) -> FromHost {
    warning(format!(
        "the store is not written as it should be: {trouble}"
    ))
}

async fn until(deadline: Option<Instant>) {
    match deadline {
        Some(deadline) => sleep_until(deadline).await,
        None => std::future::pending().await,
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use bytes::Bytes;
    use tokio::time::timeout;

    use super::*;
    use crate::behaviour::Library;
    use crate::script::Options;

    const JPEG: &[u8] = include_bytes!("../../tests/fixtures/ball-422.jpg");

    /// A host of a script, and what goes in and out.
    async fn host_of(source: &str) -> (Sender<ToHost>, Receiver<FromHost>) {
        let (near, far) = tokio::io::duplex(1 << 20);
        let (reader, writer) = tokio::io::split(far);
        tokio::task::spawn_local(serve(reader, writer, Time::Virtual));
        let (reader, writer) = tokio::io::split(near);
        let (mut to, from) = (Sender::new(writer), Receiver::new(reader));
        let launch = Launch {
            source: source.into(),
            options: Options::new("test", "test.lua"),
            library: Library::default(),
        };
        to.send(&ToHost::Load(Box::new(launch))).await.unwrap();
        to.send(&ToHost::Go).await.unwrap();
        (to, from)
    }

    fn frame(seq: u64) -> ToHost {
        let (age, jpeg) = (Duration::ZERO, Bytes::from_static(JPEG));
        ToHost::Frame { seq, age, jpeg }
    }

    /// Whether the host wants to look ahead, the next time that it wants a frame; and what the script
    /// has written before.
    async fn wish(from: &mut Receiver<FromHost>) -> (bool, Vec<String>) {
        let mut lines = Vec::new();
        loop {
            let message = timeout(Duration::from_secs(60), from.next()).await.unwrap();
            match message.unwrap().unwrap() {
                FromHost::Log(line) => lines.push(line.text),
                FromHost::WantFrame { ahead } => return (ahead, lines),
                _ => {}
            }
        }
    }

    #[tokio::test(flavor = "local")]
    async fn a_script_that_looks_sees_the_same_frame_in_whatever_parts_it_comes() {
        let look = "robot.on('frame', function(f) print(f:find_blobs('red')[1].pixels) end)";
        let (mut to, mut from) = host_of(look).await;
        assert!(!wish(&mut from).await.0);
        to.send(&frame(1)).await.unwrap();
        let (ahead, seen) = wish(&mut from).await;
        assert!(ahead && seen.len() == 1, "{ahead} {seen:?}");
        for (number, cuts) in [[700, 1500], [100, JPEG.len() - 1], [0, 0]]
            .iter()
            .enumerate()
        {
            let mut at = 0;
            for &cut in cuts {
                let jpeg = Bytes::from_static(&JPEG[at..cut]);
                to.send(&ToHost::Ahead { at, jpeg }).await.unwrap();
                at = cut;
            }
            to.send(&frame(number as u64 + 2)).await.unwrap();
            assert_eq!(wish(&mut from).await, (true, seen.clone()));
        }
        // A part in between was lost.
        let jpeg = Bytes::from_static(&JPEG[900..]);
        to.send(&ToHost::Ahead { at: 900, jpeg }).await.unwrap();
        to.send(&frame(9)).await.unwrap();
        assert_eq!(wish(&mut from).await, (true, seen));
    }

    #[tokio::test(flavor = "local")]
    async fn nothing_is_decoded_for_a_script_that_does_not_look() {
        let (mut to, mut from) = host_of("robot.on('frame', function(f) print(f.seq) end)").await;
        wish(&mut from).await;
        to.send(&frame(1)).await.unwrap();
        assert_eq!(wish(&mut from).await, (false, vec!["1".to_owned()]));
    }
}
