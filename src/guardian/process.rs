//! The guardian's own process: waits for messages, for the robot and for deadlines, and acts.

use std::ffi::OsString;
use std::fs::DirEntry;
use std::io;
use std::os::fd::{OwnedFd, RawFd};
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;
use rustix::stdio::stdin;
use tokio::signal::unix::{Signal, SignalKind, signal};
use tokio::time::Instant;

use super::dead_man::DeadMan;
use super::debt::{Acknowledged, Debt, DebtAct, DebtEvent, OpenLink, Outcome, QUESTIONS};
use super::message::{Datagram, GuardianMessage, MAX_MESSAGE_LEN, Route};
use super::record::Record;
use super::robot_link::{DialledLink, RobotLink};
use super::stop_socket::{StopAnswer, StopSocket};
use crate::robot_socket::FormerLink;
use crate::wire::{Command, Engage};

/// The hidden argument that makes the executable run as a guardian. The paths of its record and of
/// its socket for STOP follow; an empty one means none.
pub const GUARDIAN_ARGUMENT: &str = "__guardian";
/// The name of the process: one that `pkill spykee` does not match.
const PROCESS_NAME: &std::ffi::CStr = c"robot-guardian";
/// The highest file descriptor that a program is meant to inherit.
const STANDARD_ERROR: RawFd = 2;
/// How often to check whether the robot has acknowledged everything.
const RECHECK: Duration = Duration::from_millis(20);
/// A core that is silent for this long while a debt stands, and has no link, does not dial; longer
/// than the guardian's own limit, because a core that resumes dials itself.
const ABANDONED: Duration = Duration::from_secs(2);
/// How long an old link is kept beside the dialling.
const OUTAGE: Duration = Duration::from_secs(10 * 60);
/// The most requests for a stop that are served in a row.
const MAX_STOPS: usize = 16;
/// A person's STOP: the tracks stop, a search ends, which a MOVE alone may not end, and the tracks
/// stop again.
const STOP: [Command; 3] = [
    Command::STOP,
    Command::Engine(Engage::CancelDock),
    Command::STOP,
];
/// Signals that end or stop a program, but not the guardian: it ends after the agent.
const OUTLIVED: [SignalKind; 8] = [
    SignalKind::hangup(),
    SignalKind::interrupt(),
    SignalKind::terminate(),
    SignalKind::quit(),
    SignalKind::user_defined1(),
    SignalKind::user_defined2(),
    SignalKind::alarm(),
    SignalKind::from_raw(libc::SIGTSTP),
];

/// Runs the guardian process until the agent's end of its standard input is closed and no stop is
/// owed any more.
pub fn guardian_main(mut args: impl Iterator<Item = OsString>) -> ExitCode {
    close_inherited();
    let _ = rustix::thread::set_name(PROCESS_NAME);
    // In its own session no terminal signals reach it. Fails only for the leader of a process
    // group.
    let _ = rustix::process::setsid();
    // Without it, too, the robot is to be stopped.
    let _outlived = outlive_signals();
    let mut path = || {
        let path = args.next().filter(|path| !path.is_empty());
        path.map(PathBuf::from)
    };
    let record = Record::new(path());
    let stop_socket = path().and_then(|path| StopSocket::bind(path).ok());
    let mut process = GuardianProcess {
        dead_man: DeadMan::default(),
        link: None,
        former: None,
        route: None,
        owed: false,
        agent_gone: false,
        pursuit: None,
        stop_socket,
        record,
        buffer: vec![0; MAX_MESSAGE_LEN],
    };
    process.run();
    ExitCode::SUCCESS
}

/// Closes the descriptors inherited from the agent: files, pipes and terminals stay open for as
/// long as any process holds them. Standard input is the channel from the agent; standard output
/// and error lead nowhere.
fn close_inherited() {
    let Ok(open) = std::fs::read_dir("/proc/self/fd") else {
        return;
    };
    let number = |entry: io::Result<DirEntry>| entry.ok()?.file_name().to_str()?.parse().ok();
    let numbers: Vec<RawFd> = open.filter_map(number).collect();
    for number in numbers {
        if number > STANDARD_ERROR {
            // The descriptor of the listed folder is closed already.
            let _ = nix::unistd::close(number);
        }
    }
}

/// Ignores the signals for as long as the returned value lives.
fn outlive_signals() -> io::Result<(tokio::runtime::Runtime, Vec<Signal>)> {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_io()
        .build()?;
    let signals = {
        let _within = runtime.enter();
        let signals = OUTLIVED.into_iter().map(signal);
        signals.collect::<io::Result<_>>()?
    };
    Ok((runtime, signals))
}

