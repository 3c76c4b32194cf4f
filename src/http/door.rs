//! The listening socket: so many connections at a time, and each of them asks in time and reads what
//! it is answered.
//!
//! A connection carries one request (`Connection: close`), so that the time for its head counts from
//! the beginning. That for its body is kept at the gate.

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

/// How long a request's head may take.
const HEAD: Duration = Duration::from_secs(5);
/// How long nothing of an answer may be taken.
const STALL: Duration = Duration::from_secs(15);
/// Connections at a time besides those of viewers.
const SPARE: usize = 64;
/// The pause after a connection that the system could not give.
const PAUSE: Duration = Duration::from_millis(200);

/// See the module.
#[derive(Debug)]
pub struct Door {
    listener: TcpListener,
    room: Arc<Semaphore>,
}

impl Door {
    /// Opens it, for so many viewers.
    ///
    /// # Errors
    /// The address is taken, or not of this machine.
    pub async fn open(address: SocketAddr, viewers: u16) -> io::Result<Door> {
        let listener = TcpListener::bind(address).await?;
        let room = Arc::new(Semaphore::new(usize::from(viewers) + SPARE));
        Ok(Door { listener, room })
    }

    /// Where it is.
    ///
    /// # Errors
    /// What the system says.
    pub fn address(&self) -> io::Result<SocketAddr> {
        self.listener.local_addr()
    }
}

impl Listener for Door {
    type Io = Connection;
    type Addr = SocketAddr;

    async fn accept(&mut self) -> (Connection, SocketAddr) {
        loop {
            // More wait in the system's queue. The semaphore is never closed.
            let Ok(permit) = self.room.clone().acquire_owned().await else {
                std::future::pending().await
            };
            match self.listener.accept().await {
                Ok((stream, address)) => {
                    // Small messages go out at once; without that they are only late.
                    let _ = stream.set_nodelay(true);
                    return (Connection::new(stream, permit), address);
                }
                Err(error) => {
                    debug!("a connection could not be let in: {error}");
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
    /// Where it is.
    pub address: SocketAddr,
    /// Its head has come.
    heard: Arc<AtomicBool>,
}

impl Peer {
    /// The request's head has come in time.
    pub(super) fn heard(&self) {
        self.heard.store(true, Ordering::Relaxed);
    }
}

impl Connected<IncomingStream<'_, Door>> for Peer {
    fn connect_info(stream: IncomingStream<'_, Door>) -> Peer {
        Peer {
            address: *stream.remote_addr(),
            heard: stream.io().heard.clone(),
        }
    }
}

/// A connection that asks in time.
#[derive(Debug)]
pub struct Connection {
    stream: TcpStream,
    heard: Arc<AtomicBool>,
    head: Pin<Box<Sleep>>,
    /// While something waits to be written.
    stall: Option<Pin<Box<Sleep>>>,
    _permit: OwnedSemaphorePermit,
}

impl Connection {
    fn new(stream: TcpStream, permit: OwnedSemaphorePermit) -> Connection {
        Connection {
            stream,
            heard: Arc::default(),
            head: Box::pin(sleep(HEAD)),
            stall: None,
            _permit: permit,
        }
    }

    /// Whether the other end has taken nothing for too long; `progress` says that it takes something.
    fn stalls(&mut self, context: &mut Context<'_>, progress: bool) -> io::Result<()> {
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
        if !self.heard.load(Ordering::Relaxed) && self.head.as_mut().poll(context).is_ready() {
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
        self.stalls(context, written.is_ready())?;
        written
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        slices: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        let written = Pin::new(&mut self.stream).poll_write_vectored(context, slices);
        self.stalls(context, written.is_ready())?;
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
