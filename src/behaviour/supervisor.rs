//! The agent side of one behaviour: starts its host, passes messages on in both directions, and
//! sees to it that a host that has ended, for whatever reason, moves nothing any more.
//!
//! Messages are passed on by the driving core. What may wait for the system, to start a host, to read
//! a module for it, to find out why it ended, is done by the caller's runtime.

use std::io;
use std::time::Duration;

use tokio::runtime::Handle as Runtime;
use tokio::sync::{broadcast, mpsc, watch};
use tokio::task::AbortHandle;
use tokio::time::{Instant, sleep_until, timeout};
use tokio_util::task::AbortOnDropHandle;
use tracing::{debug, warn};

use super::ahead::Ahead;
use super::dialogue::{self, Dialogue, Said};
use super::library::Library;
use super::message::{FromHost, Launch, ToHost};
use super::name::judge_name;
use super::pipe::{Receiver, Sender};
use super::process::{HostProcess, Launcher, PipeReader, PipeWriter};
use super::quill::{Fate, Quill};
use super::remarks::{self, Remarks};
use crate::robot::channel::{Inbox, Request, Role, Told, events};
use crate::robot::{
    BehaviourId, Bus, Coming, EndReason, Findings, Lookout, Pictures, Priority, Remark, Turned,
};
use crate::script::{Ending, Level, LogLine, ModuleName};

/// Messages that may wait for a host that does not read.
const MAX_WAITING: usize = 128;
/// Modules that a host may ask for in its life; an honest one asks for fewer.
const MAX_MODULES: usize = 256;
/// How long a host may take to load its script.
const LOAD_TIME: Duration = Duration::from_secs(5);
/// How long a script's last words may take (`API.md`, `script.on_stop`), and the host's way out.
const STOP_TIME: Duration = Duration::from_millis(700);
/// A host that has been silent for too long is waited for once more for so long: a machine that stalls
/// as a whole must not end its scripts.
const SILENCE_GRACE: Duration = Duration::from_millis(500);
/// How long a host may take to exit once it said that it has ended.
const EXIT_TIME: Duration = Duration::from_millis(100);

/// A behaviour whose script is loaded and does not run yet.
#[derive(Debug)]
pub struct Prepared {
    by: BehaviourId,
    name: String,
    priority: Priority,
    process: HostProcess,
    from_host: Receiver<FromHost>,
    to_host: mpsc::Sender<ToHost>,
    modules: mpsc::Sender<ModuleName>,
    pump: AbortHandle,
    /// In virtual time nobody waits for a sign of life.
    in_real_time: bool,
    quill: Quill,
    remarks: Remarks,
}

/// Tells a running behaviour to end.
#[derive(Debug, Clone)]
pub struct Handle {
    stop: watch::Sender<Option<EndReason>>,
}

impl Default for Handle {
    fn default() -> Handle {
        Handle {
            stop: watch::Sender::new(None),
        }
    }
}

impl Handle {
    /// The script may say its last words and is ended by force after 0.7 s. The first reason stays.
    pub fn stop(&self, reason: EndReason) {
        self.stop
            .send_if_modified(|stop| stop.is_none() && stop.replace(reason).is_none());
    }
}

/// A behaviour that is prepared to run.
#[derive(Debug)]
pub struct Supervisor {
    host: Prepared,
    requests: mpsc::Sender<Request>,
    inbox: Inbox,
    frames: watch::Receiver<Pictures>,
    last_frame: u64,
    frame_wanted: bool,
    /// The host decodes ahead what it gets of a frame.
    ahead_wanted: bool,
    ahead: Ahead,
    dropped: u64,
    dialogue: Option<Dialogue>,
    silence: Option<Silence>,
    lookout: Lookout,
    /// Parameters that people change.
    turned: broadcast::Receiver<Turned>,
    bus: Bus,
}

/// How long nothing may be heard of a host that runs.
#[derive(Debug)]
struct Silence {
    limit: Duration,
    /// Once it runs.
    heard: Option<Instant>,
    /// It is waited for once more.
    grace: Option<Instant>,
}

