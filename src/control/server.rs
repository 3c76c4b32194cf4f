//! The private socket of a run.

use std::io;
use std::path::Path;

use tokio::net::UnixListener;

use super::folder::{BoundSocket, Folder};
use super::routes::routes;
use super::run::Run;
use crate::http;

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

    /// Serves programs of the same user; returns only on an error.
    ///
    /// # Errors
    /// If the socket cannot be served at all.
    pub async fn serve(self, run: Run) -> io::Result<()> {
        let listener = UnixListener::from_std(self.0.listener.try_clone()?)?;
        http::serve_private(listener, routes(run)).await;
        Ok(())
    }
}
