//! Loudness of the microphone's audio.

use mlua::prelude::{Lua, LuaResult, LuaTable};

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
pub(super) fn to_lua(lua: &Lua, samples: &[u8]) -> LuaResult<LuaTable> {
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
