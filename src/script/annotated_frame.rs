//! Frames that a script has examined and what it found in them, kept for a person to see. The host
//! draws and saves them; this module only copies the blobs now and then, which is cheap.

use std::time::Duration;

use tokio::time::Instant;

use super::options::Options;
use crate::robot::Frame;
use crate::vision::Blob;

/// Least time between two kept frames.
const PERIOD: Duration = Duration::from_millis(500);
/// The same while people are watching.
const LIVE_PERIOD: Duration = Duration::from_millis(100);
/// Largest number of marks of one frame.
const MAX_MARKS: usize = 64;

/// A frame that a script has examined, and what was found in it.
#[derive(Debug, Clone)]
pub struct AnnotatedFrame {
    /// The frame as it arrived.
    pub frame: Frame,
    /// What was found, in the order of the script's calls; at most 64.
    pub marks: Vec<LabelledBlob>,
}

/// One thing found.
#[derive(Debug, Clone, PartialEq)]
pub struct LabelledBlob {
    /// Where.
    pub blob: Blob,
    /// The label: the colour's name or the track's id.
    pub text: String,
}

/// Keeps a frame now and then, at most one per `period`.
#[derive(Debug)]
pub(super) struct DetectionsRecorder {
    period: Duration,
    begun: Option<Instant>,
    kept: Option<AnnotatedFrame>,
}

impl Default for DetectionsRecorder {
    fn default() -> DetectionsRecorder {
        let period = PERIOD;
        let begun = None;
        let kept = None;
        DetectionsRecorder {
            period,
            begun,
            kept,
        }
    }
}

impl DetectionsRecorder {
    /// Creates a recorder if the options say that somebody wants to see what the script sees.
    pub(super) fn from_options(options: &Options) -> Option<DetectionsRecorder> {
        let live = options.detections;
        let kept = options.annotate_dir.is_some();
        let period = if live { LIVE_PERIOD } else { PERIOD };
        (live || kept).then(|| DetectionsRecorder {
            period,
            ..DetectionsRecorder::default()
        })
    }

    /// Records what was found in a frame. All detections in one frame are kept together.
    pub(super) fn record(
        &mut self,
        frame: &Frame,
        now: Instant,
        found: impl IntoIterator<Item = LabelledBlob>,
    ) {
        let lately = |at: Instant| now.saturating_duration_since(at) < self.period;
        match &mut self.kept {
            Some(kept) if kept.frame.seq == frame.seq => {
                let room = MAX_MARKS - kept.marks.len();
                kept.marks.extend(found.into_iter().take(room));
            }
            Some(_) => {}
            None if self.begun.is_some_and(lately) => {}
            None => {
                self.begun = Some(now);
                let frame = frame.clone();
                let marks = found.into_iter().take(MAX_MARKS).collect();
                self.kept = Some(AnnotatedFrame { frame, marks });
            }
        }
    }

    /// Takes the kept frame, if it is complete.
    pub(super) fn take_if(
        &mut self,
        complete: impl FnOnce(&AnnotatedFrame) -> bool,
    ) -> Option<AnnotatedFrame> {
        self.kept.take_if(|kept| complete(kept))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(seq: u64, at: Instant) -> Frame {
        let jpeg = bytes::Bytes::new();
        Frame { seq, at, jpeg }
    }

    fn seen(count: usize) -> impl Iterator<Item = LabelledBlob> {
        let one = LabelledBlob {
            blob: Blob::default(),
            text: "red".to_owned(),
        };
        std::iter::repeat_n(one, count)
    }

    #[test]
    fn detections_in_one_frame_are_kept_together() {
        let mut recorder = DetectionsRecorder::default();
        let now = Instant::now();
        for (seq, count) in [(1, 2), (1, 1), (2, 5), (1, 100)] {
            recorder.record(&frame(seq, now), now, seen(count));
        }
        assert!(recorder.take_if(|_| false).is_none());
        let kept = recorder.take_if(|_| true).unwrap();
        assert_eq!((kept.frame.seq, kept.marks.len()), (1, MAX_MARKS));
        assert!(recorder.take_if(|_| true).is_none());
    }

    #[test]
    fn at_most_two_frames_a_second_are_kept() {
        let mut recorder = DetectionsRecorder::default();
        let start = Instant::now();
        let shown = (0..300).filter(|&seq| {
            let now = start + Duration::from_millis(10) * seq;
            recorder.record(&frame(seq.into(), now), now, seen(0));
            recorder.take_if(|_| true).is_some()
        });
        assert_eq!(shown.count(), 6);
    }
}
