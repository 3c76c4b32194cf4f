//! The run's side: takes errands and does them.

use std::io;
use std::path::Path;
use std::sync::atomic::{AtomicU16, Ordering};
use std::time::Duration;

use tokio::net::{UnixListener, UnixStream};
use tokio::sync::{mpsc, oneshot, watch};
use tokio::task::JoinSet;
use tokio::time::{Instant, sleep, timeout};
use tokio_util::sync::CancellationToken;
use tracing::{debug, info};

use super::errand::{Answer, Change, Errand, Listed, MAX_SPEECH, Next, Overview};
use super::folder::{Bound, Folder};
use super::pipe::Pipe;
use crate::agent::{Docked, MemberState, Roster, Seat, SeatError};
use crate::pilot::{LinkState, Reactions, Status};
use crate::robot::channel::{Crew, Request, Role};
use crate::robot::{BehaviourId, Intent, Pictures, Priority, Streams, Use};
use crate::safety::WatchdogState;
use crate::timetable::View;
use crate::vision::validate_markers;
use crate::wire::Stream;

/// Clients that are served at a time; more wait in the system's queue.
const MOST_CLIENTS: usize = 8;
/// How long a client may take to ask.
const ASKING: Duration = Duration::from_secs(2);
/// How long a client may take to read its answer.
const ANSWERING: Duration = Duration::from_secs(5);
/// How long the pilot may take to say who is aboard.
const CREW: Duration = Duration::from_secs(1);
/// How long a robot that was let go of may take to let us in again.
const REACH: Duration = Duration::from_millis(3500);
/// The pause after a connection that the system could not give.
const PAUSE: Duration = Duration::from_millis(200);
/// The number of the first person; behaviours are numbered from 0, and the last number is the rescue
/// behaviour's.
const FIRST_PERSON: u16 = 0xF000;
/// Persons' numbers; many more than are served at a time.
const PERSONS: u16 = 0x0FF0;
/// A person is above all behaviours.
const PERSON: Priority = Priority(i16::MAX);

/// A run, as its desk needs to know it.
#[derive(Debug, Clone)]
pub struct Run {
    /// Where its pilot is asked.
    pub requests: mpsc::Sender<Request>,
    /// Where its behaviours are started and stopped.
    pub roster: Roster,
    /// The newest status.
    pub status: watch::Receiver<Status>,
    /// What the camera shows.
    pub pictures: watch::Receiver<Pictures>,
    /// Ends the run.
    pub stop: CancellationToken,
    /// When the robot's streams are on.
    pub streams: Streams,
    /// The robot as the run was told to reach it.
    pub target: String,
    /// In this program.
    pub simulated: bool,
    /// Since when.
    pub began: Instant,
    /// What comes next.
    pub view: watch::Receiver<View>,
    /// How long it takes from a frame to a track command.
    pub reactions: Reactions,
}

/// The socket of a run. Dropping it takes it away.
#[derive(Debug)]
pub struct Desk(Bound);

impl Desk {
    /// Opens it in this data folder. Waits for the disk: not to be called on the driving core.
    ///
    /// # Errors
    /// What the system says; the run cannot be asked then.
    pub fn open(data: &Path) -> io::Result<Desk> {
        Folder::make(data)?.bind().map(Desk)
    }

    /// Serves for ever.
    ///
    /// # Errors
    /// If the socket cannot be served at all.
    pub async fn serve(self, run: Run) -> io::Result<()> {
        let listener = UnixListener::from_std(self.0.listener.try_clone()?)?;
        let mut clients = JoinSet::new();
        loop {
            tokio::select! {
                Some(_) = clients.join_next() => {}
                accepted = listener.accept(), if clients.len() < MOST_CLIENTS => match accepted {
                    Ok((stream, _)) => {
                        clients.spawn(serve(stream, run.clone()));
                    }
                    Err(error) => {
                        debug!("a client could not be let in: {error}");
                        sleep(PAUSE).await;
                    }
                },
            }
        }
    }
}

/// One client: one errand. A client that hangs up cancels it.
async fn serve(stream: UnixStream, run: Run) {
    let mut pipe = Pipe::new(stream);
    let errand = match timeout(ASKING, pipe.receive::<Errand>()).await {
        Ok(Ok(Some(errand))) => errand,
        Ok(Ok(None)) => return,
        Ok(Err(error)) => return debug!("a client talks nonsense: {error}"),
        Err(_) => return debug!("a client asks nothing"),
    };
    if !matches!(errand, Errand::Overview | Errand::Behaviours) {
        info!("a person asks from outside: {}", errand.words());
    }
    let answer = tokio::select! {
        answer = run.perform(errand) => answer,
        _ = pipe.receive::<Errand>() => return,
    };
    if timeout(ANSWERING, pipe.send(&answer)).await.is_err() {
        debug!("a client does not read its answer");
    }
}

