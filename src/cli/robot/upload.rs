//! `spykee robot upload-sound`: uploads an MP3 to one of the robot's slots for sounds.

use std::path::{Path, PathBuf};
use std::time::Duration;

use bytes::Bytes;
use serde_json::json;

use super::session::{RobotSession, with_exclusive_session};
use crate::cli::settings::CommandSettings;
use crate::cli::{ConnectionArgs, Console, Exit, Failure, print, print_json};
use crate::files;
use crate::wire::{Command, FileChunk, Report, Sound};

/// The size of a chunk is not documented. The robot's own largest message is 32 KiB; a small chunk
/// gets through a slow link before the link counts as dead.
const CHUNK: usize = 4096;
/// Maximum size of a file. The robot's limit is not documented; this guards against wrong files.
const MAX_LEN: usize = 2 << 20;
/// Timeout for processing the last bytes and replying.
const REPLY_TIMEOUT: Duration = Duration::from_secs(20);

/// Upload an MP3 as a user sound or as the music
///
/// Sends the file in chunks, and then requests the robot's settings: a reply shows that
/// the robot has read the whole file. The protocol cannot confirm that the sound is stored: listen
/// to it with `spykee robot play SLOT`. The largest size that the robot accepts is not documented;
/// this program refuses more than 2 MiB. Firmware cannot be uploaded.
#[derive(Debug, Clone, clap::Args)]
#[command(after_help = "Example: spykee robot upload-sound user0 hello.mp3 --robot 172.17.6.1")]
pub(in crate::cli) struct UploadArgs {
    /// Slot on the robot; its current sound is replaced
    #[arg(value_parser = ["user0", "user1", "music"])]
    slot: String,
    /// The sound file
    #[arg(value_name = "FILE.mp3")]
    file: PathBuf,
    /// Print a JSON object
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    connection: ConnectionArgs,
}

pub(super) fn upload(
    args: &UploadArgs,
    settings: &CommandSettings,
    console: &Console,
) -> Result<Exit, Failure> {
    let content = load(&args.file)?;
    let chunks = chunks(&args.slot, &content)?;
    with_exclusive_session(&args.connection, settings, async |session| {
        send(session, &chunks, console).await?;
        confirm(session).await?;
        report(args, content.len())
    })
}

fn load(path: &Path) -> Result<Bytes, Failure> {
    let shown = path.display();
    let content = files::read_beginning(path, MAX_LEN as u64 + 1)
        .map_err(|error| Failure::unreadable(path, error))?;
    if content.len() > MAX_LEN {
        let failure = Failure::usage(format_args!("{shown} is longer than 2 MiB"));
        return Err(failure.help("shorten it, or encode it with fewer kilobits per second"));
    }
    if !is_mp3(&content) {
        let failure = Failure::usage(format_args!("{shown} is not an MP3 file"));
        return Err(failure.help("the robot's own sounds are MP3 files (MPEG layer III)"));
    }
    Ok(content.into())
}

/// Whether a file begins with a tag, or with a frame of MPEG layer III: eleven set bits, two bits
/// of the version, 01 for the layer.
fn is_mp3(file: &[u8]) -> bool {
    file.starts_with(b"ID3") || matches!(file, [0xFF, second, ..] if second & 0xE6 == 0xE2)
}

/// Splits the file into chunks; flags the first and the last one.
fn chunks(slot: &str, content: &Bytes) -> Result<Vec<Command>, Failure> {
    let last = content.len().div_ceil(CHUNK).saturating_sub(1);
    let chunk = |number: usize| {
        let from = number * CHUNK;
        let to = content.len().min((number + 1) * CHUNK);
        let mut flags = 0;
        flags |= if number == 0 { FileChunk::FIRST } else { 0 };
        flags |= if number == last { FileChunk::LAST } else { 0 };
        let sound = Sound::from_name(slot)?;
        FileChunk::of_sound(sound, flags, content.slice(from..to)).map(Command::File)
    };
    let chunks: Option<Vec<Command>> = (0..=last).map(chunk).collect();
    chunks.ok_or_else(|| Failure::usage(format_args!("{slot} is not a slot for a sound")))
}

async fn send(
    session: &mut RobotSession,
    chunks: &[Command],
    console: &Console,
) -> Result<(), Failure> {
    for (sent, chunk) in chunks.iter().enumerate() {
        console.status(format!("uploading · {} %", 100 * sent / chunks.len()));
        session.send(std::slice::from_ref(chunk)).await?;
    }
    console.status("");
    Ok(())
}

/// Waits until the robot has read the file. The robot processes messages in order, so a reply to
/// the last request acknowledges all messages before it. The robot sends CONFIG only on request, so
/// no other report can be mistaken for the reply.
async fn confirm(session: &mut RobotSession) -> Result<(), Failure> {
    session.send(&[Command::ConfigQuery]).await?;
    let answer = |report| matches!(report, Report::Config(_)).then_some(());
    if session.receive(REPLY_TIMEOUT, answer).await?.is_some() {
        return Ok(());
    }
    let what = "the whole file was sent, but the robot did not reply afterwards";
    Err(Failure::unreachable(what).help("play the sound to check whether it arrived"))
}

fn report(args: &UploadArgs, bytes: usize) -> Result<Exit, Failure> {
    let slot = &args.slot;
    if args.json {
        return print_json(&json!({ "slot": slot, "bytes": bytes }));
    }
    print(&format!(
        "{slot}: {bytes} bytes; the robot has read them. \
         Listen to it with: spykee robot play {slot}\n"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chunks_are_flagged_and_lose_nothing() {
        for length in [1, CHUNK - 1, CHUNK, CHUNK + 1, 3 * CHUNK] {
            let content = Bytes::from(vec![7; length]);
            let chunks = chunks("user1", &content).unwrap();
            let parts: Vec<&FileChunk> = chunks
                .iter()
                .map(|command| match command {
                    Command::File(chunk) => chunk,
                    other => panic!("{other:?}"),
                })
                .collect();
            let sent: usize = parts.iter().map(|part| part.content().len()).sum();
            assert_eq!(sent, length);
            let flags: u32 = parts.iter().map(|part| u32::from(part.flags())).sum();
            assert_eq!(flags, 3, "one first, one last");
            assert_eq!(
                (parts[0].flags() & 1, parts[parts.len() - 1].flags() & 2),
                (1, 2)
            );
        }
    }

    #[test]
    fn an_mp3_is_recognised_by_its_first_bytes() {
        for mp3 in [
            &b"ID3\x04"[..],
            &[0xFF, 0xFB, 0x90],
            &[0xFF, 0xF3],
            &[0xFF, 0xE2],
        ] {
            assert!(is_mp3(mp3), "{mp3:?}");
        }
        // A WAV file, MPEG layer II, AAC, JPEG, nothing.
        for other in [
            &b"RIFF....WAVE"[..],
            &[0xFF, 0xFD],
            &[0xFF, 0xF1],
            &[0xFF, 0xD8],
            &[],
        ] {
            assert!(!is_mp3(other), "{other:?}");
        }
    }

    #[test]
    fn other_slots_are_refused() {
        assert!(chunks("alarm", &Bytes::from_static(b"x")).is_err());
        assert!(chunks("firmware", &Bytes::from_static(b"x")).is_err());
    }
}
