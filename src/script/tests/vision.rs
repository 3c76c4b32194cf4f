use super::*;
use crate::robot::{Frame, MotionEnd};
use crate::vision::Colour;
use bytes::Bytes;
use image::{Rgb, RgbImage};

const GREY: Rgb<u8> = Rgb([128, 128, 128]);

/// A rectangle (x, y, w, h) and its colour.
pub(super) type Part = ((u32, u32, u32, u32), [u8; 3]);

/// A picture as the robot sends it.
pub(super) fn encoded(pixels: &RgbImage) -> Bytes {
    let mut jpeg = Vec::new();
    image::codecs::jpeg::JpegEncoder::new_with_quality(&mut jpeg, 90)
        .encode_image(pixels)
        .unwrap();
    Bytes::from(jpeg)
}

/// A grey picture of 320x240 with rectangles.
pub(super) fn picture(parts: &[Part]) -> Bytes {
    let mut pixels = RgbImage::from_pixel(320, 240, GREY);
    for &((left, top, w, h), colour) in parts {
        for (x, y) in (left..left + w).flat_map(|x| (top..top + h).map(move |y| (x, y))) {
            pixels.put_pixel(x, y, Rgb(colour));
        }
    }
    encoded(&pixels)
}

pub(super) const RED: [u8; 3] = [220, 20, 20];
const BLUE: [u8; 3] = [20, 20, 220];

/// A script whose handler runs `body` with each frame `f`.
pub(super) fn looking(body: &str, adjust: impl FnOnce(&mut Options)) -> Rig {
    let source = format!("robot.on('frame', function(f)\n{body}\nend)");
    Rig::with(&source, |options| {
        options.limits.callback_budget_ms = 2_000;
        adjust(options);
    })
}

pub(super) fn show(rig: &mut Rig, seq: u64, jpeg: &Bytes) {
    let frame = Frame {
        seq,
        at: rig.now,
        jpeg: jpeg.clone(),
    };
    rig.script.deliver_frame(frame, rig.now);
    rig.run();
}

#[test]
fn a_handler_runs_before_the_frame_is_examined_for_the_robots_own_motion() {
    let source = "robot.on('frame', function() robot.led('left', true) end)
        robot.turn(math.pi)";
    let mut rig = Rig::new(source);
    let jpeg = picture(&[((100, 50, 40, 20), RED)]);
    for seq in 1..=2 {
        rig.now += Duration::from_millis(100);
        let at = rig.now;
        let jpeg = jpeg.clone();
        rig.script.deliver_frame(Frame { seq, at, jpeg }, rig.now);
        rig.intents.clear();
        rig.script.run_ready(rig.now);
        rig.collect();
        assert!(
            matches!(rig.intents[..], [Intent::Led { .. }]),
            "{:?}",
            rig.intents
        );
        assert_eq!(decoded(&rig), seq - 1);
        rig.run();
        assert_eq!(decoded(&rig), seq);
    }
}

fn decoded(rig: &Rig) -> u64 {
    rig.script.state.borrow().frames.analyser.decoded()
}

/// What a handler with this body logs about one frame.
pub(super) fn seen(body: &str, jpeg: &Bytes) -> Vec<String> {
    let mut rig = looking(body, |_| {});
    show(&mut rig, 1, jpeg);
    rig.log.into_iter().map(|line| line.text).collect()
}

