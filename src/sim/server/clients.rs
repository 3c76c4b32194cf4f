//! The connected clients, and which of them is the one user (`PROTOCOL.md`, *Network*: users at
//! once).

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use tokio::time::Instant;
use tokio_util::sync::CancellationToken;

use super::connection::ReportQueue;
use crate::wire::{Login, Refusal, Report};

/// Maximum number of simultaneous connections, including those that have not logged in.
const MAX_CLIENTS: usize = 8;
/// A connection without a login is closed after this time.
const LOGIN_LIMIT: Duration = Duration::from_secs(30);

struct Client {
    reports: Arc<ReportQueue>,
    cut: CancellationToken,
    since: Instant,
}

#[derive(Default)]
pub(crate) struct Clients {
    all: BTreeMap<u64, Client>,
    user: Option<(u64, String)>,
    next: u64,
    dropped: u64,
}

/// The id of a user without a connection here.
const EXTERNAL_USER: u64 = u64::MAX;

/// A new client's id, its report queue and the token that disconnects it.
pub(crate) type Admission = (u64, Arc<ReportQueue>, CancellationToken);

impl Clients {
    /// Registers a connection. If there are too many, the oldest one without a login ends.
    pub(crate) fn admit(&mut self, now: Instant) -> Admission {
        let oldest = self.all.keys().find(|id| !self.is_user(**id)).copied();
        if self.all.len() >= MAX_CLIENTS
            && let Some(oldest) = oldest
        {
            tracing::warn!(target: "spykee::sim", client = oldest, "too many connections: the oldest without a login ends");
            self.disconnect(oldest);
        }
        let client = Client {
            reports: Arc::new(ReportQueue::new()),
            cut: CancellationToken::new(),
            since: now,
        };
        let id = self.next;
        let admission = (id, client.reports.clone(), client.cut.clone());
        self.next += 1;
        self.all.insert(id, client);
        admission
    }

    /// Whether `id` is the user, who may command the robot.
    pub(crate) fn is_user(&self, id: u64) -> bool {
        self.user.as_ref().is_some_and(|(user, _)| *user == id)
    }

    pub(crate) fn contains(&self, id: u64) -> bool {
        self.all.contains_key(&id)
    }

    pub(crate) fn user(&self) -> Option<&str> {
        self.user.as_ref().map(|(_, name)| name.as_str())
    }

    /// Makes `id` the user, if the login is correct and there is no other user.
    pub(crate) fn log_in(&mut self, id: u64, login: &Login, right: &Login) -> Result<(), Refusal> {
        if login != right {
            return Err(Refusal::WrongPassword);
        }
        if self.user.as_ref().is_some_and(|(user, _)| *user != id) {
            return Err(Refusal::InUse);
        }
        self.user = Some((id, login.user.clone()));
        Ok(())
    }

    /// Makes a user without a connection here the user; returns whether another was disconnected.
    pub(crate) fn take_over(&mut self, name: &str) -> bool {
        let disconnected = self.user_id().is_some_and(|id| self.disconnect(id));
        self.user = Some((EXTERNAL_USER, name.to_owned()));
        disconnected
    }

    pub(crate) fn give_back(&mut self) {
        if self.is_user(EXTERNAL_USER) {
            self.user = None;
        }
    }

    /// Sends the refusal to `id`, and closes the connection when it has been written.
    pub(crate) fn refuse(&mut self, id: u64, refusal: Refusal) {
        if let Some(client) = self.all.get(&id) {
            let _ = client.reports.push(&Report::Refused(refusal));
            client.reports.close();
        }
    }

    /// Sends a report to the user; false if the user does not read and must be disconnected.
    pub(crate) fn send_report(&self, report: &Report) -> bool {
        let Some(client) = self.user.as_ref().and_then(|(id, _)| self.all.get(id)) else {
            return true;
        };
        client.reports.push(report).is_ok()
    }

    pub(crate) fn disconnect(&mut self, id: u64) -> bool {
        if let Some(client) = self.all.remove(&id) {
            client.cut.cancel();
            self.dropped += client.reports.dropped();
        }
        let was_user = self.is_user(id);
        if was_user {
            self.user = None;
        }
        was_user
    }

    pub(crate) fn ids(&self) -> Vec<u64> {
        self.all.keys().copied().collect()
    }

    pub(crate) fn user_id(&self) -> Option<u64> {
        self.user.as_ref().map(|(id, _)| *id)
    }

    /// Returns the clients that have exceeded the time limit for logging in.
    pub(crate) fn overdue(&self, now: Instant) -> Vec<u64> {
        let late = |client: &Client| now.duration_since(client.since) > LOGIN_LIMIT;
        let all = self.all.iter();
        all.filter(|(id, client)| !self.is_user(**id) && late(client))
            .map(|(id, _)| *id)
            .collect()
    }

    /// Returns the number of frames and audio chunks dropped so far, over all connections.
    pub(crate) fn dropped(&self) -> u64 {
        let connected = self.all.values().map(|client| client.reports.dropped());
        self.dropped + connected.sum::<u64>()
    }
}
