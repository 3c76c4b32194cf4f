//! Learns a colour from pictures of it, as a range of hues: the amount of light on an object
//! changes its value and slightly its saturation, but hardly its hue.

use thiserror::Error;

use super::Colour;
use crate::picture::{Image, Roi, Size, hsv_of};

/// Least saturation and value, in percent, of a pixel with a usable hue.
const LEAST_SATURATION: f64 = 22.0;
const LEAST_VALUE: f64 = 12.0;
/// Least share of the pixels that must have a hue, and of those that must agree on it.
const LEAST_COLOURED: f64 = 0.5;
const LEAST_AGREEING: f64 = 0.6;
/// Hues up to this far from the most common one, in degrees, agree with it.
const AGREEMENT: f64 = 22.0;
/// Widening beyond what was seen: hue in degrees, saturation in percent; the value may fall to this
/// share of the darkest seen.
const HUE_MARGIN: f64 = 9.0;
const SATURATION_MARGIN: f64 = 14.0;
const VALUE_SHARE: f64 = 0.4;
const MAX_SAMPLES: u32 = 20_000;

/// A colour learned from pictures.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Learned {
    /// The learned colour.
    pub colour: Colour,
    /// 0..1: the share of the part that has the colour, times the share of the surroundings that
    /// does not.
    pub quality: f64,
}

/// Why no colour could be learned.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum LearnRefusal {
    /// Too few pixels have a hue: grey, white, black, or too dark.
    #[error(
        "too grey: most of the part has no hue, so its colour cannot distinguish it from its surroundings"
    )]
    TooGrey,
    /// The pixels do not agree on a hue.
    #[error("too mixed: the part shows several colours; choose a smaller part inside the object")]
    TooMixed,
}

impl LearnRefusal {
    /// The code that scripts receive: `too_grey` or `too_mixed`.
    pub fn code(self) -> &'static str {
        match self {
            LearnRefusal::TooGrey => "too_grey",
            LearnRefusal::TooMixed => "too_mixed",
        }
    }
}

/// Learns the colour that fills the part `roi` of all these pictures. Pictures in different light
/// make it more reliable; pictures without this part are ignored. Refuses grey objects and
/// mixtures of colours.
pub fn learn(images: &[&Image], roi: Roi) -> Result<Learned, LearnRefusal> {
    let samples: Vec<[f64; 3]> = images
        .iter()
        .flat_map(|image| samples(image, roi))
        .collect();
    let coloured: Vec<[f64; 3]> = samples.iter().copied().filter(has_hue).collect();
    if samples.is_empty() || (coloured.len() as f64) < LEAST_COLOURED * samples.len() as f64 {
        return Err(LearnRefusal::TooGrey);
    }
    let hue = commonest_hue(&coloured);
    let agreeing: Vec<[f64; 3]> = coloured
        .iter()
        .copied()
        .filter(|hsv| turn(hue, hsv[0]).abs() <= AGREEMENT)
        .collect();
    if (agreeing.len() as f64) < LEAST_AGREEING * coloured.len() as f64 {
        return Err(LearnRefusal::TooMixed);
    }
    let colour = widened(hue, &agreeing).ok_or(LearnRefusal::TooGrey)?;
    Ok(Learned {
        colour,
        quality: quality(&colour, images, roi),
    })
}

fn has_hue(hsv: &[f64; 3]) -> bool {
    hsv[1] >= LEAST_SATURATION && hsv[2] >= LEAST_VALUE
}

/// The signed shortest angle from one hue to another, -180..180 degrees.
fn turn(from: f64, to: f64) -> f64 {
    (to - from + 180.0).rem_euclid(360.0) - 180.0
}

/// HSV values of the pixels of a part, evenly subsampled if there are many.
fn samples(image: &Image, roi: Roi) -> Vec<[f64; 3]> {
    grid(image.size(), roi)
        .filter_map(|(x, y)| image.pixel(x, y))
        .map(|rgb| hsv_of(rgb.map(f64::from)))
        .collect()
}

fn grid(size: Size, roi: Roi) -> impl Iterator<Item = (u32, u32)> {
    let part = roi.within(size).unwrap_or_default();
    let step = (f64::from(part.w) * f64::from(part.h) / f64::from(MAX_SAMPLES))
        .sqrt()
        .ceil()
        .max(1.0) as usize;
    let columns = move || (part.x..part.x + part.w).step_by(step);
    (part.y..part.y + part.h)
        .step_by(step)
        .flat_map(move |y| columns().map(move |x| (x, y)))
}

/// The centre of the 15 degrees of hue with the most pixels.
fn commonest_hue(samples: &[[f64; 3]]) -> f64 {
    const BINS: usize = 72;
    let mut counts = [0usize; BINS];
    for hsv in samples {
        counts[(hsv[0] / 5.0) as usize % BINS] += 1;
    }
    let around =
        |bin: usize| counts[(bin + BINS - 1) % BINS] + counts[bin] + counts[(bin + 1) % BINS];
    let best = (0..BINS).max_by_key(|bin| around(*bin)).unwrap_or(0);
    best as f64 * 5.0 + 2.5
}

/// The range of the samples without outliers, widened for other lighting.
fn widened(hue: f64, samples: &[[f64; 3]]) -> Option<Colour> {
    let (low, high) = middle(samples.iter().map(|hsv| turn(hue, hsv[0])))?;
    let (saturation, _) = middle(samples.iter().map(|hsv| hsv[1]))?;
    let (value, _) = middle(samples.iter().map(|hsv| hsv[2]))?;
    let angle = |offset: f64| (hue + offset).rem_euclid(360.0).round();
    let least = (saturation - SATURATION_MARGIN)
        .max(LEAST_SATURATION)
        .floor();
    let darkest = (value * VALUE_SHARE).max(LEAST_VALUE).floor();
    let hues = [angle(low - HUE_MARGIN), angle(high + HUE_MARGIN)];
    Colour::hsv(hues, [least, 100.0], [darkest, 100.0]).ok()
}