#[test]
fn a_frame_has_its_data_and_its_blobs() {
    let jpeg = picture(&[((100, 50, 40, 20), RED), ((0, 200, 20, 20), BLUE)]);
    let texts = seen(
        "print(f.seq, f.width, f.height, f.bytes > 1000, f.age, typeof(f))
         local b = f:find_blobs('red')
         print(#b, b[1].colour, math.abs(b[1].cx - 119.5) < 1, math.abs(b[1].cy - 59.5) < 1, b[1].edge, b[1].code)
         print(b[1].x + b[1].w / 2 > 0 and b[1].density > 0.9, b[1].bearing > 0, b[1].pixels > 700, b[1].count)
         local both = f:find_blobs({'blue', 'red'})
         print(#both, both[1].colour, both[1].code, both[2].colour, both[2].code, both[2].edge)
         print(#f:find_blobs('red', {roi = {0, 100, 320, 140}}), #f:find_blobs('red', {pixels_threshold = 10000}),
             #f:find_blobs({'blue', 'red'}, {max_blobs = 1}), #f:find_blobs('red', {roi = b[1]}))",
        &jpeg,
    );
    assert_eq!(
        texts,
        [
            "1 320 240 true 0 Frame",
            "1 red true true false 1",
            "true true true 1",
            "2 red 2 blue 1 true",
            "0 0 1 1",
        ]
    );
}

#[test]
fn colours_come_from_names_the_config_and_ranges() {
    let jpeg = picture(&[((100, 50, 40, 20), RED)]);
    let mut rig = looking(
        "print(#f:find_blobs('ball'), f:find_blobs('ball')[1].colour)
         print(#f:find_blobs(vision.hsv{h = {340, 20}, s = {50, 100}, v = {30, 100}}))
         print(#f:find_blobs(vision.lab{l = {20, 70}, a = {40, 127}}), f:find_blobs(vision.lab{a = {40, 127}})[1].colour)
         print(tostring(vision.hsv{h = {340, 20}}), typeof(vision.lab{}))",
        |options| {
            let ball = Colour::hsv([340.0, 20.0], [50.0, 100.0], [30.0, 100.0]).unwrap();
            options.colours.insert("ball".to_owned(), ball);
        },
    );
    show(&mut rig, 1, &jpeg);
    assert_eq!(
        rig.texts(),
        [
            "1 ball",
            "1",
            "1 nil",
            "{ h: [340, 20], s: [0, 100], v: [0, 100] } Colour",
        ]
    );
}

#[test]
fn mistakes_are_reported_with_a_message() {
    let jpeg = picture(&[]);
    for (call, words) in cases(
        "f:find_blobs('rde') => Frame:find_blobs: unknown colour 'rde'; did you mean 'red'? (known: red,
         f:find_blobs() => a colour must be a name, vision.lab{...} or vision.hsv{...}, got nothing
         f:find_blobs({}) => a list of colours has 1 to 32 of them, got 0
         f:find_blobs('red', {roy = 1}) => unknown option 'roy'; did you mean 'roi'?
         f:find_blobs('red', {roi = {1, 2, 3}}) => roi's h is missing
         f:find_blobs('red', {merge = 1}) => merge must be true or false, got 1
         f:find_blobs('red', {area_threshold = -1}) => area_threshold must be between 0
         f.find_blobs('red') => call it on a frame with a colon, like frame:find_blobs()
         print(f.widht) => Frame.widht does not exist; did you mean 'width'?
         vision.lab{l = {30}} => l must be two numbers, such as l={20, 80}
         vision.lab{h = {1, 2}} => unknown option 'h'
         vision.hsv{s = {50, 20}} => write the smaller number first
         vision.hsv{h = {-5, 20}} => must lie within 0..360
         vision.tracker{} => a colour must be a name
         vision.tracker{color = 'red'} => unknown option 'color'; did you mean 'colour'?
         vision.tracker{colour = 'red'}:update(5) => Tracker:update: frame must be a Frame, got 5
         vision.motion{threshold = 300} => threshold must be between 0 and 255
         vision.learn({}, {1, 2, 3, 4}) => a list of 1 to 16 frames
         f:save('../x') => the name may have letters
         for i = 1, 100 do _G['t' .. i] = vision.tracker{colour = 'red'} end => there are 16 trackers and detectors already",
    ) {
        let mut rig = looking(call, |_| {});
        show(&mut rig, 1, &jpeg);
        let texts = rig.logged(Level::Error);
        let text = texts.first().copied().unwrap_or_default();
        assert!(text.starts_with("test.lua:2: "), "{call}: {text}");
        assert!(text.contains(words), "{call}: {text:?} lacks {words:?}");
    }
}

#[test]
fn brightness_sharpness_and_pixels_are_measured() {
    let jpeg = picture(&[((100, 50, 40, 20), RED)]);
    let texts = seen(
        "print(math.abs(f:brightness({0, 0, 50, 50}) - 0.5) < 0.02, f:brightness({-9, -9, 5, 5}))
         print(f:sharpness() > f:sharpness({0, 0, 50, 50}), f:sharpness({0, 0, 50, 50}) >= 0)
         local r, g, b = f:get_pixel(120, 60) print(r > 180, g < 70, b < 70)
         print(f:get_pixel(320, 0), f:get_pixel(-1, 5), #f:find_qrcodes())",
        &jpeg,
    );
    assert_eq!(
        texts,
        ["true 0", "true true", "true true true", "nil nil 0"]
    );
}

#[test]
fn a_qr_code_is_read() {
    let jpeg = Bytes::from_static(include_bytes!("../../../tests/fixtures/qrcode.jpg"));
    let texts = seen(
        "local c = f:find_qrcodes()[1] print(#c.text > 0, #c.corners, c.corners[1].x < c.corners[2].x)
         print(c.x >= 0 and c.w > 20 and c.x + c.w <= f.width, math.abs(c.bearing) < 0.7, f:distance_to(c, 0.1) > 0)",
        &jpeg,
    );
    assert_eq!(texts, ["true 4 true", "true true true"]);
}

#[test]
fn the_width_of_a_box_tells_how_far_something_of_a_known_width_is() {
    let jpeg = picture(&[((150, 100, 20, 20), BLUE), ((0, 180, 30, 20), BLUE)]);
    let texts = seen(
        "local b = f:find_blobs('blue', { roi = { 100, 90, 120, 40 } })[1]
         local wide = { x = b.x - 10, y = b.y, w = b.w + 20, h = b.h }
         local far, near = f:distance_to(b, 0.1), f:distance_to(wide, 0.1)
         print(far > 0.5 and far < 5, math.abs(far / near - wide.w / b.w) < 0.05, math.abs(f:distance_to(b, 0.2) / far - 2) < 1e-6)
         print(f:distance_to(f:find_blobs('blue', { roi = { 0, 170, 60, 40 } })[1], 0.1))",
        &jpeg,
    );
    assert_eq!(texts, ["true true true", "nil"]);
}

#[test]
fn a_line_is_found() {
    let jpeg = picture(&[((150, 0, 20, 240), BLUE)]);
    let texts = seen(
        "local l = f:find_line('blue')
         print(math.abs(l.offset) < 0.05, math.abs(l.angle) < 0.1, l.strength > 0.8)
         print(f:find_line('red'), f:find_line('blue', {roi = {0, 0, 100, 100}}))",
        &jpeg,
    );
    assert_eq!(texts, ["true true true", "nil nil"]);
}

#[test]
fn a_tracker_follows_and_forgets() {
    let mut rig = looking(
        "t = rawget(_G, 't') or vision.tracker{colour = 'red', min_age = 2}
         local list = t:update(f)
         local best = t:best()
         print(#list, best and best.id, best and best.colour, best and best.vx > 50)
         if f.seq == 4 then t:reset() print(t:best()) end",
        |_| {},
    );
    for seq in 1..=4 {
        let x = 50 + 20 * seq as u32;
        show(&mut rig, seq, &picture(&[((x, 50, 30, 30), RED)]));
        rig.pass(0.1);
    }
    let texts = rig.texts();
    assert_eq!(texts[0], "0 nil nil nil");
    assert_eq!(texts[3..], ["1 1 red true", "nil"]);
}

#[test]
fn motion_is_detected_only_while_the_robot_stands() {
    let mut rig = looking(
        "d = rawget(_G, 'd') or vision.motion()
         local m, why = d:update(f)
         print(m and m.score > 0, m and m.pixels > 100, m and #m.blobs, why)
         if f.seq == 2 then robot.move(10, 10) end",
        |_| {},
    );
    for seq in 1..=4 {
        let x = 50 + 60 * seq as u32;
        show(
            &mut rig,
            seq,
            &picture(&[((x, 50, 30, 30), [250, 250, 250])]),
        );
        rig.pass(0.1);
    }
    let setpoint = rig.take_intents().pop().unwrap();
    rig.deliver(motion_ended(&setpoint, MotionEnd::Done));
    for seq in 5..=7 {
        rig.pass(if seq == 5 { 1.1 } else { 0.5 });
        let x = 10 + 40 * (seq % 4) as u32;
        show(
            &mut rig,
            seq,
            &picture(&[((x, 50, 30, 30), [250, 250, 250])]),
        );
    }
    let texts = rig.texts();
    assert_eq!(texts[0], "false false 0 nil");
    assert!(texts[1].starts_with("true true"), "{texts:?}");
    assert_eq!(texts[2..4], ["nil nil nil moving"; 2]);
    assert_eq!(texts[4], "false false 0 nil");
    assert!(texts[5].starts_with("true true"), "{texts:?}");
}

#[test]
fn no_motion_is_detected_while_somebody_else_moves_the_robot_and_for_a_second_after() {
    let mut rig = looking(
        "d = rawget(_G, 'd') or vision.motion()
         local m, why = d:update(f)
         print(m and m.pixels > 100, why)",
        |_| {},
    );
    let mut seq = 0;
    let mut look = |rig: &mut Rig| {
        rig.pass(0.2);
        seq += 1;
        let x = 10 + 40 * (seq as u32 % 6);
        show(rig, seq, &picture(&[((x, 50, 30, 30), [250, 250, 250])]));
        rig.texts()
            .last()
            .map(|text| (*text).to_owned())
            .unwrap_or_default()
    };
    assert_eq!([look(&mut rig), look(&mut rig)], ["false nil", "true nil"]);
    rig.deliver(Event::Moving { on: true });
    assert_eq!(look(&mut rig), "nil moving");
    rig.deliver(Event::Moving { on: false });
    for _ in 0..4 {
        assert_eq!(look(&mut rig), "nil moving");
    }
    let settled = [look(&mut rig), look(&mut rig)];
    assert_eq!(settled, ["false nil", "true nil"]);
    rig.deliver(Event::Undocked);
    assert_eq!(look(&mut rig), "nil moving", "its own search or a person");
}

#[test]
fn a_colour_is_learnt() {
    let jpeg = picture(&[((100, 50, 60, 60), RED)]);
    let texts = seen(
        "local c, info = vision.learn({f, f}, {105, 55, 50, 50})
         print(typeof(c), info.quality > 0.5, #f:find_blobs(c))
         print(vision.learn(f, {0, 0, 50, 50}))",
        &jpeg,
    );
    assert_eq!(texts, ["Colour true 1", "nil too_grey"]);
}