struct GuardianProcess {
    dead_man: DeadMan,
    /// The link that the agent has given.
    link: Option<RobotLink>,
    /// The addresses of that link, or of the last one.
    former: Option<FormerLink>,
    route: Option<Route>,
    owed: bool,
    agent_gone: bool,
    /// Present while this process acts for an agent that is gone, or hangs without a link.
    pursuit: Option<Pursuit>,
    stop_socket: Option<StopSocket>,
    record: Record,
    buffer: Vec<u8>,
}

/// The pursuit of a debt, or of the end of a link.
struct Pursuit {
    debt: Debt,
    dialled: Option<DialledLink>,
    began: Instant,
    /// A line about it is in the record.
    told: bool,
    /// Something was written on a dialled connection.
    wrote: bool,
}

impl GuardianProcess {
    fn run(&mut self) {
        loop {
            let broken = self.wait().unwrap_or_else(|_| {
                std::thread::sleep(RECHECK);
                false
            });
            // Drain pending messages before evaluating timeouts: the whole machine may have slept.
            self.receive_messages();
            self.serve_stops();
            let now = Instant::now();
            if self.agent_gone {
                if self.pursuit.is_none() {
                    self.begin_pursuit(now);
                }
            } else {
                self.act_for_silent_core(broken, now);
            }
            let outcome = self.pursue();
            if outcome.is_some() {
                self.pursuit = None;
                if self.agent_gone {
                    return;
                }
            }
        }
    }

    /// Waits until something happens or a deadline passes. Returns whether the agent's link is
    /// broken.
    fn wait(&self) -> io::Result<bool> {
        let until = self.next_deadline();
        let left = until.map(|until| until.saturating_duration_since(Instant::now()));
        let left = left.and_then(|left| Timespec::try_from(left).ok());
        let agent = stdin();
        let mut fds = Vec::with_capacity(4);
        if let Some(link) = &self.link {
            fds.push(PollFd::new(link, link.stream.interest(self.agent_gone)));
        }
        if !self.agent_gone {
            fds.push(PollFd::new(&agent, PollFlags::IN));
        }
        if let Some(socket) = &self.stop_socket {
            fds.push(PollFd::new(socket, PollFlags::IN));
        }
        let dialled = self.pursuit.as_ref().and_then(|one| one.dialled.as_ref());
        if let Some(dialled) = dialled {
            fds.push(PollFd::new(dialled, dialled.interest()));
        }
        match poll(&mut fds, left.as_ref()) {
            Ok(_) | Err(Errno::INTR) => {}
            Err(error) => return Err(error.into()),
        }
        let ended = PollFlags::HUP | PollFlags::ERR;
        let broken = self.link.is_some() && fds[0].revents().intersects(ended);
        Ok(broken)
    }

    fn next_deadline(&self) -> Option<Instant> {
        let now = Instant::now();
        let pursuit = self.pursuit.as_ref().map(|pursuit| {
            // The kernel does not report acknowledgements.
            pursuit.debt.next_deadline().min(now + RECHECK)
        });
        let core = if self.agent_gone || self.pursuit.is_some() {
            None
        } else {
            let abandoned = self.abandoned_from();
            let silent = self.dead_man.next_deadline();
            silent.into_iter().chain(abandoned).min()
        };
        pursuit.into_iter().chain(core).min()
    }

    /// When the debt counts as abandoned if the core does not beat before.
    fn abandoned_from(&self) -> Option<Instant> {
        let last_words = !self.dead_man.last_words().is_empty();
        if self.owed && last_words && self.link.is_none() && self.route.is_some() {
            Some(self.dead_man.silent_from()? + ABANDONED)
        } else {
            None
        }
    }

    fn receive_messages(&mut self) {
        while !self.agent_gone {
            match GuardianMessage::receive(stdin(), &mut self.buffer) {
                Ok(Datagram::Message(message, socket)) => self.take(message, socket),
                Ok(Datagram::Nothing) => return,
                // After an error, too: nobody else would stop the robot.
                Ok(Datagram::End) | Err(_) => self.agent_gone = true,
            }
        }
    }

    fn take(&mut self, message: GuardianMessage, socket: Option<OwnedFd>) {
        match &message {
            GuardianMessage::Heartbeat => {
                // An agent that does not read its answers does not miss this one.
                let _ = GuardianMessage::Heartbeat.send(stdin(), None);
                self.yield_to_agent();
            }
            GuardianMessage::Release => self.link = None,
            GuardianMessage::Route(route) => self.route = Some(route.clone()),
            GuardianMessage::Debt(owed) => self.owed = *owed,
            _ => {}
        }
        if let Some(socket) = socket {
            let robot = self.route.as_ref().map(|route| route.address);
            self.former = robot.and_then(|robot| FormerLink::new(&socket, robot));
            self.link = Some(RobotLink::new(socket));
        }
        self.dead_man.handle(message, Instant::now());
    }

