//! The bus on which an agent publishes what has happened, for a journal, notifications, a page or a
//! broker. Publishing never blocks: a listener that is too slow loses the oldest events and is told
//! how many.

use std::sync::Arc;

use tokio::sync::broadcast;
use tokio::time::Instant;

use super::Occurrence;

/// The most events that a listener may be behind.
const MOST_WAITING: usize = 1024;

/// Something that has happened.
#[derive(Debug, Clone, PartialEq)]
pub struct Happening {
    /// When it happened.
    pub at: Instant,
    /// What happened.
    pub what: Occurrence,
}

/// The publishing end. Cheap to clone; all clones are one bus.
#[derive(Debug, Clone)]
pub struct Bus(broadcast::Sender<Arc<Happening>>);

impl Default for Bus {
    /// Creates a bus without listeners.
    fn default() -> Bus {
        Bus(broadcast::Sender::new(MOST_WAITING))
    }
}

impl Bus {
    /// Publishes something that has happened just now.
    pub fn tell(&self, what: Occurrence) {
        let at = Instant::now();
        // Fails only without listeners.
        let _ = self.0.send(Arc::new(Happening { at, what }));
    }

    /// Subscribes to everything that is published from now on.
    pub fn listen(&self) -> Listener {
        Listener(self.0.subscribe())
    }
}

/// A listener's end.
#[derive(Debug)]
pub struct Listener(broadcast::Receiver<Arc<Happening>>);

/// What a listener receives.
#[derive(Debug, Clone, PartialEq)]
pub enum Heard {
    /// Something has happened.
    Happening(Arc<Happening>),
    /// The listener was too slow: this many events are lost.
    Missed(u64),
    /// All publishers are gone.
    Closed,
}

impl Listener {
    /// Waits for the next event. Cancel-safe.
    pub async fn next(&mut self) -> Heard {
        match self.0.recv().await {
            Ok(happening) => Heard::Happening(happening),
            Err(broadcast::error::RecvError::Lagged(missed)) => Heard::Missed(missed),
            Err(broadcast::error::RecvError::Closed) => Heard::Closed,
        }
    }

    /// The next event, if there is one already; [`Heard::Closed`] on every call at the end.
    pub fn try_next(&mut self) -> Option<Heard> {
        match self.0.try_recv() {
            Ok(happening) => Some(Heard::Happening(happening)),
            Err(broadcast::error::TryRecvError::Lagged(missed)) => Some(Heard::Missed(missed)),
            Err(broadcast::error::TryRecvError::Closed) => Some(Heard::Closed),
            Err(broadcast::error::TryRecvError::Empty) => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lost(reason: &str) -> Occurrence {
        let reason = reason.to_owned();
        Occurrence::LinkDown { reason }
    }

    #[tokio::test]
    async fn a_slow_listener_loses_the_oldest_and_is_told_how_many() {
        let bus = Bus::default();
        let mut slow = bus.listen();
        (0..MOST_WAITING + 3).for_each(|number| bus.tell(lost(&number.to_string())));
        assert_eq!(slow.next().await, Heard::Missed(3));
        let Heard::Happening(first) = slow.next().await else {
            panic!("nothing is left");
        };
        assert_eq!(first.what, lost("3"));
        drop(bus);
        while let Some(heard) = slow.try_next() {
            if heard == Heard::Closed {
                return;
            }
        }
        panic!("the end was not received");
    }

    #[tokio::test]
    async fn earlier_events_are_not_received() {
        let bus = Bus::default();
        bus.tell(lost("before"));
        let mut late = bus.listen();
        assert_eq!(late.try_next(), None);
        bus.tell(lost("after"));
        assert!(matches!(late.next().await, Heard::Happening(one) if one.what == lost("after")));
    }
}
