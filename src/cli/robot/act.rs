//! `spykee robot led`, `play` and `volume`: send a command and wait for its acknowledgement.

use clap::builder::PossibleValuesParser;

use super::SharedTargetArgs;
use super::session::with_session;
use crate::cli::running::{REPLY_TIMEOUT, ask, unexpected_reply};
use crate::cli::{Exit, Failure, argument};
use crate::control::{RunRequest, RunResponse};
use crate::robot::Percent;
use crate::wire::{Command, Led, Sound};

/// Switch a light on or off
#[derive(Debug, Clone, clap::Args)]
#[command(after_help = "Example: spykee robot led flash on --robot 172.17.6.1")]
pub(super) struct LedArgs {
    /// The light
    #[arg(value_parser = PossibleValuesParser::new(Led::ALL.iter().map(|led| led.name())))]
    led: String,
    /// The new state
    #[arg(value_name = "on|off", value_parser = ["on", "off"])]
    state: String,
    #[command(flatten)]
    pub(super) target: SharedTargetArgs,
}

/// Play a sound, or stop the music
#[derive(Debug, Clone, clap::Args)]
#[command(
    after_help = "Examples:\n  spykee robot play laser --robot 172.17.6.1\n  \
                        spykee robot play --stop --robot 172.17.6.1\n\n\
                        Some sounds also switch lights."
)]
pub(super) struct PlayArgs {
    /// The sound
    #[arg(required_unless_present = "stop",
          value_parser = PossibleValuesParser::new(Sound::ALL.iter().map(|sound| sound.name())))]
    sound: Option<String>,
    /// Stop the music
    #[arg(long, conflicts_with = "sound")]
    stop: bool,
    #[command(flatten)]
    pub(super) target: SharedTargetArgs,
}

/// Set the volume of the speaker
#[derive(Debug, Clone, clap::Args)]
#[command(after_help = "Example: spykee robot volume 40 --robot 172.17.6.1\n\n\
                        `spykee robot config` may show the current volume.")]
pub(super) struct VolumeArgs {
    /// Volume in percent, 0 to 100
    #[arg(value_parser = argument::whole::<u8>(0..=100))]
    percent: u8,
    #[command(flatten)]
    pub(super) target: SharedTargetArgs,
}

pub(super) fn led(args: &LedArgs) -> Result<Exit, Failure> {
    let led = Led::from_name(&args.led)
        .ok_or_else(|| Failure::usage(format_args!("no such light: {}", args.led)))?;
    let on = args.state == "on";
    send_command(
        &args.target,
        Command::Led { led, on },
        RunRequest::Led { light: led, on },
    )
}

pub(super) fn play(args: &PlayArgs) -> Result<Exit, Failure> {
    let Some(name) = &args.sound else {
        return send_command(&args.target, Command::StopSound, RunRequest::StopSound);
    };
    let sound = Sound::from_name(name)
        .ok_or_else(|| Failure::usage(format_args!("no such sound: {name}")))?;
    send_command(
        &args.target,
        Command::Play(sound),
        RunRequest::Play { sound },
    )
}

pub(super) fn volume(args: &VolumeArgs) -> Result<Exit, Failure> {
    let percent = Percent::saturating(args.percent);
    let command = Command::Volume(percent.get());
    send_command(&args.target, command, RunRequest::Volume { percent })
}

/// Sends a command, directly or through the run that uses the robot.
fn send_command(
    target: &SharedTargetArgs,
    command: Command,
    request: RunRequest,
) -> Result<Exit, Failure> {
    if let Some(run) = target.find_run()? {
        return match ask(&run, &request, REPLY_TIMEOUT)? {
            None => Ok(Exit::Interrupted),
            Some(RunResponse::Done) => Ok(Exit::Done),
            Some(_) => Err(unexpected_reply()),
        };
    }
    with_session(target, async |session| {
        session.send_confirmed(command).await?;
        Ok(Exit::Done)
    })
}
