//! The agent side of one running behaviour: forwards messages on the driving core, and ensures that
//! a host that has ended, for whatever reason, no longer moves the robot. Work that may block on
//! the system runs on the caller's runtime.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use tokio::sync::{broadcast, mpsc, watch};
use tokio::time::{Instant, timeout};
use tokio_util::task::AbortOnDropHandle;
use tracing::{debug, warn};

use super::host::{PromptCommand, ToHost};
use super::limiter::{Admission, log};
use super::process::{EXIT_TIME, HostContext, Prepared, exit};
use crate::clock::{or_never, until};
use crate::robot::channel::{EventReceiver, PilotMessage, Request, Role, events};
use crate::robot::{Detections, EndReason, HostReport, ParamChange, Pictures};
use crate::script::{Evaluated, FromHost, LogLine, ScriptExit};

/// Time limit for a script's `on_stop` handlers plus the exit of its host.
const STOP_TIME: Duration = Duration::from_millis(700);

/// A deadline noticed this late was missed by the whole machine: the host gets its time again.
const STALL: Duration = Duration::from_millis(200);

/// Tells a running behaviour to end.
#[derive(Debug, Clone, Default)]
pub struct Handle {
    stop: watch::Sender<Option<EndReason>>,
    /// Who has started it, if it does not belong to the run from its beginning.
    pub started_by: Option<String>,
    ended_by: Arc<OnceLock<String>>,
    has_driven: Arc<AtomicBool>,
}

impl Handle {
    /// The handle of a behaviour that `by` starts: a person, a timetable.
    pub fn for_start(by: &str) -> Handle {
        Handle {
            started_by: Some(by.to_owned()),
            ..Handle::default()
        }
    }

    /// Who has told it to end, or what.
    pub fn ended_by(&self) -> Option<String> {
        self.ended_by.get().cloned()
    }

    /// Whether it has ever asked for motion, also before a restart.
    pub fn has_driven(&self) -> bool {
        self.has_driven.load(Ordering::Relaxed)
    }

    /// The handle of one life between two restarts.
    pub fn one_life(&self) -> Handle {
        Handle {
            stop: watch::Sender::default(),
            ..self.clone()
        }
    }

    /// The same as [`Handle::stop`], in the name of `by`.
    pub fn stop_by(&self, reason: EndReason, by: &str) {
        if self.reason().is_none() {
            let _ = self.ended_by.set(by.to_owned());
        }
        self.stop(reason);
    }

    /// Lets the script say its last words; ends it by force after 0.7 s. The first reason is kept.
    pub fn stop(&self, reason: EndReason) {
        self.stop
            .send_if_modified(|stop| stop.is_none() && stop.replace(reason).is_none());
    }

    pub fn reason(&self) -> Option<EndReason> {
        *self.stop.borrow()
    }

    /// Waits until it is told to end. Cancel-safe.
    pub async fn stopped(&self) -> EndReason {
        let mut stop = self.stop.subscribe();
        let reason = stop.wait_for(Option::is_some).await;
        reason
            .ok()
            .and_then(|reason| *reason)
            .unwrap_or(EndReason::Shutdown)
    }
}

/// Supervises a prepared behaviour while it runs.
#[derive(Debug)]
pub struct Supervisor {
    host: Prepared,
    context: HostContext,
    inbox: EventReceiver,
    last_frame: u64,
    /// The frame passed on before that.
    last_but_one: u64,
    frame_wanted: bool,
    dropped: u64,
    repl_channel: Option<ReplChannel>,
    is_running: bool,
    liveness: Option<Liveness>,
    param_changes: broadcast::Receiver<ParamChange>,
}

impl Supervisor {
    /// Registers the behaviour with the pilot; `repl_channel` connects a prompt, whose user types
    /// lines for the script and reads its output.
    pub async fn register(
        host: Prepared,
        role: Role,
        context: HostContext,
        repl_channel: Option<ReplChannel>,
    ) -> Supervisor {
        let (events, inbox) = events();
        let join = Request::Join {
            by: host.by,
            name: host.name.clone(),
            priority: host.priority,
            role,
            events,
        };
        let _ = context.requests.send(join).await;
        let limit = context.longest_silence;
        Supervisor {
            liveness: if host.in_real_time {
                Some(Liveness {
                    limit,
                    last_message: None,
                    grace: None,
                })
            } else {
                None
            },
            host,
            inbox,
            last_frame: 0,
            last_but_one: 0,
            frame_wanted: false,
            dropped: 0,
            repl_channel,
            is_running: false,
            param_changes: context.viewers.params().changes(),
            context,
        }
    }

