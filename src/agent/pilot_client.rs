//! A person's client of the pilot: makes a behaviour's requests directly, without a host. The same
//! rules hold.

use std::time::Duration;

use tokio::sync::mpsc;
use tokio::time::sleep;

use crate::clock::every;
use crate::robot::channel::{EventReceiver, PilotMessage, Request, Role, events};
use crate::robot::{
    BehaviourId, CallId, DockEnd, DockOutcome, DockPlan, EndReason, Event, Intent, MotionEnd,
    MotionId, Priority, Setpoint,
};
use crate::wire::Stream;

/// How often a client that moves the robot sends a sign of life; the watchdog stops the tracks
/// after 0.25 s without one.
const HEARTBEAT_INTERVAL: Duration = Duration::from_millis(50);
/// Half a second of speech: s16, mono, 16 kHz.
const SPEECH: usize = 16_000;
const SPEECH_TIME: Duration = Duration::from_millis(500);

/// A person's client of the pilot. Dropping it ends everything it has requested.
#[derive(Debug)]
pub struct PilotClient {
    by: BehaviourId,
    requests: mpsc::Sender<Request>,
    inbox: EventReceiver,
    last: u64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum PilotClientError {
    #[error("the pilot has ended")]
    Closed,
    /// The watchdog or the pilot has ended this client.
    #[error("{}", .0.sentence())]
    Ended(EndReason),
}

impl PilotClient {
    pub async fn join(
        requests: mpsc::Sender<Request>,
        by: BehaviourId,
        name: &str,
        priority: Priority,
        role: Role,
    ) -> Result<PilotClient, PilotClientError> {
        let (events, inbox) = events();
        let client = PilotClient {
            by,
            requests,
            inbox,
            last: 0,
        };
        let name = name.to_owned();
        client
            .ask(Request::Join {
                by,
                name,
                priority,
                role,
                events,
            })
            .await?;
        Ok(client)
    }

    /// Drives for `duration`; returns how the motion ended.
    pub async fn run(
        &mut self,
        setpoint: Setpoint,
        duration: Duration,
    ) -> Result<MotionEnd, PilotClientError> {
        let motion = MotionId(self.next());
        let duration = Some(duration);
        let intent = Intent::Move {
            motion,
            setpoint,
            duration,
        };
        self.call(intent, |event| match event {
            Event::MotionEnded { motion: of, end } if *of == motion => Some(*end),
            _ => None,
        })
        .await
    }

    /// Goes to the station, and returns the outcome.
    pub async fn dock(&mut self, plan: DockPlan) -> Result<DockOutcome, PilotClientError> {
        let call = CallId(self.next());
        self.call(Intent::Dock { call, plan }, |event| match event {
            Event::DockEnded { call: of, outcome } if *of == call => Some(*outcome),
            _ => None,
        })
        .await
    }

    /// Leaves the station, and returns how that ended.
    pub async fn undock(&mut self, timeout: Duration) -> Result<DockEnd, PilotClientError> {
        let call = CallId(self.next());
        self.call(Intent::Undock { call, timeout }, |event| match event {
            Event::UndockEnded { call: of, end } if *of == call => Some(*end),
            _ => None,
        })
        .await
    }

    /// Speaks samples: s16 little-endian, mono, 16 kHz. Takes as long as they play.
    pub async fn say(&mut self, samples: &[u8]) -> Result<(), PilotClientError> {
        let stream = Stream::AudioOut;
        let on = true;
        self.send_intent(Intent::Stream { stream, on }).await?;
        for samples in samples.chunks(SPEECH) {
            self.send_intent(Intent::Say(samples.to_vec())).await?;
            sleep(SPEECH_TIME.mul_f64(samples.len() as f64 / SPEECH as f64)).await;
        }
        // Time to play what the robot still has in its buffer.
        sleep(SPEECH_TIME).await;
        self.send_intent(Intent::Stream { stream, on: false }).await
    }

    /// Sets the setpoint until the next command. The driver must keep showing life: see
    /// [`PilotClient::alive`].
    pub async fn drive(&mut self, setpoint: Setpoint) -> Result<(), PilotClientError> {
        let motion = MotionId(self.next());
        let duration = None;
        self.send_intent(Intent::Move {
            motion,
            setpoint,
            duration,
        })
        .await
    }

    /// Whether the event says that a docking has taken the tracks from this driver.
    pub fn has_lost_tracks(&self, event: &Event) -> bool {
        let motion = MotionId(self.last);
        let end = MotionEnd::Preempted;
        *event == Event::MotionEnded { motion, end }
    }

    /// Shows life; a driver must call it at least four times a second.
    pub async fn alive(&self) -> Result<(), PilotClientError> {
        self.ask(Request::Alive(self.by)).await
    }

    /// Waits for the next event from the pilot. Cancel-safe.
    pub async fn next_event(&mut self) -> Result<Event, PilotClientError> {
        into_event(self.inbox.next().await)
    }

    /// Sends a request without waiting for an answer.
    pub async fn send_intent(&self, intent: Intent) -> Result<(), PilotClientError> {
        self.ask(Request::Intent(self.by, intent)).await
    }

    fn next(&mut self) -> u64 {
        self.last += 1;
        self.last
    }

    async fn ask(&self, request: Request) -> Result<(), PilotClientError> {
        let asked = self.requests.send(request).await;
        asked.map_err(|_| PilotClientError::Closed)
    }

    /// Sends an intent and waits for its answer; shows life meanwhile.
    async fn call<T>(
        &mut self,
        intent: Intent,
        answer: impl Fn(&Event) -> Option<T>,
    ) -> Result<T, PilotClientError> {
        self.send_intent(intent).await?;
        let mut heartbeat = every(HEARTBEAT_INTERVAL);
        loop {
            let message = tokio::select! {
                message = self.inbox.next() => message,
                _ = heartbeat.tick() => {
                    self.ask(Request::Alive(self.by)).await?;
                    continue;
                }
            };
            if let Some(answer) = answer(&into_event(message)?) {
                return Ok(answer);
            }
        }
    }
}

fn into_event(message: PilotMessage) -> Result<Event, PilotClientError> {
    match message {
        PilotMessage::Event(event) => Ok(event),
        PilotMessage::Kill(reason) => Err(PilotClientError::Ended(reason)),
        PilotMessage::Closed => Err(PilotClientError::Closed),
    }
}

impl Drop for PilotClient {
    fn drop(&mut self) {
        // If the queue is full, the pilot is overloaded or has ended.
        let _ = self.requests.try_send(Request::Gone(self.by));
    }
}
