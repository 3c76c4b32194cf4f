//! The open connections. A new one never waits and is never refused: when there are too many, one
//! is closed, the oldest of those who have the most. So neither many clients nor slow ones keep
//! anybody else out, and nothing but other STOPs can be in the way of a STOP.

use std::cmp::Reverse;
use std::collections::BTreeMap;
use std::net::IpAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use parking_lot::Mutex;
use tokio_util::sync::CancellationToken;

use super::access::Visitor;
use super::keyring::Role;

/// Maximum number of connections in a lane, and of one owner's.
const MAX_IN_LANE: usize = 96;
const MAX_OF_OWNER: usize = 32;
/// The same for members of a class, each of whom has two or three pages open at most.
const MAX_MEMBERS: usize = 256;
const MAX_OF_MEMBER: usize = 12;

/// Connections compete for places only within their lane.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Lane {
    /// The head of the request is not complete, or its visitor has no access.
    Unknown,
    Request(Role),
    Member,
    Stop,
}

impl Lane {
    fn most(self) -> usize {
        match self {
            Lane::Member => MAX_MEMBERS,
            _ => MAX_IN_LANE,
        }
    }

    fn most_of_owner(self) -> usize {
        match self {
            Lane::Member => MAX_OF_MEMBER,
            _ => MAX_OF_OWNER,
        }
    }
}

#[derive(Debug)]
struct Connection {
    lane: Lane,
    /// Whose it is: that of a token, else that of an address.
    owner: String,
    closed: CancellationToken,
}

#[derive(Debug, Default)]
pub(super) struct Connections {
    next: AtomicU64,
    /// Those that have entered their lanes first come first.
    open: Mutex<BTreeMap<u64, Connection>>,
}

impl Connections {
    /// Adds a connection; closes one if there are too many then.
    fn enter(&self, connection: Connection) -> u64 {
        let id = self.next.fetch_add(1, Ordering::Relaxed);
        let lane = connection.lane;
        let mut open = self.open.lock();
        open.insert(id, connection);
        let rivals = || open.iter().filter(|(_, one)| one.lane == lane);
        let count = |owner: &str| rivals().filter(|(_, one)| one.owner == *owner).count();
        let oldest_of_most = rivals()
            .map(|(id, one)| (count(&one.owner), Reverse(*id)))
            .max();
        if let Some((most, Reverse(oldest))) = oldest_of_most
            && (most > lane.most_of_owner() || rivals().count() > lane.most())
            && let Some(closed) = open.remove(&oldest)
        {
            closed.closed.cancel();
        }
        id
    }
}

/// The place of a connection, until dropped.
#[derive(Debug)]
pub(super) struct Place {
    connections: Arc<Connections>,
    id: AtomicU64,
    address: IpAddr,
    closed: CancellationToken,
}

impl Place {
    /// The place of a connection from this address that has sent nothing yet.
    pub(super) fn new(connections: &Arc<Connections>, address: IpAddr) -> Place {
        let closed = CancellationToken::new();
        let id = connections.enter(Connection {
            lane: Lane::Unknown,
            owner: address.to_string(),
            closed: closed.clone(),
        });
        Place {
            connections: connections.clone(),
            id: AtomicU64::new(id),
            address,
            closed,
        }
    }

    /// Moves it to the lane of its request.
    pub(super) fn identify(&self, visitor: &Visitor, stops: bool) {
        let owner = match &visitor.key {
            Some(key) => format!("token {}", key.name),
            None => self.address.to_string(),
        };
        let lane = if stops {
            Lane::Stop
        } else {
            Lane::Request(visitor.role)
        };
        self.enter(lane, owner);
    }

    /// Moves it to the lane of the members of a class.
    pub(super) fn join(&self, name: &str) {
        self.enter(Lane::Member, name.to_owned());
    }

    fn enter(&self, lane: Lane, owner: String) {
        self.leave();
        let closed = self.closed.clone();
        let id = self.connections.enter(Connection {
            lane,
            owner,
            closed,
        });
        self.id.store(id, Ordering::Relaxed);
    }

    /// Waits until another connection needs the place.
    pub(super) async fn closed(&self) {
        self.closed.cancelled().await;
    }

    fn leave(&self) {
        self.connections
            .open
            .lock()
            .remove(&self.id.load(Ordering::Relaxed));
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        self.leave();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn address(last: u8) -> IpAddr {
        IpAddr::from([127, 0, 0, last])
    }

    fn visitor(role: Role) -> Visitor {
        Visitor::new(role, None)
    }

    fn open(places: &[Place]) -> usize {
        places
            .iter()
            .filter(|place| !place.closed.is_cancelled())
            .count()
    }

    #[test]
    fn whoever_has_the_most_connections_loses_the_oldest_and_the_newest_stays() {
        let all = Arc::new(Connections::default());
        let crowd: Vec<Place> = (0..300).map(|_| Place::new(&all, address(1))).collect();
        assert_eq!(open(&crowd), MAX_OF_OWNER);
        assert_eq!(open(&crowd[300 - MAX_OF_OWNER..]), MAX_OF_OWNER);
        let other = Place::new(&all, address(2));
        let many: Vec<Place> = (3..=200)
            .map(|last| Place::new(&all, address(last)))
            .collect();
        assert!(!many[197].closed.is_cancelled());
        assert_eq!(all.open.lock().len(), MAX_IN_LANE);
        drop((crowd, other, many));
        assert_eq!(all.open.lock().len(), 0);
    }

    #[test]
    fn a_stop_and_a_driver_keep_their_places_whatever_viewers_and_unknown_ones_do() {
        let all = Arc::new(Connections::default());
        let stop = Place::new(&all, address(1));
        stop.identify(&visitor(Role::Viewer), true);
        let driver = Place::new(&all, address(1));
        driver.identify(&visitor(Role::Driver), false);
        let crowd: Vec<Place> = (0..300).map(|_| Place::new(&all, address(1))).collect();
        for place in &crowd {
            place.identify(&visitor(Role::Viewer), false);
        }
        let more: Vec<Place> = (0..300).map(|_| Place::new(&all, address(1))).collect();
        assert!(!stop.closed.is_cancelled() && !driver.closed.is_cancelled());
        assert_eq!((open(&crowd), open(&more)), (MAX_OF_OWNER, MAX_OF_OWNER));
    }

    proptest! {
        #[test]
        fn there_are_never_too_many_and_the_newest_is_never_closed(
            owners in prop::collection::vec((1..100_u8, 0..3_u8), 1..400)
        ) {
            let all = Arc::new(Connections::default());
            let mut places = Vec::new();
            for (last, kind) in owners {
                let place = Place::new(&all, address(last));
                prop_assert!(!place.closed.is_cancelled());
                if kind > 0 {
                    place.identify(&visitor(Role::Driver), kind == 2);
                }
                prop_assert!(kind == 0 || !place.closed.is_cancelled());
                places.push(place);
                prop_assert!(all.open.lock().len() <= 3 * MAX_IN_LANE);
            }
        }
    }
}
