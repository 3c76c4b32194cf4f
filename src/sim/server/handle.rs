//! The handle with which tests and the command line observe and change a running simulator, and the
//! bounded journal of executed commands.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

use parking_lot::Mutex;
use tokio::sync::{mpsc, watch};
use wire::{Command, Report};

use super::connection::Transport;
use crate::body::trace::{Trace, TraceEventKind};
use crate::body::{Robot, State};
use crate::faults::Fault;
use crate::geometry::{Point, Pose};
use crate::world::World;

/// Capacity of the request queue; further requests are dropped with a warning.
const MAX_REQUESTS: usize = 256;

pub(crate) enum Request {
    Inject(Report),
    DisconnectAll,
    Begin(Fault),
    ClearFaults,
    Connect(Box<dyn Transport>),
    Alter(Box<dyn FnOnce(&mut Robot) + Send>),
}

/// Observes and changes a running simulator. Cheap to clone; no call blocks.
#[derive(Clone)]
pub struct Handle {
    requests: mpsc::Sender<Request>,
    muted: watch::Sender<bool>,
    state: watch::Receiver<State>,
    journal: Arc<Mutex<Journal>>,
    heard: watch::Receiver<usize>,
    trace: Arc<Mutex<Trace>>,
    world: Arc<World>,
}

pub(crate) struct Ends {
    pub(crate) muted: watch::Receiver<bool>,
    pub(crate) state: watch::Sender<State>,
    /// Hold its guard only while reading or writing entries.
    pub(crate) journal: Arc<Mutex<Journal>>,
    pub(crate) heard: watch::Sender<usize>,
}

/// Creates a handle, the queue of its requests, and the server's other ends of its channels.
pub(crate) fn open(robot: &Robot) -> (Handle, mpsc::Receiver<Request>, Ends) {
    let (requests, requests_end) = mpsc::channel(MAX_REQUESTS);
    let (muted, muted_end) = watch::channel(false);
    let (state_end, state) = watch::channel(robot.state());
    let (heard_end, heard) = watch::channel(0);
    let journal = Arc::new(Mutex::new(Journal::default()));
    let handle = Handle {
        requests,
        muted,
        state,
        journal: journal.clone(),
        heard,
        trace: robot.trace_cell(),
        world: Arc::new(robot.world().clone()),
    };
    let ends = Ends {
        muted: muted_end,
        state: state_end,
        journal,
        heard: heard_end,
    };
    (handle, requests_end, ends)
}

impl Handle {
    /// Returns the robot's state, at most one physics step old.
    pub fn state(&self) -> State {
        self.state.borrow().clone()
    }

    /// Waits until the state satisfies `wanted`. Never returns if the server ends first, so use a
    /// timeout.
    pub async fn wait_state(&self, wanted: impl Fn(&State) -> bool) -> State {
        let mut state = self.state.clone();
        if let Ok(state) = state.wait_for(|state| wanted(state)).await {
            return state.clone();
        }
        std::future::pending().await
    }

    /// Returns the commands that the robot has executed, oldest first; of very many, only the
    /// newest. Those of a client that may not command it are here too, although without effect.
    pub fn heard(&self) -> Vec<ReceivedCommand> {
        self.heard_since(0)
    }

    /// Returns the executed commands, starting with this index.
    pub fn heard_since(&self, index: usize) -> Vec<ReceivedCommand> {
        self.journal.lock().since(index).cloned().collect()
    }

    /// Returns the number of commands executed so far, which is the index of the next one.
    pub fn heard_count(&self) -> usize {
        self.journal.lock().count()
    }

    /// Waits for the first command from index `from` on that satisfies `wanted`, and returns its
    /// index. Never returns if the server ends first, so use a timeout.
    pub async fn wait_heard(&self, from: usize, wanted: impl Fn(&Command) -> bool) -> usize {
        let mut heard = self.heard.clone();
        loop {
            heard.mark_unchanged();
            let found = self
                .journal
                .lock()
                .since(from)
                .find(|h| wanted(&h.command))
                .map(|h| h.index);
            if let Some(index) = found {
                return index;
            }
            if heard.changed().await.is_err() {
                std::future::pending::<()>().await;
            }
        }
    }

    /// Returns the robot's world, in its initial state.
    pub fn world(&self) -> &World {
        &self.world
    }

    /// Returns a copy of the trace so far, for maps and tests.
    pub fn trace(&self) -> Trace {
        self.look_back(Trace::clone)
    }

    /// Reads the trace without copying it. The simulation is blocked meanwhile.
    pub fn look_back<T>(&self, look: impl FnOnce(&Trace) -> T) -> T {
        look(&self.trace.lock())
    }

    /// Adds a note to the trace, at the robot's current time and place.
    pub fn note(&self, text: impl Into<String>) {
        let mut trace = self.trace.lock();
        trace.add_event(TraceEventKind::Note(text.into()));
    }

    /// Puts a ball at a place, at rest; `index` is its index in the world's list.
    pub fn put_ball(&self, index: usize, place: Point) {
        self.alter(move |robot| robot.put_ball(index, place));
    }

    /// Sets the battery's level, percent; the change is reported immediately.
    pub fn set_battery(&self, percent: f64) {
        self.alter(move |robot| robot.set_battery(percent));
    }

    /// Multiplies all light of the world by `gain`, 0..=100.
    pub fn set_light(&self, gain: f64) {
        self.alter(move |robot| robot.set_light(gain));
    }

    /// Plays a tone of this level, dBFS, at the microphone for `time`.
    pub fn disturb(&self, dbfs: f64, time: Duration) {
        self.alter(move |robot| robot.disturb(dbfs, time));
    }