impl Silence {
    fn heard(&mut self) {
        (self.heard, self.grace) = (Some(Instant::now()), None);
    }

    /// When it has been too long.
    fn deadline(&self) -> Option<Instant> {
        self.grace.or(self.heard.map(|heard| heard + self.limit))
    }

    /// The deadline has passed: whether that is the end of the host.
    fn is_over(&mut self) -> bool {
        self.grace.replace(Instant::now() + SILENCE_GRACE).is_some()
    }
}

impl Prepared {
    /// Starts a host and has it load the script. Its pipe is served by the runtime of `core`.
    ///
    /// # Errors
    /// The script's own failure as an [`Ending`], in words for its author; a host that cannot be
    /// started likewise.
    pub async fn start(
        launcher: &Launcher,
        core: &Runtime,
        by: BehaviourId,
        priority: Priority,
        launch: Launch,
    ) -> Result<Prepared, Ending> {
        let name = launch.options.name.clone();
        let broken = |error: io::Error| {
            ending(
                EndReason::Error,
                &format!("{name}: its host cannot be started: {error}"),
            )
        };
        judge_name(&name).map_err(|error| ending(EndReason::Error, &error.to_string()))?;
        let quill = Quill::new(launch.options.limits.log_bytes_a_day);
        let folder = launch.options.data_dir.clone();
        let remarks = Remarks::new(name.clone(), folder, &launch.options.limits);
        let started = launcher.start(&launch.options.folders(), core);
        let (process, reader, writer) = started.map_err(broken)?;
        let (from_host, to_host, pump) = connect(reader, writer, core);
        let modules = librarian(
            launch.library.clone(),
            to_host.clone(),
            launcher.is_in_this_thread(),
        );
        let mut prepared = Prepared {
            by,
            name: name.clone(),
            priority,
            process,
            from_host,
            to_host,
            modules,
            pump,
            in_real_time: !launcher.is_in_this_thread(),
            quill,
            remarks,
        };
        let _ = prepared.to_host.try_send(ToHost::Load(Box::new(launch)));
        match timeout(LOAD_TIME, prepared.from_host.next()).await {
            Ok(Ok(Some(FromHost::Ready))) => Ok(prepared),
            Ok(Ok(Some(FromHost::Ended(ending)))) => Err(ending),
            Ok(Ok(_)) => Err(prepared.broken().await),
            Ok(Err(error)) => Err(broken(error)),
            Err(_) => Err(broken(io::ErrorKind::TimedOut.into())),
        }
    }

    /// The script's name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The ending of a host that ended without saying why.
    async fn broken(&mut self) -> Ending {
        let status = match timeout(EXIT_TIME, self.process.wait()).await {
            Ok(status) => status,
            Err(_) => self.process.kill().await,
        };
        let status = status.map_or_else(|error| error.to_string(), |status| status.to_string());
        let words = timeout(EXIT_TIME, self.process.last_words())
            .await
            .unwrap_or_default();
        let text = format!(
            "{}: its process ended unexpectedly ({status}) {words}",
            self.name
        );
        ending(EndReason::Error, text.trim_end())
    }
}

impl Drop for Prepared {
    fn drop(&mut self) {
        self.pump.abort();
    }
}

fn connect(
    reader: PipeReader,
    writer: PipeWriter,
    core: &Runtime,
) -> (Receiver<FromHost>, mpsc::Sender<ToHost>, AbortHandle) {
    let (to_host, waiting) = mpsc::channel(MAX_WAITING);
    let pump = core
        .spawn(pump(waiting, Sender::new(writer)))
        .abort_handle();
    (Receiver::new(reader), to_host, pump)
}

/// Writes to the host at its own pace, so that one that does not read holds nobody up.
async fn pump(mut waiting: mpsc::Receiver<ToHost>, mut sender: Sender<ToHost>) {
    while let Some(message) = waiting.recv().await {
        if let Err(error) = sender.send(&message).await {
            debug!("a host does not listen any more: {error}");
            return;
        }
    }
}

