//! The camera for other tools: one endless response of pictures (MJPEG), each a part of
//! `multipart/x-mixed-replace`.
//!
//! A boundary follows each picture at once: many tools take a picture only when they see the next
//! boundary. A slow tool gets fewer pictures, since the newest is taken when it has room. While no
//! new one arrives, the last is repeated, until it is too old to pass for a live one.

use std::sync::Arc;
use std::time::Duration;

use axum::body::Body;
use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use bytes::{BufMut as _, Bytes, BytesMut};
use futures_util::stream::unfold;
use tokio::sync::watch;
use tokio::time::{Instant, timeout};

use super::broadcast::{Broadcast, CameraViewer};
use super::viewer::Viewer;
use crate::http::{Refusal, Visitor};
use crate::robot::{Frame, Use};
use crate::wire::Stream;

pub(super) const CONTENT_TYPE: &str = "multipart/x-mixed-replace; boundary=frame";
const BOUNDARY: &str = "--frame\r\n";
/// How long the first picture may take.
const FIRST: Duration = Duration::from_secs(10);
/// A picture is repeated after this time: at least one each second, whatever delays it.
const REPEAT: Duration = Duration::from_millis(800);
/// How long the last picture is repeated.
const STALE: Duration = Duration::from_secs(10);

/// Serves the camera's pictures to a visitor who may look.
pub(super) async fn camera(
    State(broadcast): State<Arc<Broadcast>>,
    visitor: Visitor,
) -> Result<Response, Refusal> {
    let refusal = |why| Refusal::new(StatusCode::SERVICE_UNAVAILABLE, why);
    if broadcast.run.streams.usage(Stream::Video) == Use::Off {
        return Err(refusal("the run's config keeps this stream off"));
    }
    let viewer = Viewer::admit(&broadcast, visitor).ok_or_else(|| refusal("too many viewers"))?;
    let mut pictures = LivePictures::new(viewer);
    match timeout(FIRST, pictures.frames.changed()).await {
        Ok(Ok(())) => pictures.frames.mark_changed(),
        _ => return Err(refusal("no picture arrives")),
    }
    let body = unfold(pictures, |mut pictures| async move {
        let part = pictures.next_part().await?;
        Some((Ok::<_, std::convert::Infallible>(part), pictures))
    });
    let headers = [(header::CONTENT_TYPE, CONTENT_TYPE)];
    Ok((headers, Body::from_stream(body)).into_response())
}

/// What a tool is sent, until it goes or its token is revoked.
struct LivePictures {
    viewer: Viewer,
    frames: watch::Receiver<Option<Frame>>,
    _watching: CameraViewer,
    /// When the newest picture came; `None` before the first.
    came: Option<Instant>,
}

impl LivePictures {
    fn new(viewer: Viewer) -> LivePictures {
        let camera = &viewer.broadcast.camera;
        LivePictures {
            frames: camera.newest.subscribe(),
            _watching: camera.register(),
            viewer,
            came: None,
        }
    }

    /// The next part; `None` at the end.
    async fn next_part(&mut self) -> Option<Bytes> {
        let access = &self.viewer.broadcast.access;
        let changed = tokio::select! {
            biased;
            () = access.revoked(&self.viewer.visitor) => return None,
            () = self.viewer.evicted.cancelled() => return None,
            changed = timeout(REPEAT, self.frames.changed()) => changed,
        };
        let is_first = self.came.is_none();
        match changed {
            Ok(Ok(())) => self.came = Some(Instant::now()),
            Ok(Err(_)) => return None,
            Err(_) if self.came.is_none_or(|came| came.elapsed() >= STALE) => return None,
            Err(_) => {}
        }
        let frame = self.frames.borrow_and_update();
        Some(part(&frame.as_ref()?.jpeg, is_first))
    }
}

/// A picture with its head, and the boundary after it; the first begins with a boundary, too.
fn part(jpeg: &[u8], is_first: bool) -> Bytes {
    let head = format!(
        "Content-Type: image/jpeg\r\nContent-Length: {}\r\n\r\n",
        jpeg.len()
    );
    let mut part = BytesMut::with_capacity(2 * BOUNDARY.len() + head.len() + jpeg.len() + 2);
    if is_first {
        part.put_slice(BOUNDARY.as_bytes());
    }
    part.put_slice(head.as_bytes());
    part.put_slice(jpeg);
    part.put_slice(b"\r\n");
    part.put_slice(BOUNDARY.as_bytes());
    part.freeze()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_boundary_stands_before_and_after_each_picture_and_the_length_is_its_own() {
        let rest = "Content-Type: image/jpeg\r\nContent-Length: 4\r\n\r\nJPEG\r\n--frame\r\n";
        assert_eq!(part(b"JPEG", true), format!("--frame\r\n{rest}"));
        assert_eq!(part(b"JPEG", false), rest);
    }
}
