//! Statistics of a picture or of a part of it.

use super::image::{Image, Roi};

/// Mean brightness of a part of a picture, 0 (black) to 1 (white); 0 for a part outside it.
pub fn brightness(image: &Image, roi: Option<Roi>) -> f64 {
    let Some(part) = roi.unwrap_or(image.size().into()).within(image.size()) else {
        return 0.0;
    };
    let row_sum = |row: &[u8]| row.iter().map(|value| u32::from(*value)).sum::<u32>();
    let sum: u64 = rows(image, part).map(|row| u64::from(row_sum(row))).sum();
    sum as f64 / (255.0 * f64::from(part.w) * f64::from(part.h))
}

/// The sharpness of a part of a picture: the variance of its Laplacian. It is 0 for an even
/// surface, tens for a blurred picture, and hundreds to thousands for a sharp one. Only comparable
/// between pictures of the same scene. 0 for a part smaller than 3x3.
pub fn sharpness(image: &Image, roi: Option<Roi>) -> f64 {
    let Some(part) = roi.unwrap_or(image.size().into()).within(image.size()) else {
        return 0.0;
    };
    if part.w < 3 || part.h < 3 {
        return 0.0;
    }
    let mut sum = 0i64;
    let mut squares = 0i64;
    let below = rows(image, part).skip(2);
    for ((above, here), below) in rows(image, part).zip(rows(image, part).skip(1)).zip(below) {
        let (row_sum, row_squares) = edges(above, here, below);
        sum += i64::from(row_sum);
        squares += i64::from(row_squares);
    }
    let count = f64::from(part.w - 2) * f64::from(part.h - 2);
    let mean = sum as f64 / count;
    (squares as f64 / count - mean * mean).max(0.0)
}

/// Sum and sum of squares of a row's Laplacian. At most 1,280 values below 1,021 each, so neither
/// overflows.
fn edges(above: &[u8], here: &[u8], below: &[u8]) -> (i32, i32) {
    let end = here.len() - 1;
    // Slices of provably equal length let the compiler vectorise the loop.
    let left = &here[..end - 1];
    let middle = &here[1..end];
    let right = &here[2..];
    let above = &above[1..end];
    let below = &below[1..end];
    let mut sum = 0;
    let mut squares = 0;
    for x in 0..middle
        .len()
        .min(above.len())
        .min(below.len())
        .min(left.len())
        .min(right.len())
    {
        let around = [left[x], right[x], above[x], below[x]].map(i32::from);
        let edge = 4 * i32::from(middle[x]) - around.iter().sum::<i32>();
        sum += edge;
        squares += edge * edge;
    }
    (sum, squares)
}

fn rows(image: &Image, part: Roi) -> impl Iterator<Item = &[u8]> {
    (part.y..part.y + part.h)
        .map(move |y| &image.luma_row(y)[part.x as usize..(part.x + part.w) as usize])
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{Rgb, RgbImage};

    fn stripes() -> RgbImage {
        RgbImage::from_fn(64, 48, |x, _| {
            Rgb(if x / 8 % 2 == 0 { [230; 3] } else { [30; 3] })
        })
    }

    #[test]
    fn blur_lowers_sharpness_and_an_even_surface_has_none() {
        let sharp = sharpness(&Image::from_rgb(&stripes()), None);
        let blurred = sharpness(
            &Image::from_rgb(&imageproc::filter::gaussian_blur_f32(&stripes(), 1.5)),
            None,
        );
        assert!(sharp > 4.0 * blurred && blurred > 1.0, "{sharp} {blurred}");
        let even = Image::from_rgb(&RgbImage::from_pixel(64, 48, Rgb([77; 3])));
        assert_eq!(sharpness(&even, None), 0.0);
    }

    #[test]
    fn parts_outside_and_parts_too_small_have_none() {
        let image = Image::from_rgb(&stripes());
        for roi in [
            Roi {
                x: 64,
                y: 0,
                w: 9,
                h: 9,
            },
            Roi {
                x: 62,
                y: 0,
                w: 9,
                h: 9,
            },
            Roi {
                x: 0,
                y: 0,
                w: 2,
                h: 9,
            },
        ] {
            assert_eq!(sharpness(&image, Some(roi)), 0.0);
        }
        assert_eq!(
            brightness(
                &image,
                Some(Roi {
                    x: 64,
                    y: 0,
                    w: 9,
                    h: 9
                })
            ),
            0.0
        );
        let bright = brightness(
            &image,
            Some(Roi {
                x: 0,
                y: 0,
                w: 8,
                h: 9,
            }),
        );
        assert!((bright - 230.0 / 255.0).abs() < 1e-9);
    }
}