/// Reads modules for a host, one after the other, on a thread that may wait for a disk; or `here`,
/// where virtual time waits for nothing else. Ends with the behaviour.
fn librarian(
    library: Library,
    to_host: mpsc::Sender<ToHost>,
    here: bool,
) -> mpsc::Sender<ModuleName> {
    let (ask, mut asked) = mpsc::channel::<ModuleName>(MAX_MODULES);
    tokio::spawn(async move {
        let mut left = MAX_MODULES;
        while let Some(name) = asked.recv().await {
            left = match left.checked_sub(1) {
                Some(left) => left,
                None => return,
            };
            let (shelf, wanted) = (library.clone(), name.clone());
            let file = if here {
                shelf.fetch(&wanted)
            } else {
                let fetched = tokio::task::spawn_blocking(move || shelf.fetch(&wanted)).await;
                fetched.unwrap_or_else(|error| Err(error.to_string()))
            };
            if to_host.send(ToHost::Module(name, file)).await.is_err() {
                return;
            }
        }
    });
    ask
}

impl Supervisor {
    /// Brings a prepared behaviour aboard: the pilot knows it from now on.
    pub async fn board(
        host: Prepared,
        role: Role,
        requests: mpsc::Sender<Request>,
        frames: watch::Receiver<Pictures>,
    ) -> Supervisor {
        let (outbox, inbox) = events();
        let join = Request::Join {
            by: host.by,
            name: host.name.clone(),
            priority: host.priority,
            role,
            outbox,
        };
        let _ = requests.send(join).await;
        let lookout = Lookout::default();
        Supervisor {
            host,
            requests,
            inbox,
            frames,
            last_frame: 0,
            frame_wanted: false,
            ahead_wanted: false,
            ahead: Ahead::default(),
            dropped: 0,
            dialogue: None,
            silence: None,
            turned: lookout.console().turned(),
            lookout,
            bus: Bus::default(),
        }
    }

    /// What its script has done or wants that is not the robot's is told on this bus.
    #[must_use]
    pub fn with_bus(self, bus: Bus) -> Supervisor {
        Supervisor { bus, ..self }
    }

    /// What it finds in frames is told here.
    #[must_use]
    pub fn with_lookout(self, lookout: Lookout) -> Supervisor {
        Supervisor {
            turned: lookout.console().turned(),
            lookout,
            ..self
        }
    }

    /// Somebody types lines for the script and hears what it says.
    #[must_use]
    pub fn with_dialogue(self, dialogue: Dialogue) -> Supervisor {
        Supervisor {
            dialogue: Some(dialogue),
            ..self
        }
    }

    /// Its host is ended if it shows no life for so long, whether it drives or not. While it drives the
    /// watchdog is stricter.
    #[must_use]
    pub fn with_longest_silence(self, limit: Duration) -> Supervisor {
        let silence = self.host.in_real_time.then_some(Silence {
            limit,
            heard: None,
            grace: None,
        });
        Supervisor { silence, ..self }
    }

    /// Runs the behaviour to its end, its messages served by the runtime of `core`. The moment it has
    /// ended the pilot knows.
    pub async fn run(self, handle: Handle, core: &Runtime) -> Ending {
        let (requests, by) = (self.requests.clone(), self.host.by);
        let served = core.spawn(self.serve_to_the_end(handle.stop.subscribe()));
        let Ok((mut supervisor, ending)) = AbortOnDropHandle::new(served).await else {
            let _ = requests.send(Request::Gone(by)).await;
            return self::ending(
                EndReason::Error,
                "internal error: its supervisor broke down",
            );
        };
        let ending = match ending {
            Some(ending) => ending,
            // Why it broke takes time to find out; its motion has stopped by then.
            None => supervisor.host.broken().await,
        };
        supervisor.reap().await;
        ending
    }

    async fn serve_to_the_end(
        mut self,
        mut stop: watch::Receiver<Option<EndReason>>,
    ) -> (Supervisor, Option<Ending>) {
        let ending = self.serve(&mut stop).await;
        let _ = self.requests.send(Request::Gone(self.host.by)).await;
        self.lookout.console().forget(&self.host.name);
        if self.dropped > 0 {
            warn!(behaviour = %self.host.name, dropped = self.dropped, "events did not reach it");
        }
        (self, ending)
    }

