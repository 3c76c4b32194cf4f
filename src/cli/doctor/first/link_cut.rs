//! Cuts the link of a pilot as a lost network does, and keeps it cut for a while. The pilot then
//! owes a stop: it connects as soon as it may, and the guardian does if this program is gone.

use std::net::Shutdown;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use tokio::sync::watch;
use tokio::time::{Instant, sleep_until};

use crate::link::AcceptedLogin;
use crate::pilot::Connector;

pub(super) struct LinkCut {
    /// No attempt to connect begins before.
    until: watch::Sender<Instant>,
    pub(super) disconnect: Box<dyn Fn() + Send + Sync>,
}

impl LinkCut {
    /// A connector that connects as this one does, and what cuts its links.
    pub(super) fn of(mut connector: Connector) -> (Connector, LinkCut) {
        let until = watch::Sender::new(Instant::now());
        let from = until.subscribe();
        let newest: Arc<Mutex<Option<watch::Receiver<Option<AcceptedLogin>>>>> = Arc::default();
        let link = newest.clone();
        let connector: Connector = Box::new(move |supervision| {
            *newest.lock().unwrap_or_else(PoisonError::into_inner) = Some(supervision.accepted());
            let begins = *from.borrow();
            let connecting = connector(supervision);
            Box::pin(async move {
                sleep_until(begins).await;
                connecting.await
            })
        });
        let disconnect = move || {
            let link = link.lock().unwrap_or_else(PoisonError::into_inner).clone();
            if let Some(login) = link.and_then(|link| link.borrow().clone()) {
                // A socket that is closed already is cut.
                let _ = login.socket.shutdown(Shutdown::Both);
            }
        };
        let disconnect = Box::new(disconnect);
        (connector, LinkCut { until, disconnect })
    }

    /// Ends the connection without a word, and allows the next one after this time.
    pub(super) fn cut(&self, time: Duration) {
        self.until.send_replace(Instant::now() + time);
        (self.disconnect)();
    }
}
