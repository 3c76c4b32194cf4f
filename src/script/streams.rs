//! Which of the robot's streams a script has switched on, and for how long; and the loudness of the
//! microphone's audio. A stream is on as long
//! as the script has asked for it with `robot.stream`, listens to it or waits for it. Without
//! `robot.stream` it stays on for [`LINGER`] longer, so that a loop with `robot.wait_frame` does
//! not switch the camera on and off each time.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use mlua::prelude::{Lua, LuaResult, LuaTable};
use tokio::time::Instant;

use crate::wire::Stream;

/// How long after its last use a stream is switched off.
pub(super) const LINGER: Duration = Duration::from_secs(2);

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Demand {
    /// `robot.stream(name, true)`: until it is switched off by the same call.
    Explicit,
    /// A handler, a wait or `robot.frame()`: while it lasts.
    WhileUsed,
}

#[derive(Debug, Default)]
pub(super) struct WantedStreams {
    explicit: BTreeSet<Stream>,
    on: BTreeMap<Stream, Instant>,
}

impl WantedStreams {
    pub(super) fn is_on(&self, stream: Stream) -> bool {
        self.on.contains_key(&stream)
    }

    /// Records that a stream is needed; `true` if it was off.
    pub(super) fn switch_on(&mut self, stream: Stream, by: Demand, now: Instant) -> bool {
        if by == Demand::Explicit {
            self.explicit.insert(stream);
        }
        self.on.insert(stream, now).is_none()
    }

    /// Switches a stream off, for `robot.stream(name, false)`; `true` if it was on.
    pub(super) fn switch_off(&mut self, stream: Stream) -> bool {
        self.explicit.remove(&stream);
        self.on.remove(&stream).is_some()
    }

    /// The streams that are on only while something uses them.
    pub(super) fn temporary(&self) -> Vec<Stream> {
        let on = self.on.keys().copied();
        on.filter(|stream| !self.explicit.contains(stream))
            .collect()
    }

    pub(super) fn note_use(&mut self, stream: Stream, now: Instant) {
        if let Some(used) = self.on.get_mut(&stream) {
            *used = now;
        }
    }

    /// When a stream is switched off if nothing uses it.
    pub(super) fn end_of(&self, stream: Stream) -> Option<Instant> {
        self.on.get(&stream).map(|used| *used + LINGER)
    }

    /// Removes an unused stream if its time is over; `true` if it was removed.
    pub(super) fn drop_if_unused(&mut self, stream: Stream, now: Instant) -> bool {
        self.end_of(stream).is_some_and(|end| end <= now) && self.on.remove(&stream).is_some()
    }
}

/// Samples per second of the microphone and the speaker, as the robot's AUDIO message has them.
pub(super) const RATE: u32 = 16_000;

/// The level of silence, in dBFS: lower than 16 bits can represent.
const SILENCE: f64 = -100.0;

/// Loudness of a chunk of s16 little-endian samples; 1.0 is full scale.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Loudness {
    pub(super) rms: f64,
    pub(super) peak: f64,
}

impl Loudness {
    /// Measures a chunk of samples; an odd last byte is ignored.
    pub(super) fn from_samples(samples: &[u8]) -> Loudness {
        let mut squares = 0.0;
        let mut peak = 0.0_f64;
        let mut count = 0_u32;
        for pair in samples.chunks_exact(2) {
            let sample = f64::from(i16::from_le_bytes([pair[0], pair[1]])) / 32_768.0;
            squares += sample * sample;
            peak = peak.max(sample.abs());
            count += 1;
        }
        Loudness {
            rms: (squares / f64::from(count.max(1))).sqrt(),
            peak,
        }
    }

    /// Decibels below full scale, -100 for silence.
    pub(super) fn dbfs(self) -> f64 {
        (20.0 * self.rms.log10()).max(SILENCE)
    }
}

/// The payload of an `audio` event: `{rate, rms, peak, dbfs, samples}`.
pub(super) fn audio_to_lua(lua: &Lua, samples: &[u8]) -> LuaResult<LuaTable> {
    let loudness = Loudness::from_samples(samples);
    let table = lua.create_table_with_capacity(0, 5)?;
    table.raw_set("rate", RATE)?;
    table.raw_set("rms", loudness.rms)?;
    table.raw_set("peak", loudness.peak)?;
    table.raw_set("dbfs", loudness.dbfs())?;
    table.raw_set("samples", lua.create_buffer(samples)?)?;
    Ok(table)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn loudness_is_relative_to_full_scale() {
        let half: Vec<u8> = [16_384_i16, -16_384]
            .iter()
            .flat_map(|s| s.to_le_bytes())
            .collect();
        let loudness = Loudness::from_samples(&half);
        assert_eq!((loudness.rms, loudness.peak), (0.5, 0.5));
        assert!((loudness.dbfs() + 6.02).abs() < 0.01);
        assert_eq!(Loudness::from_samples(&[]).dbfs(), SILENCE);
        assert_eq!(Loudness::from_samples(&[1]).peak, 0.0);
    }
}
