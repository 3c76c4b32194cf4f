//! The listening socket: it limits the number of connections and the time that each may take to
//! send its request and to read the response.
//!
//! A connection carries one request (`Connection: close`), so that the timeout for its head counts
//! from the start. The middleware enforces the timeout for the body.

use std::future::Future;
use std::io;
use std::net::SocketAddr;
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::task::{Context, Poll, ready};
use std::time::Duration;

use axum::extract::connect_info::Connected;
use axum::serve::{IncomingStream, Listener};
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::time::{Instant, Sleep, sleep, sleep_until};
use tracing::debug;

/// Timeout for a request's head.
const HEAD: Duration = Duration::from_secs(5);
/// How long the client may read nothing of a response.
const STALL: Duration = Duration::from_secs(15);
/// Maximum number of connections besides those of viewers.
const SPARE: usize = 64;
/// Pause after a failed `accept`.
const PAUSE: Duration = Duration::from_millis(200);

/// See the module.
#[derive(Debug)]
pub struct LimitedListener {
    listener: TcpListener,
    room: Arc<Semaphore>,
}

impl LimitedListener {
    /// Opens the socket, for this many viewers.
    ///
    /// # Errors
    /// If the address is in use or does not belong to this machine.
    pub async fn open(address: SocketAddr, viewers: u16) -> io::Result<LimitedListener> {
        let listener = TcpListener::bind(address).await?;
        let room = Arc::new(Semaphore::new(usize::from(viewers) + SPARE));
        Ok(LimitedListener { listener, room })
    }

    /// Returns the socket's address.
    ///
    /// # Errors
    /// Any error of the system.
    pub fn address(&self) -> io::Result<SocketAddr> {
        self.listener.local_addr()
    }
}

impl Listener for LimitedListener {
    type Io = Connection;
    type Addr = SocketAddr;

    async fn accept(&mut self) -> (Connection, SocketAddr) {
        loop {
            // Further connections wait in the system's queue. The semaphore is never closed.
            let Ok(permit) = self.room.clone().acquire_owned().await else {
                std::future::pending().await
            };
            match self.listener.accept().await {
                Ok((stream, address)) => {
                    // Send small messages at once. A failure only delays them.
                    let _ = stream.set_nodelay(true);
                    return (Connection::new(stream, permit), address);
                }
                Err(error) => {
                    debug!("cannot accept a connection: {error}");
                    sleep(PAUSE).await;
                }
            }
        }
    }

    fn local_addr(&self) -> io::Result<SocketAddr> {
        self.address()
    }
}

/// The other end of a connection.
#[derive(Debug, Clone)]
pub struct Peer {
    /// Its address.
    pub address: SocketAddr,
    /// Whether the request's head has arrived.
    head_received: Arc<AtomicBool>,
}

impl Peer {
    /// Records that the request's head has arrived in time.
    pub(super) fn mark_head_received(&self) {
        self.head_received.store(true, Ordering::Relaxed);
    }
}

impl Connected<IncomingStream<'_, LimitedListener>> for Peer {
    fn connect_info(stream: IncomingStream<'_, LimitedListener>) -> Peer {
        Peer {
            address: *stream.remote_addr(),
            head_received: stream.io().head_received.clone(),
        }
    }
}

/// A connection with timeouts.
#[derive(Debug)]
pub struct Connection {
    stream: TcpStream,
    head_received: Arc<AtomicBool>,
    head: Pin<Box<Sleep>>,
    /// Set while a write is pending.
    stall: Option<Pin<Box<Sleep>>>,
    _permit: OwnedSemaphorePermit,
}

impl Connection {
    fn new(stream: TcpStream, permit: OwnedSemaphorePermit) -> Connection {
        Connection {
            stream,
            head_received: Arc::default(),
            head: Box::pin(sleep(HEAD)),
            stall: None,
            _permit: permit,
        }
    }

    /// Returns an error if the other end has read nothing for too long. `progress`: it has just
    /// read something.
    fn check_stall(&mut self, context: &mut Context<'_>, progress: bool) -> io::Result<()> {
        if progress {
            self.stall = None;
            return Ok(());
        }
        let stall = self
            .stall
            .get_or_insert_with(|| Box::pin(sleep_until(Instant::now() + STALL)));
        match stall.as_mut().poll(context) {
            Poll::Ready(()) => Err(io::ErrorKind::TimedOut.into()),
            Poll::Pending => Ok(()),
        }
    }
}

impl AsyncRead for Connection {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        if !self.head_received.load(Ordering::Relaxed)
            && self.head.as_mut().poll(context).is_ready()
        {
            return Poll::Ready(Err(io::ErrorKind::TimedOut.into()));
        }
        Pin::new(&mut self.stream).poll_read(context, buffer)
    }
}

impl AsyncWrite for Connection {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        let written = Pin::new(&mut self.stream).poll_write(context, bytes);
        self.check_stall(context, written.is_ready())?;
        written
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        slices: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        let written = Pin::new(&mut self.stream).poll_write_vectored(context, slices);
        self.check_stall(context, written.is_ready())?;
        written
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        ready!(Pin::new(&mut self.stream).poll_shutdown(context))?;
        Poll::Ready(Ok(()))
    }
}
