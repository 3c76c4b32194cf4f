//! The attempts to connect, and the pauses between them.

use std::future::Future;
use std::pin::Pin;
use std::time::Duration;

use rand::SeedableRng;
use rand::rngs::StdRng;
use tokio::sync::watch;
use tokio::time::{Instant, Sleep, sleep};

use crate::link::{AcceptedLogin, LinkError, Options, Session, Supervision};
use crate::rate_limit::Backoff;
use crate::robot_socket::FormerLink;
use crate::wire::Command;

type Connecting = Pin<Box<dyn Future<Output = Result<Session, LinkError>> + Send>>;

/// The longest pause between two attempts while a stop is owed.
const HURRIED_PAUSE: Duration = Duration::from_millis(250);
/// After so many hurried attempts in a row, each fourth one has all the time of the config.
const MANY_ATTEMPTS: u32 = 40;
const PATIENT_EVERY: u32 = 4;
/// An attempt that began before a stop was owed, and takes longer than this, is given up for another.
const HURRIED_ATTEMPT: Duration = Duration::from_secs(1);

/// Makes one attempt to connect and log in, over any transport, under this supervision (see
/// [`connect`](crate::link::connect)).
pub type Connector = Box<dyn FnMut(Supervision) -> Connecting + Send>;

pub(super) enum ConnectionEvent {
    /// Connected and logged in; no further attempt is made until [`Connection::reconnect`].
    Up(Box<Session>),
    /// The robot has accepted the login of an attempt; `None`: that link has ended.
    Accepted(Option<AcceptedLogin>),
    /// An attempt has failed; another will be made.
    Failed(LinkError),
}

enum State {
    Pausing(Pin<Box<Sleep>>),
    Connecting(Attempt),
    Connected,
}

struct Attempt {
    connecting: Connecting,
    began: Instant,
    /// Once the robot has accepted the login.
    accepted: watch::Receiver<Option<AcceptedLogin>>,
}

pub(super) struct Connection {
    connector: Connector,
    state: State,
    backoff: Backoff,
    rng: StdRng,
    last_words: watch::Sender<Vec<Command>>,
    released: bool,
    hurried: bool,
    /// Attempts in a row while hurried.
    hurried_attempts: u32,
    /// The last link that the robot had accepted.
    former: Option<FormerLink>,
}

impl Connection {
    pub(super) fn new(
        mut connector: Connector,
        options: &Options,
        seed: u64,
        last_words: Vec<Command>,
    ) -> Connection {
        let last_words = watch::Sender::new(last_words);
        let supervision = Supervision::new(last_words.subscribe());
        let state = begin_attempt(&mut connector, supervision);
        Connection {
            connector,
            state,
            backoff: Backoff::new(options.first_pause, options.longest_pause),
            rng: StdRng::seed_from_u64(seed),
            last_words,
            released: false,
            hurried: false,
            hurried_attempts: 0,
            former: None,
        }
    }

    /// Stops attempts to connect while the link is released, or resumes them; an open link stays
    /// open.
    pub(super) fn set_released(&mut self, released: bool) {
        if released == self.released {
            return;
        }
        self.released = released;
        if matches!(self.state, State::Connecting(_) | State::Pausing(_)) {
            self.backoff.reset();
            self.state = State::Pausing(Box::pin(sleep(Duration::ZERO)));
        }
    }

    /// Whether a stop is owed, or the robot must be sent home: attempts then follow each other with
    /// short pauses.
    pub(super) fn set_hurried(&mut self, hurried: bool) {
        let begins = hurried && !self.hurried;
        self.hurried = hurried;
        if !begins || self.released {
            return;
        }
        match &self.state {
            State::Pausing(pause) if pause.deadline() > Instant::now() + HURRIED_PAUSE => {
                self.state = State::Pausing(Box::pin(sleep(HURRIED_PAUSE)));
            }
            State::Connecting(attempt)
                if attempt.accepted.borrow().is_none()
                    && attempt.began.elapsed() > HURRIED_ATTEMPT =>
            {
                self.state = State::Pausing(Box::pin(sleep(Duration::ZERO)));
            }
            _ => {}
        }
    }

    /// Sets the last words of attempts to connect, also of one in progress.
    pub(super) fn set_last_words(&mut self, last_words: Vec<Command>) {
        self.last_words.send_replace(last_words);
    }

    /// Whether the robot has accepted the login of an attempt in progress.
    pub(super) fn is_logging_in(&self) -> bool {
        matches!(&self.state, State::Connecting(attempt) if attempt.accepted.borrow().is_some())
    }

    /// Leaves a login in progress to the guardian: dropped, it would send its last words before the
    /// robot's first POWER; the robot would disconnect, and might drive on.
    pub(super) fn abandon_login(&mut self) {
        if self.is_logging_in() {
            let none = State::Pausing(Box::pin(sleep(Duration::ZERO)));
            std::mem::forget(std::mem::replace(&mut self.state, none));
        }
    }

