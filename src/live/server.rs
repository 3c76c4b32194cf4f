//! The page's thread: its runtime and its server.

use std::io;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::{Arc, mpsc};
use std::time::Duration;

use axum::http::header;
use axum::routing::{MethodRouter, get};
use axum::{Router, middleware};
use tokio::net::TcpListener;
use tokio::sync::watch;
use tokio_util::task::AbortOnDropHandle;

use super::broadcast::Broadcast;
use super::log::Line;
use super::scripts::RunDefinition;
use super::{api, book};
use crate::control::{self, Run};
use crate::http;
use crate::http::{Access, AccessError, Options};
use crate::robot::Listener;
use crate::side_thread::SideThread;

/// How long the end of the server may take.
const SHUTDOWN_TIMEOUT: Duration = Duration::from_secs(5);

/// The run that the page shows and controls.
pub struct WebContext {
    pub run: Run,
    pub definition: watch::Receiver<RunDefinition>,
    pub bus: Listener,
    /// Its log lines, if they are copied: see [`tap`](super::tap).
    pub log: Option<tokio::sync::mpsc::Receiver<Line>>,
    /// The folder of its tokens, its journal and the pictures of its behaviours.
    pub data: PathBuf,
}

#[derive(Debug, thiserror::Error)]
pub enum LiveError {
    /// Access cannot be set up: no visitor could log in, or anyone could.
    #[error(transparent)]
    Access(#[from] AccessError),
    #[error("the page cannot be served at {address}: {source}")]
    Socket {
        address: SocketAddr,
        source: io::Error,
    },
    #[error("the page cannot be served: {0}")]
    System(#[from] io::Error),
}

/// A running page server. Dropping it ends the server, and driving by hand.
#[derive(Debug)]
pub struct Live {
    address: SocketAddr,
    thread: SideThread,
}

impl Live {
    /// Starts the server on a separate thread. Waits until the socket is open.
    pub fn start(context: WebContext, options: &Options) -> Result<Live, LiveError> {
        let options = options.clone();
        let (started, starting) = mpsc::sync_channel(1);
        let thread = SideThread::start("live", |stop| async move {
            match open(&context, &options).await {
                Ok((listener, access)) => {
                    let _ = started.send(listener.local_addr().map_err(LiveError::System));
                    let _ = stop
                        .run_until_cancelled(serve(listener, access, context))
                        .await;
                }
                Err(error) => drop(started.send(Err(error))),
            }
        })?;
        let ended = |_| LiveError::System(io::Error::other("its thread has ended"));
        let address = starting.recv().map_err(ended)??;
        Ok(Live { address, thread })
    }

    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Returns the page's address for a browser on this machine.
    pub fn url(&self) -> String {
        let address = self.address;
        if address.ip().is_unspecified() {
            return format!("http://localhost:{}/", address.port());
        }
        format!("http://{address}/")
    }
}

impl Drop for Live {
    fn drop(&mut self) {
        self.thread.finish(SHUTDOWN_TIMEOUT);
    }
}

async fn open(
    context: &WebContext,
    options: &Options,
) -> Result<(TcpListener, Arc<Access>), LiveError> {
    let address = options.address();
    // Check the access before the socket is opened.
    Access::new(options, address, &context.data)?;
    let listener = TcpListener::bind(address).await;
    let listener = listener.map_err(|source| LiveError::Socket { address, source })?;
    // Use the actual port, which matters for the check of `Host`.
    let access = Access::new(options, listener.local_addr()?, &context.data)?;
    Ok((listener, Arc::new(access)))
}

async fn serve(listener: TcpListener, access: Arc<Access>, context: WebContext) {
    let _following = AbortOnDropHandle::new(tokio::spawn(access.clone().follow_tokens()));
    let (requests, _tasks) = serve_run(context, access.clone());
    let router = Router::new()
        .route("/", served("text/html; charset=utf-8", PAGE.as_bytes()))
        .merge(page_files())
        .merge(book::routes())
        .merge(http::routes(access.clone()))
        .merge(requests)
        .layer(middleware::from_fn_with_state(access, http::guard_request));
    http::serve(listener, router).await;
}

/// Serves the run on a thread of its own to programs of the same user, which connect to this socket:
/// without files and without a login.
pub fn serve_privately(
    context: WebContext,
    listener: std::os::unix::net::UnixListener,
) -> Result<SideThread, LiveError> {
    let access = Access::new(
        &Options::default(),
        Options::default().address(),
        &context.data,
    )?;
    listener.set_nonblocking(true)?;
    let thread = SideThread::start("live", |stop| async move {
        let (router, _tasks) = serve_run(context, Arc::new(access));
        match tokio::net::UnixListener::from_std(listener) {
            Ok(listener) => {
                let serving = http::serve_private(listener, router);
                let _ = stop.run_until_cancelled(serving).await;
            }
            Err(error) => tracing::error!("the run cannot be shown: {error}"),
        }
    })?;
    Ok(thread)
}

/// What the page asks of a run, and the tasks behind it.
fn serve_run(context: WebContext, access: Arc<Access>) -> (Router, Vec<AbortOnDropHandle<()>>) {
    let requests = control::routes(context.run.clone());
    let broadcast = Broadcast::new(context.run, context.definition, context.data, access);
    let serving = tokio::spawn(broadcast.clone().serve(context.bus));
    let mut tasks = vec![AbortOnDropHandle::new(serving)];
    let keeper = broadcast.clone();
    tasks.extend(context.log.map(|log| {
        AbortOnDropHandle::new(tokio::spawn(
            async move { keeper.log_buffer.collect(log).await },
        ))
    }));
    (api::routes(broadcast).merge(requests), tasks)
}

const PAGE: &str = include_str!("page/index.html");
/// Path, content type, content.
const FILES: &[(&str, &str, &str)] = &[
    (
        "/style.css",
        "text/css; charset=utf-8",
        include_str!("page/style.css"),
    ),
    ("/icon.svg", "image/svg+xml", include_str!("page/icon.svg")),
    (
        "/manifest.webmanifest",
        "application/manifest+json",
        include_str!("page/manifest.webmanifest"),
    ),
    ("/app.js", JS, include_str!("page/app.js")),
    ("/battery.js", JS, include_str!("page/battery.js")),
    ("/behaviours.js", JS, include_str!("page/behaviours.js")),
    ("/camera.js", JS, include_str!("page/camera.js")),
    ("/connection.js", JS, include_str!("page/connection.js")),
    ("/dom.js", JS, include_str!("page/dom.js")),
    ("/drive.js", JS, include_str!("page/drive.js")),
    ("/gallery.js", JS, include_str!("page/gallery.js")),
    ("/log.js", JS, include_str!("page/log.js")),
    ("/login.js", JS, include_str!("page/login.js")),
    ("/map.js", JS, include_str!("page/map.js")),
    ("/history.js", JS, include_str!("page/history.js")),
    ("/photo.js", JS, include_str!("page/photo.js")),
    ("/robot.js", JS, include_str!("page/robot.js")),
    ("/script.js", JS, include_str!("page/script.js")),
    ("/stop.js", JS, include_str!("page/stop.js")),
    ("/simulation.js", JS, include_str!("page/simulation.js")),
    ("/texts.js", JS, include_str!("page/texts.js")),
];
const JS: &str = "text/javascript; charset=utf-8";
/// The icon for iOS, which draws no SVG on its home screen.
const ICON: &[u8] = include_bytes!("page/icon.png");

/// The page's modules, style and icons, which the pages of a class use too.
pub fn page_files() -> Router {
    let files = FILES
        .iter()
        .fold(Router::new(), |router, &(path, kind, content)| {
            router.route(path, served(kind, content.as_bytes()))
        });
    files.route("/icon.png", served("image/png", ICON))
}

/// A file of a page, compiled into the program.
pub fn served(kind: &'static str, content: &'static [u8]) -> MethodRouter {
    // Another version of the program has other files.
    let headers = [
        (header::CONTENT_TYPE, kind),
        (header::CACHE_CONTROL, "no-cache"),
    ];
    get(move || async move { (headers, content) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_has_no_external_resources_and_no_inline_code() {
        let page = ("/", "text/html", PAGE);
        for (path, kind, content) in FILES.iter().chain([&page]) {
            assert!(!content.contains("https://"), "{path}");
            assert!(
                !content.contains("innerHTML") && !content.contains("eval("),
                "{path}"
            );
            if kind.starts_with("text/html") {
                assert!(
                    !content.contains(" style=") && !content.contains(" onclick"),
                    "{path}"
                );
                assert_eq!(content.matches("<script").count(), 1, "{path}");
            }
        }
    }

    #[test]
    fn phones_of_both_kinds_find_an_icon_that_is_served() {
        let content = |path: &str| FILES.iter().find(|file| file.0 == path).unwrap().2;
        let link = "<link rel=\"apple-touch-icon\" href=\"/icon.png\">";
        assert!(PAGE.contains(link));
        assert!(content("/manifest.webmanifest").contains("\"/icon.png\""));
        assert!(ICON.starts_with(b"\x89PNG\r\n\x1a\n"));
        // Width and height (PNG, 11.2.1), as the manifest says.
        assert_eq!(&ICON[16..24], [0, 0, 0, 180, 0, 0, 0, 180]);
    }

    #[test]
    fn every_imported_module_exists() {
        for (path, _, content) in FILES.iter().filter(|file| file.1 == JS) {
            for line in content.lines().filter(|line| line.starts_with("import")) {
                let name = line
                    .rsplit('"')
                    .nth(1)
                    .unwrap_or_default()
                    .trim_start_matches('.');
                assert!(FILES.iter().any(|file| file.0 == name), "{path}: {line}");
            }
        }
    }
}