impl Run {
    /// Does one thing for a person, by the same rules from a tool, a page or a broker.
    /// Dropping the wait gives it up.
    pub async fn perform(&self, errand: Errand) -> Answer {
        let errand = match errand {
            Errand::Overview => return self.overview().await,
            Errand::Stop => return self.halt().await,
            Errand::Behaviours => return self.behaviours(),
            Errand::Behaviour { name, change } => return self.change(&name, change).await,
            other => other,
        };
        if !self.reach().await {
            return Answer::Offline;
        }
        match self.allowed(&errand) {
            Err(why) => Answer::Refused(why.to_owned()),
            Ok(()) => match self.try_perform(errand).await {
                Ok(answer) => answer,
                Err(error) => Answer::Refused(error.to_string()),
            },
        }
    }

    /// Whether the robot is there; a released link is dialled again.
    async fn reach(&self) -> bool {
        let mut status = self.status.clone();
        if status.borrow().link == LinkState::Released {
            let _ = self.requests.send(Request::Release(false)).await;
            let up = status.wait_for(|status| status.link == LinkState::Up);
            let _ = timeout(REACH, up).await;
        }
        self.status.borrow().link == LinkState::Up
    }

    /// What is dropped without an answer further down is refused in words here.
    fn allowed(&self, errand: &Errand) -> Result<(), &'static str> {
        let status = *self.status.borrow();
        let (stream, length) = match errand {
            Errand::Say(samples) => (Some(Stream::AudioOut), samples.len()),
            Errand::Picture(_) => (Some(Stream::Video), 0),
            _ => (None, 0),
        };
        let lights_and_sounds = matches!(
            errand,
            Errand::Led { .. }
                | Errand::Play(_)
                | Errand::StopSound
                | Errand::Volume(_)
                | Errand::Say(_)
        );
        if stream.is_some_and(|stream| self.streams.usage(stream) == Use::Off) {
            Err("the run's config keeps this stream off")
        } else if length > MAX_SPEECH {
            Err("that is too long to say at once")
        } else if lights_and_sounds && status.safety == WatchdogState::Alarm {
            Err("the battery is low and the alarm sounds: lights and sounds are the watchdog's")
        } else if status.shed && (lights_and_sounds || stream.is_some()) {
            Err("the battery is nearly empty: what is left of it is for the way home")
        } else {
            Ok(())
        }
    }

    async fn try_perform(&self, errand: Errand) -> Result<Answer, SeatError> {
        let mut seat = self.seat("a person").await?;
        let intent = match errand {
            Errand::Overview | Errand::Stop | Errand::Behaviours | Errand::Behaviour { .. } => {
                return Ok(Answer::Done);
            }
            Errand::Dock(plan) => {
                let Docked {
                    end,
                    attempts,
                    took,
                } = seat.dock(plan).await?;
                return Ok(Answer::Docked {
                    end,
                    attempts,
                    took,
                });
            }
            Errand::Undock(limit) => return seat.undock(limit).await.map(Answer::Undocked),
            Errand::Say(samples) => return seat.say(&samples).await.map(|()| Answer::Done),
            Errand::Picture(limit) => return self.picture(&seat, limit).await,
            Errand::Led { led, on } => Intent::Led { led, on },
            Errand::Play(sound) => Intent::Play(sound),
            Errand::StopSound => Intent::StopSound,
            Errand::Volume(percent) => Intent::Volume(percent),
        };
        seat.intend(intent).await?;
        Ok(Answer::Done)
    }

    fn behaviours(&self) -> Answer {
        let members = self.roster.members();
        let members = members.borrow();
        Answer::Behaviours(members.iter().map(Listed::of).collect())
    }

    async fn change(&self, name: &str, change: Change) -> Answer {
        answer(match change {
            Change::Start => self.roster.start(name).await,
            Change::StartFor(lasts) => self.roster.start_for(name, lasts).await,
            Change::Stop => self.roster.stop(name).await,
            Change::Restart => self.roster.restart(name).await,
        })
    }

    /// The tracks rest at once; then the run comes to its end, so that nothing drives on.
    async fn halt(&self) -> Answer {
        let stopped = self.stop_tracks().await;
        self.stop.cancel();
        answer(stopped)
    }

    async fn stop_tracks(&self) -> Result<(), SeatError> {
        self.seat("a person").await?.intend(Intent::Stop).await
    }

    /// The tracks rest at once, and all behaviours end, so that nothing drives on. Unlike [`Errand::Stop`]
    /// it does not end a run that stays.
    pub async fn rest(&self) -> Answer {
        let stopped = self.stop_tracks().await;
        let mut ending = JoinSet::new();
        for member in self.roster.members().borrow().iter() {
            if matches!(member.state, MemberState::Idle | MemberState::Ending) {
                continue;
            }
            let (roster, name) = (self.roster.clone(), member.name.clone());
            ending.spawn(async move { roster.stop(&name).await });
        }
        // A behaviour that ended by itself meanwhile needs no stop.
        ending.join_all().await;
        answer(stopped)
    }

    async fn picture(&self, seat: &Seat, limit: Duration) -> Result<Answer, SeatError> {
        let stream = Stream::Video;
        let mut pictures = self.pictures.clone();
        let number = |pictures: &Pictures| pictures.newest.as_ref().map(|frame| frame.seq);
        let last = number(&pictures.borrow());
        seat.intend(Intent::Stream { stream, on: true }).await?;
        // By number: a laboratory's time is another than the asker's.
        let new = |pictures: &Pictures| {
            let newest = pictures.newest.as_ref();
            number(pictures) != last
                && newest.is_some_and(|frame| validate_markers(&frame.jpeg).is_ok())
        };
        Ok(match timeout(limit, pictures.wait_for(new)).await {
            Ok(Ok(pictures)) => match &pictures.newest {
                Some(frame) => Answer::Picture(frame.jpeg.to_vec()),
                None => Answer::NoPicture,
            },
            _ => Answer::NoPicture,
        })
    }

    /// A person's seat in front of the pilot, above all behaviours; `name` is what the log calls him.
    ///
    /// # Errors
    /// [`SeatError::Closed`]: the run is over.
    pub async fn seat(&self, name: &str) -> Result<Seat, SeatError> {
        static COUNT: AtomicU16 = AtomicU16::new(0);
        let number = COUNT.fetch_add(1, Ordering::Relaxed) % PERSONS;
        let by = BehaviourId(FIRST_PERSON + number);
        Seat::join(self.requests.clone(), by, name, PERSON, Role::Person).await
    }

    /// STOP: from now on nothing moves the robot until the stop is released.
    ///
    /// # Errors
    /// [`SeatError::Closed`]: the run is over, and the robot was stopped at its end.
    pub async fn hold(&self, on: bool) -> Result<(), SeatError> {
        let asked = self.requests.send(Request::Halt(on)).await;
        asked.map_err(|_| SeatError::Closed)
    }

    async fn overview(&self) -> Answer {
        let crew = match self.aboard().await {
            Some(crew) => crew,
            None => return Answer::Refused("the run is ending".to_owned()),
        };
        let (status, view) = (*self.status.borrow(), self.view.borrow().clone());
        Answer::Overview(Box::new(Overview {
            pid: std::process::id(),
            target: self.target.clone(),
            simulated: self.simulated,
            running: self.began.elapsed(),
            online: status.link == LinkState::Up,
            robot: crew.robot,
            state: match status.link.absence() {
                Some(words) => words.to_owned(),
                None if status.halted => "stopped by a person".to_owned(),
                None => status.safety.to_string(),
            },
            place: status.place.to_string(),
            docked: status.docked,
            low: status.low,
            battery: status.battery,
            behaviours: crew.aboard,
            next: Next::of(&view),
            quiet: view.quiet,
        }))
    }

    /// The robot and who is aboard; `None` if the pilot does not say so in time.
    pub async fn aboard(&self) -> Option<Crew> {
        timeout(CREW, self.crew()).await.ok().flatten()
    }

    async fn crew(&self) -> Option<Crew> {
        let (tell, told) = oneshot::channel();
        self.requests.send(Request::Crew(tell)).await.ok()?;
        told.await.ok()
    }
}

fn answer<E: ToString>(done: Result<(), E>) -> Answer {
    match done {
        Ok(()) => Answer::Done,
        Err(error) => Answer::Refused(error.to_string()),
    }
}
