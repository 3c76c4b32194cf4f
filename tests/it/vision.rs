//! Vision from the outside: real JPEG bytes in, blobs out; malformed bytes do no harm.
#![allow(clippy::unwrap_used)]

use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, Rgb, RgbImage};
use imageproc::drawing::draw_filled_circle_mut;
use proptest::prelude::*;
use spykee::vision::{
    Annotation, BlobOptions, Camera, Colour, Decoder, FrameAnalyser, FrameError, Image,
    MotionDetector, MotionOptions, Tracker, TrackerOptions, annotate, brightness, find_qrcodes,
    sharpness, validate_markers,
};
use std::time::Duration;

/// A room with a red ball left of the middle and a blue one right of it.
fn room() -> RgbImage {
    let mut picture = RgbImage::from_fn(320, 240, |x, y| {
        let shade = 90 + (x / 8 + y / 4) as u8;
        Rgb([shade, shade, shade - 10])
    });
    draw_filled_circle_mut(&mut picture, (90, 130), 30, Rgb([205, 25, 30]));
    draw_filled_circle_mut(&mut picture, (240, 90), 20, Rgb([25, 40, 200]));
    picture
}

fn jpeg(picture: &RgbImage) -> Vec<u8> {
    let mut bytes = Vec::new();
    JpegEncoder::new_with_quality(&mut bytes, 85)
        .encode_image(picture)
        .unwrap();
    bytes
}

fn without_tables(jpeg: &[u8]) -> Vec<u8> {
    let mut bytes = jpeg.to_vec();
    while let Some(at) = bytes.windows(2).position(|pair| pair == [0xFF, 0xC4]) {
        let len = usize::from(u16::from_be_bytes([bytes[at + 2], bytes[at + 3]]));
        bytes.drain(at..at + 2 + len);
    }
    bytes
}

#[test]
fn finds_the_balls_of_a_jpeg() {
    let red_and_blue = ["red", "blue"].map(|name| Colour::named(name).unwrap());
    let mut analyser = FrameAnalyser::new(Camera::default());
    let blobs = analyser
        .find_blobs(1, &jpeg(&room()), &red_and_blue, &BlobOptions::default())
        .unwrap();
    let [red, blue] = blobs else {
        panic!("{blobs:?}")
    };
    assert!(
        (red.cx - 90.0).abs() < 0.5 && (red.cy - 130.0).abs() < 0.5,
        "{red:?}"
    );
    assert!(
        (blue.cx - 240.0).abs() < 0.5 && (blue.cy - 90.0).abs() < 0.5,
        "{blue:?}"
    );
    assert!(red.bearing > 0.1 && blue.bearing < -0.1);
    assert_eq!((red.colour, blue.colour), (0, 1));
    assert!(red.roundness > 0.95);
}

#[test]
fn a_frame_is_decoded_once_however_often_it_is_used() {
    let bytes = jpeg(&room());
    let red = [Colour::named("red").unwrap()];
    let mut analyser = FrameAnalyser::new(Camera::default());
    for _ in 0..3 {
        analyser
            .find_blobs(7, &bytes, &red, &BlobOptions::default())
            .unwrap();
        analyser.decode(7, &bytes).unwrap();
    }
    assert_eq!(analyser.decoded(), 1);
    analyser.decode(8, &bytes).unwrap();
    assert_eq!(analyser.decoded(), 2);
    assert!(analyser.decode(9, &bytes[..900]).is_err());
    assert_eq!(
        analyser.decode(9, &bytes[..900]).unwrap_err(),
        FrameError::NoEnd
    );
    assert_eq!(analyser.decoded(), 3);
    analyser.decode(10, &bytes).unwrap();
}

#[test]
fn frames_without_the_standard_tables_are_decoded() {
    let bytes = jpeg(&room());
    let bare = without_tables(&bytes);
    assert!(bare.len() + 400 < bytes.len());
    let mut with = Decoder::default();
    let mut without = Decoder::default();
    let pixels = with.decode(&bytes).unwrap().to_rgb();
    assert_eq!(pixels, without.decode(&bare).unwrap().to_rgb());
}

#[test]
fn grey_pictures_are_decoded_too() {
    let mut bytes = Vec::new();
    let grey = image::imageops::grayscale(&room());
    JpegEncoder::new(&mut bytes)
        .encode(&grey, 320, 240, ExtendedColorType::L8)
        .unwrap();
    let mut decoder = Decoder::default();
    let [r, g, b] = decoder.decode(&bytes).unwrap().pixel(10, 10).unwrap();
    assert!(r == g && g == b && r.abs_diff(93) < 6);
}

