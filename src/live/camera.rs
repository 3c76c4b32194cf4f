//! The camera for viewers: one seat wants the stream while anybody looks, and the newest frame is in a
//! place where each viewer takes it when he is ready.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use tokio::sync::watch;
use tokio::time::{sleep, timeout};

use crate::agent::SeatError;
use crate::control::Run;
use crate::robot::{Frame, Intent};
use crate::vision::validate_markers;
use crate::wire::Stream;

/// The stream stays on for so long after the last viewer.
const LINGER: Duration = Duration::from_secs(2);

/// Behaviours get a frame first: sending it to many viewers keeps a small machine busy for longer than
/// a behaviour needs for its answer, so viewers get it so much later.
const AFTER_BEHAVIOURS: Duration = Duration::from_millis(5);

/// See the module.
#[derive(Debug)]
pub(super) struct Camera {
    newest: watch::Sender<Option<Frame>>,
    viewers: watch::Sender<usize>,
    bytes: AtomicU64,
}

/// One who looks; until it is dropped.
#[derive(Debug)]
pub(super) struct Look<'a>(&'a Camera);

impl Drop for Look<'_> {
    fn drop(&mut self) {
        self.0
            .viewers
            .send_modify(|viewers| *viewers = viewers.saturating_sub(1));
    }
}

impl Camera {
    pub(super) fn new() -> Camera {
        Camera {
            newest: watch::Sender::new(None),
            viewers: watch::Sender::new(0),
            bytes: AtomicU64::new(0),
        }
    }

    /// Looks from now on.
    pub(super) fn look(&self) -> Look<'_> {
        self.viewers.send_modify(|viewers| *viewers += 1);
        Look(self)
    }

    /// The newest frame, whenever there is a newer one.
    pub(super) fn frames(&self) -> watch::Receiver<Option<Frame>> {
        self.newest.subscribe()
    }

    /// Bytes of all frames that have come.
    pub(super) fn bytes(&self) -> u64 {
        self.bytes.load(Ordering::Relaxed)
    }

    /// Passes frames on until the run is over.
    pub(super) async fn serve(&self, run: &Run) {
        tokio::join!(self.pass_on(run), self.want(run));
    }

    async fn pass_on(&self, run: &Run) {
        let (mut pictures, mut last) = (run.pictures.clone(), 0);
        while pictures.changed().await.is_ok() {
            sleep(AFTER_BEHAVIOURS).await;
            let newest = pictures.borrow_and_update().newest.clone();
            let sound = |frame: &Frame| validate_markers(&frame.jpeg).is_ok();
            if let Some(frame) = newest.filter(|frame| frame.seq != last && sound(frame)) {
                last = frame.seq;
                self.bytes
                    .fetch_add(frame.jpeg.len() as u64, Ordering::Relaxed);
                self.newest.send_replace(Some(frame));
            }
        }
    }

    /// While there is a viewer, and a little longer, the stream is wanted.
    async fn want(&self, run: &Run) {
        let mut viewers = self.viewers.subscribe();
        while viewers.wait_for(|viewers| *viewers > 0).await.is_ok() {
            let Err(error) = watch_on(run, &mut viewers).await else {
                continue;
            };
            tracing::debug!("the page cannot have the camera just now: {error}");
            if run.requests.is_closed() {
                return;
            }
            sleep(LINGER).await;
        }
    }
}

async fn watch_on(run: &Run, viewers: &mut watch::Receiver<usize>) -> Result<(), SeatError> {
    let mut seat = run.seat("the page").await?;
    let (stream, on) = (Stream::Video, true);
    seat.intend(Intent::Stream { stream, on }).await?;
    let gone = async {
        loop {
            let nobody = viewers.wait_for(|viewers| *viewers == 0).await.is_err();
            let back = timeout(LINGER, viewers.wait_for(|viewers| *viewers > 0)).await;
            if nobody || back.is_err() {
                return;
            }
        }
    };
    tokio::pin!(gone);
    loop {
        tokio::select! {
            () = &mut gone => return Ok(()),
            told = seat.told() => drop(told?),
        }
    }
}
