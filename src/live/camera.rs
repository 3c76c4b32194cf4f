//! The camera for viewers: one client of the pilot requests the stream while there are viewers, and
//! a channel holds the newest frame, which each viewer takes when ready.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use tokio::sync::watch;
use tokio::time::{sleep, timeout};

use crate::agent::PilotClientError;
use crate::control::Run;
use crate::robot::{Frame, Intent};
use crate::vision::validate_markers;
use crate::wire::Stream;

/// How long the stream stays on after the last viewer.
const LINGER: Duration = Duration::from_secs(2);

/// Delay of frames for viewers. Behaviours get a frame first: sending it to many viewers keeps a
/// small machine busy for longer than a behaviour needs to react.
const AFTER_BEHAVIOURS: Duration = Duration::from_millis(5);

#[derive(Debug)]
pub(super) struct Camera {
    newest: watch::Sender<Option<Frame>>,
    viewers: watch::Sender<usize>,
    bytes: AtomicU64,
}

/// A registered viewer of the camera, until dropped.
#[derive(Debug)]
pub(super) struct CameraViewer<'a>(&'a Camera);

impl Drop for CameraViewer<'_> {
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

    /// Registers a viewer.
    pub(super) fn register(&self) -> CameraViewer<'_> {
        self.viewers.send_modify(|viewers| *viewers += 1);
        CameraViewer(self)
    }

    /// Returns a channel with the newest frame.
    pub(super) fn frames(&self) -> watch::Receiver<Option<Frame>> {
        self.newest.subscribe()
    }

    /// Returns the total bytes of all frames passed on.
    pub(super) fn bytes(&self) -> u64 {
        self.bytes.load(Ordering::Relaxed)
    }

    /// Passes frames on until the run has ended.
    pub(super) async fn serve(&self, run: &Run) {
        tokio::join!(self.pass_on(run), self.request_stream(run));
    }

    async fn pass_on(&self, run: &Run) {
        let mut pictures = run.pictures.clone();
        let mut last = 0;
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

    /// Requests the stream while there are viewers, and for a while after.
    async fn request_stream(&self, run: &Run) {
        let mut viewers = self.viewers.subscribe();
        while viewers.wait_for(|viewers| *viewers > 0).await.is_ok() {
            let Err(error) = watch_on(run, &mut viewers).await else {
                continue;
            };
            tracing::debug!("the page cannot get the camera stream now: {error}");
            if run.requests.is_closed() {
                return;
            }
            sleep(LINGER).await;
        }
    }
}

async fn watch_on(run: &Run, viewers: &mut watch::Receiver<usize>) -> Result<(), PilotClientError> {
    let mut client = run.pilot_client("the page").await?;
    let stream = Stream::Video;
    let on = true;
    client.send_intent(Intent::Stream { stream, on }).await?;
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
            event = client.next_event() => drop(event?),
        }
    }
}
