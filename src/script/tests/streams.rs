//! When the camera and the microphone are on.

use super::*;
use crate::wire::Stream;

#[test]
fn handlers_and_waits_switch_their_streams_on() {
    for (source, stream) in [
        ("robot.on('frame', print)", Stream::Video),
        ("robot.wait_frame(1)", Stream::Video),
        ("robot.frame() task.wait(1)", Stream::Video),
        ("robot.wait_for('frame')", Stream::Video),
        ("robot.on('audio', print)", Stream::AudioIn),
        ("robot.once('noise', print)", Stream::AudioIn),
    ] {
        let rig = Rig::new(source);
        assert_eq!(rig.intents, [Intent::Stream { stream, on: true }]);
        assert_eq!(rig.script.wants_frames(), stream == Stream::Video);
    }
    let mut rig = Rig::new(
        "robot.on('frame', print) robot.on('frame', print) robot.stream('video', false) robot.stream('video', true)",
    );
    let on = rig.take_intents().into_iter().map(|intent| match intent {
        Intent::Stream { on, .. } => on,
        other => panic!("{other:?}"),
    });
    assert_eq!(on.collect::<Vec<_>>(), [true, false, true]);
}

/// The streams that the script has switched since the last call.
fn switches(rig: &mut Rig) -> Vec<(Stream, bool)> {
    let intents = rig.take_intents().into_iter();
    let switch = |intent| match intent {
        Intent::Stream { stream, on } => Some((stream, on)),
        _ => None,
    };
    intents.filter_map(switch).collect()
}

#[test]
fn a_stream_is_switched_off_some_time_after_its_last_use() {
    for source in [
        "robot.wait_frame(5)",
        "robot.frame() task.wait(5)",
        "local on = robot.on('frame', print) task.wait(5) on:off()",
        "robot.wait_for('frame', 5)",
    ] {
        let mut rig = Rig::new(&format!("{source} task.wait(60)"));
        assert_eq!(switches(&mut rig), [(Stream::Video, true)], "{source}");
        rig.pass(1.9);
        assert_eq!(switches(&mut rig), [], "{source}");
        rig.pass(5.2);
        assert_eq!(switches(&mut rig), [(Stream::Video, false)], "{source}");
        assert!(!rig.script.wants_frames(), "{source}");
        rig.pass(60.0);
        assert_eq!(switches(&mut rig), [], "{source}");
    }
}

#[test]
fn a_stream_stays_on_while_a_script_uses_it_repeatedly_or_has_switched_it_on() {
    for source in [
        "robot.stream('video', true) task.wait(60)",
        "robot.stream('video', true) robot.wait_frame(1) task.wait(60)",
        "while true do robot.wait_frame(1) task.wait(1.5) end",
        "robot.on('frame', print)",
    ] {
        let mut rig = Rig::new(source);
        rig.pass(30.0);
        assert_eq!(switches(&mut rig), [(Stream::Video, true)], "{source}");
    }
}
