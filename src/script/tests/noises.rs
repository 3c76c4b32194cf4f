//! Events from the microphone.

use bytes::Bytes;

use super::*;

/// A chunk of audio in which all samples are equal.
fn audio(sample: i16) -> Event {
    Event::Audio(Bytes::from(sample.to_le_bytes().repeat(160)))
}

#[test]
fn audio_events_have_their_loudness_and_loud_ones_cause_a_noise() {
    let mut rig = Rig::new(
        "robot.on('audio', function(a)
             print(a.rate, a.rms, a.peak, a.dbfs < 0, buffer.readi16(a.samples, 0), buffer.len(a.samples))
         end)
         robot.on('noise', function(n) print('noise', math.round(n.dbfs)) end)",
    );
    rig.deliver(audio(100));
    rig.deliver(audio(16_384));
    assert_eq!(rig.texts()[0].split(' ').next(), Some("16000"));
    assert_eq!(
        rig.texts()[1..],
        ["noise -6", "16000 0.5 0.5 true 16384 320"]
    );
}

#[test]
fn a_noise_that_may_be_the_robots_own_is_marked() {
    let mut rig = Rig::new("robot.on('noise', function(n) print(n.own) end)");
    let mut noise_after = |event: Option<Event>, seconds: f64| {
        if let Some(event) = event {
            rig.deliver(event);
        }
        rig.pass(seconds);
        rig.deliver(audio(16_384));
        rig.texts().last().map(|text| (*text).to_owned())
    };
    let own = Some("true".to_owned());
    let foreign = Some("false".to_owned());
    assert_eq!(noise_after(None, 2.0), foreign);
    assert_eq!(noise_after(Some(Event::Moving { on: true }), 20.0), own);
    assert_eq!(noise_after(Some(Event::Moving { on: false }), 0.9), own);
    assert_eq!(noise_after(None, 1.1), foreign);
    assert_eq!(noise_after(Some(Event::Sounding), 4.9), own);
    assert_eq!(noise_after(None, 1.1), foreign);
}

#[test]
fn a_long_noise_is_one_event() {
    let mut rig = Rig::new("robot.on('noise', function() print('noise') task.wait(2) end)");
    for (chunks, count) in [(20, 1), (60, 1), (1, 1)] {
        for _ in 0..chunks {
            rig.deliver(audio(16_384));
            rig.pass(0.05);
        }
        assert_eq!(rig.texts().len(), count);
    }
    rig.pass(3.0);
    rig.deliver(audio(16_384));
    assert_eq!(rig.texts().len(), 2);
}
