//! The half that speaks to the robot.

use std::future::Future;
use std::io::{self, Write};
use std::net::TcpStream;
use std::pin::{Pin, pin};
use std::task::{Context, Poll, Waker};
use std::time::Duration;

use tokio::io::{AsyncWrite, AsyncWriteExt};
use tokio::task::coop;
use tokio::time::timeout;

use super::LinkError;
use super::outbox::Outbox;
use crate::wire::Command;

/// The write half of a [`super::Session`]. Whoever owns it, and nobody else, moves the robot.
///
/// Dropped without [`Writer::close`], be it by a panic, it stops the tracks as [`Writer::stop_now`]
/// does.
pub struct Writer {
    io: Box<dyn AsyncWrite + Send + Unpin>,
    /// The same socket once more: writes without a runtime, in the middle of a panic.
    direct: Option<TcpStream>,
    outbox: Outbox,
    dead_after: Duration,
    /// The tracks may be on: a drop must stop them.
    armed: bool,
}

impl Writer {
    pub(super) fn new(
        io: Box<dyn AsyncWrite + Send + Unpin>,
        direct: Option<TcpStream>,
        dead_after: Duration,
    ) -> Writer {
        Writer {
            io,
            direct,
            outbox: Outbox::default(),
            dead_after,
            armed: false,
        }
    }

    /// From now on a drop stops the tracks. Before the login is through a MOVE would be refused.
    pub(super) fn arm(&mut self) {
        self.armed = true;
    }

    /// Writes all commands in one write, and flushes. If the wait is dropped, what is left goes out
    /// first with the next write: messages are never cut or mixed.
    ///
    /// # Errors
    /// [`LinkError::Dead`] when the robot does not take them within `dead_after`,
    /// [`LinkError::Closed`] when it has gone. Then drop the session; bytes may be left unwritten.
    pub async fn write(&mut self, commands: &[Command]) -> Result<(), LinkError> {
        let after = self.dead_after;
        if !self.outbox.push(commands) {
            return Err(LinkError::Dead { after });
        }
        match timeout(after, self.drain()).await {
            Ok(written) => written.map_err(|error| LinkError::from_io(error, after)),
            Err(_) => Err(LinkError::Dead { after }),
        }
    }

    async fn drain(&mut self) -> io::Result<()> {
        while !self.outbox.rest().is_empty() {
            let count = self.io.write(self.outbox.rest()).await?;
            if count == 0 {
                return Err(io::ErrorKind::WriteZero.into());
            }
            self.outbox.advance(count);
        }
        self.io.flush().await
    }

    /// MOVE 0 0 without waiting, as well as can be: for panics and drops, inside a runtime or not.
    /// A message that is partly out is finished first, others that wait are forgotten: they might
    /// be motion.
    pub fn stop_now(&mut self) {
        self.outbox.replace_unstarted(&Command::STOP);
        while !self.outbox.rest().is_empty() {
            match self.write_now() {
                Ok(count @ 1..) => self.outbox.advance(count),
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Ok(0) | Err(_) => return,
            }
        }
        if self.direct.is_none() {
            let _ = poll_once(|cx| Pin::new(&mut self.io).poll_flush(cx));
        }
    }

    fn write_now(&mut self) -> io::Result<usize> {
        let rest = self.outbox.rest();
        match &self.direct {
            // Shares the non-blocking mode of the socket it was cloned from.
            Some(direct) => (&mut &*direct).write(rest),
            None => poll_once(|cx| Pin::new(&mut self.io).poll_write(cx, rest)),
        }
    }

    /// Writes what is left, and ends the connection, within `dead_after`. Sends nothing of its own
    /// when that works: stop the tracks first.
    pub async fn close(mut self) {
        let limit = self.dead_after;
        let closing = async {
            self.drain().await?;
            self.io.shutdown().await
        };
        let closed = timeout(limit, closing).await;
        self.armed = !matches!(closed, Ok(Ok(())));
    }
}

/// One poll, outside of any task's budget.
fn poll_once<T>(
    mut poll: impl FnMut(&mut Context<'_>) -> Poll<io::Result<T>> + Unpin,
) -> io::Result<T> {
    let future = pin!(coop::unconstrained(std::future::poll_fn(|cx| poll(cx))));
    match future.poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(result) => result,
        Poll::Pending => Err(io::ErrorKind::WouldBlock.into()),
    }
}

impl Drop for Writer {
    fn drop(&mut self) {
        if self.armed {
            self.stop_now();
        }
    }
}

impl std::fmt::Debug for Writer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Writer").finish_non_exhaustive()
    }
}
