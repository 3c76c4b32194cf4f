//! The agent side of one behaviour that runs: passes messages on in both directions, and sees to it that a host that has ended, for whatever reason, moves nothing any more.
//!
//! Messages are passed on by the driving core. What may wait for the system, to start a host, to read
//! a module for it, to find out why it ended, is done by the caller's runtime.

use std::time::Duration;

use tokio::runtime::Handle as Runtime;
use tokio::sync::{broadcast, mpsc, watch};
use tokio::time::{Instant, sleep_until, timeout};
use tokio_util::task::AbortOnDropHandle;
use tracing::{debug, warn};

use super::ahead::Ahead;
use super::dialogue::{self, Dialogue, Said};
use super::liveness::Liveness;
use super::log_limiter::{Fate, log};
use super::message::{FromHost, ToHost};
use super::prepared::{EXIT_TIME, Prepared, ending};
use super::remarks;
use crate::clock::until;
use crate::robot::channel::{EventReceiver, PilotMessage, Request, Role, events};
use crate::robot::{Bus, Coming, EndReason, Findings, Lookout, Pictures, Remark, Turned};
use crate::script::{Ending, LogLine, Output};

/// How long a script's last words may take (`API.md`, `script.on_stop`), and the host's way out.
const STOP_TIME: Duration = Duration::from_millis(700);

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
    inbox: EventReceiver,
    frames: watch::Receiver<Pictures>,
    last_frame: u64,
    /// The frame that it got before that.
    last_but_one: u64,
    frame_wanted: bool,
    /// The host decodes ahead what it gets of a frame.
    ahead_wanted: bool,
    ahead: Ahead,
    dropped: u64,
    dialogue: Option<Dialogue>,
    liveness: Option<Liveness>,
    lookout: Lookout,
    /// Parameters that people change.
    turned: broadcast::Receiver<Turned>,
    bus: Bus,
}

