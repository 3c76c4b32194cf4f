//! The guardian's socket for a person's STOP, for an agent that hangs. One datagram asks, one
//! answers: no client can keep another one waiting.

use std::io;
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::net::{SocketAddr, UnixDatagram};
use std::path::{Path, PathBuf};
use std::time::Duration;

use rustix::net::{SocketAddrUnix, bind};

use crate::files::Folder;

const STOP: &[u8] = b"STOP\n";
const MAX_WORD_LEN: usize = 16;
/// How long an answer may take.
const ANSWER_LIMIT: Duration = Duration::from_secs(2);

/// What a guardian has done about a person's STOP.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StopAnswer {
    /// The run hangs, and the guardian has written the stop to the robot.
    Written,
    /// The run hangs and has no link to the robot. The guardian writes the stop as soon as it has
    /// one.
    Pending,
    /// The run does not hang: it takes the request itself.
    Alive,
}

impl StopAnswer {
    fn word(self) -> &'static [u8] {
        match self {
            StopAnswer::Written => b"ok\n",
            StopAnswer::Pending => b"pending\n",
            StopAnswer::Alive => b"alive\n",
        }
    }

    fn parse(word: &[u8]) -> Option<StopAnswer> {
        let all = [StopAnswer::Written, StopAnswer::Pending, StopAnswer::Alive];
        all.into_iter().find(|answer| answer.word() == word)
    }
}

/// Asks the guardian that listens at `path` to stop its robot in place of a run that hangs. Blocks
/// for at most two seconds.
/// Fails if nobody listens there, or no answer comes in time.
pub fn request_stop(path: &Path) -> io::Result<StopAnswer> {
    let (folder, name) = place(path)?;
    let socket = UnixDatagram::unbound()?;
    // The kernel chooses a name, to which the answer is sent.
    bind(&socket, &SocketAddrUnix::new_unnamed())?;
    socket.connect(folder.socket_path(&name))?;
    socket.set_read_timeout(Some(ANSWER_LIMIT))?;
    socket.set_write_timeout(Some(ANSWER_LIMIT))?;
    socket.send(STOP)?;
    let mut word = [0; MAX_WORD_LEN];
    let count = socket.recv(&mut word)?;
    let unknown = || io::Error::new(io::ErrorKind::InvalidData, "an unknown answer");
    StopAnswer::parse(&word[..count]).ok_or_else(unknown)
}

/// The folder of a socket, and its name in there.
fn place(path: &Path) -> io::Result<(Folder, String)> {
    let (Some(folder), Some(name)) = (path.parent(), path.file_name()) else {
        return Err(io::ErrorKind::InvalidInput.into());
    };
    Ok((Folder::open(folder)?, name.to_string_lossy().into_owned()))
}

/// Dropping it removes the socket's file, and its folder if that is then empty.
#[derive(Debug)]
pub(super) struct StopSocket {
    socket: UnixDatagram,
    path: PathBuf,
}

impl StopSocket {
    /// Takes the place of a socket that an earlier guardian of this run has left. Fails if its folder
    /// does not exist.
    pub(super) fn bind(path: PathBuf) -> io::Result<StopSocket> {
        let (folder, name) = place(&path)?;
        let socket = folder.bind(&name, |path| UnixDatagram::bind(path))?;
        socket.set_nonblocking(true)?;
        // The folder is not kept open: the guardian may outlive the run.
        Ok(StopSocket { socket, path })
    }

    /// Who asks for a stop, if anyone does.
    pub(super) fn receive(&self) -> Option<SocketAddr> {
        let mut word = [0; MAX_WORD_LEN];
        let (count, from) = self.socket.recv_from(&mut word).ok()?;
        if &word[..count] == STOP {
            Some(from)
        } else {
            None
        }
    }

    pub(super) fn answer(&self, to: &SocketAddr, answer: StopAnswer) {
        // The asker may be gone.
        let _ = self.socket.send_to_addr(answer.word(), to);
    }
}

impl AsFd for StopSocket {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.socket.as_fd()
    }
}

impl Drop for StopSocket {
    fn drop(&mut self) {
        if let Ok((folder, name)) = place(&self.path) {
            let _ = folder.remove(&name);
        }
        if let Some(folder) = self.path.parent() {
            let _ = std::fs::remove_dir(folder);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::PermissionsExt as _;

    use super::*;

    #[test]
    fn one_word_is_asked_and_answered_and_nothing_is_left() {
        let home = tempfile::tempdir().unwrap();
        let folder = home.path().join("a".repeat(150));
        std::fs::create_dir(&folder).unwrap();
        let path = folder.join("7.guardian");
        for answer in [StopAnswer::Written, StopAnswer::Pending, StopAnswer::Alive] {
            // As left by a guardian that was killed.
            std::fs::write(&path, "").unwrap();
            let socket = StopSocket::bind(path.clone()).unwrap();
            let mode = path.metadata().unwrap().permissions().mode();
            assert_eq!(mode & 0o777, 0o600);
            let asked = path.clone();
            let asking = std::thread::spawn(move || request_stop(&asked).unwrap());
            let from = loop {
                if let Some(from) = socket.receive() {
                    break from;
                }
                std::thread::yield_now();
            };
            socket.answer(&from, answer);
            assert_eq!(asking.join().unwrap(), answer);
            drop(socket);
            assert!(!folder.exists());
            std::fs::create_dir(&folder).unwrap();
        }
        assert!(request_stop(&path).is_err());
    }

    #[test]
    fn other_words_are_ignored() {
        let home = tempfile::tempdir().unwrap();
        let path = home.path().join("7.guardian");
        let socket = StopSocket::bind(path.clone()).unwrap();
        let other = UnixDatagram::unbound().unwrap();
        for word in [&b"GO\n"[..], b"STOP", b"STOP\nSTOP\nSTOP\nSTOP\n", b""] {
            other.send_to(word, &path).unwrap();
            assert!(socket.receive().is_none());
        }
    }
}
