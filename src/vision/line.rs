//! Finds the line on the floor that a robot should follow.

use super::blobs::{BlobFinder, BlobOptions};
use super::camera::Camera;
use crate::vision::colour::palette::Palette;
use crate::vision::picture::{Image, Roi};

/// A line, as needed for steering.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Line {
    /// Position of the line's centre: -1 at the left border of the searched part, 1 at the right
    /// border.
    pub offset: f64,
    /// Direction of the line in radians, -pi/2..=pi/2: 0 is straight ahead, positive leads to the
    /// left.
    pub angle: f64,
    /// How much it resembles a line across the whole searched part, 0..1.
    pub strength: f64,
}

impl Line {
    /// The line as a camera without roll would show its direction; roll in degrees, positive when
    /// the horizon falls to the right.
    pub(super) fn levelled(self, roll: f64) -> Line {
        use std::f64::consts::{FRAC_PI_2, PI};
        if roll == 0.0 {
            return self;
        }
        let angle = self.angle + roll.to_radians();
        Line {
            angle: (angle + FRAC_PI_2).rem_euclid(PI) - FRAC_PI_2,
            ..self
        }
    }
}

/// Returns the line formed by the largest blob of the palette's colours in a part of the picture;
/// `None` if there is none.
pub fn find_line(
    finder: &mut BlobFinder,
    image: &Image,
    palette: &mut Palette,
    roi: Option<Roi>,
) -> Option<Line> {
    let part = roi.unwrap_or(image.size().into()).within(image.size())?;
    let options = BlobOptions {
        roi: Some(part),
        max_blobs: 1,
        ..BlobOptions::default()
    };
    let blob = *finder
        .find(image, palette, &options, Camera::default())
        .first()?;
    let half = f64::from(part.w) / 2.0;
    let length = (f64::from(blob.w) / f64::from(part.w)).max(f64::from(blob.h) / f64::from(part.h));
    Some(Line {
        offset: ((blob.cx + 0.5 - f64::from(part.x)) / half - 1.0).clamp(-1.0, 1.0),
        angle: std::f64::consts::FRAC_PI_2 - blob.rotation,
        strength: blob.elongation * length,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::Colour;
    use image::{Rgb, RgbImage};
    use imageproc::drawing::draw_polygon_mut;
    use imageproc::point::Point;

    /// A black tape 16 pixels wide, from this column at the bottom to this one at the top.
    fn tape(bottom: i32, top: i32) -> Image {
        let mut picture = RgbImage::from_pixel(320, 240, Rgb([180, 175, 170]));
        let corners = [
            (bottom - 8, 239),
            (bottom + 8, 239),
            (top + 8, 0),
            (top - 8, 0),
        ]
        .map(|(x, y)| Point::new(x, y));
        draw_polygon_mut(&mut picture, &corners, Rgb([15, 15, 15]));
        Image::from_rgb(&picture)
    }

    fn line(image: &Image, roi: Option<Roi>) -> Option<Line> {
        let mut palette = Palette::compile(&[Colour::named("black").unwrap()], false);
        find_line(&mut BlobFinder::default(), image, &mut palette, roi)
    }

    #[test]
    fn a_line_straight_ahead_needs_no_steering() {
        let found = line(&tape(160, 160), None).unwrap();
        assert!(
            found.offset.abs() < 0.01 && found.angle.abs() < 0.01 && found.strength > 0.95,
            "{found:?}"
        );
    }

    #[test]
    fn a_line_that_leads_left_has_a_positive_angle() {
        let left = line(&tape(160, 60), None).unwrap();
        assert!(
            (left.angle - (100.0_f64 / 240.0).atan()).abs() < 0.03,
            "{left:?}"
        );
        let right = line(&tape(160, 260), None).unwrap();
        assert!(
            (left.angle + right.angle).abs() < 0.02 && (left.offset + right.offset).abs() < 0.02
        );
    }

    #[test]
    fn a_line_straight_ahead_is_so_for_a_tilted_camera_too() {
        // With a roll of 8 degrees everything leans to the right.
        let top = 160.0 + 240.0 * 8.0_f64.to_radians().tan();
        let leans = line(&tape(160, top as i32), None).unwrap();
        assert!(leans.angle < -0.1, "{leans:?}");
        let level = leans.levelled(8.0);
        assert!(level.angle.abs() < 0.02, "{level:?}");
        let across = Line {
            angle: 1.5,
            ..leans
        };
        assert!(across.levelled(8.0).angle < -1.4);
    }

    #[test]
    fn the_offset_is_relative_to_the_searched_part() {
        assert!(line(&tape(300, 300), None).unwrap().offset > 0.8);
        let part = Roi {
            x: 240,
            y: 120,
            w: 120,
            h: 120,
        };
        assert!((line(&tape(280, 280), Some(part)).unwrap().offset).abs() < 0.03);
        assert_eq!(line(&tape(280, 280), Some(Roi { x: 0, ..part })), None);
    }

    #[test]
    fn a_patch_is_a_weak_line() {
        let mut picture = RgbImage::from_pixel(320, 240, Rgb([180, 175, 170]));
        imageproc::drawing::draw_filled_circle_mut(&mut picture, (160, 120), 20, Rgb([15, 15, 15]));
        assert!(line(&Image::from_rgb(&picture), None).unwrap().strength < 0.1);
    }
}