    /// Until it has ended; `None` if its host has, without a word.
    async fn serve(&mut self, stop: &mut watch::Receiver<Option<EndReason>>) -> Option<Ending> {
        let (mut last_moment, mut running) = (None, false);
        let picture = self.inbox.picture();
        loop {
            tokio::select! {
                biased;
                told = self.inbox.next() => match told {
                    Told::Event(event) => {
                        let (answer, go) = (event.is_answer(), event.is_welcome() && !running);
                        if !self.pass_on(ToHost::Event(event)) && answer {
                            return Some(self.deaf());
                        }
                        if go && self.pass_on(ToHost::Go) {
                            running = true;
                            self.silence.iter_mut().for_each(Silence::heard);
                        }
                    }
                    Told::Kill(reason) => return Some(self.killed(reason)),
                    Told::Closed => return Some(self.killed(EndReason::Shutdown)),
                },
                Ok(()) = stop.changed(), if last_moment.is_none() => {
                    let reason = stop.borrow_and_update().unwrap_or(EndReason::Shutdown);
                    self.pass_on(ToHost::Stop(reason));
                    running = running || self.pass_on(ToHost::Go);
                    last_moment = Some((Instant::now() + STOP_TIME, reason));
                }
                Some(reason) = at(last_moment) => return Some(self.killed(reason)),
                Ok(turned) = self.turned.recv() => {
                    if turned.behaviour == self.host.name {
                        let (name, value) = (turned.name, turned.value);
                        self.pass_on(ToHost::Turn { name, value });
                    }
                }
                order = dialogue::next(&mut self.dialogue) => {
                    if !self.pass_on(order.into()) {
                        return Some(self.deaf());
                    }
                }
                message = self.host.from_host.next() => match message {
                    Ok(Some(FromHost::Ended(ending))) => return Some(ending),
                    Ok(Some(message)) => {
                        self.silence.iter_mut().filter(|_| running).for_each(Silence::heard);
                        self.heard(message).await;
                    }
                    Ok(None) => return None,
                    Err(error) => {
                        debug!("a host broke the pipe: {error}");
                        return None;
                    }
                },
                () = picture.notified(), if self.frame_wanted => self.pass_picture(),
                () = silence(self.silence.as_ref().and_then(Silence::deadline)) => {
                    if self.silence.as_mut().is_some_and(Silence::is_over) {
                        return Some(self.silent());
                    }
                }
            }
        }
    }

    async fn heard(&mut self, message: FromHost) {
        let by = self.host.by;
        let request = match message {
            FromHost::Intent(intent) => Request::Intent(by, intent),
            FromHost::Alive => Request::Alive(by),
            FromHost::WantFrame { ahead } => {
                (self.frame_wanted, self.ahead_wanted) = (true, ahead);
                return self.pass_picture();
            }
            FromHost::Log(line) => return self.write(line),
            FromHost::Found { frame, list } => {
                let behaviour = self.host.name.clone();
                return self.lookout.tell(Findings {
                    behaviour,
                    frame,
                    list,
                });
            }
            FromHost::Remark(remark) => return self.remark(remark),
            FromHost::Params(knobs) => {
                return self.lookout.console().declare(&self.host.name, knobs);
            }
            FromHost::Evaluated(evaluated) => {
                if let Some(dialogue) = &self.dialogue {
                    dialogue.say(Said::Evaluated(evaluated));
                }
                return;
            }
            FromHost::Module(name) => {
                // One that asks for more than there is room for is not honest, and gets nothing.
                let _ = self.host.modules.try_send(name);
                return;
            }
            FromHost::Ready | FromHost::Ended(_) => return,
        };
        let _ = self.requests.send(request).await;
    }

    fn write(&mut self, line: LogLine) {
        let name = &self.host.name;
        match (self.host.quill.judge(line, Instant::now()), &self.dialogue) {
            (Fate::Written(line), Some(dialogue)) => dialogue.say(Said::Line(line)),
            (Fate::Written(line), None) => log(name, &line),
            (Fate::LeftOut(before), _) => warn!(
                behaviour = %name,
                before,
                "it logs too much: lines are left out, which is said at most once a minute"
            ),
            (Fate::Silent, _) => {}
        }
    }