    /// Runs the behaviour to its end. The pilot is informed as soon as it has ended.
    pub async fn run(self, handle: Handle) -> ScriptExit {
        let core = self.context.core.clone();
        let requests = self.context.requests.clone();
        let by = self.host.by;
        let watched = if self.host.in_real_time {
            Some(self.host.account.clone().watch())
        } else {
            None
        };
        let mut served = AbortOnDropHandle::new(core.spawn(self.serve_to_the_end(handle.clone())));
        let mut overweight = None;
        let served = tokio::select! {
            served = &mut served => served,
            why = or_never(watched) => {
                overweight = Some(why);
                handle.stop(EndReason::Error);
                served.await
            }
        };
        let Ok((mut supervisor, exit)) = served else {
            let _ = requests.send(Request::Gone(by)).await;
            return self::exit(EndReason::Error, "internal error: its supervisor panicked");
        };
        let overweight = overweight.map(|why| {
            let text = format!("{}: {why}", supervisor.host.name);
            self::exit(EndReason::Error, &text)
        });
        let exit = overweight.or(exit);
        let exit = match exit {
            Some(exit) => exit,
            // Finding out why the host failed takes time; its motion has stopped by then.
            None => supervisor.host.failure_exit().await,
        };
        supervisor.reap().await;
        exit
    }

    async fn serve_to_the_end(mut self, handle: Handle) -> (Supervisor, Option<ScriptExit>) {
        let exit = self.serve(&handle).await;
        let _ = self
            .context
            .requests
            .send(Request::Gone(self.host.by))
            .await;
        self.context.viewers.params().forget(&self.host.name);
        if self.dropped > 0 {
            warn!(
                behaviour = %self.host.name,
                dropped = self.dropped,
                "messages to its host were dropped, because it did not read them in time"
            );
        }
        (self, exit)
    }

    /// Serves the behaviour until it has ended; `None` if its host ended without a report.
    async fn serve(&mut self, handle: &Handle) -> Option<ScriptExit> {
        let mut last_moment = None;
        let picture = self.inbox.picture();
        loop {
            tokio::select! {
                biased;
                message = self.inbox.next() => {
                    if let Some(exit) = self.handle_pilot(message) {
                        return Some(exit);
                    }
                }
                reason = handle.stopped(), if last_moment.is_none() => {
                    self.pass_on(ToHost::Stop(reason));
                    self.is_running = self.is_running || self.pass_on(ToHost::Run);
                    last_moment = Some((Instant::now() + STOP_TIME, reason));
                }
                () = until(last_moment.map(|(moment, _)| moment)) => match &mut last_moment {
                    Some((moment, _)) if Instant::now() > *moment + STALL => {
                        *moment = Instant::now() + STOP_TIME;
                    }
                    ended => return ended.map(|(_, reason)| self.killed_exit(reason)),
                },
                Ok(change) = self.param_changes.recv() => self.set_param(change),
                command = next_command(&mut self.repl_channel) => {
                    if !self.pass_on(ToHost::Prompt(command)) {
                        return Some(self.queue_full_exit());
                    }
                }
                message = self.host.from_host.next() => match message {
                    Ok(Some(FromHost::Ended(exit))) => return Some(exit),
                    Ok(Some(message)) => self.handle_message(message, handle).await,
                    Ok(None) => return None,
                    Err(error) => {
                        debug!("the pipe to a host broke: {error}");
                        return None;
                    }
                },
                () = picture.notified(), if self.frame_wanted => self.pass_picture(),
                () = until(self.liveness.as_ref().and_then(Liveness::deadline)) => {
                    if self.liveness.as_mut().is_some_and(Liveness::is_over) {
                        return Some(self.unresponsive_exit());
                    }
                }
            }
        }
    }

