//! The run's side: receives requests and performs them.

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

use super::emergency_stop::EmergencyStop;
use super::folder::{BoundSocket, Folder};
use super::pipe::Pipe;
use super::request::{
    BehaviourListing, Change, MAX_SPEECH, Next, Overview, RunRequest, RunResponse,
};
use crate::agent::{Docked, PilotClient, PilotClientError, Roster, RosterError};
use crate::pilot::{LinkState, Reactions, Status};
use crate::robot::channel::{Request, Role, RunningBehaviours};
use crate::robot::{
    BehaviourId, Intent, Pictures, Priority, STOP_HOLDS, StopConfirmation, StopOutcome, Streams,
    Use,
};
use crate::safety::WatchdogState;
use crate::timetable::View;
use crate::vision::validate_markers;
use crate::wire::Stream;

/// Maximum number of clients served at a time; more wait in the system's queue.
const MAX_CLIENTS: usize = 8;
const REQUEST_TIMEOUT: Duration = Duration::from_secs(2);
const ANSWER_TIMEOUT: Duration = Duration::from_secs(5);
/// Timeout for the pilot's list of running behaviours.
const RUNNING_TIMEOUT: Duration = Duration::from_secs(1);
/// How long a STOP waits for a place in the pilot's queue before it latches without the pilot.
const PILOT_TIMEOUT: Duration = Duration::from_millis(500);
/// How long the answer to a STOP waits for the robot.
const CONFIRMATION_TIMEOUT: Duration = Duration::from_secs(2);
/// Timeout for connecting again to a robot whose link was released.
const RECONNECT_TIMEOUT: Duration = Duration::from_millis(3500);
/// Pause after a failed `accept`.
const PAUSE: Duration = Duration::from_millis(200);
/// The first ID of a person's client; behaviours are numbered from 0, and the last number belongs
/// to the rescue behaviour.
const FIRST_PERSON: u16 = 0xF000;
/// Number of IDs for persons; many more than are served at a time.
const PERSONS: u16 = 0x0FF0;
/// Priority of a person: above all behaviours.
const PERSON: Priority = Priority(i16::MAX);

/// The handles through which the server controls its run.
#[derive(Debug, Clone)]
pub struct Run {
    /// Requests to the pilot.
    pub requests: mpsc::Sender<Request>,
    /// Starts and stops behaviours.
    pub roster: Roster,
    /// The newest status.
    pub status: watch::Receiver<Status>,
    /// The frames of the camera.
    pub pictures: watch::Receiver<Pictures>,
    /// Ends a single run after `spykee robot stop`; a service goes on.
    pub end: Option<CancellationToken>,
    /// A person's STOP.
    pub emergency_stop: EmergencyStop,
    /// The config's settings for the robot's streams.
    pub streams: Streams,
    /// The robot's address as given to the run.
    pub target: String,
    /// Whether the robot is simulated in this program.
    pub simulated: bool,
    /// Start time of the run.
    pub began: Instant,
    /// The next start of the timetable, and whether it is a quiet hour.
    pub view: watch::Receiver<View>,
    /// Times from a frame to a track command.
    pub reactions: Reactions,
}

/// The socket of a run. Dropping it removes the socket.
#[derive(Debug)]
pub struct ControlServer(BoundSocket);

impl ControlServer {
    /// Opens the socket in this data folder. Blocks on the disk: must not be called on the driving
    /// core.
    ///
    /// # Errors
    /// Any error of the system; the run then accepts no requests.
    pub fn open(data: &Path) -> io::Result<ControlServer> {
        Folder::make(data)?.bind().map(ControlServer)
    }

    /// Serves clients; returns only on an error.
    ///
    /// # Errors
    /// If the socket cannot be served at all.
    pub async fn serve(self, run: Run) -> io::Result<()> {
        let listener = UnixListener::from_std(self.0.listener.try_clone()?)?;
        let mut clients = JoinSet::new();
        loop {
            tokio::select! {
                Some(_) = clients.join_next() => {}
                accepted = listener.accept(), if clients.len() < MAX_CLIENTS => match accepted {
                    Ok((stream, _)) => {
                        clients.spawn(serve(stream, run.clone()));
                    }
                    Err(error) => {
                        debug!("cannot accept a client: {error}");
                        sleep(PAUSE).await;
                    }
                },
            }
        }
    }
}