/// The central 95 % of the values: the quantiles 0.025 and 0.975.
fn middle(values: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
    let mut values: Vec<f64> = values.collect();
    values.sort_unstable_by(f64::total_cmp);
    let last = values.len().checked_sub(1)?;
    let at = |share: f64| values[(last as f64 * share).round() as usize];
    Some((at(0.025), at(0.975)))
}

/// How well the colour separates the part from the picture beyond its neighbourhood.
fn quality(colour: &Colour, images: &[&Image], roi: Roi) -> f64 {
    let near = Roi {
        x: roi.x.saturating_sub(roi.w),
        y: roi.y.saturating_sub(roi.h),
        w: roi.w.saturating_mul(3),
        h: roi.h.saturating_mul(3),
    };
    let has = |part: Roi, x: u32, y: u32| {
        (part.x..part.x.saturating_add(part.w)).contains(&x)
            && (part.y..part.y.saturating_add(part.h)).contains(&y)
    };
    // How many pixels do not have the colour, and how many have it.
    let mut inside = [0u32; 2];
    let mut outside = [0u32; 2];
    for image in images {
        for (x, y) in grid(image.size(), image.size().into()).chain(grid(image.size(), roi)) {
            let Some(rgb) = image.pixel(x, y) else {
                continue;
            };
            if has(roi, x, y) {
                inside[usize::from(colour.contains(rgb))] += 1;
            } else if !has(near, x, y) {
                outside[usize::from(colour.contains(rgb))] += 1;
            }
        }
    }
    let share = |[without, with]: [u32; 2]| f64::from(with) / f64::from((without + with).max(1));
    share(inside) * (1.0 - share(outside))
}

#[cfg(test)]
mod tests {
    use image::{Rgb, RgbImage};
    use imageproc::drawing::draw_filled_circle_mut;

    use super::*;
    use crate::{BlobFinder, BlobOptions, Camera, Palette};

    /// Colour of the light, as factors of red, green and blue: daylight, a warm bulb, a dim room.
    const LIGHTS: [[f64; 3]; 3] = [[1.0, 1.0, 1.0], [1.0, 0.86, 0.68], [0.5, 0.5, 0.55]];
    const PART: Roi = Roi {
        x: 90,
        y: 90,
        w: 24,
        h: 24,
    };

    /// A shaded ball at (100, 100) in a room with a wooden floor, in this light, with deterministic
    /// noise.
    fn scene(ball: [u8; 3], light: [f64; 3]) -> Image {
        let mut picture = RgbImage::from_fn(320, 240, |_, y| {
            Rgb(if y < 120 {
                [190, 188, 180]
            } else {
                [140, 115, 90]
            })
        });
        draw_filled_circle_mut(&mut picture, (100, 100), 30, Rgb(ball));
        let mut state = 1u32;
        for (x, y, pixel) in picture.enumerate_pixels_mut() {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let noise = f64::from(state >> 28) - 8.0;
            let shade = 1.0 - (f64::from(x).hypot(f64::from(y)) / 2000.0);
            for (value, light) in pixel.0.iter_mut().zip(light) {
                *value = (f64::from(*value) * light * shade + noise).clamp(0.0, 255.0) as u8;
            }
        }
        Image::from_rgb(&picture)
    }

    fn is_found(colour: Colour, image: &Image) -> bool {
        let mut palette = Palette::compile(&[colour], false);
        let mut finder = BlobFinder::default();
        let blobs = finder.find(
            image,
            &mut palette,
            &BlobOptions::default(),
            Camera::default(),
        );
        blobs.first().is_some_and(|blob| {
            (blob.cx - 100.0).abs() < 2.0 && (blob.cy - 100.0).abs() < 2.0 && blob.pixels > 2400
        })
    }

    const BALLS: [[u8; 3]; 5] = [
        [205, 30, 35],
        [230, 120, 20],
        [30, 150, 60],
        [30, 60, 190],
        [200, 190, 30],
    ];

    #[test]
    fn a_colour_learned_under_three_lights_is_found_under_each() {
        for ball in BALLS {
            let scenes = LIGHTS.map(|light| scene(ball, light));
            let learned = learn(&scenes.each_ref(), PART).unwrap();
            assert!(learned.quality > 0.9, "{ball:?}: {learned:?}");
            for (light, image) in LIGHTS.iter().zip(&scenes) {
                assert!(
                    is_found(learned.colour, image),
                    "{ball:?} under {light:?} by {}",
                    learned.colour
                );
            }
        }
    }

    #[test]
    fn a_colour_learned_in_daylight_is_found_in_a_dim_room() {
        for ball in BALLS {
            let learned = learn(&[&scene(ball, LIGHTS[0])], PART).unwrap();
            assert!(
                is_found(learned.colour, &scene(ball, LIGHTS[2])),
                "{ball:?} by {}",
                learned.colour
            );
        }
    }

    #[test]
    fn grey_is_refused_with_its_reason() {
        for ball in [[120, 120, 120], [250, 250, 250], [12, 10, 11]] {
            let refusal = learn(&[&scene(ball, LIGHTS[0])], PART).unwrap_err();
            assert_eq!(refusal.code(), "too_grey", "{ball:?}");
        }
        assert_eq!(learn(&[], PART), Err(LearnRefusal::TooGrey));
        let outside = Roi { x: 900, ..PART };
        assert_eq!(
            learn(&[&scene(BALLS[0], LIGHTS[0])], outside),
            Err(LearnRefusal::TooGrey)
        );
    }
}