    /// Returns the exit if the behaviour has ended with this message.
    fn handle_pilot(&mut self, message: PilotMessage) -> Option<ScriptExit> {
        let event = match message {
            PilotMessage::Event(event) => event,
            PilotMessage::Kill(reason) => return Some(self.killed_exit(reason)),
            PilotMessage::Closed => return Some(self.killed_exit(EndReason::Shutdown)),
        };
        let is_answer = event.is_answer();
        let starts = event.is_welcome() && !self.is_running;
        if !self.pass_on(ToHost::Event(event)) && is_answer {
            return Some(self.queue_full_exit());
        }
        if starts && self.pass_on(ToHost::Run) {
            self.is_running = true;
            self.reset_liveness();
        }
        None
    }

    fn set_param(&mut self, change: ParamChange) {
        if change.behaviour == self.host.name {
            self.pass_on(ToHost::SetParam {
                name: change.name,
                value: change.value,
            });
        }
    }

    fn reset_liveness(&mut self) {
        if let Some(liveness) = &mut self.liveness {
            liveness.reset();
        }
    }

    async fn handle_message(&mut self, message: FromHost, handle: &Handle) {
        if self.is_running {
            self.reset_liveness();
        }
        let by = self.host.by;
        let viewers = &self.context.viewers;
        let request = match message {
            FromHost::Intent(intent) => {
                if intent.drives() {
                    handle.has_driven.store(true, Ordering::Relaxed);
                }
                Request::Intent(by, intent)
            }
            FromHost::Alive => Request::Alive(by),
            FromHost::WantFrame { damaged } => {
                self.frame_wanted = true;
                return if damaged {
                    self.pass_previous()
                } else {
                    self.pass_picture()
                };
            }
            FromHost::Found { frame, list } => {
                let behaviour = self.host.name.clone();
                return viewers.send(Detections {
                    behaviour,
                    frame,
                    list,
                });
            }
            FromHost::Params(params) => return viewers.params().declare(&self.host.name, params),
            FromHost::Log(line) => return self.write(line),
            FromHost::HostReport(report) => return self.report(report),
            FromHost::Evaluated(evaluated) => {
                if let Some(repl_channel) = &self.repl_channel {
                    repl_channel.send(PromptMessage::Evaluated(evaluated));
                }
                return;
            }
            FromHost::Module(name) => {
                // Only a compromised host requests more than the queue holds: drop the request.
                let _ = self.host.modules.try_send(name);
                return;
            }
            FromHost::Ready | FromHost::Ended(_) => return,
        };
        let _ = self.context.requests.send(request).await;
    }

    fn write(&mut self, line: LogLine) {
        let name = &self.host.name;
        match (
            self.host.account.limiter().admit_line(line, Instant::now()),
            &self.repl_channel,
        ) {
            (Admission::Passed(line), Some(repl_channel)) => {
                repl_channel.send(PromptMessage::Line(line))
            }
            (Admission::Passed(line), None) => log(name, &line),
            (Admission::Dropped(before), _) => warn!(
                behaviour = %name,
                before,
                "it logs too much: lines are dropped; this is logged at most once a minute"
            ),
            (Admission::DroppedSilently, _) => {}
        }
    }

    fn report(&mut self, report: HostReport) {
        match self
            .host
            .account
            .limiter()
            .admit_report(report, Instant::now())
        {
            Admission::Passed(what) => self.context.bus.publish(what),
            Admission::Dropped(before) => warn!(
                behaviour = %self.host.name,
                before,
                "it sends too much: journal entries, messages or pictures are dropped; this is logged at \
                 most once a minute"
            ),
            Admission::DroppedSilently => {}
        }
    }

    /// Passes on the newest frame, unless it was already.
    fn pass_picture(&mut self) {
        let newest = self.context.frames.borrow().newest.clone();
        let Some(frame) = newest.filter(|frame| frame.seq > self.last_frame) else {
            return;
        };
        self.last_but_one = std::mem::replace(&mut self.last_frame, frame.seq);
        self.frame_wanted = false;
        self.pass_on(ToHost::Frame(frame));
    }

    /// Replaces a damaged frame: passes on the frame before it, unless that one was passed on too
    /// or a newer one has arrived.
    fn pass_previous(&mut self) {
        let Pictures { newest, before } = self.context.frames.borrow().clone();
        let still_newest = newest.is_some_and(|frame| frame.seq == self.last_frame);
        match before.filter(|frame| still_newest && frame.seq > self.last_but_one) {
            Some(frame) => {
                (self.last_but_one, self.frame_wanted) = (frame.seq, false);
                self.pass_on(ToHost::Frame(frame));
            }
            None => self.pass_picture(),
        }
    }

