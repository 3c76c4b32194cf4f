//! Frames: saved, damaged, and of any size.

use bytes::Bytes;
use image::{Rgb, RgbImage};

use super::vision::{RED, encoded, looking, picture, seen, show};
use super::*;
use crate::wire::Stream;

#[test]
fn frames_are_saved_as_received() {
    let folder = tempfile::tempdir().unwrap();
    let jpeg = picture(&[]);
    let mut rig = looking(
        "print(f:save('ball-' .. f.seq)) print(f:save('more.jpg'))",
        |options| {
            options.data_dir = Some(folder.path().join("data"));
            options.limits.free_bytes = 0;
        },
    );
    for seq in 1..=2 {
        show(&mut rig, seq, &jpeg);
    }
    let path = folder.path().join("data/ball-1.jpg");
    assert_eq!(std::fs::read(&path).unwrap(), jpeg);
    assert_eq!(rig.texts()[0], path.to_str().unwrap());
    assert!(folder.path().join("data/more.jpg").exists());

    let root = folder.path().to_owned();
    let mut rig = looking("print(f:save('x'))", |options| {
        options.data_dir = Some(root.join("none"));
        options.limits.picture_bytes = 0;
    });
    show(&mut rig, 1, &jpeg);
    let texts = rig.texts();
    assert!(texts[0].contains("larger than the limit"), "{texts:?}");
    assert_eq!(texts[1], "nil quota");

    let texts = seen("print(f:save('x'))", &jpeg);
    assert!(texts[0].contains("there is no data folder"));
    assert_eq!(texts[1], "nil io");
}

/// Removes a part of the data, which the markers do not reveal.
fn torn(jpeg: &Bytes) -> Bytes {
    let middle = jpeg.len() - 400;
    let end = jpeg.len() - 100;
    [&jpeg[..middle], &jpeg[end..]].concat().into()
}

#[test]
fn a_truncated_frame_never_reaches_a_script() {
    let jpeg = picture(&[((100, 50, 40, 20), RED)]);
    let mut rig = Rig::new(
        "robot.on('frame', function(f) print(f.seq, robot.frame().seq) end)
         print('next', robot.wait_frame(5).seq)",
    );
    show(&mut rig, 1, &jpeg.slice(..jpeg.len() / 2));
    assert_eq!(rig.texts(), [rig.logged(Level::Warn)[0]]);
    show(&mut rig, 2, &jpeg);
    show(&mut rig, 3, &jpeg.slice(..jpeg.len() - 2));
    assert_eq!(rig.logged(Level::Info), ["next 2", "2 2"]);
    assert!(rig.logged(Level::Warn)[0].contains("cut short"));
    assert_eq!(rig.logged(Level::Warn).len(), 1);
}

