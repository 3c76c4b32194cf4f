//! The write half: sends to the robot.

use std::future::Future;
use std::io::{self, Write};
use std::net::TcpStream;
use std::pin::{Pin, pin};
use std::sync::Arc;
use std::task::{Context, Poll, Waker, ready};
use std::time::Duration;

use bytes::Bytes;
use tokio::io::{AsyncWrite, AsyncWriteExt};
use tokio::sync::watch;
use tokio::task::coop;
use tokio::time::{Instant, timeout_at};

use super::LinkError;
use super::pace::{Delays, Executes};
use super::send_queue::SendQueue;
use crate::socket_outq::{round_trip, unacknowledged};
use crate::wire::{Command, Report};

/// How long the program of a robot that answers no question may take to execute what its system has
/// acknowledged.
const UNSEEN_EXECUTION: Duration = Duration::from_secs(1);

/// How far the robot is with what it was sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Confirmation {
    /// Nothing is known of it.
    NotYet,
    /// The robot's system has acknowledged it; its program may still answer.
    Received,
    /// The robot's system has acknowledged it, long enough ago; its program answers no question.
    Acknowledged,
    /// The robot's program has executed it: it has answered a question that followed it.
    Executed,
}

#[derive(Debug, Clone, Copy)]
struct Asked {
    /// The last question; `None` if the robot answers none.
    question: Option<u64>,
    at: Instant,
}

/// The write half of a [`super::Session`]. Its owner is the only code that moves the robot.
///
/// [`Writer::send`] and [`Writer::say`] never block: data that the robot does not accept at once is
/// written while a caller waits for [`Writer::progress`] or [`Writer::written`].
///
/// If dropped without [`hang_up`](super::hang_up), for example by a panic, it sends its last words like
/// [`Writer::send_last_words`].
pub struct Writer {
    io: Box<dyn AsyncWrite + Send + Unpin>,
    /// A duplicate of the socket: writes without a runtime, in the middle of a panic.
    direct: Option<Arc<TcpStream>>,
    queue: SendQueue,
    last_words: Vec<Command>,
    /// During a login: the newest last words, in place of `last_words`.
    shared_words: Option<watch::Receiver<Vec<Command>>>,
    dead_after: Duration,
    /// The tracks may be on: a drop must send the last words.
    armed: bool,
    unflushed: bool,
    asked: Option<Asked>,
    /// A message was cut, or the rest of a cut one has changed, since [`Writer::progress`] last
    /// returned.
    rest_changed: bool,
}

impl Writer {
    pub(super) fn new(
        io: Box<dyn AsyncWrite + Send + Unpin>,
        direct: Option<Arc<TcpStream>>,
        dead_after: Duration,
    ) -> Writer {
        Writer {
            io,
            direct,
            queue: SendQueue::default(),
            last_words: vec![Command::STOP],
            shared_words: None,
            dead_after,
            armed: false,
            unflushed: false,
            asked: None,
            rest_changed: false,
        }
    }

    /// Makes a drop send the last words. Before the login is accepted the robot ignores them.
    pub(super) fn arm(&mut self) {
        self.armed = true;
    }

    /// Sets what is sent to the robot if all else fails: MOVE 0 0 by default; empty: nothing.
    pub fn set_last_words(&mut self, commands: Vec<Command>) {
        self.last_words = commands;
        self.shared_words = None;
    }

    /// The same, with commands that may change until they are sent.
    pub(super) fn share_last_words(&mut self, commands: watch::Receiver<Vec<Command>>) {
        self.shared_words = Some(commands);
    }

    /// The data that another process must write if this one no longer can: the rest of a partly
    /// written message, then whole messages.
    pub fn last_words(&self) -> (&[u8], Vec<u8>) {
        match &self.shared_words {
            Some(shared) => self.queue.after_replacing(&shared.borrow()),
            None => self.queue.after_replacing(&self.last_words),
        }
    }

    /// The socket, if there is one; there is none in virtual time.
    pub fn socket(&self) -> Option<Arc<TcpStream>> {
        self.direct.clone()
    }

    /// Sends commands that belong together, in one write if the robot accepts them at once, and
    /// never blocks. Queued MOVEs are replaced by a newer one. AUDIO is handled as in
    /// [`Writer::say`].
    ///
    /// # Errors
    /// [`LinkError::Dead`] when too much is queued, [`LinkError::Closed`] when the robot has closed
    /// the connection. Drop the session then.
    pub fn send(&mut self, commands: &[Command], now: Instant) -> Result<(), LinkError> {
        self.queue(commands, now)?;
        self.write_ready()
    }

    /// Like [`Writer::send`], but writes nothing yet: [`Writer::write_ready`] does.
    /// Fails with [`LinkError::Dead`] when too much is queued.
    pub fn queue(&mut self, commands: &[Command], now: Instant) -> Result<(), LinkError> {
        if self.queue.push(commands, now) {
            Ok(())
        } else {
            let after = self.dead_after;
            Err(LinkError::Dead { after })
        }
    }

