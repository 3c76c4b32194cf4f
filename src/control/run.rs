//! A run that accepts the requests of persons. The same rules apply whether a request comes from a
//! tool, the page, a program or a broker.

use std::sync::atomic::{AtomicU16, Ordering};
use std::time::Duration;

use jiff::Timestamp;
use tokio::sync::{mpsc, oneshot, watch};
use tokio::time::{Instant, sleep, timeout};
use tokio_util::sync::CancellationToken;
use tracing::{info, warn};

use super::emergency_stop::EmergencyStop;
use super::request::RunRequest;
use super::response::RunResponse;
use super::run_status::{self, BehaviourListing, RunStatus};
use super::world_change::SimulatedRobot;
use crate::agent::{Agent, Change, PilotClient, PilotClientError, Roster, RosterError};
use crate::clock::Span;
use crate::pilot::{LinkState, Reactions, Status};
use crate::robot::channel::{Request, Role, RunningBehaviours};
use crate::robot::{
    BehaviourId, DockOutcome, DockPlan, Intent, Pictures, Priority, STOP_HOLDS, StopConfirmation,
    StopOutcome, Streams, Use, WatchdogState,
};
use crate::timetable::{TimetableChange, TimetableOrder, View};
use crate::vision::validate_markers;
use crate::wire::Stream;

/// Timeout for the pilot's list of running behaviours.
const RUNNING_TIMEOUT: Duration = Duration::from_secs(1);
/// How long a STOP waits for a place in the pilot's queue before it latches without the pilot.
const PILOT_TIMEOUT: Duration = Duration::from_millis(500);
/// How long the answer to a STOP waits for the robot.
const CONFIRMATION_TIMEOUT: Duration = Duration::from_secs(2);
/// Timeout for connecting again to a robot whose link was released.
const RECONNECT_TIMEOUT: Duration = Duration::from_millis(3500);
/// How long a run goes on after a STOP that ends it, so that the answer leaves first.
const ANSWER_TIME: Duration = Duration::from_millis(50);
/// Timeout for a picture: default and maximum, in seconds.
const PICTURE: u64 = 5;
const MAX_PICTURE: u64 = 600;
/// Maximum duration of one search for the station in seconds, and maximum number of retries.
const MAX_SEARCH: u64 = 3600;
const MAX_RETRIES: u32 = 20;
/// Timeout for an undocking: default and maximum, in seconds.
const UNDOCKING: u64 = 15;
const MAX_UNDOCKING: u64 = 600;
/// The first ID of a person's client; behaviours are numbered from 0, and the last number belongs
/// to the rescue behaviour.
const FIRST_PERSON: u16 = 0xF000;
/// Number of IDs for persons; many more than are served at a time.
const PERSONS: u16 = 0x0FF0;
/// Priority of a person: above all behaviours.
const PERSON: Priority = Priority(i16::MAX);

/// The handles through which persons control a run.
#[derive(Debug, Clone)]
pub struct Run {
    pub requests: mpsc::Sender<Request>,
    pub roster: Roster,
    pub status: watch::Receiver<Status>,
    pub pictures: watch::Receiver<Pictures>,
    /// Ends a single run after `spykee robot stop`; a service goes on.
    pub end: Option<CancellationToken>,
    pub emergency_stop: EmergencyStop,
    /// The config's settings for the robot's streams.
    pub streams: Streams,
    /// The robot's address as given to the run.
    pub target: String,
    /// Whether the robot is simulated in this program.
    pub simulated: bool,
    pub began: Instant,
    /// The next start of the timetable, and whether it is a quiet hour.
    pub view: watch::Receiver<View>,
    /// Where the timetable is changed; closed in a run without one.
    pub timetable: mpsc::Sender<TimetableOrder>,
    /// Its simulated robot, if it can be changed.
    pub sim: Option<SimulatedRobot>,
    /// Times from a frame to a track command.
    pub reactions: Reactions,
}

impl Run {
    /// A run of this agent on a genuine robot, without a timetable, that a STOP does not end.
    pub fn new(
        agent: &Agent,
        target: &str,
        emergency_stop: EmergencyStop,
        status: watch::Receiver<Status>,
    ) -> Run {
        Run {
            requests: agent.requests(),
            roster: agent.roster(),
            status,
            pictures: agent.pictures(),
            end: None,
            emergency_stop,
            streams: Streams::default(),
            target: target.to_owned(),
            simulated: false,
            began: Instant::now(),
            view: View::channel().1,
            timetable: mpsc::channel(1).0,
            sim: None,
            reactions: agent.reactions(),
        }
    }

