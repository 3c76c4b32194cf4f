//! HTTP for people and programs: a server with bounded resources on one address, and a check in
//! front of everything it serves; programs of the same user have a private socket, which needs no
//! check. Also the client that asks other programs. Independent of the robot.
//!
//! The check of the origin answers three questions about each request before anything else sees it.
//! Is it meant for us (`Host`, against DNS rebinding)? Did our own page send it (`Origin`)? Who
//! sends it (a token in a header or in the page's cookie, or anyone, on loopback without tokens)?
//! Requests that fail are rejected here.

mod access;
mod connections;
mod keyring;
mod middleware;
mod origin_check;
mod unknown_host;

use std::io;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use axum::extract::ConnectInfo;
use axum::middleware::from_fn;
use hyper::Request;
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper::service::{Service as _, service_fn};
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::{TcpListener, UnixListener};
use tokio::time::sleep;
use tokio_io_timeout::TimeoutStream;
use tracing::debug;

use connections::{Connections, Place};

pub use access::{Access, Refusal, Visitor};
pub use keyring::{AccessError, Key, Keyring, Role};
pub use middleware::{
    CAMERA, Me, ROLE, cookie, count_as_member, guard_request, routes, set_cookie,
};

const LISTEN: SocketAddr = SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), 7788);
pub const MAX_VIEWERS: usize = 32;

/// `live:` of the config.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Options {
    /// The address of the page and the API, `IP:PORT`. Beyond loopback a token is required.
    #[schemars(with = "Option<String>")]
    pub listen: Option<SocketAddr>,
    /// Host names of the page besides that address, such as that of a proxy in front of it.
    pub hosts: Vec<String>,
}

impl Options {
    pub fn address(&self) -> SocketAddr {
        self.listen.unwrap_or(LISTEN)
    }
}

/// Returns a client that asks one other program, for at most this long.
pub fn agent(limit: Duration) -> ureq::Agent {
    ureq::Agent::config_builder()
        .timeout_global(Some(limit))
        .http_status_as_error(false)
        // Another host is not to get the header fields, which may hold secrets.
        .max_redirects(0)
        .user_agent(concat!("spykee/", env!("CARGO_PKG_VERSION")))
        .build()
        .into()
}

/// Timeout for a request's head, and its maximum length in bytes.
const HEAD: Duration = Duration::from_secs(5);
const MAX_HEAD: usize = 64 * 1024;
/// How long the client may read nothing of a response.
const STALL: Duration = Duration::from_secs(15);
const PAUSE: Duration = Duration::from_millis(200);

/// Serves the network; never returns. A connection carries one request, so that the timeout for its
/// head counts from the start; the middleware enforces the one for the body.
pub async fn serve(listener: TcpListener, router: Router) {
    let server = Server::new(router);
    loop {
        match listener.accept().await {
            Ok((stream, address)) => {
                // Send small messages at once. A failure only delays them.
                let _ = stream.set_nodelay(true);
                server.serve(stream, address.ip(), ConnectInfo(address));
            }
            Err(error) => pause_after(&error).await,
        }
    }
}

/// Serves programs of the same user through a private socket; never returns.
pub async fn serve_private(listener: UnixListener, router: Router) {
    let server = Server::new(router.layer(from_fn(middleware::admit_local)));
    loop {
        let accepted = listener.accept().await;
        let connected = accepted.and_then(|(stream, _)| Ok((stream.peer_cred()?.uid(), stream)));
        match connected {
            Ok((user, stream)) => {
                server.serve(stream, Ipv4Addr::LOCALHOST.into(), Visitor::local(user));
            }
            Err(error) => pause_after(&error).await,
        }
    }
}

async fn pause_after(error: &io::Error) {
    debug!("cannot accept a connection: {error}");
    sleep(PAUSE).await;
}

struct Server {
    connections: Arc<Connections>,
    router: Arc<TowerToHyperService<Router>>,
}

impl Server {
    fn new(router: Router) -> Server {
        Server {
            connections: Arc::default(),
            router: Arc::new(TowerToHyperService::new(router)),
        }
    }

    /// Serves one connection in a task of its own; its requests have this extension.
    fn serve<S, E>(&self, stream: S, address: IpAddr, extension: E)
    where
        S: AsyncRead + AsyncWrite + Send + 'static,
        E: Clone + Send + Sync + 'static,
    {
        let mut stream = TimeoutStream::new(stream);
        stream.set_write_timeout(Some(STALL));
        let router = self.router.clone();
        let place = Arc::new(Place::new(&self.connections, address));
        let request_place = place.clone();
        let service = service_fn(move |mut request: Request<Incoming>| {
            request.extensions_mut().insert(extension.clone());
            request.extensions_mut().insert(request_place.clone());
            router.call(request)
        });
        let connection = http1::Builder::new()
            .timer(TokioTimer::new())
            .header_read_timeout(HEAD)
            .max_buf_size(MAX_HEAD)
            .serve_connection(TokioIo::new(Box::pin(stream)), service)
            .with_upgrades();
        tokio::spawn(async move {
            tokio::select! {
                ended = connection => if let Err(error) = ended {
                    debug!("a connection of {address} has failed: {error}");
                },
                () = place.closed() => debug!("a connection of {address} is closed: too many"),
            }
        });
    }
}