/// One scene of 99x75 pixels (not a multiple of any block size), encoded in every way that cameras
/// use.
fn kinds() -> [(&'static str, &'static [u8]); 6] {
    [
        ("4:4:4", include_bytes!("../fixtures/ball-444.jpg")),
        (
            "4:2:2, own tables",
            include_bytes!("../fixtures/ball-422.jpg"),
        ),
        ("4:2:0", include_bytes!("../fixtures/ball-420.jpg")),
        ("4:4:0", include_bytes!("../fixtures/ball-440.jpg")),
        (
            "restart markers",
            include_bytes!("../fixtures/ball-restart.jpg"),
        ),
        ("grey", include_bytes!("../fixtures/ball-grey.jpg")),
    ]
}

#[test]
fn every_kind_of_jpeg_of_cameras_shows_the_same_balls() {
    let colours = ["red", "blue"].map(|name| Colour::named(name).unwrap());
    let mut analyser = FrameAnalyser::new(Camera::default());
    for (key, (kind, bytes)) in (0..).zip(kinds()) {
        let size = analyser.decode(key, bytes).unwrap().size();
        assert_eq!((size.width, size.height), (99, 75), "{kind}");
        let blobs = analyser
            .find_blobs(key, bytes, &colours, &BlobOptions::default())
            .unwrap();
        if kind == "grey" {
            assert_eq!(blobs, []);
            continue;
        }
        let [red, blue] = blobs else {
            panic!("{kind}: {blobs:?}")
        };
        assert!(
            (red.cx - 35.0).abs() < 0.5 && (red.cy - 35.0).abs() < 0.5,
            "{kind}: {red:?}"
        );
        assert!(
            (blue.cx - 75.0).abs() < 0.5 && (blue.cy - 40.0).abs() < 0.5,
            "{kind}: {blue:?}"
        );
    }
}

#[test]
fn a_qr_code_is_read_with_its_corners() {
    let mut decoder = Decoder::default();
    let image = decoder
        .decode(include_bytes!("../fixtures/qrcode.jpg"))
        .unwrap();
    let codes = find_qrcodes(image);
    let [code] = &codes[..] else {
        panic!("{codes:?}")
    };
    assert_eq!(code.text, "spykee: dock here");
    let [top_left, top_right, bottom_right, bottom_left] = code.corners;
    assert!(
        top_left[0] < top_right[0] && bottom_left[0] < bottom_right[0],
        "{code:?}"
    );
    assert!(
        top_left[1] < bottom_left[1] && top_right[1] < bottom_right[1],
        "{code:?}"
    );
    assert_eq!(find_qrcodes(decoder.decode(&jpeg(&room())).unwrap()), []);
}

#[test]
fn half_a_frame_is_refused() {
    let bytes = jpeg(&room());
    for len in (0..bytes.len()).step_by(37) {
        assert!(validate_markers(&bytes[..len]).is_err());
        assert!(Decoder::default().decode(&bytes[..len]).is_err());
    }
}

#[test]
fn pixels_and_brightness_match_the_picture() {
    let mut decoder = Decoder::default();
    let image = decoder.decode(&jpeg(&room())).unwrap();
    let [r, g, b] = image.pixel(90, 130).unwrap();
    assert!(r > 180 && g < 60 && b < 60);
    assert_eq!(image.pixel(320, 0), None);
    assert_eq!(image.pixel(0, 240), None);
    assert!((0.4..0.6).contains(&brightness(image, None)));
    let red = brightness(
        image,
        Some(spykee::vision::Roi {
            x: 80,
            y: 120,
            w: 20,
            h: 20,
        }),
    );
    assert!((red - 0.305).abs() < 0.02, "{red}");
}

#[test]
fn marks_are_drawn_on_a_copy() {
    let mut analyser = FrameAnalyser::new(Camera::default());
    let bytes = jpeg(&room());
    let blobs = analyser
        .find_blobs(
            1,
            &bytes,
            &[Colour::named("red").unwrap()],
            &BlobOptions::default(),
        )
        .unwrap()
        .to_vec();
    let image = analyser.decode(1, &bytes).unwrap();
    let marks: Vec<Annotation<'_>> = blobs
        .iter()
        .map(|blob| Annotation {
            blob,
            text: "red #1",
        })
        .collect();
    let drawn = annotate(image, &marks);
    let changed = |x, y| drawn.get_pixel(x, y) != image.to_rgb().get_pixel(x, y);
    assert!(changed(blobs[0].x - 1, blobs[0].y - 1), "no corner");
    assert!(changed(blobs[0].x + 4, blobs[0].y - 6), "no text");
    assert!(!changed(250, 200), "drawn where nothing was seen");
    if let Ok(path) = std::env::var("SPYKEE_TEST_KEEP_ANNOTATED") {
        drawn.save(path).unwrap();
    }
}

