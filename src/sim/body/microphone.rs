//! The microphone: mixes room noise, the sound sources of the world, motor hum and the speaker into
//! raw samples (`PROTOCOL.md`, AUDIO: signed 16-bit little-endian, 16,000 Hz, mono).

use std::collections::VecDeque;
use std::f64::consts::TAU;
use std::time::Duration;

use bytes::{BufMut, Bytes, BytesMut};
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};

use super::speaker::Speaker;
use crate::geometry::Point;
use crate::geometry::obstacles::Obstacles;
use crate::world::fixtures::{Noise, NoiseKind};

/// Samples per second.
pub(crate) const RATE: u32 = 16_000;
/// Samples in most AUDIO messages: an eighth of a second.
pub(crate) const CHUNK: usize = 2000;
/// One in this many messages has another length.
const IRREGULAR_ONE_IN: u32 = 8;
/// The range of those other lengths, samples.
const IRREGULAR_LENGTHS: std::ops::RangeInclusive<usize> = 500..=4000;
/// Maximum delay of a message, seconds.
const MAX_DELAY: f64 = 0.1;

const ROOM_NOISE: f64 = 40.0;
const HUM_LOUDNESS: f64 = 1800.0;
const SPEAKER_LOUDNESS: f64 = 12_000.0;
/// Amplitude of a source of loudness 1 at 1 m.
const SOURCE_LOUDNESS: f64 = 20_000.0;
/// Below this distance, metres, a source does not get louder.
const NEAREST: f64 = 0.3;
/// Frequency of a disturbance.
const BURST_HERTZ: f64 = 700.0;
/// Share of a source's loudness that passes through walls.
const WALL_TRANSMISSION: f64 = 0.25;

#[derive(Debug)]
pub(crate) struct Microphone {
    random: StdRng,
    /// Draws the delays and lengths of messages.
    message_rng: StdRng,
    chunk: BytesMut,
    /// Length of the message being filled, in samples.
    length: usize,
    /// Full messages, with the seconds until they are sent.
    waiting: VecDeque<(f64, Bytes)>,
    due_samples: f64,
    phase: f64,
    sources: Vec<Source>,
    burst: Option<Burst>,
}

#[derive(Debug)]
struct Burst {
    amplitude: f64,
    until: Duration,
    phase: f64,
}

#[derive(Debug)]
struct Source {
    noise: Noise,
    loudness: f64,
    phase: f64,
}

impl Microphone {
    pub(crate) fn new(seed: u64, sources: &[Noise]) -> Microphone {
        let source = |noise: &Noise| Source {
            noise: noise.clone(),
            loudness: 0.0,
            phase: 0.0,
        };
        let random = StdRng::seed_from_u64(seed);
        Microphone {
            random,
            message_rng: StdRng::seed_from_u64(!seed),
            chunk: BytesMut::new(),
            length: CHUNK,
            waiting: VecDeque::new(),
            due_samples: 0.0,
            phase: 0.0,
            sources: sources.iter().map(source).collect(),
            burst: None,
        }
    }

    /// Adds a tone that lasts until `until`; its level is in dBFS (0 is full scale).
    pub(crate) fn disturb(&mut self, dbfs: f64, until: Duration) {
        self.burst = Some(Burst {
            amplitude: f64::from(i16::MAX) * 10_f64.powf(dbfs / 20.0) * std::f64::consts::SQRT_2,
            until,
            phase: 0.0,
        });
    }

    pub(crate) fn update_sources(&mut self, time: Duration, here: Point, obstacles: &Obstacles) {
        if self.burst.as_ref().is_some_and(|burst| time >= burst.until) {
            self.burst = None;
        }
        for source in &mut self.sources {
            let noise = &source.noise;
            let at = source.noise.at.point();
            let wall = if obstacles.is_behind_wall(at, here) {
                WALL_TRANSMISSION
            } else {
                1.0
            };
            let near = noise.loudness * wall / at.distance(here).max(NEAREST);
            source.loudness = if noise.sounds(time.as_secs_f64()) {
                near
            } else {
                0.0
            };
        }
    }

    /// Records for `dt`; `effort` is the motors' load, 0..=1. Returns a message if one is due. Most
    /// messages have the same length, and they come at irregular intervals.
    pub(crate) fn record(
        &mut self,
        dt: Duration,
        effort: f64,
        speaker: &mut Speaker,
    ) -> Option<Bytes> {
        self.due_samples += dt.as_secs_f64() * f64::from(RATE);
        while self.due_samples >= 1.0 {
            self.due_samples -= 1.0;
            let sample = self.sample(effort, speaker);
            self.chunk.put_i16_le(sample);
        }
        for (due, _) in &mut self.waiting {
            *due -= dt.as_secs_f64();
        }
        while self.chunk.len() >= self.length * 2 {
            self.queue_chunk();
        }
        let (due, _) = self.waiting.front()?;
        if *due > 0.0 {
            return None;
        }
        self.waiting.pop_front().map(|(_, chunk)| chunk)
    }

    fn queue_chunk(&mut self) {
        let chunk = self.chunk.split_to(self.length * 2).freeze();
        let due = self.message_rng.random_range(0.0..MAX_DELAY);
        self.waiting.push_back((due, chunk));
        self.length = if self.message_rng.random_ratio(1, IRREGULAR_ONE_IN) {
            self.message_rng.random_range(IRREGULAR_LENGTHS)
        } else {
            CHUNK
        };
    }