/// Serves one request of one client. A client that disconnects cancels it.
async fn serve(stream: UnixStream, run: Run) {
    let mut pipe = Pipe::new(stream);
    let request = match timeout(REQUEST_TIMEOUT, pipe.receive::<RunRequest>()).await {
        Ok(Ok(Some(request))) => request,
        Ok(Ok(None)) => return,
        Ok(Err(error)) => return debug!("a client sent an invalid request: {error}"),
        Err(_) => return debug!("a client sent no request in time"),
    };
    if !matches!(request, RunRequest::Overview | RunRequest::Behaviours) {
        info!(
            "a person's request from another program: {}",
            request.describe()
        );
    }
    let by = match pipe.user() {
        Some(user) => format!("the command line, user ID {user}"),
        None => "the command line".to_owned(),
    };
    let response = match request {
        // Also if the client no longer waits, as when this program was suspended meanwhile.
        RunRequest::Stop => run.press_stop(&by).await,
        RunRequest::ResetStop => answer(run.reset_stop(&by).await),
        request => tokio::select! {
            response = run.perform(request) => response,
            _ = pipe.receive::<RunRequest>() => return,
        },
    };
    let stopped = matches!(response, RunResponse::Stopped { .. });
    if timeout(ANSWER_TIMEOUT, pipe.send(&response)).await.is_err() {
        debug!("a client does not read its answer");
    }
    if let Some(end) = run.end
        && stopped
    {
        end.cancel();
    }
}

impl Run {
    /// Performs one request of a person. The same rules apply whether it comes from a tool, the
    /// page or a broker. Dropping the future cancels it.
    pub async fn perform(&self, request: RunRequest) -> RunResponse {
        let request = match request {
            RunRequest::Overview => return self.overview().await,
            RunRequest::Stop => return self.press_stop("a person").await,
            RunRequest::ResetStop => return answer(self.reset_stop("a person").await),
            RunRequest::Behaviours => return self.behaviours(),
            RunRequest::Behaviour { name, change } => return self.change(&name, change).await,
            other => other,
        };
        let drives = matches!(request, RunRequest::Dock(_) | RunRequest::Undock(_));
        if drives && self.emergency_stop.is_on() {
            return RunResponse::Refused(STOP_HOLDS.to_owned());
        }
        if !self.reach().await {
            return RunResponse::Offline;
        }
        match self.allowed(&request) {
            Err(why) => RunResponse::Refused(why.to_owned()),
            Ok(()) => match self.try_perform(request).await {
                Ok(answer) => answer,
                Err(error) => RunResponse::Refused(error.to_string()),
            },
        }
    }

    /// Whether the robot is connected; a released link is connected again first.
    async fn reach(&self) -> bool {
        let mut status = self.status.clone();
        if status.borrow().link == LinkState::Released {
            let _ = self.requests.send(Request::Release(false)).await;
            let up = status.wait_for(|status| status.link == LinkState::Up);
            let _ = timeout(RECONNECT_TIMEOUT, up).await;
        }
        self.status.borrow().link == LinkState::Up
    }

