//! `spykee robot snapshot`: saves one intact picture.

use std::path::{Path, PathBuf};
use std::time::Duration;

use bytes::Bytes;
use serde_json::json;
use tokio::time::Instant;

use super::SharedTargetArgs;
use super::session::{RobotSession, with_session};
use crate::cli::running::{REPLY_TIMEOUT, ask, unexpected_reply};
use crate::cli::{Exit, Failure, argument, print};
use crate::control::{Client, RunRequest, RunResponse};
use crate::robot::Use;
use crate::vision::{Decoder, Size};
use crate::wire::{Command, Report, Stream};

/// Save a picture from the camera
///
/// Waits for an intact frame; damaged ones are counted and discarded.
#[derive(Debug, Clone, clap::Args)]
#[command(after_help = "Example: spykee robot snapshot -o room.jpg --robot 172.17.6.1")]
pub(super) struct SnapshotArgs {
    /// File to write; an existing file is replaced
    #[arg(short, long, value_name = "FILE.jpg")]
    output: PathBuf,
    /// Time to wait for an intact frame, in seconds
    #[arg(long, value_name = "SECONDS", default_value_t = 5,
          value_parser = argument::whole::<u64>(1..=600))]
    timeout: u64,
    /// Print a JSON object
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    pub(super) target: SharedTargetArgs,
}

/// An intact frame, and the number of damaged ones before it.
pub(in crate::cli) struct Shot {
    pub(in crate::cli) jpeg: Bytes,
    size: Size,
    damaged: u32,
}

pub(super) fn snapshot(args: &SnapshotArgs) -> Result<Exit, Failure> {
    with_picture(&args.target, args.timeout, |shot| {
        save_and_report(args, shot)
    })
}

/// Takes a picture, itself or through the run that uses the robot, and has it used.
///
/// # Errors
/// The config keeps video off, no intact frame arrives within these seconds, or its use fails.
pub(in crate::cli) fn with_picture(
    target: &SharedTargetArgs,
    seconds: u64,
    used: impl FnOnce(&Shot) -> Result<Exit, Failure>,
) -> Result<Exit, Failure> {
    let limit = Duration::from_secs(seconds);
    if let Some(run) = target.find_run()? {
        return match request_picture(&run, limit)? {
            Some(shot) => used(&shot),
            None => Ok(Exit::Interrupted),
        };
    }
    with_session(target, async |session| {
        if session.streams.video == Use::Off {
            let failure = Failure::usage("the config keeps video off");
            return Err(failure.help("it has streams: { video: off }"));
        }
        let shot = take_picture(session, limit).await?;
        used(&shot)
    })
}

fn save_and_report(args: &SnapshotArgs, shot: &Shot) -> Result<Exit, Failure> {
    save(&args.output, &shot.jpeg)?;
    let file = args.output.display().to_string();
    let bytes = shot.jpeg.len();
    let Size { width, height } = shot.size;
    if args.json {
        let object = json!({
            "file": file, "bytes": bytes, "width": width, "height": height,
            "damaged_frames": shot.damaged,
        });
        print(&format!("{object}\n"))?;
    } else {
        print(&format!("{file}: {width}x{height}, {bytes} bytes\n"))?;
    }
    Ok(Exit::Done)
}

/// Requests an intact picture from the run that uses the robot; `None` if interrupted.
fn request_picture(run: &Client, limit: Duration) -> Result<Option<Shot>, Failure> {
    let until = std::time::Instant::now() + limit;
    let mut decoder = Decoder::default();
    let mut damaged = 0;
    loop {
        let left = until.saturating_duration_since(std::time::Instant::now());
        let request = RunRequest::Picture {
            seconds: Some(left.as_secs_f64().ceil() as u64),
        };
        let jpeg = match ask(run, &request, left + REPLY_TIMEOUT)? {
            None => return Ok(None),
            Some(RunResponse::Picture { jpeg }) => Bytes::from(jpeg),
            Some(RunResponse::NoPicture) => return Err(no_picture_in_time(limit, damaged)),
            Some(_) => return Err(unexpected_reply()),
        };
        match decoder.decode(&jpeg).map(|image| image.size()) {
            Ok(size) => {
                return Ok(Some(Shot {
                    jpeg,
                    size,
                    damaged,
                }));
            }
            Err(error) => {
                tracing::debug!("a damaged frame: {error}");
                damaged += 1;
            }
        }
    }
}

async fn take_picture(session: &mut RobotSession, limit: Duration) -> Result<Shot, Failure> {
    let video = |on| Command::Stream {
        stream: Stream::Video,
        on,
    };
    let until = Instant::now() + limit;
    let mut decoder = Decoder::default();
    let mut damaged = 0;
    session.send(&[video(true)]).await?;
    let shot = loop {
        let left = until.saturating_duration_since(Instant::now());
        let frame = session.receive(left, |report| match report {
            Report::Video(jpeg) => Some(jpeg),
            _ => None,
        });
        let Some(jpeg) = frame.await? else {
            return Err(no_picture_in_time(limit, damaged));
        };
        match decoder.decode(&jpeg) {
            Ok(image) => break (image.size(), jpeg),
            Err(error) => {
                tracing::debug!("a damaged frame: {error}");
                damaged += 1;
            }
        }
    };
    session.send(&[video(false)]).await?;
    let (size, jpeg) = shot;
    Ok(Shot {
        jpeg,
        size,
        damaged,
    })
}

fn no_picture_in_time(limit: Duration, damaged: u32) -> Failure {
    let seconds = limit.as_secs();
    let what = format!("no intact frame arrived within {seconds} s; damaged ones: {damaged}");
    Failure::new(Exit::Unreachable, what)
        .help("move the robot closer to this computer, or increase --timeout")
}

fn save(path: &Path, jpeg: &[u8]) -> Result<(), Failure> {
    std::fs::write(path, jpeg).map_err(|error| Failure::unwritable(path, error))
}
