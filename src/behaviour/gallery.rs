//! Saves marked copies of the newest hundred frames that a script analysed. A separate thread draws
//! and writes them, at the cost of neither the script's budget nor its reaction to a frame; frames
//! that arrive while it is busy are skipped.

use std::io;
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;

use image::RgbImage;
use image::codecs::jpeg::JpegEncoder;
use tokio::time::Instant;

use crate::files::Folder;
use crate::rate_limit::TokenBucket;
use crate::script::{AnnotatedFrame, Limits};
use crate::vision::{Annotation, Decoder, annotate};

/// Maximum number of pictures in the folder; after that the oldest is overwritten.
const PICTURES: usize = 100;
const LONGEST: usize = 512 * 1024;
/// JPEG qualities, tried in this order until the file is short enough.
const QUALITIES: [u8; 2] = [85, 40];

/// Dropping it waits until the last pictures are written: the last frame that a script saw is
/// usually the most interesting one.
#[derive(Debug)]
pub(super) struct Gallery {
    /// Taken in `drop`, which ends the thread.
    frames: Option<SyncSender<AnnotatedFrame>>,
    /// Delivers the first error; `None` once it was reported.
    trouble: Option<Receiver<String>>,
    thread: Option<JoinHandle<()>>,
    /// For virtual time: waits for the thread instead of skipping a frame.
    blocking: bool,
}

impl Gallery {
    /// `left`: how many bytes may be written at once now, if not the whole budget. `blocking`: for
    /// virtual time, in which any thread appears slow, [`Gallery::offer`] waits until
    /// the previous picture was taken from the queue.
    pub(super) fn open(
        folder: PathBuf,
        limits: &Limits,
        left: Option<u64>,
        blocking: bool,
    ) -> io::Result<Gallery> {
        let (frames, waiting) = sync_channel::<AnnotatedFrame>(1);
        let (complaints, trouble) = sync_channel(1);
        let mut ring = Ring::new(folder, limits);
        ring.day = ring.day.with_left(left);
        let thread = std::thread::Builder::new()
            .name("gallery".into())
            .spawn(move || {
                for annotated in waiting {
                    if let Err(error) = ring.save(&annotated) {
                        // Only the first error is reported.
                        let _ = complaints.try_send(error.to_string());
                    }
                }
            })?;
        Ok(Gallery {
            frames: Some(frames),
            trouble: Some(trouble),
            thread: Some(thread),
            blocking,
        })
    }

    /// Skips the picture if the queue is full; never waits, unless the gallery is blocking.
    pub(super) fn offer(&self, annotated: AnnotatedFrame) {
        let Some(frames) = &self.frames else {
            return;
        };
        if self.blocking {
            let _ = frames.send(annotated);
        } else {
            let _ = frames.try_send(annotated);
        }
    }

    /// Why a picture was not saved, once: for the first failure.
    pub(super) fn take_error(&mut self) -> Option<String> {
        let trouble = self.trouble.as_ref()?.try_recv().ok()?;
        self.trouble = None;
        Some(trouble)
    }
}

