//! `spykee robot led`, `play` and `volume`, which send a command and wait for its acknowledgement,
//! and `say`, which plays a sound file through the robot's speaker.

use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::builder::{PossibleValuesParser, TypedValueParser as _};

use super::drive_robot;
use super::session::with_session;
use crate::cli::running::{REPLY_TIMEOUT, SharedTargetArgs, order};
use crate::cli::settings::CommandSettings;
use crate::cli::{Exit, Failure, argument};
use crate::control::{MAX_SPEECH, RunRequest};
use crate::robot::{Percent, Use};
use crate::wire::{Command, Led, Sound};

/// Switch a light on or off
#[derive(Debug, Clone, clap::Args)]
#[command(after_help = "Example: spykee robot led flash on --robot 172.17.6.1")]
pub(in crate::cli) struct LedArgs {
    /// The light
    #[arg(value_parser = PossibleValuesParser::new(Led::ALL.iter().map(|led| led.name()))
          .try_map(|name| Led::from_name(&name).ok_or("no such light")))]
    led: Led,
    /// The new state
    #[arg(value_name = "on|off", value_parser = ["on", "off"])]
    state: String,
    #[command(flatten)]
    target: SharedTargetArgs,
}

/// Play a sound, or stop the music
#[derive(Debug, Clone, clap::Args)]
#[command(
    after_help = "Examples:\n  spykee robot play laser --robot 172.17.6.1\n  \
                        spykee robot play --stop --robot 172.17.6.1\n\n\
                        Some sounds also switch lights."
)]
pub(in crate::cli) struct PlayArgs {
    /// The sound
    #[arg(required_unless_present = "stop",
          value_parser = PossibleValuesParser::new(Sound::ALL.iter().map(|sound| sound.name()))
          .try_map(|name| Sound::from_name(&name).ok_or("no such sound")))]
    sound: Option<Sound>,
    /// Stop the music
    #[arg(long, conflicts_with = "sound")]
    stop: bool,
    #[command(flatten)]
    target: SharedTargetArgs,
}

/// Set the volume of the speaker
#[derive(Debug, Clone, clap::Args)]
#[command(after_help = "Example: spykee robot volume 40 --robot 172.17.6.1\n\n\
                        `spykee robot config` may show the current volume.")]
pub(in crate::cli) struct VolumeArgs {
    /// Volume in percent, 0 to 100
    #[arg(value_parser = argument::whole::<u8>(0..=100))]
    percent: u8,
    #[command(flatten)]
    target: SharedTargetArgs,
}

pub(super) fn led(args: &LedArgs, settings: &CommandSettings) -> Result<Exit, Failure> {
    let led = args.led;
    let on = args.state == "on";
    let request = RunRequest::Led { light: led, on };
    send_command(&args.target, settings, Command::Led { led, on }, request)
}

pub(super) fn play(args: &PlayArgs, settings: &CommandSettings) -> Result<Exit, Failure> {
    let Some(sound) = args.sound else {
        let request = RunRequest::StopSound;
        return send_command(&args.target, settings, Command::StopSound, request);
    };
    let request = RunRequest::Play { sound };
    send_command(&args.target, settings, Command::Play(sound), request)
}

pub(super) fn volume(args: &VolumeArgs, settings: &CommandSettings) -> Result<Exit, Failure> {
    let percent = Percent::saturating(args.percent);
    let command = Command::Volume(percent.get());
    let request = RunRequest::Volume { percent };
    send_command(&args.target, settings, command, request)
}

/// Sends a command, directly or through the run that uses the robot.
fn send_command(
    target: &SharedTargetArgs,
    settings: &CommandSettings,
    command: Command,
    request: RunRequest,
) -> Result<Exit, Failure> {
    if let Some(run) = target.find_run(settings)? {
        return order(&run, &request, REPLY_TIMEOUT);
    }
    with_session(&target.connection, settings, async |session| {
        session.send_confirmed(command).await?;
        Ok(Exit::Done)
    })
}

/// Maximum size of a file: the samples, and room for the chunks before them.
const MAX_FILE: u64 = MAX_SPEECH as u64 + 64 * 1024;
const BYTES_PER_SECOND: f64 = 32_000.0;
/// Timeout beyond the playing time.
const SLACK: Duration = Duration::from_secs(10);

/// Play a sound file through the speaker: WAV, one channel, 16 kHz, 16 bits, up to 30 s
#[derive(Debug, Clone, clap::Args)]
#[command(
    after_help = "Example: spykee robot say hello.wav --robot 172.17.6.1\n\n\
                        To convert any other sound file: ffmpeg -i hello.mp3 -ac 1 -ar 16000 -c:a pcm_s16le hello.wav"
)]
pub(in crate::cli) struct SayArgs {
    /// The sound file
    #[arg(value_name = "FILE.wav")]
    file: PathBuf,
    #[command(flatten)]
    target: SharedTargetArgs,
}

pub(super) fn say(args: &SayArgs, settings: &CommandSettings) -> Result<Exit, Failure> {
    let file = read(&args.file)?;
    let shown = args.file.display();
    let refused = |why: &dyn std::fmt::Display| {
        Failure::usage(format_args!("{shown} cannot be played: {why}"))
            .help("ffmpeg -i FILE -ac 1 -ar 16000 -c:a pcm_s16le FILE.wav converts a file")
    };
    let samples = samples(&file).map_err(|error| refused(&error))?;
    if samples.len() > MAX_SPEECH {
        return Err(refused(&"it is longer than 30 s"));
    }
    if let Some(run) = args.target.find_run(settings)? {
        let length = Duration::from_secs_f64(samples.len() as f64 / BYTES_PER_SECOND);
        let request = RunRequest::Say {
            samples: samples.to_vec(),
        };
        return order(&run, &request, length + SLACK);
    }
    if settings.config()?.streams.audio_out == Use::Off {
        let failure = Failure::usage("the config keeps the speaker off");
        return Err(failure.help("it has streams: { audio_out: off }"));
    }
    drive_robot(&args.target.connection, settings, async |driver| {
        driver.ask(async |client| client.say(samples).await).await?;
        Ok(Exit::Done)
    })
}