    /// Performs one request in the name of `by`, for the journal. Dropping the future cancels it,
    /// but not a STOP or its release.
    pub async fn perform(&self, request: RunRequest, by: &str) -> RunResponse {
        if !matches!(request, RunRequest::Status | RunRequest::Behaviours) {
            info!("{by}: {request}");
        }
        match request {
            RunRequest::Status => self.status().await,
            RunRequest::Behaviours => self.behaviours(),
            RunRequest::Stop | RunRequest::ResetStop => self.stop_or_reset(request, by).await,
            RunRequest::Behaviour {
                name,
                change,
                lasts,
            } => self.change(&name, change, lasts, by).await,
            RunRequest::Param { name, param, value } => {
                RunResponse::from_result(self.roster.change_param(&name, &param, value))
            }
            RunRequest::Timetable {
                change,
                until,
                start,
            } => self.change_timetable(change, until, start, by).await,
            RunRequest::Sim { change } => match &self.sim {
                Some(sim) => RunResponse::from_result(change.apply(sim)),
                None => RunResponse::refused("this robot is not simulated"),
            },
            request => self.ask_pilot(request, by).await,
        }
    }

    async fn ask_pilot(&self, request: RunRequest, by: &str) -> RunResponse {
        let drives = matches!(request, RunRequest::Dock { .. } | RunRequest::Undock { .. });
        if drives && self.emergency_stop.is_on() {
            return RunResponse::refused(STOP_HOLDS);
        }
        if !self.reach().await {
            return RunResponse::Offline;
        }
        if let Err(why) = self.allowed(&request) {
            return RunResponse::refused(why);
        }
        match self.join_and_perform(request, by).await {
            Ok(response) => response,
            Err(error) => RunResponse::refused(error),
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
        let stream = match request {
            RunRequest::Say { .. } => Some(Stream::AudioOut),
            RunRequest::Picture { .. } => Some(Stream::Video),
            _ => None,
        };
        let lights_and_sounds = matches!(
            request,
            RunRequest::Led { .. }
                | RunRequest::Play { .. }
                | RunRequest::StopSound
                | RunRequest::Volume { .. }
                | RunRequest::Say { .. }
        );
        if stream.is_some_and(|stream| self.streams.usage(stream) == Use::Off) {
            Err("the run's config keeps this stream off")
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

    async fn join_and_perform(
        &self,
        request: RunRequest,
        by: &str,
    ) -> Result<RunResponse, PilotClientError> {
        let mut client = self.pilot_client("a person").await?;
        let intent = match request {
            RunRequest::Dock { seconds, retries } => {
                let usual = DockPlan::ORDERED;
                let plan = DockPlan {
                    timeout: time_limit(seconds, usual.timeout.as_secs(), MAX_SEARCH),
                    retries: retries.unwrap_or(usual.retries).min(MAX_RETRIES),
                    ..usual
                };
                let docked = self.dock(client, plan, by).await?;
                return Ok(RunResponse::Docked {
                    end: docked.end,
                    attempts: docked.attempts,
                    seconds: docked.took.as_secs_f64(),
                });
            }
            RunRequest::Undock { seconds } => {
                let limit = time_limit(seconds, UNDOCKING, MAX_UNDOCKING);
                let end = client.undock(limit).await?;
                return Ok(RunResponse::Undocked { end });
            }
            RunRequest::Say { samples } => {
                client.say(&samples).await?;
                return Ok(RunResponse::Done);
            }
            RunRequest::Picture { seconds } => {
                let limit = time_limit(seconds, PICTURE, MAX_PICTURE);
                return self.picture(&client, limit).await;
            }
            RunRequest::Led { light, on } => Intent::Led { led: light, on },
            RunRequest::Play { sound } => Intent::Play(sound),
            RunRequest::StopSound => Intent::StopSound,
            RunRequest::Volume { percent } => Intent::Volume(percent),
            RunRequest::Status
            | RunRequest::Behaviours
            | RunRequest::Stop
            | RunRequest::ResetStop
            | RunRequest::Behaviour { .. }
            | RunRequest::Param { .. }
            | RunRequest::Timetable { .. }
            | RunRequest::Sim { .. } => return Ok(RunResponse::Done),
        };
        client.send_intent(intent).await?;
        Ok(RunResponse::Done)
    }

    /// Docks in the name of `by`, and ends the behaviours that drive as soon as nothing but this
    /// docking moves the robot, or nobody waits for it any more: none of them leaves the station a
    /// moment later.
    async fn dock(
        &self,
        mut client: PilotClient,
        plan: DockPlan,
        by: &str,
    ) -> Result<DockOutcome, PilotClientError> {
        let mut status = self.status.clone();
        let roster = self.roster.clone();
        let by = format!("docking, ordered by {by}");
        let given_up = CancellationToken::new();
        let waits = given_up.clone().drop_guard();
        let ending = tokio::spawn(async move {
            tokio::select! {
                _ = status.wait_for(|status| status.safety != WatchdogState::Free) => {}
                () = given_up.cancelled() => {}
            }
            if let Err(error) = roster.stop_drivers(by).await {
                warn!("the behaviours that drive go on: {error}");
            }
        });
        let docked = client.dock(plan).await;
        drop(waits);
        let _ = ending.await;
        docked
    }

    fn behaviours(&self) -> RunResponse {
        let statuses = self.roster.statuses();
        let statuses = statuses.borrow();
        let now = Instant::now();
        let listing = |status| BehaviourListing::new(status, now);
        RunResponse::Behaviours {
            behaviours: statuses.iter().map(listing).collect(),
        }
    }

    async fn change(
        &self,
        name: &str,
        change: Change,
        lasts: Option<Span>,
        by: &str,
    ) -> RunResponse {
        if change != Change::Stop && self.emergency_stop.is_on() {
            return RunResponse::refused(STOP_HOLDS);
        }
        let lasts = lasts.map(Span::get);
        if lasts.is_some_and(|lasts| change != Change::Start || lasts.is_zero()) {
            let why = "`for` is allowed only with `start`, and must be above zero";
            return RunResponse::refused(why);
        }
        RunResponse::from_result(self.roster.change(change, name, lasts, by).await)
    }

    async fn change_timetable(
        &self,
        change: TimetableChange,
        until: Option<String>,
        start: Option<Timestamp>,
        by: &str,
    ) -> RunResponse {
        let (answer, answered) = oneshot::channel();
        let order = TimetableOrder {
            change,
            until,
            start,
            by: by.to_owned(),
            answer,
        };
        if self.timetable.send(order).await.is_err() {
            return RunResponse::refused("only a service has a timetable");
        }
        let ending = || Err("the run is ending".to_owned());
        RunResponse::from_result(answered.await.unwrap_or_else(|_| ending()))
    }

    /// Engages or releases STOP, also if the one who asked no longer waits. A single run ends after
    /// a STOP.
    async fn stop_or_reset(&self, request: RunRequest, by: &str) -> RunResponse {
        let run = self.clone();
        let by = by.to_owned();
        let (answer, answered) = oneshot::channel();
        tokio::spawn(async move {
            if request == RunRequest::ResetStop {
                let _ = answer.send(RunResponse::from_result(run.reset_stop(&by).await));
                return;
            }
            let _ = answer.send(RunResponse::Stopped {
                outcome: run.engage_stop(&by).await,
                ends: run.end.is_some(),
            });
            if let Some(end) = run.end {
                sleep(ANSWER_TIME).await;
                end.cancel();
            }
        });
        let failed = || RunResponse::refused("the run is ending");
        answered.await.unwrap_or_else(|_| failed())
    }

    /// Ends all behaviours in the name of `by`, also those that start or restart at this moment.
    /// The error says why a behaviour may still run.
    pub async fn end_behaviours(&self, by: &str) -> Result<(), String> {
        match self.roster.stop_all(by).await {
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
                Some(frame) => RunResponse::Picture {
                    jpeg: frame.jpeg.to_vec(),
                },
                None => RunResponse::NoPicture,
            },
            _ => RunResponse::NoPicture,
        })
    }

    /// Joins the pilot with a person's client, whose priority is above all behaviours. `name`
    /// appears in the log.
    pub async fn pilot_client(&self, name: &str) -> Result<PilotClient, PilotClientError> {
        static COUNT: AtomicU16 = AtomicU16::new(0);
        let number = COUNT.fetch_add(1, Ordering::Relaxed) % PERSONS;
        let by = BehaviourId(FIRST_PERSON + number);
        PilotClient::join(self.requests.clone(), by, name, PERSON, Role::Person).await
    }

    /// Engages STOP in the name of `by`: nothing moves the robot until a person releases it, in this
    /// program or in the next one of its data folder. The answer waits until it is kept, and for the
    /// robot; both take a few milliseconds, and are limited.
    async fn engage_stop(&self, by: &str) -> StopOutcome {
        let Some(place) = self.reserve_place().await else {
            let kept = self.emergency_stop.engage(by, || ()).await;
            let confirmation = StopConfirmation::NotConfirmed;
            return StopOutcome { confirmation, kept };
        };
        let tell_pilot = || place.send(Request::EmergencyStop(true));
        let engaged = self.emergency_stop.engage(by, tell_pilot);
        let (kept, confirmation) = tokio::join!(engaged, self.confirmation());
        StopOutcome { confirmation, kept }
    }

    /// Releases STOP in the name of `by`.
    /// The error says why it may hold in the next program.
    async fn reset_stop(&self, by: &str) -> Result<(), String> {
        match self.reserve_place().await {
            Some(place) => {
                let tell_pilot = || place.send(Request::EmergencyStop(false));
                self.emergency_stop.reset(by, tell_pilot).await
            }
            None => self.emergency_stop.reset(by, || ()).await,
        }
    }

    /// A place in the pilot's queue; `None` if the run has ended, which has stopped the robot, or if
    /// the queue is full: then the pilot is told later.
    async fn reserve_place(&self) -> Option<mpsc::Permit<'_, Request>> {
        match timeout(PILOT_TIMEOUT, self.requests.reserve()).await {
            Ok(place) => place.ok(),
            Err(_) => {
                self.tell_pilot_later();
                None
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

    async fn status(&self) -> RunResponse {
        match self.running_behaviours().await {
            Some(running) => {
                RunResponse::Status(Box::new(self.run_status(running, Instant::now())))
            }
            None => RunResponse::refused("the run is ending"),
        }
    }

    pub fn run_status(&self, running: RunningBehaviours, now: Instant) -> RunStatus {
        let status = *self.status.borrow();
        let view = self.view.borrow();
        let mut battery = status.battery;
        if let Some(battery) = &mut battery {
            battery.minutes_left = battery.minutes_left.map(f32::round);
        }
        let percent = |power: i8| (f32::from(power) / 0.9).round() as i8;
        let stop_confirmation = if self.emergency_stop.is_being_kept() {
            StopConfirmation::Sending
        } else {
            status.stop
        };
        let tracks = status.actuators.tracks;
        RunStatus {
            process: std::process::id(),
            target: self.target.clone(),
            simulated: self.simulated,
            running: now.saturating_duration_since(self.began).as_secs(),
            state: run_status::describe(&status),
            place: status.dock_state.to_string(),
            link: status.link,
            safety: status.safety,
            dock_state: status.dock_state,
            docked: status.docked,
            low: status.low,
            emergency_stop: status.emergency_stop,
            stop_confirmation,
            battery,
            battery_age: status
                .level_told
                .map(|at| now.saturating_duration_since(at).as_secs()),
            delays: status.delays.map(Into::into),
            tracks: [percent(tracks.left.get()), percent(tracks.right.get())],
            lights: status.actuators.lights,
            sound: status.actuators.sound.map(|sound| sound.name().to_owned()),
            sounds: status.actuators.sounds,
            robot: running.robot,
            behaviours: running.behaviours,
            next: view.next.clone(),
            paused: view.hold.paused,
            quiet: view.quiet,
        }
    }

    /// Returns the robot and the running behaviours; `None` if the pilot does not reply in time.
    pub async fn running_behaviours(&self) -> Option<RunningBehaviours> {
        let (sender, reply) = oneshot::channel();
        let query = async {
            self.requests.send(Request::Running(sender)).await.ok()?;
            reply.await.ok()
        };
        timeout(RUNNING_TIMEOUT, query).await.ok()?
    }
}

fn time_limit(seconds: Option<u64>, usual: u64, most: u64) -> Duration {
    Duration::from_secs(seconds.unwrap_or(usual).clamp(1, most))
}
