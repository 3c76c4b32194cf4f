//! `Debug` output of messages for logs and tests. Payloads that may contain secrets, such as Wi-Fi
//! keys, or that are long, such as sounds, are shown only as a number of bytes.

use std::fmt;

use super::{Command, FileChunk, Report, Setting};

/// Shown instead of a payload.
struct Length(usize);

impl fmt::Debug for Length {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} bytes", self.0)
    }
}

fn tuple(f: &mut fmt::Formatter<'_>, name: &str, inner: &dyn fmt::Debug) -> fmt::Result {
    f.debug_tuple(name).field(inner).finish()
}

impl fmt::Debug for Command {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Command::None => f.write_str("None"),
            Command::Audio(bytes) => tuple(f, "Audio", &Length(bytes.len())),
            Command::PowerQuery => f.write_str("PowerQuery"),
            Command::Led { led, on } => f
                .debug_struct("Led")
                .field("led", led)
                .field("on", on)
                .finish(),
            Command::Move { left, right } => f
                .debug_struct("Move")
                .field("left", left)
                .field("right", right)
                .finish(),
            Command::File(chunk) => tuple(f, "File", chunk),
            Command::Play(sound) => tuple(f, "Play", sound),
            Command::StopSound => f.write_str("StopSound"),
            Command::Volume(percent) => tuple(f, "Volume", percent),
            Command::Login(login) => tuple(f, "Login", login),
            Command::Mute(bytes) => tuple(f, "Mute", &Length(bytes.len())),
            Command::ConfigQuery => f.write_str("ConfigQuery"),
            Command::ConfigSet(bytes) => tuple(f, "ConfigSet", &Length(bytes.len())),
            Command::NetworksQuery => f.write_str("NetworksQuery"),
            Command::Stream { stream, on } => f
                .debug_struct("Stream")
                .field("stream", stream)
                .field("on", on)
                .finish(),
            Command::Engine(engage) => tuple(f, "Engine", engage),
            Command::LogQuery => f.write_str("LogQuery"),
            Command::MotorSpeed(bytes) => tuple(f, "MotorSpeed", &Length(bytes.len())),
            Command::Unknown(packet) => tuple(f, "Unknown", packet),
        }
    }
}

impl fmt::Debug for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Report::Audio(bytes) => tuple(f, "Audio", &Length(bytes.len())),
            Report::Video(bytes) => tuple(f, "Video", &Length(bytes.len())),
            Report::Power(power) => tuple(f, "Power", power),
            Report::SoundFinished => f.write_str("SoundFinished"),
            Report::Accepted(accepted) => tuple(f, "Accepted", accepted),
            Report::Refused(refusal) => tuple(f, "Refused", refusal),
            Report::Config(bytes) => tuple(f, "Config", &Length(bytes.len())),
            Report::Networks(bytes) => tuple(f, "Networks", &Length(bytes.len())),
            Report::Engine(report) => tuple(f, "Engine", report),
            Report::Log(bytes) => tuple(f, "Log", &Length(bytes.len())),
            Report::Unknown(packet) => tuple(f, "Unknown", packet),
        }
    }
}

impl fmt::Debug for FileChunk {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut shown = f.debug_struct("FileChunk");
        shown.field("id", &self.id()).field("flags", &self.flags());
        shown
            .field("content", &Length(self.content().len()))
            .finish()
    }
}

impl fmt::Debug for Setting {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut shown = f.debug_struct("Setting");
        shown
            .field("key", &self.key)
            .field("value", &Length(self.value.len()))
            .finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::{Login, Packet, Sound, kind};

    #[test]
    fn debug_output_never_contains_a_payload() {
        let secret = "hunter2";
        let chunk = FileChunk::of_sound(Sound::User0, 3, secret.into()).unwrap();
        // A truncated login is not parsed as one, but still contains the password.
        let mut login = Command::Login(Login::new("anna", secret)).to_bytes();
        login.truncate(login.len() - 1);
        let torn = Packet::new(kind::AUTH_REQUEST, login.slice(5..));
        let setting = Setting {
            key: "wifi-key".into(),
            value: secret.into(),
        };
        for shown in [
            format!("{:?}", Command::ConfigSet(secret.into())),
            format!("{:?}", Command::Audio(secret.into())),
            format!("{:?}", Command::File(chunk)),
            format!("{:?}", Command::Login(Login::new("anna", secret))),
            format!("{:?}", Command::parse(torn)),
            format!("{:?}", Report::Config(secret.into())),
            format!("{:?}", Report::Networks(secret.into())),
            format!("{:?}", Report::Log(secret.into())),
            format!("{setting:?}"),
        ] {
            assert!(
                !shown.contains("hunter") && !shown.contains("104, 117"),
                "{shown}"
            );
        }
        assert_eq!(
            format!("{:?}", Report::Config(secret.into())),
            "Config(7 bytes)"
        );
        assert_eq!(
            format!("{setting:?}"),
            "Setting { key: \"wifi-key\", value: 7 bytes }"
        );
        let chunk = FileChunk::of_sound(Sound::User0, 3, secret.into()).unwrap();
        let shown = format!("{chunk:?}");
        assert!(shown.starts_with("FileChunk { id:") && shown.ends_with("content: 7 bytes }"));
    }
}
