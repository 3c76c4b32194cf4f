//! `spykee robot say`: plays a sound file through the robot's speaker.

use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::time::Duration;

use super::SharedTargetArgs;
use super::wav;
use crate::cli::driver::drive;
use crate::cli::running::{ask, unexpected_reply};
use crate::cli::{Exit, Failure, block_on};
use crate::control::{MAX_SPEECH, RunRequest, RunResponse};
use crate::robot::Use;

/// Maximum size of a file: the samples, and room for the chunks before them.
const MAX_FILE: u64 = MAX_SPEECH as u64 + 64 * 1024;
/// Bytes of samples per second.
const RATE: f64 = 32_000.0;
/// Timeout beyond the playing time.
const SLACK: Duration = Duration::from_secs(10);

/// Play a sound file through the speaker: WAV, one channel, 16 kHz, 16 bits, up to 30 s
#[derive(Debug, Clone, clap::Args)]
#[command(
    after_help = "Example: spykee robot say hello.wav --robot 172.17.6.1\n\n\
                        To convert any other sound file: ffmpeg -i hello.mp3 -ac 1 -ar 16000 -c:a pcm_s16le hello.wav"
)]
pub(super) struct SayArgs {
    /// The sound file
    #[arg(value_name = "FILE.wav")]
    file: PathBuf,
    #[command(flatten)]
    pub(super) target: SharedTargetArgs,
}

pub(super) fn say(args: &SayArgs) -> Result<Exit, Failure> {
    let file = read(&args.file)?;
    let shown = args.file.display();
    let refused = |why: &dyn std::fmt::Display| {
        Failure::usage(format_args!("{shown} cannot be played: {why}"))
            .help("ffmpeg -i FILE -ac 1 -ar 16000 -c:a pcm_s16le FILE.wav converts a file")
    };
    let samples = wav::samples(&file).map_err(|error| refused(&error))?;
    if samples.len() > MAX_SPEECH {
        return Err(refused(&"it is longer than 30 s"));
    }
    if let Some(run) = args.target.find_run()? {
        let length = Duration::from_secs_f64(samples.len() as f64 / RATE);
        let request = RunRequest::Say {
            samples: samples.to_vec(),
        };
        return match ask(&run, &request, length + SLACK)? {
            None => Ok(Exit::Interrupted),
            Some(RunResponse::Done) => Ok(Exit::Done),
            Some(_) => Err(unexpected_reply()),
        };
    }
    let seed = rand::random();
    let target = args.target.resolve(seed)?;
    if target.config.streams.audio_out == Use::Off {
        let failure = Failure::usage("the config keeps the speaker off");
        return Err(failure.help("it has streams: { audio_out: off }"));
    }
    block_on(drive(target.driver_parts(seed)?, async |driver| {
        driver.say(samples).await?;
        Ok(Exit::Done)
    }))?
}

fn read(path: &Path) -> Result<Vec<u8>, Failure> {
    let mut file = Vec::new();
    std::fs::File::open(path)
        .and_then(|source| source.take(MAX_FILE).read_to_end(&mut file))
        .map_err(|error| Failure::unreadable(path, error))?;
    Ok(file)
}