    /// The core beats again: it dials itself.
    fn yield_to_agent(&mut self) {
        let Some(pursuit) = self.pursuit.take() else {
            return;
        };
        if pursuit.wrote {
            self.tell_agent();
        }
        if pursuit.told {
            self.record.append("the robot has its agent back");
        }
    }

    /// An agent that resumes must know that the robot no longer does what it was last told.
    fn tell_agent(&self) {
        if !self.agent_gone {
            let _ = GuardianMessage::Wrote.send(stdin(), None);
        }
    }

    fn act_for_silent_core(&mut self, broken: bool, now: Instant) {
        if broken {
            self.lose_link();
        }
        if self.dead_man.is_login() && self.dead_man.next_deadline().is_some_and(|due| due <= now) {
            let obeys = self.link.as_ref().is_some_and(RobotLink::has_first_power);
            if !obeys {
                self.dead_man.defer(now);
            }
        }
        if let Some(pending) = self.dead_man.poll(now) {
            self.write_in_place_of_agent(&pending.bytes, pending.closes);
        }
        if self.link.as_mut().is_some_and(|link| !link.stream.flush()) {
            self.lose_link();
        }
        if self.pursuit.is_none() && self.abandoned_from().is_some_and(|from| from <= now) {
            self.begin_pursuit(now);
        }
    }

    fn lose_link(&mut self) {
        self.link = None;
        self.dead_man.lose_link();
    }

    /// Returns whether the link works.
    fn write_in_place_of_agent(&mut self, bytes: &[u8], closes: bool) -> bool {
        let Some(link) = &mut self.link else {
            return false;
        };
        if link.is_closing() {
            return false;
        }
        let works = link.write_in_place_of_agent(bytes, closes);
        if !works {
            self.lose_link();
        }
        self.tell_agent();
        works
    }

    // A person's STOP.

    fn serve_stops(&mut self) {
        for _ in 0..MAX_STOPS {
            let asked = self.stop_socket.as_ref().and_then(StopSocket::receive);
            let Some(from) = asked else {
                return;
            };
            let answer = self.stop();
            if let Some(socket) = &self.stop_socket {
                socket.answer(&from, answer);
            }
        }
    }

    fn stop(&mut self) -> StopAnswer {
        let now = Instant::now();
        if !self.agent_gone && !self.dead_man.is_silent(now) {
            return StopAnswer::Alive;
        }
        let bytes = STOP.iter().flat_map(Command::to_bytes).collect();
        self.dead_man.replace_last(bytes);
        self.owed = true;
        // An agent that resumes must not drive on.
        let _ = GuardianMessage::Stopped.send(stdin(), None);
        if self.agent_gone || self.link.is_none() {
            // Begins again, with the new words.
            self.begin_pursuit(now);
            return StopAnswer::Pending;
        }
        if self.dead_man.open_link() != OpenLink::Ready {
            return StopAnswer::Pending;
        }
        let written = match self.dead_man.take_pending() {
            Some(pending) => self.write_in_place_of_agent(&pending.bytes, pending.closes),
            None => false,
        };
        if written {
            StopAnswer::Written
        } else {
            StopAnswer::Pending
        }
    }

    // In place of an agent that is gone.

    fn begin_pursuit(&mut self, now: Instant) {
        let open = match &self.link {
            None => OpenLink::None,
            Some(link) => {
                link.outlive(OUTAGE);
                if link.is_closing() {
                    OpenLink::Written
                } else {
                    self.dead_man.open_link()
                }
            }
        };
        let words = !self.dead_man.last_words().is_empty();
        let owed = self.owed && self.route.is_some();
        let debt = Debt::begin(open, words, owed, now);
        match &mut self.pursuit {
            Some(pursuit) => {
                pursuit.debt = debt;
                pursuit.dialled = None;
            }
            None => {
                self.pursuit = Some(Pursuit {
                    debt,
                    dialled: None,
                    began: now,
                    told: false,
                    wrote: false,
                });
            }
        }
        // Without last words, too: the rest of a message that the agent has begun.
        if open == OpenLink::Ready && !words {
            self.write_last_words();
        }
    }

    fn pursue(&mut self) -> Option<Outcome> {
        self.read_robot();
        loop {
            let act = self.pursuit.as_mut()?.poll(self.link.as_ref());
            match act? {
                DebtAct::WriteOnLink => self.write_last_words(),
                DebtAct::HalfCloseLink => {
                    if let Some(link) = &mut self.link {
                        link.half_close();
                    }
                }
                DebtAct::Dial => self.dial(),
                DebtAct::LogIn => {
                    let login = self.route.as_ref().map(|route| route.login.clone());
                    self.write_on_dialled(&login.unwrap_or_default());
                }
                DebtAct::WriteOnDialled => {
                    let last_words = self.dead_man.last_words().to_vec();
                    self.write_on_dialled(&with_questions(last_words));
                    self.pursuit.as_mut()?.wrote = true;
                }
                DebtAct::HangUp => self.pursuit.as_mut()?.dialled = None,
                DebtAct::End(outcome) => {
                    self.end_pursuit(outcome);
                    return Some(outcome);
                }
            }
        }
    }

