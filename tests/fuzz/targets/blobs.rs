//! Arbitrary bytes as a frame: validates, decodes and searches it for blobs. However a JPEG was
//! damaged, the result is an error, or blobs that lie within the picture.
#![no_main]

use std::cell::RefCell;

use libfuzzer_sys::fuzz_target;
use spykee::vision::{
    Blob, BlobOptions, Camera, Colour, Decoder, FrameAnalyser, FrameError, MAX_HEIGHT,
    MAX_JPEG_LEN, MAX_WIDTH, Roi, Size, brightness, sharpness, validate_markers,
};

/// Number of bytes at the end of the input that select the search options; after the end of a JPEG
/// they count as padding.
const OPTION_BYTES: usize = 8;
/// Pictures of up to this many pixels are decoded a second time, by a fresh decoder.
const MAX_EXACT_PIXELS: u32 = 160 * 120;

/// A `FrameAnalyser` that has processed all earlier frames, as in a behaviour.
struct State {
    analyser: FrameAnalyser,
    frames: u64,
    sets: Vec<Vec<Colour>>,
}

thread_local! {
    static STATE: RefCell<State> = RefCell::new(State {
        analyser: FrameAnalyser::new(Camera::default()),
        frames: 0,
        sets: sets(),
    });
}

/// Returns sets of colours: one, several, and all named ones.
fn sets() -> Vec<Vec<Colour>> {
    let sets: [&[&str]; 3] = [&["red"], &["white", "black", "blue"], &Colour::NAMES];
    let named = |name: &&str| Colour::named(name).expect("a valid name");
    sets.iter()
        .map(|set| set.iter().map(named).collect())
        .collect()
}

fuzz_target!(|jpeg: &[u8]| {
    let validated = validate_markers(jpeg);
    check_validated(jpeg, &validated);
    STATE.with_borrow_mut(|state| search(state, jpeg, validated));
});

fn check_validated(jpeg: &[u8], validated: &Result<Size, FrameError>) {
    if let Ok(Size { width, height }) = validated {
        assert!(jpeg.len() <= MAX_JPEG_LEN);
        assert!((1..=MAX_WIDTH).contains(width) && (1..=MAX_HEIGHT).contains(height));
    }
}

fn search(state: &mut State, jpeg: &[u8], validated: Result<Size, FrameError>) {
    state.frames += 1;
    let size = match state.analyser.decode(state.frames, jpeg) {
        Ok(image) => image.size(),
        Err(error) => return check_refusal(error, validated),
    };
    assert_eq!(Ok(size), validated, "differs from the validated size");
    compare_with_fresh_decoder(state, jpeg, size);
    let (options, set) = search_options(jpeg);
    let colours = &state.sets[set % state.sets.len()];
    let found = state
        .analyser
        .find_blobs(state.frames, jpeg, colours, &options)
        .expect("it was decoded");
    check(found, &options, size, colours.len());
    let found = found.len();
let max = options.max_blobs;
    assert!(found <= max, "{found} blobs, at most {max} requested");
    let line = state
        .analyser
        .find_line(state.frames, jpeg, colours, options.roi)
        .expect("it was decoded");
    if let Some(line) = line {
        assert!((-1.0..=1.0).contains(&line.offset), "{line:?}");
        assert!((0.0..=1.0 + 1e-9).contains(&line.strength), "{line:?}");
    }
    let image = state
        .analyser
        .decode(state.frames, jpeg)
        .expect("it was decoded");
    assert!((0.0..=1.0).contains(&brightness(image, options.roi)));
    assert!(sharpness(image, options.roi) >= 0.0);
}

/// A frame rejected by its markers must be rejected for the same reason; a frame that they accept
/// may still be damaged.
fn check_refusal(error: FrameError, validated: Result<Size, FrameError>) {
    if let Err(reason) = validated {
        assert_eq!(error, reason);
    }
}

/// Checks that no earlier frame affects the result, by comparison with a fresh decoder.
fn compare_with_fresh_decoder(state: &mut State, jpeg: &[u8], size: Size) {
    if size.width * size.height > MAX_EXACT_PIXELS {
        return;
    }
    let mut decoder = Decoder::default();
    let fresh = decoder.decode(jpeg).expect("it was decoded").to_rgb();
    let warm = state
        .analyser
        .decode(state.frames, jpeg)
        .expect("it was decoded");
    assert!(fresh == warm.to_rgb(), "earlier frames affect the result");
}

/// Returns the search options and the number of the colour set.
fn search_options(jpeg: &[u8]) -> (BlobOptions, usize) {
    let Some((_, bytes)) = jpeg.split_last_chunk::<OPTION_BYTES>() else {
        return (BlobOptions::default(), 0);
    };
    let [x, y, w, h, flags, pixels, margin, most] = bytes.map(u32::from);
    let options = BlobOptions {
        roi: (flags & 1 != 0).then_some(Roi { x, y, w, h }),
        invert: flags & 2 != 0,
        merge: flags & 4 != 0,
        area_threshold: pixels,
        pixels_threshold: pixels,
        margin,
        max_blobs: most as usize,
    };
    (options, (flags >> 3) as usize)
}

fn check(blobs: &[Blob], options: &BlobOptions, size: Size, colours: usize) {
    let whole = Roi {
        x: 0,
        y: 0,
        w: size.width,
        h: size.height,
    };
    let part = options.roi.unwrap_or(whole).within(size);
    for blob in blobs {
        let part = part.expect("no blobs without a search area");
        check_box(blob, part);
        check_figures(blob, options, colours);
    }
    let sorted = blobs
        .windows(2)
        .all(|pair| pair[0].pixels >= pair[1].pixels);
    assert!(sorted, "not sorted by size");
}

fn check_box(blob: &Blob, part: Roi) {
    assert!(blob.w > 0 && blob.h > 0, "{blob:?}");
    assert!(blob.x >= part.x && blob.y >= part.y, "{blob:?} in {part:?}");
    let right = blob.x + blob.w;
let bottom = blob.y + blob.h;
    let inside = right <= part.x + part.w && bottom <= part.y + part.h;
    assert!(inside, "{blob:?} in {part:?}");
    let within = |centre: f64, start: u32, length: u32| {
        (f64::from(start)..=f64::from(start + length - 1)).contains(&centre)
    };
    let centred = within(blob.cx, blob.x, blob.w) && within(blob.cy, blob.y, blob.h);
    assert!(centred, "{blob:?}");
}

fn check_figures(blob: &Blob, options: &BlobOptions, colours: usize) {
    assert_eq!(blob.area, blob.w * blob.h);
    assert!((1..=blob.area).contains(&blob.pixels), "{blob:?}");
    assert!(blob.pixels >= options.pixels_threshold && blob.area >= options.area_threshold);
    assert!((1..=blob.pixels).contains(&blob.perimeter), "{blob:?}");
    assert!(
        blob.count >= 1 && (options.merge || blob.count == 1),
        "{blob:?}"
    );
    let real = [blob.density, blob.elongation, blob.roundness];
    assert!(
        real.iter().all(|real| (0.0..=1.0).contains(real)),
        "{blob:?}"
    );
    assert!(
        (0.0..=std::f64::consts::PI).contains(&blob.rotation),
        "{blob:?}"
    );
    assert!(blob.bearing.is_finite());
    if !options.invert {
        assert!(
            blob.colour < colours && blob.code & (1 << blob.colour) != 0,
            "{blob:?}"
        );
        assert_eq!(u64::from(blob.code) >> colours, 0, "{blob:?}");
    }
}