impl Supervisor {
    /// Brings a prepared behaviour aboard: the pilot knows it from now on.
    pub async fn board(
        host: Prepared,
        role: Role,
        requests: mpsc::Sender<Request>,
        frames: watch::Receiver<Pictures>,
    ) -> Supervisor {
        let (events, inbox) = events();
        let join = Request::Join {
            by: host.by,
            name: host.name.clone(),
            priority: host.priority,
            role,
            events,
        };
        let _ = requests.send(join).await;
        let lookout = Lookout::default();
        Supervisor {
            host,
            requests,
            inbox,
            frames,
            last_frame: 0,
            last_but_one: 0,
            frame_wanted: false,
            ahead_wanted: false,
            ahead: Ahead::default(),
            dropped: 0,
            dialogue: None,
            liveness: None,
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

    /// A person at a prompt types lines for the script and reads its output.
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
        let liveness = self.host.in_real_time.then(|| Liveness::new(limit));
        Supervisor { liveness, ..self }
    }

    /// Runs the behaviour to its end, its messages served by the runtime of `core`. The moment it has
    /// ended the pilot knows.
    pub async fn run(self, handle: Handle, core: &Runtime) -> Ending {
        let (requests, by) = (self.requests.clone(), self.host.by);
        let served = core.spawn(self.serve_to_the_end(handle.stop.subscribe()));
        let Ok((mut supervisor, ending)) = AbortOnDropHandle::new(served).await else {
            let _ = requests.send(Request::Gone(by)).await;
            return self::ending(EndReason::Error, "internal error: its supervisor panicked");
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
                message = self.inbox.next() => match message {
                    PilotMessage::Event(event) => {
                        let (answer, go) = (event.is_answer(), event.is_welcome() && !running);
                        if !self.pass_on(ToHost::Event(event)) && answer {
                            return Some(self.deaf());
                        }
                        if go && self.pass_on(ToHost::Go) {
                            running = true;
                            self.liveness.iter_mut().for_each(Liveness::heard);
                        }
                    }
                    PilotMessage::Kill(reason) => return Some(self.killed(reason)),
                    PilotMessage::Closed => return Some(self.killed(EndReason::Shutdown)),
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
                        self.liveness.iter_mut().filter(|_| running).for_each(Liveness::heard);
                        self.heard(message).await;
                    }
                    Ok(None) => return None,
                    Err(error) => {
                        debug!("a host broke the pipe: {error}");
                        return None;
                    }
                },
                () = picture.notified(), if self.frame_wanted => self.pass_picture(),
                () = until(self.liveness.as_ref().and_then(Liveness::deadline)) => {
                    if self.liveness.as_mut().is_some_and(Liveness::is_over) {
                        return Some(self.silent());
                    }
                }
            }
        }
    }

    async fn heard(&mut self, message: FromHost) {
        let by = self.host.by;
        let request = match message {
            FromHost::Output(Output::Intent(intent)) => Request::Intent(by, intent),
            FromHost::Alive => Request::Alive(by),
            FromHost::WantFrame { ahead, damaged } => {
                (self.frame_wanted, self.ahead_wanted) = (true, ahead);
                return if damaged {
                    self.pass_before()
                } else {
                    self.pass_picture()
                };
            }
            FromHost::Found { frame, list } => {
                let behaviour = self.host.name.clone();
                return self.lookout.tell(Findings {
                    behaviour,
                    frame,
                    list,
                });
            }
            FromHost::Output(Output::Params(knobs)) => {
                return self.lookout.console().declare(&self.host.name, knobs);
            }
            FromHost::Output(Output::Log(line)) => return self.write(line),
            FromHost::Output(Output::Remark(remark)) => return self.remark(remark),
            FromHost::Output(Output::Evaluated(evaluated)) => {
                if let Some(dialogue) = &self.dialogue {
                    dialogue.say(Said::Evaluated(evaluated));
                }
                return;
            }
            FromHost::Output(Output::Module(name)) => {
                // A host that asks for more than there is room for is compromised, and gets nothing.
                let _ = self.host.modules.try_send(name);
                return;
            }
            FromHost::Ready | FromHost::Ended(_) => return,
        };
        let _ = self.requests.send(request).await;
    }

    fn write(&mut self, line: LogLine) {
        let name = &self.host.name;
        match (
            self.host.log_limiter.admit(line, Instant::now()),
            &self.dialogue,
        ) {
            (Fate::Written(line), Some(dialogue)) => dialogue.say(Said::Line(line)),
            (Fate::Written(line), None) => log(name, &line),
            (Fate::LeftOut(before), _) => warn!(
                behaviour = %name,
                before,
                "it logs too much: lines are dropped; this is logged at most once a minute"
            ),
            (Fate::Silent, _) => {}
        }
    }

    fn remark(&mut self, remark: Remark) {
        match self.host.remarks.admit(remark, Instant::now()) {
            remarks::Fate::Passed(what) => self.bus.tell(what),
            remarks::Fate::LeftOut(before) => warn!(
                behaviour = %self.host.name,
                before,
                "it sends too much: journal entries, messages or pictures are dropped; this is logged at \
                 most once a minute"
            ),
            remarks::Fate::Silent => {}
        }
    }

    /// The newest frame, if it is newer than the last one that was passed on, or the part of the
    /// next frame that has come.
    fn pass_picture(&mut self) {
        let Pictures { newest, coming, .. } = self.frames.borrow().clone();
        let Some(frame) = newest.filter(|frame| frame.seq > self.last_frame) else {
            return self.pass_beginning(coming);
        };
        self.last_but_one = std::mem::replace(&mut self.last_frame, frame.seq);
        self.frame_wanted = false;
        self.pass_on(ToHost::Frame(frame));
    }

    /// The last frame that was passed on is damaged: the one before it, unless it was passed on too or
    /// a newer one has come.
    fn pass_before(&mut self) {
        let Pictures { newest, before, .. } = self.frames.borrow().clone();
        let still_newest = newest.is_some_and(|frame| frame.seq == self.last_frame);
        match before.filter(|frame| still_newest && frame.seq > self.last_but_one) {
            Some(frame) => {
                (self.last_but_one, self.frame_wanted) = (frame.seq, false);
                self.pass_on(ToHost::Frame(frame));
            }
            None => self.pass_picture(),
        }
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
            .liveness
            .as_ref()
            .map_or(0.0, |liveness| liveness.limit.as_secs_f64());
        let text = format!(
            "{}: showed no life for {limit} s, within one call that cannot be interrupted; make its \
             work smaller (`watchdog: {{ host_idle_silence: ... }}` is how long it may take)",
            self.host.name
        );
        ending(EndReason::Cpu, &text)
    }

    fn deaf(&self) -> Ending {
        let text = format!("{}: it does not read its messages", self.host.name);
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

async fn at(moment: Option<(Instant, EndReason)>) -> Option<EndReason> {
    match moment {
        Some((moment, reason)) => {
            sleep_until(moment).await;
            Some(reason)
        }
        None => std::future::pending().await,
    }
}