    /// Sends samples for the speaker, at the speed of speech and after all commands. Returns
    /// `false`, and does nothing, when four seconds of them are queued.
    pub fn say(&mut self, samples: &Bytes) -> Result<bool, LinkError> {
        let taken = self.queue.say(samples);
        self.write_ready()?;
        Ok(taken)
    }

    /// Drops the samples of which no byte is written.
    pub fn drop_audio(&mut self) {
        self.queue.drop_audio();
    }

    /// Asks the robot's program whether it has executed everything that was sent so far: see
    /// [`Writer::confirmation`].
    pub fn ask(&mut self, now: Instant) -> Result<(), LinkError> {
        let question = self.queue.ask(now);
        self.asked = Some(Asked { question, at: now });
        self.write_ready()
    }

    /// Notes a report: one of the kind that is asked for may be an answer.
    pub fn answer(&mut self, report: &Report, now: Instant) {
        if self.queue.pace().is_answer(report, now) {
            let direct = self.direct.as_deref();
            let network = direct.and_then(round_trip).unwrap_or_default();
            let unacknowledged = direct.and_then(unacknowledged).unwrap_or_default();
            let acknowledged = self.queue.written().saturating_sub(unacknowledged as u64);
            self.queue.pace().answer(network, acknowledged, now);
        }
    }

    /// Whether a new setpoint waits, here or in the robot's queue.
    pub fn is_new_setpoint_waiting(&self, now: Instant) -> bool {
        self.queue.is_new_setpoint_waiting(now)
    }

    /// When the robot begins to execute the last setpoint, unless it has begun.
    pub fn move_begins(&self, now: Instant) -> Option<Instant> {
        self.queue.move_begins(now)
    }

    /// Whether the robot's program has executed everything that was sent before the last
    /// [`Writer::ask`].
    pub fn is_executed(&mut self) -> bool {
        let question = self.asked.and_then(|asked| asked.question);
        question.is_some_and(|question| self.queue.pace().is_answered(question))
    }

    /// How far the robot is with what was sent before the last [`Writer::ask`]. Costs a system call
    /// for a robot that answers no questions.
    pub fn confirmation(&mut self, now: Instant) -> Confirmation {
        let executes = self.executes(now);
        let Some(asked) = self.asked else {
            return Confirmation::NotYet;
        };
        if self.is_executed() {
            return Confirmation::Executed;
        }
        if matches!(executes, Executes::Every(_)) || !self.is_acknowledged() {
            return Confirmation::NotYet;
        }
        if executes == Executes::NoAnswer && now >= asked.at + UNSEEN_EXECUTION {
            Confirmation::Acknowledged
        } else {
            Confirmation::Received
        }
    }

    /// Whether the robot's program answers questions, and how fast it executes what it is sent.
    pub fn executes(&mut self, now: Instant) -> Executes {
        let pace = self.queue.pace();
        pace.poll(now);
        pace.executes()
    }

    /// The delays of what is sent; `None` before the first answer.
    pub fn delays(&mut self) -> Option<Delays> {
        self.queue.pace().delays()
    }

    /// Since when a robot that answers questions has left one unanswered for longer than it should.
    pub fn overdue_since(&mut self) -> Option<Instant> {
        self.queue.pace().overdue_since()
    }

    /// Whether everything urgent is written, and the robot's system has acknowledged it, as far as
    /// this computer's system can tell.
    fn is_acknowledged(&self) -> bool {
        if !self.queue.no_urgent_pending() {
            return false;
        }
        let direct = self.direct.as_deref();
        direct
            .and_then(unacknowledged)
            .is_none_or(|bytes| bytes == 0)
    }

    /// Writes the queued data. Returns only when the rest of a partly written message has changed,
    /// and with it [`Writer::last_words`]. Cancel-safe: messages are never cut or mixed.
    ///
    /// # Errors
    /// [`LinkError::Dead`] when a command was queued for `dead_after`, [`LinkError::Closed`] when
    /// the robot has closed the connection. Drop the session then.
    pub async fn progress(&mut self) -> Result<(), LinkError> {
        self.write_ready()?;
        while !self.rest_changed {
            if self.queue.is_empty() && !self.unflushed {
                return std::future::pending().await;
            }
            let check = self.next_check(Instant::now())?;
            let writing = std::future::poll_fn(|cx| self.poll_progress(cx));
            if let Ok(written) = timeout_at(check, writing).await {
                written.map_err(|error| LinkError::from_io(error, self.dead_after))?;
            }
        }
        self.rest_changed = false;
        Ok(())
    }

