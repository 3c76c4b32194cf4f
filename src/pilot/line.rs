//! The read half of the link in all its states: connecting, connected, ending, pausing.

use std::future::Future;
use std::net::SocketAddr;
use std::pin::Pin;
use std::time::Duration;

use rand::SeedableRng;
use rand::rngs::StdRng;
use tokio::sync::watch;
use tokio::time::{Sleep, sleep};
use tracing::debug;

use crate::link::{
    self, Backoff, Delivery, LinkError, Options, Reader, Received, Session, Supervision, Writer,
};
use crate::wire::{Accepted, Command, Power, Report};

type Dialling = Pin<Box<dyn Future<Output = Result<Session, LinkError>> + Send>>;

/// How long the last words of an ended link may take to be acknowledged.
const DELIVERY_TIMEOUT: Duration = Duration::from_millis(500);

type LastDelivery = Pin<Box<dyn Future<Output = Delivery> + Send>>;

/// Makes one attempt to connect and log in, over any transport, under this supervision (see
/// [`connect`](crate::link::connect)).
pub type Dial = Box<dyn FnMut(Supervision) -> Dialling + Send>;

/// A session without its reader, which stays with the line.
pub(super) struct NewSession {
    pub(super) accepted: Accepted,
    pub(super) power: Power,
    pub(super) peer: SocketAddr,
    pub(super) early: Vec<Report>,
    pub(super) writer: Writer,
}

/// An event of the line.
pub(super) enum LinkEvent {
    /// Connected and logged in.
    Up(Box<NewSession>),
    /// Something from the robot.
    Received(Received),
    /// An open link is lost.
    Lost(LinkError),
    /// An attempt has failed; another will be made.
    Failed(LinkError),
}

enum State {
    /// The last words are being delivered.
    Delivering(LastDelivery),
    Pausing(Pin<Box<Sleep>>),
    Dialling(Dialling),
    Up(Reader),
}

/// The line; see the module.
pub(super) struct Line {
    dial: Dial,
    state: State,
    backoff: Backoff,
    rng: StdRng,
    last_words: watch::Sender<Vec<Command>>,
    released: bool,
}

impl Line {
    /// Begins to connect at once.
    pub(super) fn new(
        mut dial: Dial,
        options: &Options,
        seed: u64,
        last_words: Vec<Command>,
    ) -> Line {
        let last_words = watch::Sender::new(last_words);
        let state = attempt(&mut dial, &last_words);
        Line {
            dial,
            state,
            backoff: Backoff::new(options),
            rng: StdRng::seed_from_u64(seed),
            last_words,
            released: false,
        }
    }

    /// Stops attempts to connect while the link is released, or resumes them; an open link stays
    /// open.
    pub(super) fn set_released(&mut self, released: bool) {
        if released == self.released {
            return;
        }
        self.released = released;
        if matches!(self.state, State::Dialling(_) | State::Pausing(_)) {
            self.backoff.reset();
            self.state = State::Pausing(Box::pin(sleep(Duration::ZERO)));
        }
    }

    /// Sets the last words of attempts to connect, also of one in progress.
    pub(super) fn set_last_words(&mut self, last_words: Vec<Command>) {
        self.last_words.send_replace(last_words);
    }

    /// The next event. Cancel-safe.
    pub(super) async fn next(&mut self) -> LinkEvent {
        loop {
            match &mut self.state {
                State::Delivering(delivery) => {
                    debug!("at the end of a link: {}", delivery.await);
                    self.redial();
                    continue;
                }
                State::Pausing(_) if self.released => std::future::pending().await,
                State::Pausing(pause) => pause.await,
                State::Dialling(dialling) => {
                    let result = dialling.await;
                    return self.dialled(result);
                }
                State::Up(reader) => {
                    return match reader.receive().await {
                        Ok(received) => LinkEvent::Received(received),
                        Err(error) => LinkEvent::Lost(error),
                    };
                }
            }
            self.state = attempt(&mut self.dial, &self.last_words);
        }
    }

    fn dialled(&mut self, result: Result<Session, LinkError>) -> LinkEvent {
        match result {
            Ok(session) => self.up(session),
            Err(error) => {
                self.redial();
                LinkEvent::Failed(error)
            }
        }
    }

    /// Ends an open link whose last words are with its writer, and reconnects after a pause.
    pub(super) fn hang_up(&mut self, writer: Option<Writer>) {
        let none: LastDelivery = Box::pin(std::future::ready(Delivery::Offline));
        match (
            std::mem::replace(&mut self.state, State::Delivering(none)),
            writer,
        ) {
            (State::Up(reader), Some(writer)) => {
                let delivery = link::close_gracefully(reader, writer, DELIVERY_TIMEOUT);
                self.state = State::Delivering(Box::pin(delivery));
            }
            (State::Up(_), None) => self.redial(),
            (other, _) => self.state = other,
        }
    }

    /// The reader of an open link.
    pub(super) fn into_reader(self) -> Option<Reader> {
        match self.state {
            State::Up(reader) => Some(reader),
            _ => None,
        }
    }

    fn up(&mut self, session: Session) -> LinkEvent {
        let Session {
            accepted,
            power,
            peer,
            early,
            reader,
            writer,
        } = session;
        self.state = State::Up(reader);
        self.backoff.reset();
        LinkEvent::Up(Box::new(NewSession {
            accepted,
            power,
            peer,
            early,
            writer,
        }))
    }

    fn redial(&mut self) {
        let pause = self.backoff.next(&mut self.rng);
        self.state = State::Pausing(Box::pin(sleep(pause)));
    }
}

/// Begins an attempt to connect.
fn attempt(dial: &mut Dial, last_words: &watch::Sender<Vec<Command>>) -> State {
    State::Dialling(dial(Supervision::new(last_words.subscribe())))
}