#[test]
fn most_damaged_data_is_noticed() {
    let bytes = jpeg(&room());
    let scan = bytes
        .windows(2)
        .position(|pair| pair == [0xFF, 0xDA])
        .unwrap()
        + 14;
    let places = (scan..bytes.len() - 40).step_by(29);
    let mut noticed = 0;
    let mut tried = 0;
    for place in places {
        let mut damaged = bytes.clone();
        // A missing piece, as on a bad link.
        damaged.drain(place..place + 25);
        noticed += u32::from(Decoder::default().decode(&damaged).is_err());
        tried += 1;
    }
    assert!(noticed * 10 > tried * 8, "noticed {noticed} of {tried}");
}

/// The room some frames later.
fn later(frame: i32) -> Vec<u8> {
    let mut picture = room();
    draw_filled_circle_mut(&mut picture, (40 + 12 * frame, 190), 12, Rgb([40, 170, 60]));
    jpeg(&picture)
}

#[test]
fn nothing_is_allocated_per_frame_once_warm() {
    let frames: Vec<Vec<u8>> = (0..12).map(later).collect();
    let colours = ["red", "green", "blue", "yellow"].map(|name| Colour::named(name).unwrap());
    let options = BlobOptions {
        merge: true,
        margin: 2,
        ..BlobOptions::default()
    };
    let camera = Camera::default();
    let mut analyser = FrameAnalyser::new(camera);
    let mut tracker = Tracker::new(TrackerOptions::default(), camera);
    let mut motion = MotionDetector::new(MotionOptions::default(), camera);
    let mut seen = 0;
    let mut look_at_all = |round: u32| {
        for (number, jpeg) in (0..).zip(&frames) {
            let key = u64::from(round * 100 + number);
            let blobs = analyser.find_blobs(key, jpeg, &colours, &options).unwrap();
            let size = validate_markers(jpeg).unwrap();
            seen += tracker
                .update(Duration::from_millis(40 * key), size, blobs)
                .len();
            let line = analyser.find_line(key, jpeg, &colours[..1], None).unwrap();
            seen += usize::from(line.is_some());
            let image = analyser.decode(key, jpeg).unwrap();
            seen += motion.update(image).blobs.len();
            seen += usize::from(brightness(image, None) > 0.1)
                + usize::from(sharpness(image, None) > 0.1);
        }
    };
    (0..2).for_each(&mut look_at_all);
    let counted = allocation_counter::measure(|| look_at_all(2));
    assert_eq!(counted.count_total, 0, "{counted:?}");
    assert!(
        seen > 150,
        "nothing was seen that could have cost anything: {seen}"
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(600))]

    #[test]
    fn no_bytes_crash_the_decoder(bytes in proptest::collection::vec(any::<u8>(), 0..600), headed in any::<bool>()) {
        let bytes = if headed { [&[0xFF, 0xD8], &bytes[..], &[0xFF, 0xD9]].concat() } else { bytes };
        let mut decoder = Decoder::default();
        prop_assert_eq!(decoder.decode(&bytes).map(|image| image.size()).is_ok(), false);
    }

    #[test]
    fn damaged_frames_give_an_error_or_a_picture_of_the_size_that_its_markers_say(
        kind in 0..7usize,
        changes in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..12),
        headers_only in any::<bool>(),
    ) {
        let mut bytes = kinds().get(kind).map_or_else(|| jpeg(&room()), |(_, bytes)| bytes.to_vec());
        let reach = if headers_only { 640.min(bytes.len()) } else { bytes.len() };
        for (place, value) in changes {
            bytes[place.index(reach)] = value;
        }
        let mut analyser = FrameAnalyser::new(Camera::default());
        let colours = [Colour::named("red").unwrap()];
        if analyser.find_blobs(1, &bytes, &colours, &BlobOptions::default()).is_ok() {
            prop_assert_eq!(Ok(analyser.decode(1, &bytes).unwrap().size()), validate_markers(&bytes));
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    #[test]
    fn damaged_codes_do_no_harm(
        dots in proptest::collection::vec((0u32..320, 0u32..240, 1i32..12, any::<u8>()), 0..60),
    ) {
        let mut decoder = Decoder::default();
        let mut picture = decoder.decode(include_bytes!("../fixtures/qrcode.jpg")).unwrap().to_rgb();
        for (x, y, radius, shade) in dots {
            draw_filled_circle_mut(&mut picture, (x as i32, y as i32), radius, Rgb([shade; 3]));
        }
        for code in find_qrcodes(&Image::from_rgb(&picture)) {
            prop_assert!(code.text.len() < 10_000);
        }
    }
}