    /// Queues a message to the host. Returns false if the queue is full.
    fn pass_on(&mut self, message: ToHost) -> bool {
        let sent = self.host.to_host.try_send(message).is_ok();
        self.dropped += u64::from(!sent);
        sent
    }

    fn unresponsive_exit(&self) -> ScriptExit {
        let limit = self
            .liveness
            .as_ref()
            .map_or(0.0, |liveness| liveness.limit.as_secs_f64());
        let text = format!(
            "{}: showed no life for {limit} s, within one call that cannot be interrupted; make its \
             work smaller",
            self.host.name
        );
        exit(EndReason::Cpu, &text)
    }

    fn queue_full_exit(&self) -> ScriptExit {
        let text = format!("{}: it does not read its messages", self.host.name);
        exit(EndReason::Cpu, &text)
    }

    fn killed_exit(&self, reason: EndReason) -> ScriptExit {
        exit(
            reason,
            &format!("{}: {}", self.host.name, reason.sentence()),
        )
    }

    /// Ends the host process, so that no host outlives its behaviour.
    async fn reap(&mut self) {
        if timeout(EXIT_TIME, self.host.process.wait()).await.is_ok() {
            return;
        }
        if let Err(error) = self.host.process.kill().await {
            warn!(behaviour = %self.host.name, "its host cannot be ended: {error}");
        }
    }
}

/// Extra time, granted once, to a host that was silent for too long: a stall of the whole machine
/// must not end its scripts.
const SILENCE_GRACE: Duration = Duration::from_millis(500);

/// When a running host last sent a message, and how long it may be silent.
#[derive(Debug)]
struct Liveness {
    limit: Duration,
    /// Time of the last message; `None` until the host runs.
    last_message: Option<Instant>,
    /// End of the extra time, if it was granted.
    grace: Option<Instant>,
}

impl Liveness {
    fn reset(&mut self) {
        (self.last_message, self.grace) = (Some(Instant::now()), None);
    }

    /// When the silence will have lasted too long.
    fn deadline(&self) -> Option<Instant> {
        self.grace
            .or(self.last_message.map(|last| last + self.limit))
    }

    /// To be called at the deadline. Whether the host must be ended; first grants the extra time.
    fn is_over(&mut self) -> bool {
        self.grace.replace(Instant::now() + SILENCE_GRACE).is_some()
    }
}

const MAX_COMMANDS: usize = 16;
/// Capacity of the queue to the user; its last slot is reserved for answers.
const MAX_MESSAGES: usize = 512;

#[derive(Debug, Clone, PartialEq, Eq)]
pub enum PromptMessage {
    /// The behaviour accepts commands from now on.
    Ready,
    Line(LogLine),
    /// The outcome of the last [`PromptCommand::Evaluate`].
    Evaluated(Evaluated),
    /// The behaviour has ended, and a new one starts.
    Ended(ScriptExit),
}

/// The behaviour's end of the two queues.
#[derive(Debug)]
pub struct ReplChannel {
    commands: mpsc::Receiver<PromptCommand>,
    messages: mpsc::Sender<PromptMessage>,
}

impl ReplChannel {
    /// Creates the queues; also returns the user's ends of them.
    pub fn new() -> (
        mpsc::Sender<PromptCommand>,
        mpsc::Receiver<PromptMessage>,
        ReplChannel,
    ) {
        let (commands_sender, commands) = mpsc::channel(MAX_COMMANDS);
        let (messages, received) = mpsc::channel(MAX_MESSAGES);
        (
            commands_sender,
            received,
            ReplChannel { commands, messages },
        )
    }

    /// Sends a message to the user. A log line is dropped if the user's side does not keep up.
    fn send(&self, message: PromptMessage) {
        let room = self.messages.capacity() > 1 || !matches!(message, PromptMessage::Line(_));
        if room {
            let _ = self.messages.try_send(message);
        }
    }
}

/// Returns the next command. Without a prompt, or once it is closed, it never completes.
async fn next_command(repl_channel: &mut Option<ReplChannel>) -> PromptCommand {
    if let Some(repl_channel) = repl_channel
        && let Some(command) = repl_channel.commands.recv().await
    {
        return command;
    }
    std::future::pending().await
}