fn read(path: &Path) -> Result<Vec<u8>, Failure> {
    let mut file = Vec::new();
    std::fs::File::open(path)
        .and_then(|source| source.take(MAX_FILE).read_to_end(&mut file))
        .map_err(|error| Failure::unreadable(path, error))?;
    Ok(file)
}

/// Format of the robot's audio (`PROTOCOL.md`, AUDIO): one channel, 16 kHz, s16 little-endian.
const CHANNELS: u16 = 1;
const RATE: u32 = 16_000;
const BITS: u16 = 16;
/// Format tag of integer samples.
const PCM: u16 = 1;
/// Format tag of samples whose kind is in an extension of the header.
const EXTENSIBLE: u16 = 0xFFFE;

const NO_WAV: &str = "it is not a WAV file";
const NO_SAMPLES: &str = "it has no samples";

/// Returns the samples. Of a truncated file, returns the samples that are there. The crate `hound`
/// (3.5.1) refuses files that play well: those with a chunk of odd length before the samples, and
/// those that ffmpeg writes to a pipe, whose length is unknown.
fn samples(file: &[u8]) -> Result<&[u8], String> {
    let (head, mut rest) = file.split_at_checked(12).ok_or(NO_WAV)?;
    if !head.starts_with(b"RIFF") || !head.ends_with(b"WAVE") {
        return Err(NO_WAV.to_owned());
    }
    let mut known = false;
    while let Some((head, behind)) = rest.split_first_chunk::<8>() {
        let [a, b, c, d, length @ ..] = *head;
        let length = usize::try_from(u32::from_le_bytes(length)).unwrap_or(usize::MAX);
        let (chunk, next) = behind.split_at(length.min(behind.len()));
        match &[a, b, c, d] {
            b"fmt " => {
                check_format(chunk)?;
                known = true;
            }
            b"data" if known => {
                let whole = chunk.len() - chunk.len() % 2;
                return match whole {
                    0 => Err(NO_SAMPLES.to_owned()),
                    _ => Ok(&chunk[..whole]),
                };
            }
            _ => {}
        }
        // Chunks begin at even offsets.
        rest = next.get(length % 2..).unwrap_or_default();
    }
    let why = if known { NO_SAMPLES } else { NO_WAV };
    Err(why.to_owned())
}

fn check_format(chunk: &[u8]) -> Result<(), String> {
    let Some(&[a, b, c, d, r0, r1, r2, r3, _, _, _, _, _, _, e, f]) = chunk.first_chunk() else {
        return Err(NO_WAV.to_owned());
    };
    let kind = u16::from_le_bytes([a, b]);
    let channels = u16::from_le_bytes([c, d]);
    let rate = u32::from_le_bytes([r0, r1, r2, r3]);
    let bits = u16::from_le_bytes([e, f]);
    if matches!(kind, PCM | EXTENSIBLE) && (channels, rate, bits) == (CHANNELS, RATE, BITS) {
        return Ok(());
    }
    Err(format!(
        "it has {channels} channels, {rate} samples per second of {bits} bits; the robot takes 1, \
         16000 and 16"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn wav(channels: u16, rate: u32, bits: u16, samples: &[u8]) -> Vec<u8> {
        let mut file = b"RIFF\0\0\0\0WAVE".to_vec();
        file.extend(b"LIST\x03\0\0\0abc\0fmt \x10\0\0\0\x01\0");
        file.extend(channels.to_le_bytes());
        file.extend(rate.to_le_bytes());
        file.extend([0; 6]);
        file.extend(bits.to_le_bytes());
        file.extend(b"data");
        file.extend(u32::try_from(samples.len()).unwrap().to_le_bytes());
        file.extend(samples);
        file
    }

    #[test]
    fn samples_are_found_after_other_chunks() {
        assert_eq!(
            samples(&wav(1, 16_000, 16, &[1, 2, 3, 4])),
            Ok(&[1, 2, 3, 4][..])
        );
        let mut cut = wav(1, 16_000, 16, &[1, 2, 3, 4]);
        cut.pop();
        assert_eq!(samples(&cut), Ok(&[1, 2][..]));
        let mut piped = wav(1, 16_000, 16, &[1, 2, 3, 4]);
        let length = piped.len() - 8..piped.len() - 4;
        piped[length].copy_from_slice(&u32::MAX.to_le_bytes());
        assert_eq!(samples(&piped), Ok(&[1, 2, 3, 4][..]));
    }

    #[test]
    fn unsupported_formats_are_refused_with_a_reason() {
        let stereo = samples(&wav(2, 44_100, 16, &[0; 8])).unwrap_err();
        assert!(stereo.contains("2 channels, 44100"), "{stereo}");
        assert_eq!(samples(b"RIFF"), Err(NO_WAV.to_owned()));
        assert_eq!(samples(&[0; 100]), Err(NO_WAV.to_owned()));
        assert_eq!(
            samples(&wav(1, 16_000, 16, &[])),
            Err(NO_SAMPLES.to_owned())
        );
    }

    proptest! {
        #[test]
        fn no_file_causes_a_panic(mut file in prop::collection::vec(any::<u8>(), 0..200), whole: bool) {
            if whole && file.len() > 12 {
                file[..12].copy_from_slice(b"RIFF\0\0\0\0WAVE");
            }
            let _ = samples(&file);
        }
    }
}