#[test]
fn a_damaged_frame_has_no_results_and_is_counted_once() {
    let jpeg = picture(&[((100, 50, 40, 20), RED)]);
    let mut rig = looking(
        "local t = vision.tracker{colour = 'red'} local d = vision.motion()
         print(f.width >= 0, #f:find_blobs('red'), f:brightness(), f:get_pixel(1, 1), f:find_line('red'), #f:find_qrcodes(),
             #t:update(f), d:update(f).score, f:sharpness(), vision.learn(f, {1, 1, 9, 9}))",
        |_| {},
    );
    show(&mut rig, 1, &torn(&jpeg));
    show(&mut rig, 2, &torn(&jpeg));
    assert_eq!(
        rig.logged(Level::Info),
        ["true 0 0 nil nil 0 0 0 0 nil too_grey"; 2]
    );
    assert!(rig.logged(Level::Warn)[0].contains("damaged"));
    assert_eq!(rig.logged(Level::Warn).len(), 1);
    rig.script.stop(EndReason::Shutdown, rig.now);
    rig.collect();
    assert!(rig.logged(Level::Warn)[1].starts_with("2 damaged frames so far"));
    assert_eq!(rig.logged(Level::Error), [""; 0]);
}

#[test]
fn a_damaged_frame_shows_no_free_floor() {
    let jpeg = picture(&[((100, 50, 40, 20), RED)]);
    let mut rig = looking(
        "local floor = require('@spykee/floor') local free = floor.look(f)
         local near = floor.memory():look(f)
         print(free.ahead, free.left, free.right, free.turn, near.ahead, floor.nearest(f), #floor.texture(f) > 0)",
        |_| {},
    );
    show(&mut rig, 1, &torn(&jpeg));
    assert_eq!(rig.logged(Level::Info), ["0 0 0 0 0 0 true"]);
    assert_eq!(rig.logged(Level::Error), [""; 0]);
}

/// Somebody who stood right in front of the robot and has left is in its way no longer.
#[test]
fn what_filled_the_picture_is_forgotten_once_there_is_floor() {
    let source = "local near = require('@spykee/floor').memory()
        robot.on('frame', function(f)
            local free = near:look(f)
            print(free.known, free.ahead > 1, free.beside.left, free.beside.right)
        end)";
    let mut rig = Rig::with(source, |options| {
        options.limits.callback_budget_ms = 2_000;
    });
    let wall = |height| picture(&[((0, 0, 320, height), RED)]);
    show(&mut rig, 1, &wall(240));
    show(&mut rig, 2, &wall(120));
    assert_eq!(
        rig.logged(Level::Info),
        ["false false false false", "true true false false"]
    );
}

#[test]
fn a_frame_is_decoded_once_for_many_calls() {
    let jpeg = picture(&[]);
    let mut rig = looking(
        "for _ = 1, 5 do f:find_blobs('red') f:brightness() f:get_pixel(1, 1) end",
        |_| {},
    );
    for seq in 1..=3 {
        show(&mut rig, seq, &jpeg);
    }
    assert_eq!(rig.script.state.borrow().frames.analyser.decoded(), 3);
}

/// A picture of any size with a floor, a wall, and a red object on the floor.
fn room(width: u32, height: u32) -> Bytes {
    let pixels = RgbImage::from_fn(width, height, |x, y| {
        let red = (width * 9 / 20..width * 11 / 20).contains(&x)
            && (height * 9 / 20..height * 12 / 20).contains(&y);
        match (red, y < height * 11 / 20) {
            (true, _) => Rgb(RED),
            (_, true) => Rgb([200, 210, 220]),
            _ => Rgb([120, 100, 80]),
        }
    });
    encoded(&pixels)
}

/// Runs one of the supplied behaviours with three frames of this size.
fn shown(behaviour: &str, width: u32, height: u32) -> Rig {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("behaviours")
        .join(behaviour);
    let source = std::fs::read_to_string(path).unwrap();
    let mut rig = Rig::with(&source, |options| {
        options.limits.callback_budget_ms = 5_000;
    });
    rig.deliver(connected(false));
    // The robot is not docked: there is no station to leave.
    if let Some(Intent::Undock { call, .. }) = rig.take_intents().last() {
        let call = *call;
        let end = crate::robot::DockEnd::NotDocked;
        rig.deliver(Event::UndockEnded { call, end });
    }
    let jpeg = room(width, height);
    for seq in 1..=3 {
        rig.pass(0.2);
        show(&mut rig, seq, &jpeg);
    }
    rig
}

#[test]
fn behaviours_that_see_the_floor_go_on_with_frames_of_any_size() {
    for behaviour in ["explore.lua", "find_and_return.lua"] {
        for (width, height) in [
            (1, 1),
            (8, 8),
            (8, 400),
            (400, 8),
            (63, 47),
            (64, 48),
            (160, 120),
            (317, 241),
            (320, 240),
            (640, 480),
            (1280, 1024),
        ] {
            let rig = shown(behaviour, width, height);
            assert!(
                rig.script.ended().is_none(),
                "{behaviour} {width}x{height}: {:?}",
                rig.script.ended()
            );
            let moves = |intent: &Intent| matches!(intent, Intent::Move { .. });
            assert!(
                rig.intents.iter().any(moves),
                "{behaviour} {width}x{height}"
            );
        }
    }
}

#[test]
fn the_modules_take_a_frame_of_8x8_which_shows_no_free_floor() {
    let mut rig = looking(
        "local floor = require('@spykee/floor') local compass = require('@spykee/compass')
         local texture = floor.texture(f)
         print(floor.look(f).ahead, floor.look(f).known, floor.nearest(f), floor.differs(texture, texture))
         local profile = compass.profile(f) compass.turned(profile, profile, 0, 1)
         compass.growth(profile, profile)
         require('@spykee/station').find(f)
         local whereabouts = require('@spykee/whereabouts')
         whereabouts.begin_watching() whereabouts.watch(f)",
        |_| {},
    );
    show(&mut rig, 1, &room(8, 8));
    assert_eq!(rig.texts(), ["0 false 0 false"]);
}

/// What a robot with this heading sees of a room whose walls are plain from 230 to 370 degrees; the left is positive.
fn seen_towards(heading: f64) -> Bytes {
    let pixels = RgbImage::from_fn(320, 240, |x, y| {
        let angle = (heading + (160.0 - f64::from(x)) / 6.0 - 230.0).rem_euclid(360.0);
        let pattern = 40.0 * (angle / 9.0).sin() + 30.0 * (angle / 17.0 + 1.0).sin();
        let wall = 150.0 + if angle < 140.0 { 0.0 } else { pattern };
        if y < 140 {
            Rgb([wall as u8; 3])
        } else {
            Rgb([120, 100, 80])
        }
    });
    encoded(&pixels)
}

#[test]
fn a_turn_that_begins_next_to_something_plain_begins_as_soon_as_one_before() {
    let source = "local whereabouts = require('@spykee/whereabouts')
         robot.on('frame', whereabouts.watch)
         for number = 1, 2 do
             local before = whereabouts.heading()
             whereabouts.begin_watching()
             task.wait(19)
             whereabouts.settle()
             print(math.deg(whereabouts.heading() - before))
         end";
    let mut rig = Rig::with(source, |options| options.limits.callback_budget_ms = 5_000);
    rig.deliver(connected(false));
    let mut seq = 0;
    for start in [45.0, 260.0] {
        // For 0.5 s it stands, then it turns for 18 s, then it stands.
        for tenth in 0..190 {
            let turned = 2.8 * f64::from((tenth - 5).clamp(0, 180));
            seq += 1;
            show(&mut rig, seq, &seen_towards(start + turned));
            rig.pass(0.1);
        }
        rig.pass(0.1);
    }
    let texts = rig.texts();
    assert_eq!(texts.len(), 2);
    for text in texts {
        let turned: f64 = text.parse().unwrap();
        assert!((489.0..519.0).contains(&turned), "degrees: {turned}");
    }
}

#[test]
fn the_rescue_behaviour_gives_up_a_search_whose_pictures_no_longer_change_but_not_of_a_camera_that_hangs()
 {
    let source = crate::script::modules::RESCUE;
    let mut rig = Rig::with(source, |options| options.limits.callback_budget_ms = 5_000);
    rig.deliver(connected(false));
    let mut seq = 0;
    let mut give_ups = |jpeg: &Bytes, pictures: u32| {
        for _ in 0..pictures {
            seq += 1;
            show(&mut rig, seq, jpeg);
            rig.pass(0.2);
        }
        let is_give_up = |intent: &&Intent| matches!(intent, Intent::CancelDock);
        rig.take_intents().iter().filter(is_give_up).count()
    };
    let (one, other) = (room(320, 240), picture(&[]));
    assert_eq!(give_ups(&one, 100), 0);
    assert_eq!(give_ups(&other, 29), 0);
    // About twice a second, since the watchdog does not allow it at all times.
    let asked = give_ups(&other, 60);
    assert!((15..=25).contains(&asked), "{asked}");
}

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
