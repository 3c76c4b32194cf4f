use bytes::Bytes;

use super::*;
use crate::robot::{Percent, Streams, Use};
use crate::wire::{Led, Sound, Stream};

#[test]
fn lights_sounds_and_volume_become_intents() {
    let rig = Rig::new(
        "robot.led('flash', true) robot.led('all', false)
         robot.play('laser') robot.stop_sound() robot.volume(30)",
    );
    let led = |led, on| Intent::Led { led, on };
    assert_eq!(
        rig.intents,
        [
            led(Led::Flash, true),
            led(Led::Flash, false),
            led(Led::Left, false),
            led(Led::Right, false),
            Intent::Play(Sound::Laser),
            Intent::StopSound,
            Intent::Volume(Percent::new(30).unwrap()),
        ]
    );
}

#[test]
fn unknown_names_are_errors_with_the_nearest() {
    for (call, words) in cases(
        "robot.led('lef', true) => unknown light 'lef'; did you mean 'left'? (known: flash, left, right, all)
         robot.led('left') => on is missing; it must be true or false
         robot.led('left', 1) => on must be true or false, got 1
         robot.play('lazer') => unknown sound 'lazer'; did you mean 'laser'?
         robot.play('unknown') => unknown sound 'unknown'
         robot.volume(101) => percent must be between 0 and 100, got 101
         robot.stream('vido', true) => did you mean 'video'?
         robot.blink('all', {count = -1}) => count must be between 0
         robot.play(('x'):rep(1e6)) => unknown sound 'xxxx",
    ) {
        let text = failure(call);
        assert!(text.contains(words), "{text:?} lacks {words:?}");
        assert!(text.len() < 400, "{} bytes", text.len());
    }
}

#[test]
fn blink_switches_on_and_off_and_ends_with_the_light_off() {
    let mut rig = Rig::new("robot.blink('left', {on = 0.1, off = 0.1, count = 2})");
    rig.pass(1.0);
    let on: Vec<bool> = rig
        .take_intents()
        .into_iter()
        .map(|intent| match intent {
            Intent::Led { led: Led::Left, on } => on,
            other => panic!("{other:?}"),
        })
        .collect();
    assert_eq!(on, [true, false, true, false]);
    rig.assert_ended(EndReason::Done, "");

    let mut rig = Rig::new("local t = robot.blink('left', {on = 5}) task.wait(1) t:cancel()");
    rig.pass(2.0);
    assert_eq!(
        rig.intents.last(),
        Some(&Intent::Led {
            led: Led::Left,
            on: false
        })
    );
}

#[test]
fn say_needs_its_stream_and_bounded_samples() {
    let rig = Rig::new(
        "local b = buffer.create(320)
         print(pcall(robot.say, b))
         robot.stream('audio_out', true)
         robot.say(b)
         print(pcall(robot.say, buffer.create(321)))
         print(pcall(robot.say, buffer.create(70000)))
         print(pcall(robot.say, 'text'))
         local big = buffer.create(65534)
         for _ = 1, 100 do local ok, why = pcall(robot.say, big) if not ok then print(why) break end end",
    );
    assert_eq!(
        rig.intents[..2],
        [
            Intent::Stream {
                stream: Stream::AudioOut,
                on: true
            },
            Intent::Say(vec![0; 320])
        ]
    );
    assert!(rig.intents.len() < 10);
    let texts = rig.texts();
    assert!(texts[0].contains("switch the stream on first"));
    assert!(texts[1].contains("even number"));
    assert!(texts[2].contains("at most 65535"));
    assert!(texts[3].contains("must be a buffer"));
    assert!(texts[4].contains("too many commands at once"));
}

#[test]
fn a_stream_that_the_config_keeps_off_stays_off_and_scripts_that_do_not_depend_on_it_continue() {
    let off = |options: &mut Options| {
        options.limits.callback_budget_ms = 2_000;
        options.streams = Streams {
            video: Use::Off,
            audio_in: Use::Off,
            audio_out: Use::Off,
        };
    };
    for (call, name) in [
        ("robot.stream('audio_in', true)", "audio_in"),
        ("robot.wait_for('noise')", "audio_in"),
        ("robot.wait_frame()", "video"),
        ("robot.stream('audio_out', true)", "audio_out"),
    ] {
        let rig = Rig::with(call, off);
        let words = format!("the config keeps {name} off; it has streams: {{ {name}: off }}");
        rig.assert_ended(EndReason::Error, &words);
        assert_eq!(rig.intents, [], "{call}");
    }
    let rig = Rig::with("robot.stream('audio_in', false) print('lives')", off);
    assert_eq!(rig.texts(), ["lives"]);
    for (call, name, event) in [
        ("robot.on('audio', print)", "audio_in", "audio"),
        ("robot.once('noise', print)", "audio_in", "noise"),
        ("robot.wait_for('noise', 1)", "audio_in", "noise"),
        ("robot.on('frame', print)", "video", "frame"),
        ("assert(robot.frame() == nil)", "video", "frame"),
        (
            "local _, why = robot.wait_frame(1) assert(why == 'timeout')",
            "video",
            "frame",
        ),
    ] {
        let mut rig = Rig::with(&format!("for i = 1, 3 do {call} end print('lives')"), off);
        rig.pass(5.0);
        let why = format!("the config keeps {name} off; it has streams: {{ {name}: off }}");
        let text = format!("'{event}' never comes: {why}");
        assert_eq!(rig.texts(), [text.as_str(), "lives"], "{call}");
        assert_eq!(rig.intents, [], "{call}");
    }
}

#[test]
fn a_stream_that_is_always_on_is_not_switched() {
    let rig = Rig::with("robot.say(buffer.create(4))", |options| {
        options.streams.audio_out = Use::On;
    });
    assert_eq!(rig.intents, [Intent::Say(vec![0; 4])]);
}

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