    pub(super) async fn next(&mut self) -> ConnectionEvent {
        loop {
            match &mut self.state {
                State::Pausing(_) if self.released => std::future::pending().await,
                State::Pausing(pause) => pause.await,
                State::Connecting(attempt) => {
                    let result = tokio::select! {
                        biased;
                        result = &mut attempt.connecting => result,
                        Ok(()) = attempt.accepted.changed() => {
                            let accepted = attempt.accepted.borrow().clone();
                            return ConnectionEvent::Accepted(accepted);
                        }
                    };
                    if let Some(login) = &*attempt.accepted.borrow() {
                        self.former = FormerLink::new(&login.socket, login.peer);
                    }
                    return match result {
                        Ok(session) => {
                            self.state = State::Connected;
                            self.backoff.reset();
                            ConnectionEvent::Up(Box::new(session))
                        }
                        Err(error) => {
                            self.schedule_reconnect();
                            ConnectionEvent::Failed(error)
                        }
                    };
                }
                State::Connected => std::future::pending().await,
            }
            let supervision = self.supervision();
            self.state = begin_attempt(&mut self.connector, supervision);
        }
    }

    fn supervision(&mut self) -> Supervision {
        self.hurried_attempts = if self.hurried {
            self.hurried_attempts.saturating_add(1)
        } else {
            0
        };
        // A robot that takes long to answer must have the time at last.
        let patient = self.hurried_attempts > MANY_ATTEMPTS
            && self.hurried_attempts.is_multiple_of(PATIENT_EVERY);
        let mut supervision = Supervision::new(self.last_words.subscribe());
        supervision.hurried = self.hurried && !patient;
        supervision.former = self.former;
        supervision
    }

    /// The open link has ended, if there was one: reconnects after a pause.
    pub(super) fn reconnect(&mut self) {
        if matches!(self.state, State::Connected) {
            self.schedule_reconnect();
        }
    }

    fn schedule_reconnect(&mut self) {
        let pause = self.backoff.next(&mut self.rng);
        let pause = if self.hurried {
            pause.min(HURRIED_PAUSE)
        } else {
            pause
        };
        self.state = State::Pausing(Box::pin(sleep(pause)));
    }
}

fn begin_attempt(connector: &mut Connector, supervision: Supervision) -> State {
    let accepted = supervision.accepted();
    let connecting = connector(supervision);
    State::Connecting(Attempt {
        connecting,
        began: Instant::now(),
        accepted,
    })
}

#[cfg(test)]
mod tests {
    use std::net::SocketAddr;

    use tokio::io::{AsyncWriteExt, DuplexStream};
    use tokio::sync::mpsc;

    use super::*;
    use crate::link;
    use crate::wire::{Accepted, Login, Power, Report};

    /// A connection to robots that accept each login, and the robots' ends of its links.
    fn connection() -> (Connection, mpsc::UnboundedReceiver<DuplexStream>) {
        let (connect, robots) = mpsc::unbounded_channel();
        let connector: Connector = Box::new(move |supervision| {
            let (ours, mut robot) = tokio::io::duplex(1 << 16);
            let connect = connect.clone();
            Box::pin(async move {
                for answer in [accepted(), Report::Power(POWER)] {
                    robot.write_all(&answer.to_bytes()).await.unwrap();
                }
                connect.send(robot).unwrap();
                let (reader, writer) = tokio::io::split(ours);
                let peer = SocketAddr::from(([127, 0, 0, 1], 9000));
                let login = Login::new("admin", "admin");
                let options = Options::default();
                link::open(reader, writer, peer, &login, supervision, &options).await
            })
        });
        let connection = Connection::new(connector, &Options::default(), 1, vec![Command::STOP]);
        (connection, robots)
    }

    const POWER: Power = Power {
        percent: 80,
        charging: false,
    };

    fn accepted() -> Report {
        Report::Accepted(Accepted {
            uid: "SPYKEE0001".to_owned(),
            name: "test".to_owned(),
            place: "test".to_owned(),
            firmware: "1.0.22".to_owned(),
            docked: false,
            tail: bytes::Bytes::new(),
        })
    }

    #[tokio::test(start_paused = true)]
    async fn a_link_that_has_ended_is_dialled_again_after_a_pause() {
        let (mut connection, mut robots) = connection();
        assert!(matches!(connection.next().await, ConnectionEvent::Up(_)));
        let _robot = robots.recv().await.unwrap();
        connection.reconnect();
        connection.reconnect();
        assert!(robots.try_recv().is_err(), "an attempt has begun");
        assert!(matches!(connection.next().await, ConnectionEvent::Up(_)));
    }
}
