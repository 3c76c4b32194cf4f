//! The server's connections: it limits their number, and the time that each may take to send its
//! request and to read the response.
//!
//! A connection carries one request (`Connection: close`), so that the timeout for its head counts
//! from the start. The middleware enforces the timeout for the body.

use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use axum::extract::ConnectInfo;
use hyper::Request;
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper::service::{Service as _, service_fn};
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use tokio::net::TcpListener;
use tokio::sync::Semaphore;
use tokio::time::sleep;
use tokio_io_timeout::TimeoutStream;
use tracing::debug;

/// Timeout for a request's head, and its maximum length in bytes.
const HEAD: Duration = Duration::from_secs(5);
const MAX_HEAD: usize = 64 * 1024;
/// How long the client may read nothing of a response.
const STALL: Duration = Duration::from_secs(15);
/// Maximum number of connections besides those of viewers, whose number is limited elsewhere.
const MAX_CONNECTIONS: usize = 64;
/// Pause after a failed `accept`.
const PAUSE: Duration = Duration::from_millis(200);

/// Serves the router on this socket; never returns.
pub async fn serve(listener: TcpListener, router: Router) {
    let room = Arc::new(Semaphore::new(MAX_CONNECTIONS));
    let router = Arc::new(TowerToHyperService::new(router));
    loop {
        // Further connections wait in the system's queue. The semaphore is never closed.
        let Ok(permit) = room.clone().acquire_owned().await else {
            return;
        };
        let (stream, address) = match listener.accept().await {
            Ok(accepted) => accepted,
            Err(error) => {
                debug!("cannot accept a connection: {error}");
                sleep(PAUSE).await;
                continue;
            }
        };
        // Send small messages at once. A failure only delays them.
        let _ = stream.set_nodelay(true);
        let mut stream = TimeoutStream::new(stream);
        stream.set_write_timeout(Some(STALL));
        let router = router.clone();
        let service = service_fn(move |mut request: Request<Incoming>| {
            request.extensions_mut().insert(ConnectInfo(address));
            router.call(request)
        });
        let connection = http1::Builder::new()
            .timer(TokioTimer::new())
            .header_read_timeout(HEAD)
            .max_buf_size(MAX_HEAD)
            .serve_connection(TokioIo::new(Box::pin(stream)), service)
            .with_upgrades();
        tokio::spawn(async move {
            if let Err(error) = connection.await {
                debug!("a connection of {address} has failed: {error}");
            }
            drop(permit);
        });
    }
}
