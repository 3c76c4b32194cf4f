//! `spykee robot snapshot`: saves one intact picture.

use std::io::Write as _;
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::PathBuf;
use std::time::Duration;

use bytes::Bytes;
use serde_json::json;
use tokio::time::Instant;

use super::session::{RobotSession, with_session};
use crate::cli::running::{REPLY_TIMEOUT, SharedTargetArgs, ask, unexpected_reply};
use crate::cli::settings::CommandSettings;
use crate::cli::{Exit, Failure, argument, print, print_json};
use crate::control::{Client, RunRequest, RunResponse};
use crate::robot::Use;
use crate::vision::{Decoder, Size};
use crate::wire::{Command, Report, Stream};

/// Save a picture from the camera
///
/// Waits for an intact frame; damaged ones are counted and discarded.
#[derive(Debug, Clone, clap::Args)]
#[command(after_help = "Example: spykee robot snapshot -o room.jpg --robot 172.17.6.1")]
pub(in crate::cli) struct SnapshotArgs {
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
    target: SharedTargetArgs,
}

/// An intact frame, and the number of damaged ones before it.
pub(in crate::cli) struct Shot {
    pub(in crate::cli) jpeg: Bytes,
    size: Size,
    damaged: u32,
}

pub(super) fn snapshot(args: &SnapshotArgs, settings: &CommandSettings) -> Result<Exit, Failure> {
    with_pictures(&args.target, settings, args.timeout, |shot| {
        save_and_report(args, shot).map(Some)
    })
}

/// Takes pictures, itself or through the run that uses the robot, until `used` returns what they
/// have led to. Waits for each picture for so many seconds at most.
pub(in crate::cli) fn with_pictures(
    target: &SharedTargetArgs,
    settings: &CommandSettings,
    seconds: u64,
    mut used: impl FnMut(&Shot) -> Result<Option<Exit>, Failure>,
) -> Result<Exit, Failure> {
    let limit = Duration::from_secs(seconds);
    if let Some(run) = target.find_run(settings)? {
        loop {
            if let Some(exit) = used(&request_picture(&run, limit)?)? {
                return Ok(exit);
            }
        }
    }
    with_session(&target.connection, settings, async |session| {
        if session.streams.video == Use::Off {
            let failure = Failure::usage("the config keeps video off");
            return Err(failure.help("it has streams: { video: off }"));
        }
        session.send(&[video(true)]).await?;
        loop {
            let shot = next_picture(session, limit).await?;
            if let Some(done) = used(&shot).transpose() {
                session.send(&[video(false)]).await?;
                return done;
            }
        }
    })
}

fn save_and_report(args: &SnapshotArgs, shot: &Shot) -> Result<Exit, Failure> {
    let output = &args.output;
    // It may show a home: only this user may look at a new file.
    let mut private = std::fs::OpenOptions::new();
    private.write(true).create(true).truncate(true).mode(0o600);
    let written = private
        .open(output)
        .and_then(|mut file| file.write_all(&shot.jpeg));
    written.map_err(|error| Failure::unwritable(output, error))?;
    let file = output.display().to_string();
    let bytes = shot.jpeg.len();
    let Size { width, height } = shot.size;
    if args.json {
        print_json(&json!({
            "file": file, "bytes": bytes, "width": width, "height": height,
            "damaged_frames": shot.damaged,
        }))
    } else {
        print(&format!("{file}: {width}x{height}, {bytes} bytes\n"))
    }
}

#[derive(Default)]
struct Search {
    decoder: Decoder,
    damaged: u32,
}

impl Search {
    /// A shot of this frame, if it is intact.
    fn shot(&mut self, jpeg: Bytes) -> Option<Shot> {
        match self.decoder.decode(&jpeg) {
            Ok(image) => Some(Shot {
                size: image.size(),
                jpeg,
                damaged: self.damaged,
            }),
            Err(error) => {
                tracing::debug!("a damaged frame: {error}");
                self.damaged += 1;
                None
            }
        }
    }
}

/// Requests an intact picture from the run that uses the robot.
fn request_picture(run: &Client, limit: Duration) -> Result<Shot, Failure> {
    let until = Instant::now() + limit;
    let mut search = Search::default();
    loop {
        let left = until.saturating_duration_since(Instant::now());
        let request = RunRequest::Picture {
            seconds: Some(left.as_secs_f64().ceil() as u64),
        };
        let jpeg = match ask(run, &request, left + REPLY_TIMEOUT)? {
            RunResponse::Picture { jpeg } => Bytes::from(jpeg),
            RunResponse::NoPicture => return Err(no_picture_in_time(limit, search.damaged)),
            _ => return Err(unexpected_reply()),
        };
        if let Some(shot) = search.shot(jpeg) {
            return Ok(shot);
        }
    }
}

async fn next_picture(session: &mut RobotSession, limit: Duration) -> Result<Shot, Failure> {
    let until = Instant::now() + limit;
    let mut search = Search::default();
    loop {
        let left = until.saturating_duration_since(Instant::now());
        let frame = session.receive(left, |report| match report {
            Report::Video(jpeg) => Some(jpeg),
            _ => None,
        });
        let Some(jpeg) = frame.await? else {
            return Err(no_picture_in_time(limit, search.damaged));
        };
        if let Some(shot) = search.shot(jpeg) {
            return Ok(shot);
        }
    }
}

pub(in crate::cli) fn video(on: bool) -> Command {
    let stream = Stream::Video;
    Command::Stream { stream, on }
}

fn no_picture_in_time(limit: Duration, damaged: u32) -> Failure {
    let seconds = limit.as_secs();
    let what = format!("no intact frame arrived within {seconds} s; damaged ones: {damaged}");
    Failure::unreachable(what).help("move the robot closer to this computer, or increase --timeout")
}