    fn remark(&mut self, remark: Remark) {
        match self.host.remarks.judge(remark, Instant::now()) {
            remarks::Fate::Told(what) => self.bus.tell(what),
            remarks::Fate::LeftOut(before) => warn!(
                behaviour = %self.host.name,
                before,
                "it tells too much: an entry, a message or a picture is not told, which is said at \
                 most once a minute"
            ),
            remarks::Fate::Silent => {}
        }
    }

    /// The newest frame, if it is newer than the last one that was passed on, or what has come of
    /// the next.
    fn pass_picture(&mut self) {
        let Pictures { newest, coming } = self.frames.borrow().clone();
        let Some(frame) = newest.filter(|frame| frame.seq > self.last_frame) else {
            return self.pass_beginning(coming);
        };
        (self.last_frame, self.frame_wanted) = (frame.seq, false);
        let age = frame.at.elapsed();
        self.pass_on(ToHost::Frame {
            seq: frame.seq,
            age,
            jpeg: frame.jpeg,
        });
    }

    fn pass_beginning(&mut self, coming: Option<Coming>) {
        let coming = coming.filter(|_| self.ahead_wanted);
        if let Some((at, jpeg)) = coming.and_then(|coming| self.ahead.rest(&coming)) {
            self.pass_on(ToHost::Ahead { at, jpeg });
        }
    }

    /// Whether the message found room.
    fn pass_on(&mut self, message: ToHost) -> bool {
        let sent = self.host.to_host.try_send(message).is_ok();
        self.dropped += u64::from(!sent);
        sent
    }

    fn silent(&self) -> Ending {
        let limit = self
            .silence
            .as_ref()
            .map_or(0.0, |silence| silence.limit.as_secs_f64());
        let text = format!(
            "{}: showed no life for {limit} s, within one call that cannot be interrupted; make its \
             work smaller (`watchdog: {{ host_idle_silence: ... }}` is how long it may take)",
            self.host.name
        );
        ending(EndReason::Cpu, &text)
    }

    fn deaf(&self) -> Ending {
        let text = format!("{}: it does not read what it is told", self.host.name);
        ending(EndReason::Cpu, &text)
    }

    fn killed(&self, reason: EndReason) -> Ending {
        ending(
            reason,
            &format!("{}: {}", self.host.name, reason.sentence()),
        )
    }

    /// No host outlives its behaviour.
    async fn reap(&mut self) {
        if timeout(EXIT_TIME, self.host.process.wait()).await.is_ok() {
            return;
        }
        if let Err(error) = self.host.process.kill().await {
            warn!(behaviour = %self.host.name, "its host cannot be ended: {error}");
        }
    }
}

async fn silence(deadline: Option<Instant>) {
    match deadline {
        Some(deadline) => sleep_until(deadline).await,
        None => std::future::pending().await,
    }
}

async fn at(moment: Option<(Instant, EndReason)>) -> Option<EndReason> {
    match moment {
        Some((moment, reason)) => {
            sleep_until(moment).await;
            Some(reason)
        }
        None => std::future::pending().await,
    }
}

fn ending(reason: EndReason, message: &str) -> Ending {
    Ending {
        reason,
        message: Some(message.to_owned()),
    }
}

/// A script's line in the agent's log.
fn log(behaviour: &str, line: &LogLine) {
    let fields: Vec<String> = line
        .fields
        .iter()
        .map(|(key, value)| format!("{key}={value}"))
        .collect();
    let text = [&[line.text.clone()][..], &fields].concat().join(" ");
    let at = line.line;
    match line.level {
        Level::Debug => tracing::debug!(target: "spykee::script", behaviour, line = at, "{text}"),
        Level::Info => tracing::info!(target: "spykee::script", behaviour, line = at, "{text}"),
        Level::Warn => tracing::warn!(target: "spykee::script", behaviour, line = at, "{text}"),
        Level::Error => tracing::error!(target: "spykee::script", behaviour, line = at, "{text}"),
    }
}