    /// Refuses here, with a reason, what lower layers would drop without an answer.
    fn allowed(&self, request: &RunRequest) -> Result<(), &'static str> {
        let status = *self.status.borrow();
        let (stream, length) = match request {
            RunRequest::Say(samples) => (Some(Stream::AudioOut), samples.len()),
            RunRequest::Picture(_) => (Some(Stream::Video), 0),
            _ => (None, 0),
        };
        let lights_and_sounds = matches!(
            request,
            RunRequest::Led { .. }
                | RunRequest::Play(_)
                | RunRequest::StopSound
                | RunRequest::Volume(_)
                | RunRequest::Say(_)
        );
        if stream.is_some_and(|stream| self.streams.usage(stream) == Use::Off) {
            Err("the run's config keeps this stream off")
        } else if length > MAX_SPEECH {
            Err("that is too long to say at once")
        } else if lights_and_sounds && status.safety == WatchdogState::Alarm {
            Err(
                "the battery is low and the alarm sounds: only the watchdog controls lights and sounds",
            )
        } else if status.shed && (lights_and_sounds || stream.is_some()) {
            Err("the battery is nearly empty: the rest is reserved for the way to the station")
        } else {
            Ok(())
        }
    }

    async fn try_perform(&self, request: RunRequest) -> Result<RunResponse, PilotClientError> {
        let mut client = self.pilot_client("a person").await?;
        let intent = match request {
            RunRequest::Overview
            | RunRequest::Stop
            | RunRequest::ResetStop
            | RunRequest::Behaviours
            | RunRequest::Behaviour { .. } => {
                return Ok(RunResponse::Done);
            }
            RunRequest::Dock(plan) => {
                let Docked {
                    end,
                    attempts,
                    took,
                } = client.dock(plan).await?;
                return Ok(RunResponse::Docked {
                    end,
                    attempts,
                    took,
                });
            }
            RunRequest::Undock(limit) => {
                return client.undock(limit).await.map(RunResponse::Undocked);
            }
            RunRequest::Say(samples) => {
                return client.say(&samples).await.map(|()| RunResponse::Done);
            }
            RunRequest::Picture(limit) => return self.picture(&client, limit).await,
            RunRequest::Led { led, on } => Intent::Led { led, on },
            RunRequest::Play(sound) => Intent::Play(sound),
            RunRequest::StopSound => Intent::StopSound,
            RunRequest::Volume(percent) => Intent::Volume(percent),
        };
        client.send_intent(intent).await?;
        Ok(RunResponse::Done)
    }

    fn behaviours(&self) -> RunResponse {
        let statuses = self.roster.statuses();
        let statuses = statuses.borrow();
        RunResponse::Behaviours(statuses.iter().map(BehaviourListing::new).collect())
    }

    async fn change(&self, name: &str, change: Change) -> RunResponse {
        if change != Change::Stop && self.emergency_stop.is_on() {
            return RunResponse::Refused(STOP_HOLDS.to_owned());
        }
        answer(match change {
            Change::Start => self.roster.start(name).await,
            Change::StartFor(lasts) => self.roster.start_for(name, lasts).await,
            Change::Stop => self.roster.stop(name).await,
            Change::Restart => self.roster.restart(name).await,
        })
    }

    async fn press_stop(&self, by: &str) -> RunResponse {
        RunResponse::Stopped {
            outcome: self.engage_stop(by).await,
            ends: self.end.is_some(),
        }
    }

    /// Ends all behaviours, also those that start or restart at this moment.
    ///
    /// # Errors
    /// Why a behaviour may still run, in words.
    pub async fn end_behaviours(&self) -> Result<(), String> {
        match self.roster.stop_all().await {
            // A run that is ending ends its behaviours itself.
            Ok(()) | Err(RosterError::Closed) => Ok(()),
            Err(RosterError::Busy) => {
                Err("a behaviour has not ended within ten seconds".to_owned())
            }
            Err(refused) => Err(refused.to_string()),
        }
    }

    async fn picture(
        &self,
        client: &PilotClient,
        limit: Duration,
    ) -> Result<RunResponse, PilotClientError> {
        let stream = Stream::Video;
        let mut pictures = self.pictures.clone();
        let number = |pictures: &Pictures| pictures.newest.as_ref().map(|frame| frame.seq);
        let last = number(&pictures.borrow());
        client
            .send_intent(Intent::Stream { stream, on: true })
            .await?;
        // Compare numbers, not times: a simulation's clock differs from the client's.
        let new = |pictures: &Pictures| {
            let newest = pictures.newest.as_ref();
            number(pictures) != last
                && newest.is_some_and(|frame| validate_markers(&frame.jpeg).is_ok())
        };
        Ok(match timeout(limit, pictures.wait_for(new)).await {
            Ok(Ok(pictures)) => match &pictures.newest {
                Some(frame) => RunResponse::Picture(frame.jpeg.to_vec()),
                None => RunResponse::NoPicture,
            },
            _ => RunResponse::NoPicture,
        })
    }

    /// Joins the pilot with a person's client, whose priority is above all behaviours. `name`
    /// appears in the log.
    ///
    /// # Errors
    /// [`PilotClientError::Closed`]: the run has ended.
    pub async fn pilot_client(&self, name: &str) -> Result<PilotClient, PilotClientError> {
        static COUNT: AtomicU16 = AtomicU16::new(0);
        let number = COUNT.fetch_add(1, Ordering::Relaxed) % PERSONS;
        let by = BehaviourId(FIRST_PERSON + number);
        PilotClient::join(self.requests.clone(), by, name, PERSON, Role::Person).await
    }

    /// Engages STOP in the name of `by`: nothing moves the robot until a person releases it, in this
    /// program or in the next one of its data folder. The answer waits until it is kept, and for the
    /// robot; both take a few milliseconds, and are limited.
    pub async fn engage_stop(&self, by: &str) -> StopOutcome {
        let kept = match timeout(PILOT_TIMEOUT, self.requests.reserve()).await {
            Ok(Ok(place)) => {
                let tell_pilot = || place.send(Request::EmergencyStop(true));
                let engaged = self.emergency_stop.engage(by, tell_pilot);
                let (kept, confirmation) = tokio::join!(engaged, self.confirmation());
                return StopOutcome { confirmation, kept };
            }
            // The run has ended, and its end has stopped the robot.
            Ok(Err(_)) => self.emergency_stop.engage(by, || ()).await,
            Err(_) => {
                self.tell_pilot_later();
                self.emergency_stop.engage(by, || ()).await
            }
        };
        let confirmation = StopConfirmation::NotConfirmed;
        StopOutcome { confirmation, kept }
    }

    /// Releases STOP in the name of `by`.
    ///
    /// # Errors
    /// Why it may hold in the next program, in words.
    pub async fn reset_stop(&self, by: &str) -> Result<(), String> {
        match timeout(PILOT_TIMEOUT, self.requests.reserve()).await {
            Ok(Ok(place)) => {
                let tell_pilot = || place.send(Request::EmergencyStop(false));
                self.emergency_stop.reset(by, tell_pilot).await
            }
            Ok(Err(_)) => self.emergency_stop.reset(by, || ()).await,
            Err(_) => {
                self.tell_pilot_later();
                self.emergency_stop.reset(by, || ()).await
            }
        }
    }

    /// Tells a pilot whose queue is full whether STOP holds, as soon as there is room.
    fn tell_pilot_later(&self) {
        let run = self.clone();
        tokio::spawn(async move {
            if let Ok(place) = run.requests.reserve().await {
                run.emergency_stop.repeat(place);
            }
        });
    }

    /// Waits for what the robot says to a STOP.
    async fn confirmation(&self) -> StopConfirmation {
        let mut status = self.status.clone();
        let known = status
            .wait_for(|status| status.emergency_stop && status.stop != StopConfirmation::Sending);
        let Ok(Ok(status)) = timeout(CONFIRMATION_TIMEOUT, known).await else {
            return StopConfirmation::NotConfirmed;
        };
        match (status.stop, status.link) {
            (StopConfirmation::None, LinkState::Lost | LinkState::Connecting) => {
                StopConfirmation::NotConfirmed
            }
            (confirmation, _) => confirmation,
        }
    }

    async fn overview(&self) -> RunResponse {
        let running = match self.running_behaviours().await {
            Some(running) => running,
            None => return RunResponse::Refused("the run is ending".to_owned()),
        };
        let status = *self.status.borrow();
        let view = self.view.borrow().clone();
        RunResponse::Overview(Box::new(Overview {
            pid: std::process::id(),
            target: self.target.clone(),
            simulated: self.simulated,
            running: self.began.elapsed(),
            online: status.link == LinkState::Up,
            robot: running.robot,
            state: describe(&status),
            dock_state: status.dock_state.to_string(),
            docked: status.docked,
            low: status.low,
            emergency_stop: status.emergency_stop,
            stop_confirmation: status.stop,
            battery: status.battery,
            behaviours: running.behaviours,
            next: Next::from_view(&view),
            quiet: view.quiet,
        }))
    }

    /// Returns the robot and the running behaviours; `None` if the pilot does not reply in time.
    pub async fn running_behaviours(&self) -> Option<RunningBehaviours> {
        timeout(RUNNING_TIMEOUT, self.query_running())
            .await
            .ok()
            .flatten()
    }

    async fn query_running(&self) -> Option<RunningBehaviours> {
        let (sender, reply) = oneshot::channel();
        self.requests.send(Request::Running(sender)).await.ok()?;
        reply.await.ok()
    }
}

/// The state of the run, for people.
fn describe(status: &Status) -> String {
    let stopped = match (status.emergency_stop, status.stop) {
        (false, _) => None,
        (true, StopConfirmation::NotConfirmed) => Some("stopped by a person, NOT CONFIRMED"),
        (true, _) => Some("stopped by a person"),
    };
    match (stopped, status.link.absence()) {
        (Some(stopped), Some(words)) => format!("{stopped}; {words}"),
        (Some(words), None) | (None, Some(words)) => words.to_owned(),
        (None, None) => status.safety.to_string(),
    }
}

fn answer<E: ToString>(done: Result<(), E>) -> RunResponse {
    match done {
        Ok(()) => RunResponse::Done,
        Err(error) => RunResponse::Refused(error.to_string()),
    }
}
