//! The bus on which an agent publishes what has happened, for a journal, notifications, a page or a
//! broker. Publishing never blocks: a listener that is too slow loses the oldest events and is told
//! how many.

use std::sync::Arc;

use tokio::sync::broadcast;
use tokio::time::Instant;

use super::AgentEvent;

/// The most events that a listener may be behind.
const MAX_WAITING: usize = 1024;

/// An event and its time.
#[derive(Debug, Clone, PartialEq)]
pub struct TimedEvent {
    /// When it happened.
    pub at: Instant,
    /// What happened.
    pub what: AgentEvent,
}

/// The publishing end. Cheap to clone; all clones are one bus.
#[derive(Debug, Clone)]
pub struct Bus(broadcast::Sender<Arc<TimedEvent>>);

impl Default for Bus {
    /// Creates a bus without listeners.
    fn default() -> Bus {
        Bus(broadcast::Sender::new(MAX_WAITING))
    }
}

impl Bus {
    /// Publishes something that has happened just now.
    pub fn publish(&self, what: AgentEvent) {
        let at = Instant::now();
        // Fails only without listeners.
        let _ = self.0.send(Arc::new(TimedEvent { at, what }));
    }

    /// Subscribes to everything that is published from now on.
    pub fn subscribe(&self) -> Listener {
        Listener(self.0.subscribe())
    }
}

/// A listener's end.
#[derive(Debug)]
pub struct Listener(broadcast::Receiver<Arc<TimedEvent>>);

/// What a listener receives.
#[derive(Debug, Clone, PartialEq)]
pub enum BusMessage {
    /// Something has happened.
    Event(Arc<TimedEvent>),
    /// The listener was too slow: this many events are lost.
    Missed(u64),
    /// All publishers are gone.
    Closed,
}

impl Listener {
    /// Waits for the next event. Cancel-safe.
    pub async fn next(&mut self) -> BusMessage {
        match self.0.recv().await {
            Ok(event) => BusMessage::Event(event),
            Err(broadcast::error::RecvError::Lagged(missed)) => BusMessage::Missed(missed),
            Err(broadcast::error::RecvError::Closed) => BusMessage::Closed,
        }
    }

    /// The next event, if there is one already; [`BusMessage::Closed`] on every call at the end.
    pub fn try_next(&mut self) -> Option<BusMessage> {
        match self.0.try_recv() {
            Ok(event) => Some(BusMessage::Event(event)),
            Err(broadcast::error::TryRecvError::Lagged(missed)) => Some(BusMessage::Missed(missed)),
            Err(broadcast::error::TryRecvError::Closed) => Some(BusMessage::Closed),
            Err(broadcast::error::TryRecvError::Empty) => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lost(reason: &str) -> AgentEvent {
        let reason = reason.to_owned();
        AgentEvent::LinkDown { reason }
    }

    #[tokio::test]
    async fn a_slow_listener_loses_the_oldest_and_is_told_how_many() {
        let bus = Bus::default();
        let mut slow = bus.subscribe();
        (0..MAX_WAITING + 3).for_each(|number| bus.publish(lost(&number.to_string())));
        assert_eq!(slow.next().await, BusMessage::Missed(3));
        let BusMessage::Event(first) = slow.next().await else {
            panic!("nothing is left");
        };
        assert_eq!(first.what, lost("3"));
        drop(bus);
        while let Some(message) = slow.try_next() {
            if message == BusMessage::Closed {
                return;
            }
        }
        panic!("the end was not received");
    }

    #[tokio::test]
    async fn earlier_events_are_not_received() {
        let bus = Bus::default();
        bus.publish(lost("before"));
        let mut late = bus.subscribe();
        assert_eq!(late.try_next(), None);
        bus.publish(lost("after"));
        assert!(matches!(late.next().await, BusMessage::Event(one) if one.what == lost("after")));
    }
}
