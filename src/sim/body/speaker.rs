//! The speaker: the sound that plays, how long it lasts, and its samples for the microphone.

use std::f64::consts::TAU;
use std::time::Duration;

use wire::Sound;

/// The synthetic sound that replaces one of the robot's recordings, with a similar length and distinct
/// from the others: its length in milliseconds, its frequency, the change of that from start to end
/// (hertz; positive is up), and its number of separate beeps; 1 is one continuous sound.
fn tone(sound: Sound) -> Option<(u64, f64, f64, u32)> {
    Some(match sound {
        Sound::Alarm => (2500, 900.0, 500.0, 5),
        Sound::Bomb => (2800, 220.0, -180.0, 1),
        Sound::Laser => (700, 1800.0, -1500.0, 1),
        Sound::Laugh => (1800, 420.0, -120.0, 6),
        Sound::Engine => (2200, 90.0, 60.0, 1),
        Sound::Robot => (1500, 300.0, 240.0, 3),
        Sound::User0 | Sound::User1 => (2000, 500.0, 0.0, 1),
        Sound::Snapshot => (400, 2400.0, -800.0, 2),
        Sound::Record => (250, 1000.0, 0.0, 1),
        Sound::Bip2 => (500, 1000.0, 0.0, 2),
        Sound::Bip3 => (750, 1000.0, 0.0, 3),
        Sound::Bip4 => (1000, 1000.0, 0.0, 4),
        Sound::Music => (0, 392.0, 130.0, 24),
        Sound::Unknown(_) => return None,
    })
}

#[derive(Debug, Clone)]
struct Playing {
    sound: Sound,
    played: Duration,
    length: Duration,
}

#[derive(Debug, Clone)]
pub(crate) struct Speaker {
    pub(super) volume: u8,
    music: Duration,
    playing: Option<Playing>,
    phase: f64,
}

impl Speaker {
    pub(crate) fn new(music: Duration) -> Speaker {
        Speaker {
            volume: 80,
            music,
            playing: None,
            phase: 0.0,
        }
    }

    pub(crate) fn set_volume(&mut self, percent: u8) {
        self.volume = percent.min(100);
    }

    pub(crate) fn playing(&self) -> Option<Sound> {
        self.playing.as_ref().map(|playing| playing.sound)
    }

    /// Plays a sound, replacing the current one. Unknown sounds are silent.
    pub(crate) fn play(&mut self, sound: Sound) {
        self.playing = tone(sound).map(|(millis, ..)| Playing {
            sound,
            played: Duration::ZERO,
            length: match sound {
                Sound::Music => self.music,
                _ => Duration::from_millis(millis),
            },
        });
    }

    pub(crate) fn stop(&mut self) {
        self.playing = None;
    }

    /// Advances by `dt`; returns the sound that reached its end in that time.
    pub(crate) fn step(&mut self, dt: Duration) -> Option<Sound> {
        let playing = self.playing.as_mut()?;
        playing.played += dt;
        if playing.played < playing.length {
            return None;
        }
        self.playing.take().map(|playing| playing.sound)
    }

    /// Returns the next sample for the microphone, -1..=1, `seconds` after the previous one.
    pub(crate) fn sample(&mut self, seconds: f64) -> f64 {
        let Some(playing) = &self.playing else {
            return 0.0;
        };
        let Some((_, hertz, sweep, beeps)) = tone(playing.sound) else {
            return 0.0;
        };
        let share = playing.played.as_secs_f64() / playing.length.as_secs_f64().max(1e-3);
        let beep = (share * f64::from(beeps)).fract();
        let hertz = hertz + sweep * if beeps > 1 { beep } else { share };
        self.phase = (self.phase + TAU * hertz * seconds) % TAU;
        let pause = beeps > 1 && beep > 0.6;
        let loudness = if pause {
            0.0
        } else {
            f64::from(self.volume) / 100.0
        };
        loudness * (0.8 * self.phase.sin() + 0.2 * (3.0 * self.phase).sin())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TICK: Duration = Duration::from_millis(20);

    #[test]
    fn every_known_sound_reaches_its_end() {
        for &sound in Sound::ALL {
            let mut speaker = Speaker::new(Duration::from_secs(3));
            speaker.play(sound);
            assert_eq!(speaker.playing(), Some(sound));
            let ended = (0..1000).find_map(|_| speaker.step(TICK));
            assert_eq!(ended, Some(sound));
            assert_eq!(speaker.playing(), None);
        }
    }

    #[test]
    fn a_stopped_sound_does_not_report_its_end() {
        let mut speaker = Speaker::new(Duration::from_secs(3));
        speaker.play(Sound::Music);
        speaker.stop();
        assert!((0..1000).all(|_| speaker.step(TICK).is_none()));
    }

    #[test]
    fn unknown_sounds_are_silent() {
        let mut speaker = Speaker::new(Duration::ZERO);
        speaker.play(Sound::Unknown(99));
        assert_eq!(speaker.playing(), None);
        assert_eq!(speaker.sample(0.001), 0.0);
    }
}
