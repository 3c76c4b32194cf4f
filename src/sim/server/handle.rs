//! The handle by which tests and the command line observe a running simulator and change it.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::sync::{mpsc, watch};

use crate::wire::{Command, Report};

use super::connection::Transport;
use super::journal::{Heard, Journal};
use crate::sim::body::robot::Robot;
use crate::sim::body::state::State;
use crate::sim::body::trace::{Trace, What};
use crate::sim::faults::fault::Fault;
use crate::sim::geometry::{Point, Pose};
use crate::sim::world::document::World;

/// Requests that may wait for the server; more are dropped with a warning.
const MAX_REQUESTS: usize = 256;

/// What a handle asks of the server.
pub(crate) enum Request {
    Battery(f64),
    ChargerWorks(bool),
    Place(Pose),
    Beacon(bool),
    Inject(Report),
    Cut,
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

/// The server's ends of a handle.
pub(crate) struct Ends {
    pub(crate) muted: watch::Receiver<bool>,
    pub(crate) state: watch::Sender<State>,
    pub(crate) journal: Arc<Mutex<Journal>>,
    pub(crate) heard: watch::Sender<usize>,
}

/// A handle, the requests that come through it, and the server's other ends of it.
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

/// The journal, locked for as long as it takes to read or write an entry.
pub(crate) fn lock(journal: &Mutex<Journal>) -> MutexGuard<'_, Journal> {
    journal.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Handle {
    /// The robot as it is now, at most one physics step old.
    pub fn state(&self) -> State {
        self.state.borrow().clone()
    }

    /// Waits until the state is as wanted. Waits for ever if the server ends first: set a limit.
    pub async fn wait_state(&self, wanted: impl Fn(&State) -> bool) -> State {
        let mut state = self.state.clone();
        let found = state
            .wait_for(|state| wanted(state))
            .await
            .map(|state| state.clone());
        match found {
            Ok(state) => state,
            Err(_) => std::future::pending().await,
        }
    }

    /// What the robot has heard, oldest first; of very many commands only the newest.
    pub fn heard(&self) -> Vec<Heard> {
        self.heard_since(0)
    }

    /// What the robot has heard from the command with this index on.
    pub fn heard_since(&self, index: usize) -> Vec<Heard> {
        lock(&self.journal).since(index).cloned().collect()
    }

    /// How many commands the robot has heard: the index of the next one.
    pub fn heard_count(&self) -> usize {
        lock(&self.journal).count()
    }

    /// Waits for the first wanted command whose index is at least `from`; its index. Waits for
    /// ever if the server ends first: set a limit.
    pub async fn wait_heard(&self, from: usize, wanted: impl Fn(&Command) -> bool) -> usize {
        let mut heard = self.heard.clone();
        loop {
            heard.mark_unchanged();
            let found = lock(&self.journal)
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

    /// The place that the robot lives in, as it was at first.
    pub fn world(&self) -> &World {
        &self.world
    }

    /// What the robot did so far, for its picture and for tests.
    pub fn trace(&self) -> Trace {
        self.look_back(Trace::clone)
    }

    /// Reads the trace without copying it. The robot waits meanwhile.
    pub fn look_back<T>(&self, look: impl FnOnce(&Trace) -> T) -> T {
        look(&self.trace.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Writes something down for the picture of the run, here and now.
    pub fn note(&self, text: impl Into<String>) {
        let mut trace = self.trace.lock().unwrap_or_else(PoisonError::into_inner);
        trace.note(What::Note(text.into()));
    }

    /// Puts a ball somewhere, at rest; the number is its place in the world's list.
    pub fn put_ball(&self, index: usize, place: Point) {
        self.request(Request::Alter(Box::new(move |robot| {
            robot.put_ball(index, place)
        })));
    }

    /// Sets the battery's level, percent; the change is reported at once.
    pub fn set_battery(&self, percent: f64) {
        self.request(Request::Battery(percent));
    }

    /// Makes all light so many times as bright as the world says, 0..=100.
    pub fn set_light(&self, gain: f64) {
        self.request(Request::Alter(Box::new(move |robot| robot.set_light(gain))));
    }

    /// A tone of this level, dBFS, at the microphone for so long.
    pub fn disturb(&self, dbfs: f64, time: Duration) {
        self.request(Request::Alter(Box::new(move |robot| {
            robot.disturb(dbfs, time);
        })));
    }

    /// With a broken charger the robot docks and does not charge.
    pub fn set_charging_broken(&self, broken: bool) {
        self.request(Request::ChargerWorks(!broken));
    }

    /// Puts the robot somewhere else. On the station's dock pose it is docked.
    pub fn place(&self, pose: Pose) {
        self.request(Request::Place(pose));
    }

    /// A hidden station cannot be found: BASE_FIND ends with BASE_NOT_FOUND.
    pub fn hide_station(&self, hidden: bool) {
        self.request(Request::Beacon(!hidden));
    }

    /// Sends the connected user any report, true or not.
    pub fn inject(&self, report: Report) {
        self.request(Request::Inject(report));
    }

    /// Closes all connections without a message.
    pub fn cut(&self) {
        self.request(Request::Cut);
    }

    /// Adds a fault; its times count from now.
    pub fn begin(&self, fault: Fault) {
        self.request(Request::Begin(fault));
    }

    /// Ends all faults; a connection that is dead already stays so.
    pub fn clear_faults(&self) {
        self.request(Request::ClearFaults);
    }

    /// A mute robot neither reads nor writes, and does not close; what it did not read, it hears
    /// when it is mute no more. It drives on.
    pub fn mute(&self, muted: bool) {
        self.muted.send_replace(muted);
    }

    /// Serves a client over a byte stream other than a socket, such as a pipe in memory.
    pub fn connect(&self, transport: impl Transport) {
        self.request(Request::Connect(Box::new(transport)));
    }

    fn request(&self, request: Request) {
        if self.requests.try_send(request).is_err() {
            tracing::warn!(target: "spykee::sim", "the simulator does not run or is overrun");
        }
    }
}
