//! How the pilot leaves a link: a lost link, and the last link at the end of the run.

use std::pin::pin;

use tokio::time::{Instant, timeout_at};
use tracing::{debug, info, warn};

use super::last_words::tell_guardian;
use super::line::Line;
use super::lost::LinkLost;
use super::pulse::Pulse;
use super::{DELIVERY, Pilot};
use crate::clock::until;
use crate::link::{Delivery, close_gracefully};
use crate::robot::Event;
use crate::safety::Fact;

impl Pilot {
    /// Handles a lost link: the last words are tried without blocking, and the line completes them.
    /// The guardian keeps the link until then.
    pub(super) fn lose(&mut self, lost: &LinkLost, line: &mut Line) {
        self.store_last_words(line);
        let Some(mut writer) = self.writer.take() else {
            return line.hang_up(None);
        };
        writer.send_last_words();
        tell_guardian(&mut self.pulse, &writer);
        line.hang_up(Some(writer));
        if self.released {
            info!("disconnected: {lost}; the robot is free for others")
        } else {
            warn!("disconnected: {lost}; reconnecting")
        }
        self.minutes_left.forget();
        let acts = self.watchdog.take(Fact::LinkDown, Instant::now());
        // Without a link nothing is sent, so this cannot fail.
        let _ = self.perform(acts);
        let reason = lost.to_string();
        self.publish_link_down(&reason);
        self.seats.tell_all(&Event::Disconnected { reason });
    }

    /// Ends the run's motion (see [`Fact::RunEnding`]), switches the streams off, and closes the
    /// link when that has been acknowledged, or [`DELIVERY`] is over.
    pub(super) async fn close(mut self, mut line: Line) -> Delivery {
        self.settle(&mut line).await;
        let stopped = self.take(Fact::RunEnding);
        let off = self.seats.streams_off();
        if let Err(lost) = stopped.and_then(|()| self.send(&off)) {
            warn!("at the end: {lost}");
        }
        self.store_last_words(&mut line);
        let delivery = match (self.writer.take(), line.into_reader()) {
            (Some(writer), Some(reader)) => {
                self.beat_during(close_gracefully(reader, writer, DELIVERY))
                    .await
            }
            _ => Delivery::Offline,
        };
        match delivery {
            Delivery::Acknowledged => info!("{delivery}"),
            Delivery::Offline if self.info.is_none() => debug!("never connected"),
            Delivery::NotAcknowledged { .. } | Delivery::Offline => warn!("{delivery}"),
        }
        // What has not been acknowledged is left to the guardian, which keeps the connection open
        // until it is.
        if delivery == Delivery::Acknowledged {
            self.release_guard();
        }
        delivery
    }

    /// Waits, for at most [`DELIVERY`], until the last words of a lost link are delivered, and until
    /// a login that the robot has accepted is complete: before its first POWER it obeys no stop.
    async fn settle(&mut self, line: &mut Line) {
        let until = Instant::now() + DELIVERY;
        self.store_last_words(line);
        while line.is_unsettled() {
            let next = timeout_at(until, line.next());
            let Ok(event) = self.beat_during(next).await else {
                if self.pulse.as_mut().and_then(Pulse::guardian).is_some() {
                    line.leave_login();
                }
                return;
            };
            if let Err(error) = self.handle_event(event) {
                warn!("at the end: {error}");
            }
            self.store_last_words(line);
        }
    }

    /// Keeps the heartbeat going during `work`, so that the guardian does not act yet.
    pub(super) async fn beat_during<T>(&mut self, work: impl Future<Output = T>) -> T {
        let mut work = pin!(work);
        loop {
            let due = self.pulse.as_ref().map(Pulse::due);
            tokio::select! {
                biased;
                done = &mut work => return done,
                () = until(due) => {
                    if let Some(pulse) = &mut self.pulse {
                        pulse.beat(Instant::now());
                    }
                }
            }
        }
    }
}