    /// Waits until the queue is empty, speech included. Cancel-safe.
    pub async fn written(&mut self) -> Result<(), LinkError> {
        self.write_ready()?;
        loop {
            let check = self.next_check(Instant::now())?;
            let writing = std::future::poll_fn(|cx| self.poll_written(cx));
            if let Ok(written) = timeout_at(check, writing).await {
                return written.map_err(|error| LinkError::from_io(error, self.dead_after));
            }
        }
    }

    /// Sends commands, and waits until the queue is empty.
    pub async fn write(&mut self, commands: &[Command]) -> Result<(), LinkError> {
        self.send(commands, Instant::now())?;
        self.written().await
    }

    /// Writes what waits for its pace, as far as the robot accepts it at once, and closes the write
    /// half. Nothing is sent any more, not even by a drop.
    pub(super) async fn shut_down(&mut self) {
        self.armed = false;
        self.queue.release_paced();
        let _ = self.write_ready();
        let _ = self.io.shutdown().await;
    }

    /// When to check again although the robot accepts no data.
    fn next_check(&self, now: Instant) -> Result<Instant, LinkError> {
        let after = self.dead_after;
        let dead = self.queue.waits_since().unwrap_or(now) + after;
        if dead <= now {
            return Err(LinkError::Dead { after });
        }
        let offer = self.queue.next_offer(now);
        Ok(offer.map_or(dead, |offer| offer.min(dead)))
    }

    /// Ready when everything is written. Also pending while speech must wait: poll again then.
    fn poll_written(&mut self, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        loop {
            let now = Instant::now();
            let offer = self.offer(now);
            if offer.is_empty() {
                break;
            }
            let count = ready!(Pin::new(&mut self.io).poll_write(cx, &offer))?;
            self.advance(count, now)?;
        }
        if self.unflushed {
            ready!(Pin::new(&mut self.io).poll_flush(cx))?;
            self.unflushed = false;
        }
        if self.queue.is_empty() {
            Poll::Ready(Ok(()))
        } else {
            Poll::Pending
        }
    }

    /// Like [`Writer::poll_written`], but ready as soon as the rest of a message has changed.
    fn poll_progress(&mut self, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        match self.poll_written(cx) {
            Poll::Pending if self.rest_changed => Poll::Ready(Ok(())),
            polled => polled,
        }
    }

    fn offer(&mut self, now: Instant) -> Bytes {
        let direct = self.direct.as_deref();
        self.queue.offer(now, || direct.and_then(unacknowledged))
    }

    fn advance(&mut self, count: usize, now: Instant) -> io::Result<()> {
        if count == 0 {
            return Err(io::ErrorKind::WriteZero.into());
        }
        self.unflushed = true;
        let cut = self.queue.is_message_cut();
        self.queue.advance(count, now);
        self.rest_changed |= cut || self.queue.is_message_cut();
        Ok(())
    }

    /// Writes the queued data that the robot accepts at once.
    pub fn write_ready(&mut self) -> Result<(), LinkError> {
        let after = self.dead_after;
        match poll_once(|cx| self.poll_written(cx)) {
            Err(error) if error.kind() != io::ErrorKind::WouldBlock => {
                Err(LinkError::from_io(error, after))
            }
            _ => Ok(()),
        }
    }

    /// Sends the last words without blocking, best effort: for panics and drops, inside a runtime
    /// or not. A partly written message is finished first; other queued messages are dropped: they
    /// might be motion.
    pub fn send_last_words(&mut self) {
        if let Some(shared) = &self.shared_words {
            self.last_words.clone_from(&shared.borrow());
        }
        let now = Instant::now();
        self.queue.replace_unstarted(&self.last_words, now);
        while !self.queue.no_urgent_pending() {
            let offer = self.offer(now);
            match self.write_now(&offer) {
                Ok(count @ 1..) => self.queue.advance(count, now),
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Ok(0) | Err(_) => return,
            }
        }
        if self.direct.is_none() {
            let _ = poll_once(|cx| Pin::new(&mut self.io).poll_flush(cx));
        }
    }

    fn write_now(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match &self.direct {
            // Shares the non-blocking mode of the socket it was duplicated from.
            Some(direct) => (&mut &**direct).write(bytes),
            None => poll_once(|cx| Pin::new(&mut self.io).poll_write(cx, bytes)),
        }
    }
}

/// Polls once, outside of any task's budget.
fn poll_once<T>(
    mut poll: impl FnMut(&mut Context<'_>) -> Poll<io::Result<T>> + Unpin,
) -> io::Result<T> {
    let future = pin!(coop::unconstrained(std::future::poll_fn(|cx| poll(cx))));
    match future.poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(result) => result,
        Poll::Pending => Err(io::ErrorKind::WouldBlock.into()),
    }
}

impl Drop for Writer {
    fn drop(&mut self) {
        if self.armed {
            self.send_last_words();
        }
    }
}

impl std::fmt::Debug for Writer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Writer").finish_non_exhaustive()
    }
}