    pub(crate) fn clear(&mut self) {
        self.chunk.clear();
        self.waiting.clear();
        self.due_samples = 0.0;
    }

    fn sample(&mut self, effort: f64, speaker: &mut Speaker) -> i16 {
        let seconds = 1.0 / f64::from(RATE);
        let noise = self.random.random_range(-ROOM_NOISE..ROOM_NOISE);
        let hum = if effort > 0.0 {
            self.hum(effort, seconds)
        } else {
            0.0
        };
        let own = speaker.sample(seconds) * SPEAKER_LOUDNESS;
        let sources = self.sources(seconds) + self.burst(seconds);
        (noise + hum + own + sources) as i16
    }

    fn burst(&mut self, seconds: f64) -> f64 {
        let Some(burst) = &mut self.burst else {
            return 0.0;
        };
        burst.phase = (burst.phase + TAU * BURST_HERTZ * seconds) % TAU;
        burst.amplitude * burst.phase.sin()
    }

    fn sources(&mut self, seconds: f64) -> f64 {
        let mut sum = 0.0;
        for source in self
            .sources
            .iter_mut()
            .filter(|source| source.loudness > 0.0)
        {
            let tone = match source.noise.kind {
                NoiseKind::Knock => 0.01,
                _ => 1.0,
            };
            source.phase = (source.phase + TAU * tone * source.noise.hertz * seconds) % TAU;
            let wave = match source.noise.kind {
                NoiseKind::Tone => source.phase.sin(),
                NoiseKind::Hiss => self.random.random_range(-1.0..1.0),
                NoiseKind::Knock => (40.0 * source.phase).sin() * (-6.0 * source.phase).exp(),
            };
            sum += wave * source.loudness * SOURCE_LOUDNESS;
        }
        sum
    }

    fn hum(&mut self, effort: f64, seconds: f64) -> f64 {
        self.phase = (self.phase + TAU * (60.0 + 120.0 * effort) * seconds) % TAU;
        let rattle = self.random.random_range(-0.3..0.3);
        let tone = self.phase.sin() + 0.5 * (2.0 * self.phase).sin() + rattle;
        HUM_LOUDNESS * (0.3 + 0.7 * effort) * tone
    }
}

#[cfg(test)]
mod tests {
    use wire::Sound;

    use super::*;

    const TICK: Duration = Duration::from_millis(20);

    fn loudness(effort: f64, sound: Option<Sound>) -> f64 {
        let mut microphone = Microphone::new(7, &[]);
        let mut speaker = Speaker::new(Duration::ZERO);
        sound.into_iter().for_each(|sound| speaker.play(sound));
        let chunk = (0..50)
            .find_map(|_| microphone.record(TICK, effort, &mut speaker))
            .unwrap();
        let samples = chunk
            .chunks_exact(2)
            .map(|two| i16::from_le_bytes([two[0], two[1]]));
        samples.map(|s| f64::from(s).powi(2)).sum::<f64>().sqrt()
    }

    #[test]
    fn motors_are_louder_than_the_room_and_the_speaker_louder_than_both() {
        assert!(loudness(0.0, None) > 0.0);
        assert!(loudness(1.0, None) > 10.0 * loudness(0.0, None));
        assert!(loudness(0.0, Some(Sound::Record)) > 2.0 * loudness(1.0, None));
    }

    #[test]
    fn a_second_is_sixteen_thousand_samples() {
        let mut microphone = Microphone::new(1, &[]);
        let mut speaker = Speaker::new(Duration::ZERO);
        let heard: usize = (0..500)
            .filter_map(|_| microphone.record(TICK, 0.0, &mut speaker))
            .map(|chunk| chunk.len())
            .sum();
        let late = 2 * (IRREGULAR_LENGTHS.end() + CHUNK);
        assert!((320_000 - late..=320_000).contains(&heard), "{heard}");
    }

    #[test]
    fn messages_usually_last_an_eighth_of_a_second_and_come_at_irregular_intervals() {
        let mut microphone = Microphone::new(1, &[]);
        let mut speaker = Speaker::new(Duration::ZERO);
        let heard: Vec<(usize, usize)> = (0..5000)
            .filter_map(|step| Some((step, microphone.record(TICK, 0.0, &mut speaker)?.len())))
            .collect();
        let usual = heard.iter().filter(|(_, bytes)| *bytes == 4000).count();
        assert!(
            usual * 4 > heard.len() * 3 && usual < heard.len(),
            "{usual}"
        );
        let gaps = heard.windows(2).map(|two| two[1].0 - two[0].0);
        let gaps: std::collections::BTreeSet<usize> = gaps.collect();
        assert!(gaps.len() > 5, "{gaps:?}");
    }

    #[test]
    fn the_same_seed_gives_the_same_audio() {
        let recorded = |seed| {
            let mut speaker = Speaker::new(Duration::ZERO);
            let mut microphone = Microphone::new(seed, &[]);
            (0..50)
                .find_map(|_| microphone.record(TICK, 0.5, &mut speaker))
                .unwrap()
        };
        assert_eq!(recorded(3), recorded(3));
        assert_ne!(recorded(3), recorded(4));
    }
}