    fn write_on_dialled(&mut self, bytes: &[u8]) {
        let pursuit = self.pursuit.as_mut();
        if let Some(dialled) = pursuit.and_then(|pursuit| pursuit.dialled.as_mut()) {
            dialled.stream.write(bytes);
        }
    }

    /// Reads from both connections and tells the debt what has come.
    fn read_robot(&mut self) {
        let now = Instant::now();
        let Some(pursuit) = &mut self.pursuit else {
            return;
        };
        if let Some(link) = &mut self.link {
            let flushed = link.stream.flush();
            let received = link.read();
            // A POWER that was on its way before the robot had the questions is no answer.
            if pursuit.debt.waits_for_first_power() || link.stream.is_acknowledged() {
                let powers = DebtEvent::LinkPowers(received.powers);
                pursuit.debt.handle(powers, now);
            }
            let end = match received.end {
                None if !flushed => Some(DebtEvent::LinkBroken),
                end => end,
            };
            if let Some(end) = end {
                pursuit.debt.handle(end, now);
                self.link = None;
                self.dead_man.lose_link();
            }
        }
        let Some(dialled) = &mut pursuit.dialled else {
            return;
        };
        for event in dialled.progress() {
            if event == DebtEvent::InUse
                && let Some(link) = &self.link
                && !link.stream.is_acknowledged()
            {
                link.reset();
            }
            pursuit.debt.handle(event, now);
        }
    }

    /// Writes on the agent's link, with the questions that the robot answers when it has executed
    /// what stands before them.
    fn write_last_words(&mut self) {
        let pending = self.dead_man.take_pending();
        // Nobody else writes on it any more.
        self.dead_man.set_ready();
        let (Some(pending), Some(link)) = (pending, &mut self.link) else {
            return;
        };
        // What has come before the questions is no answer.
        link.read();
        let bytes = match self.dead_man.last_words() {
            [] => pending.bytes,
            _ => with_questions(pending.bytes),
        };
        // A broken link is noticed when it is read.
        link.stream.write(&bytes);
    }

    fn dial(&mut self) {
        let Some(route) = &self.route else {
            return;
        };
        let address = route.address;
        let who = if self.agent_gone { "is gone" } else { "hangs" };
        let Some(pursuit) = &mut self.pursuit else {
            return;
        };
        if !std::mem::replace(&mut pursuit.told, true) {
            self.record.append(&format!(
                "the agent {who} and the robot may be driving: dialling {address}"
            ));
        }
        let former = if self.link.is_none() {
            self.former
        } else {
            None
        };
        match DialledLink::begin(address, former) {
            Ok(dialled) => pursuit.dialled = Some(dialled),
            Err(_) => pursuit.debt.handle(DebtEvent::DialFailed, Instant::now()),
        }
    }

    fn end_pursuit(&mut self, outcome: Outcome) {
        let Some(pursuit) = &self.pursuit else {
            return;
        };
        let paid = matches!(outcome, Outcome::Executed | Outcome::Acknowledged);
        if paid {
            self.owed = false;
        }
        let seconds = pursuit.began.elapsed().as_secs_f64();
        let host = self.route.as_ref().map(|route| route.address.to_string());
        let host = host.unwrap_or_default();
        let line = match outcome {
            Outcome::Executed => format!("the robot has executed the stop after {seconds:.1} s"),
            Outcome::Acknowledged => format!(
                "the robot has acknowledged the stop after {seconds:.1} s, but answers no question"
            ),
            Outcome::GaveUp | Outcome::NothingOwed => format!(
                "gave up after {:.0} min: {host} could not be reached; if the robot drives, switch \
                 it off",
                seconds / 60.0
            ),
        };
        if pursuit.told {
            self.record.append(&line);
        }
        if pursuit.wrote {
            self.tell_agent();
        }
    }
}

impl Pursuit {
    fn poll(&mut self, link: Option<&RobotLink>) -> Option<DebtAct> {
        let dialled = self.dialled.as_ref();
        let acknowledged = Acknowledged {
            link: link.is_some_and(|link| link.stream.is_acknowledged()),
            dialled: dialled.is_some_and(|dialled| dialled.stream.is_acknowledged()),
        };
        self.debt.poll(acknowledged, Instant::now())
    }
}

fn with_questions(mut bytes: Vec<u8>) -> Vec<u8> {
    for _ in 0..QUESTIONS {
        bytes.extend_from_slice(&Command::PowerQuery.to_bytes());
    }
    bytes
}
