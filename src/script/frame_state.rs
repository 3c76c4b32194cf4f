//! The state of the camera's frames: the newest frame, its decoder, and the planned check of a
//! frame for the robot's own motion.

use std::rc::{Rc, Weak};
use std::time::Duration;

use tokio::time::Instant;

use super::damage::Damage;
use super::options::Options;
use crate::odometry::TimedMotion;
use crate::robot::Frame;
use crate::vision::{Blob, FrameAnalyser, Size, SkylineReader, validate_markers};

/// Least time between two kept frames.
const PERIOD: Duration = Duration::from_millis(500);
/// The same while people are watching.
const LIVE_PERIOD: Duration = Duration::from_millis(100);
const MAX_MARKS: usize = 64;

pub(super) struct FrameState {
    pub(super) newest: Option<Rc<Frame>>,
    /// Of the newest frame.
    newest_size: Size,
    /// All frames that something may still reference.
    held: Vec<Weak<Frame>>,
    pub(super) analyser: FrameAnalyser,
    pub(super) skyline_reader: SkylineReader,
    /// Each tracker and motion detector that exists holds one more reference.
    pub(super) watchers: Rc<()>,
    /// A frame that is still to be examined for the robot's own motion.
    pub(super) motion_check: Option<MotionCheck>,
    /// When the last frame arrived during which the tracks turned the robot.
    pub(super) turned: Option<Instant>,
    pub(super) damage: Damage,
    /// Set only if somebody wants to see what the script sees.
    pub(super) recorder: Option<DetectionsRecorder>,
}

/// How to examine a frame for the robot's own motion, with the state at the time when the frame
/// arrived.
pub(super) struct MotionCheck {
    pub(super) frame: Rc<Frame>,
    pub(super) timed: Option<TimedMotion>,
    pub(super) turns: bool,
}

impl FrameState {
    pub(super) fn new(options: &Options) -> FrameState {
        FrameState {
            newest: None,
            newest_size: Size::default(),
            held: Vec::new(),
            analyser: FrameAnalyser::new(options.camera),
            skyline_reader: SkylineReader::new(options.camera),
            watchers: Rc::default(),
            motion_check: None,
            turned: None,
            damage: Damage::default(),
            recorder: DetectionsRecorder::from_options(options),
        }
    }

    /// Makes a frame the newest one, and counts its bytes for as long as something references it.
    /// `size` is from the markers of the JPEG.
    pub(super) fn hold(&mut self, frame: Frame, size: Size) -> Rc<Frame> {
        let frame = Rc::new(frame);
        self.held.retain(|held| held.strong_count() > 0);
        self.held.push(Rc::downgrade(&frame));
        self.newest = Some(Rc::clone(&frame));
        self.newest_size = size;
        frame
    }

    /// The size of a frame that is held. Scripts ask for that of the newest one for each column that
    /// they look at, so the markers of that one are read only once.
    pub(super) fn size_of(&self, frame: &Rc<Frame>) -> Size {
        match &self.newest {
            Some(newest) if Rc::ptr_eq(newest, frame) => self.newest_size,
            _ => validate_markers(&frame.jpeg).unwrap_or_default(),
        }
    }

    /// The JPEG bytes of all frames that are still referenced.
    pub(super) fn held_bytes(&self) -> u64 {
        let held = self.held.iter().filter_map(Weak::upgrade);
        held.map(|frame| frame.jpeg.len() as u64).sum()
    }
}

/// A frame that a script has examined, and what was found in it.
#[derive(Debug, Clone)]
pub struct AnnotatedFrame {
    pub frame: Frame,
    /// What was found, in the order of the script's calls; at most 64.
    pub marks: Vec<LabelledBlob>,
}

#[derive(Debug, Clone, PartialEq)]
pub struct LabelledBlob {
    pub blob: Blob,
    pub text: String,
}

/// Keeps a frame now and then, at most one per `period`.
#[derive(Debug)]
pub(super) struct DetectionsRecorder {
    period: Duration,
    begun: Option<Instant>,
    kept: Option<AnnotatedFrame>,
}

impl DetectionsRecorder {
    /// Creates a recorder if the options say that somebody wants to see what the script sees.
    pub(super) fn from_options(options: &Options) -> Option<DetectionsRecorder> {
        if options.detections {
            Some(DetectionsRecorder::new(LIVE_PERIOD))
        } else if options.annotate_dir.is_some() {
            Some(DetectionsRecorder::new(PERIOD))
        } else {
            None
        }
    }

    fn new(period: Duration) -> DetectionsRecorder {
        DetectionsRecorder {
            period,
            begun: None,
            kept: None,
        }
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
        let mut recorder = DetectionsRecorder::new(PERIOD);
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
        let mut recorder = DetectionsRecorder::new(PERIOD);
        let start = Instant::now();
        let shown = (0..300).filter(|&seq| {
            let now = start + Duration::from_millis(10) * seq;
            recorder.record(&frame(seq.into(), now), now, seen(0));
            recorder.take_if(|_| true).is_some()
        });
        assert_eq!(shown.count(), 6);
    }
}
