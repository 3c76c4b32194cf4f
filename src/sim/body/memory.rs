//! The robot's memory: settings (CONFIG), uploaded sounds (FILE) and the log (LOG). Which settings the
//! real robot has is not known; these are made up.

use std::collections::VecDeque;
use std::time::Duration;

use bytes::{Bytes, BytesMut};
use wire::{FileChunk, parse_settings, to_latin1};

/// Maximum size of an upload in bytes; longer ones are discarded.
const MAX_UPLOAD: usize = 4 << 20;
/// Maximum length of a setting's value.
const MAX_VALUE: usize = 256;
/// Made-up settings, besides the volume (from the speaker) and the version (from the firmware).
const SETTINGS: [(&str, &str); 5] = [
    ("name", "Spykee"),
    ("motor-speed", "90"),
    ("wifi-mode", "adhoc"),
    ("wifi-essid", "SPYKEE0001"),
    ("wifi-key", "made-up-key"),
];

#[derive(Debug, Clone)]
pub(crate) struct Memory {
    version: String,
    settings: Vec<(&'static str, String)>,
    upload: Option<(u8, BytesMut)>,
}

impl Memory {
    pub(crate) fn new(version: &str) -> Memory {
        Memory {
            version: version.to_owned(),
            settings: SETTINGS
                .map(|(key, value)| (key, value.to_owned()))
                .to_vec(),
            upload: None,
        }
    }

    /// Returns the reply to a CONFIG query as two messages, split between two pairs.
    pub(crate) fn settings(&self, volume: u8) -> [Bytes; 2] {
        let listed: Vec<String> = self
            .settings
            .iter()
            .map(|(key, value)| format!("{key}={value}"))
            .collect();
        let first = format!("version={}&volume={volume}", self.version);
        [first, listed.join("&")].map(|text| to_latin1(&text).collect())
    }

    /// Changes the known settings and returns a line for the log; unknown ones have no effect.
    pub(crate) fn configure(&mut self, text: &[u8]) -> String {
        let mut changed = Vec::new();
        for setting in parse_settings(text) {
            let known = self
                .settings
                .iter_mut()
                .find(|(key, _)| *key == setting.key);
            if let Some((key, value)) = known
                && setting.value.len() <= MAX_VALUE
            {
                *value = setting.value;
                changed.push(*key);
            }
        }
        format!("config set: {}", changed.join(" "))
    }

    /// Stores a chunk of an upload; returns a line for the log at its end or on an error.
    pub(crate) fn store(&mut self, chunk: &FileChunk) -> Option<String> {
        let id = chunk.id();
        if chunk.flags() & FileChunk::FIRST != 0 {
            self.upload = Some((id, BytesMut::new()));
        }
        let Some((_, content)) = self.upload.as_mut().filter(|(open, _)| *open == id) else {
            return Some(format!("file {id}: a chunk without a beginning"));
        };
        if content.len() + chunk.content().len() > MAX_UPLOAD {
            self.upload = None;
            return Some(format!("file {id}: too long"));
        }
        content.extend_from_slice(chunk.content());
        if chunk.flags() & FileChunk::LAST == 0 {
            return None;
        }
        let length = content.len();
        self.upload = None;
        Some(format!("file {id} stored, {length} bytes"))
    }
}

const MAX_LINES: usize = 64;

/// The most recent lines, oldest first.
#[derive(Debug, Default)]
pub(super) struct RobotLog {
    lines: VecDeque<String>,
}

impl RobotLog {
    pub(super) fn write(&mut self, time: Duration, line: &str) {
        let seconds = time.as_secs_f64();
        tracing::debug!(target: "spykee::sim", seconds, "{line}");
        if self.lines.len() == MAX_LINES {
            self.lines.pop_front();
        }
        self.lines.push_back(format!("[{seconds:.1}] {line}"));
    }

    pub(super) fn clear(&mut self) {
        self.lines.clear();
    }

    pub(super) fn text(&self) -> Bytes {
        let lines: Vec<&str> = self.lines.iter().map(String::as_str).collect();
        Bytes::from(lines.join("\n"))
    }
}

#[cfg(test)]
mod tests {
    use wire::{Sound, join_settings};

    use super::*;

    fn chunk(flags: u8, content: &'static [u8]) -> FileChunk {
        FileChunk::of_sound(Sound::User0, flags, Bytes::from_static(content)).unwrap()
    }

    #[test]
    fn known_settings_are_stored_and_reported() {
        let mut memory = Memory::new("1.0.22");
        let line = memory.configure(b"name=Anna&nonsense=1&version=9");
        assert_eq!(line, "config set: name");
        let text = join_settings(&memory.settings(80));
        let sent = parse_settings(&text);
        let value = |key: &str| sent.iter().find(|s| s.key == key).map(|s| s.value.as_str());
        assert_eq!(
            (value("name"), value("version")),
            (Some("Anna"), Some("1.0.22"))
        );
        assert_eq!((value("nonsense"), value("volume")), (None, Some("80")));
    }

    #[test]
    fn an_upload_ends_with_its_last_chunk() {
        let mut memory = Memory::new("1");
        assert!(
            memory
                .store(&chunk(0, b"x"))
                .unwrap()
                .contains("without a beginning")
        );
        assert_eq!(memory.store(&chunk(FileChunk::FIRST, b"ab")), None);
        assert_eq!(memory.store(&chunk(0, b"cd")), None);
        let stored = memory.store(&chunk(FileChunk::LAST, b"e")).unwrap();
        assert_eq!(stored, "file 6 stored, 5 bytes");
        assert!(memory.store(&chunk(3, b"")).unwrap().contains("0 bytes"));
    }
}