    /// Breaks or repairs the charger; with a broken one the robot docks but does not charge.
    pub fn set_charging_broken(&self, broken: bool) {
        self.alter(move |robot| robot.set_charger_works(!broken));
    }

    /// Moves the robot to a pose. At the station's dock pose it is docked.
    pub fn place(&self, pose: Pose) {
        self.alter(move |robot| robot.place(pose));
    }

    /// Hides the station, so that BASE_FIND ends with BASE_NOT_FOUND, or shows it again.
    pub fn hide_station(&self, hidden: bool) {
        self.alter(move |robot| robot.set_beacon(!hidden));
    }

    /// Sends any report to the connected user, whether or not it is true.
    pub fn inject(&self, report: Report) {
        self.request(Request::Inject(report));
    }

    /// Closes all connections without a message.
    pub fn disconnect_all(&self) {
        self.request(Request::DisconnectAll);
    }

    /// Adds a fault; its times count from now.
    pub fn begin(&self, fault: Fault) {
        self.request(Request::Begin(fault));
    }

    /// Ends all faults; a connection that is already dead stays dead.
    pub fn clear_faults(&self) {
        self.request(Request::ClearFaults);
    }

    /// Mutes or unmutes the robot. A muted robot neither reads, writes nor closes its connections,
    /// but keeps driving. It reads the pending commands when it is unmuted.
    pub fn mute(&self, muted: bool) {
        self.muted.send_replace(muted);
    }

    /// Serves a client over a byte stream other than a socket, such as an in-memory pipe.
    pub fn connect(&self, transport: impl Transport) {
        self.request(Request::Connect(Box::new(transport)));
    }

    fn alter(&self, alter: impl FnOnce(&mut Robot) + Send + 'static) {
        self.request(Request::Alter(Box::new(alter)));
    }

    fn request(&self, request: Request) {
        if self.requests.try_send(request).is_err() {
            tracing::warn!(target: "spykee::sim", "the simulator does not run or is overrun");
        }
    }
}

/// Maximum number of entries; older ones are dropped.
const MAX_ENTRIES: usize = 16_384;
/// Maximum total of payload bytes; older entries are dropped.
const MAX_BYTES: usize = 4 * 1024 * 1024;

/// One command that the robot received and executed.
#[derive(Debug, Clone, PartialEq)]
pub struct ReceivedCommand {
    /// Index of the command since the start, from 0.
    pub index: usize,
    /// Time since the start of the server at which it was executed.
    pub at: Duration,
    /// Time since the start of the server at which it was received; earlier than `at` only on a
    /// robot that executes commands slowly.
    pub received: Duration,
    /// Index of the read, counted over all connections. Commands of one client write share it,
    /// unless the network split that write.
    pub write: u64,
    /// Index of the connection, from 0.
    pub client: u64,
    /// The command as received.
    pub command: Command,
}

#[derive(Debug, Default)]
pub(crate) struct Journal {
    entries: VecDeque<ReceivedCommand>,
    next: usize,
    bytes: usize,
}

impl Journal {
    pub(crate) fn add(&mut self, at: Duration, heard: ReceivedCommand) {
        self.bytes += weight(&heard.command);
        self.entries.push_back(ReceivedCommand {
            index: self.next,
            at,
            ..heard
        });
        self.next += 1;
        while self.entries.len() > MAX_ENTRIES || self.bytes > MAX_BYTES {
            let Some(oldest) = self.entries.pop_front() else {
                break;
            };
            self.bytes -= weight(&oldest.command);
        }
    }

    /// Returns the entries from an index on, as far as they have been kept.
    pub(crate) fn since(&self, index: usize) -> impl Iterator<Item = &ReceivedCommand> {
        let forgotten = self.next - self.entries.len();
        self.entries.iter().skip(index.saturating_sub(forgotten))
    }

    pub(crate) fn count(&self) -> usize {
        self.next
    }
}

/// Returns the number of payload bytes that a command keeps in memory.
fn weight(command: &Command) -> usize {
    match command {
        Command::Audio(payload)
        | Command::Mute(payload)
        | Command::ConfigSet(payload)
        | Command::MotorSpeed(payload) => payload.len(),
        Command::File(chunk) => chunk.content().len(),
        Command::Unknown(packet) => packet.payload.len(),
        _ => 0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytes::Bytes;

    fn heard(command: Command) -> ReceivedCommand {
        ReceivedCommand {
            index: 0,
            at: Duration::ZERO,
            received: Duration::ZERO,
            write: 0,
            client: 0,
            command,
        }
    }

    #[test]
    fn the_journal_drops_the_oldest_entries_and_keeps_counting() {
        let mut journal = Journal::default();
        for _ in 0..MAX_ENTRIES + 10 {
            journal.add(Duration::ZERO, heard(Command::None));
        }
        assert_eq!(journal.count(), MAX_ENTRIES + 10);
        assert_eq!(journal.since(0).next().unwrap().index, 10);
        assert_eq!(journal.since(MAX_ENTRIES).count(), 10);
        assert_eq!(journal.since(usize::MAX).count(), 0);
    }

    #[test]
    fn long_payloads_do_not_accumulate() {
        let mut journal = Journal::default();
        for _ in 0..1000 {
            let payload = Bytes::from(vec![0; 60_000]);
            journal.add(Duration::ZERO, heard(Command::Audio(payload)));
        }
        assert!(journal.bytes <= MAX_BYTES && journal.since(0).count() > 10);
    }
}