impl Drop for Gallery {
    fn drop(&mut self) {
        self.frames = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// The files `00.jpg` to `99.jpg`, written in rotation.
struct Ring {
    folder: PathBuf,
    decoder: Decoder,
    /// Number of the next file; `None` before the first write.
    next: Option<usize>,
    day: TokenBucket,
    free: u64,
}

impl Ring {
    fn new(folder: PathBuf, limits: &Limits) -> Ring {
        Ring {
            folder,
            day: TokenBucket::a_day(limits.bytes_a_day),
            free: limits.free_bytes,
            decoder: Decoder::default(),
            next: None,
        }
    }

    fn save(&mut self, annotated: &AnnotatedFrame) -> io::Result<()> {
        // A frame that cannot be decoded is skipped; it is counted elsewhere.
        let Ok(image) = self.decoder.decode(&annotated.frame.jpeg) else {
            return Ok(());
        };
        let marks = annotated.marks.iter().map(|seen| Annotation {
            blob: &seen.blob,
            text: &seen.text,
        });
        let picture = annotate(image, &marks.collect::<Vec<_>>());
        let bytes = encode(&picture)?;
        let folder = Folder::make(&self.folder)?;
        let length = bytes.len() as u64;
        if folder.free()? < self.free.saturating_add(length) {
            let words = format!("the disk has less than {} bytes left", self.free);
            return Err(io::Error::other(words));
        }
        if !self.day.take(length as f64, Instant::now()) {
            let words = format!(
                "the limit of {} bytes of pictures per day is used up",
                self.day.per_day()
            );
            return Err(io::Error::other(words));
        }
        let next = match self.next {
            Some(next) => next,
            None => behind_newest(&folder)?,
        };
        folder.replace(&name(next), &bytes)?;
        self.next = Some((next + 1) % PICTURES);
        Ok(())
    }
}

fn name(number: usize) -> String {
    format!("{number:02}.jpg")
}

/// The number after the newest file of an earlier run: the newest pictures are kept.
fn behind_newest(folder: &Folder) -> io::Result<usize> {
    let mut written = [None; PICTURES];
    for item in folder.items()? {
        if let Some(number) = (0..PICTURES).find(|number| name(*number) == item.name) {
            written[number] = Some(item.written);
        }
    }
    // File times are coarse: of several files with the same time, the last written is the one whose
    // successor is older.
    let is_last = |number: &usize| written[(number + 1) % PICTURES] < written[*number];
    let newest = (0..PICTURES)
        .filter(is_last)
        .max_by_key(|number| written[*number]);
    Ok(newest.map_or(0, |newest| (newest + 1) % PICTURES))
}

fn encode(picture: &RgbImage) -> io::Result<Vec<u8>> {
    for quality in QUALITIES {
        let mut bytes = Vec::new();
        JpegEncoder::new_with_quality(&mut bytes, quality)
            .encode_image(picture)
            .map_err(io::Error::other)?;
        if bytes.len() <= LONGEST {
            return Ok(bytes);
        }
    }
    let (width, height) = picture.dimensions();
    Err(io::Error::other(format!(
        "a marked picture of {width}x{height} has more than {LONGEST} bytes"
    )))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::Frame;
    use crate::script::LabelledBlob;
    use crate::vision::Blob;
    use bytes::Bytes;
    use image::Rgb;
    use std::fs;
    use std::os::unix::fs::PermissionsExt as _;
    use std::path::Path;

    const JPEG: &[u8] = include_bytes!("../../tests/fixtures/ball-444.jpg");

    fn annotated(seq: u64) -> AnnotatedFrame {
        let blob = Blob {
            x: 10,
            y: 20,
            w: 30,
            h: 40,
            ..Blob::default()
        };
        let text = "red".to_owned();
        AnnotatedFrame {
            frame: Frame {
                seq,
                at: tokio::time::Instant::now(),
                jpeg: Bytes::from_static(JPEG),
            },
            marks: vec![LabelledBlob { blob, text }],
        }
    }

    fn files(folder: &Path) -> usize {
        fs::read_dir(folder).unwrap().count()
    }

    #[test]
    fn the_newest_hundred_are_kept_and_are_private() {
        let root = tempfile::tempdir().unwrap();
        let folder = root.path().join("a/b");
        let mut ring = Ring::new(folder.clone(), &Limits::default());
        (0..PICTURES as u64 + 3).for_each(|seq| ring.save(&annotated(seq)).unwrap());
        assert_eq!((files(&folder), ring.next), (PICTURES, Some(3)));
        let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode() & 0o777;
        assert_eq!(
            (mode(&folder), mode(&folder.join("02.jpg"))),
            (0o700, 0o600)
        );
        let mut again = Ring::new(folder.clone(), &Limits::default());
        again.save(&annotated(1)).unwrap();
        assert_eq!((files(&folder), again.next), (PICTURES, Some(4)));
    }

    #[test]
    fn the_last_picture_is_written_before_the_drop_returns() {
        let root = tempfile::tempdir().unwrap();
        let gallery =
            Gallery::open(root.path().to_owned(), &Limits::default(), None, false).unwrap();
        gallery.offer(annotated(1));
        drop(gallery);
        let kept = image::open(root.path().join("00.jpg")).unwrap().to_rgb8();
        let plain = image::load_from_memory(JPEG).unwrap().to_rgb8();
        assert_eq!(kept.dimensions(), plain.dimensions());
        let differs = |x, y| {
            let pairs = kept
                .get_pixel(x, y)
                .0
                .into_iter()
                .zip(plain.get_pixel(x, y).0);
            pairs.map(|(a, b)| u32::from(a.abs_diff(b))).sum::<u32>() > 60
        };
        assert!(differs(9, 40) && differs(25, 19), "no box is drawn");
        assert!(!differs(90, 70), "the rest stays as it was");
    }

    #[test]
    fn a_folder_that_cannot_be_written_is_reported_once() {
        let root = tempfile::tempdir().unwrap();
        let file = root.path().join("file");
        fs::write(&file, "").unwrap();
        let mut gallery =
            Gallery::open(file.join("folder"), &Limits::default(), None, false).unwrap();
        gallery.offer(annotated(1));
        let trouble = loop {
            if let Some(trouble) = gallery.take_error() {
                break trouble;
            }
            std::thread::yield_now();
        };
        assert!(!trouble.is_empty());
        gallery.offer(annotated(2));
        assert_eq!(gallery.take_error(), None);
    }

    #[test]
    fn no_picture_exceeds_the_maximum_length() {
        let mut state = 1_u32;
        let noise = RgbImage::from_fn(1280, 1024, |_, _| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            Rgb([(state >> 8) as u8, (state >> 16) as u8, (state >> 24) as u8])
        });
        let length = encode(&noise).map_or(0, |bytes| bytes.len());
        assert!(length <= LONGEST, "{length}");
        assert!(encode(&RgbImage::new(1280, 1024)).is_ok());
    }
}
