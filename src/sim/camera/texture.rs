//! Textures of surfaces, painted on first use, with mipmap levels so that distant things do not
//! flicker.

use super::surface::Rgb;

/// Red, green, blue and an unused byte, 0..=255.
pub(crate) type Pixel = [u8; 4];

/// A texture in full size and in repeatedly halved sizes.
#[derive(Debug)]
pub(crate) struct Texture {
    levels: Vec<Level>,
}

/// One mipmap level. Pixels that are neighbours along the second axis are neighbours in memory.
#[derive(Debug)]
pub(crate) struct Level {
    first: usize,
    second: usize,
    /// Pixels per metre along each axis.
    pub(crate) scale: [f32; 2],
    pixels: Vec<Pixel>,
}

impl Texture {
    /// Paints the texture of a surface with side lengths `sides`, in metres, and pixels of about
    /// `size` metres. For a place on the first axis, `strip` returns the function of the colours
    /// along the second one.
    pub(crate) fn paint<C: Fn(f32) -> Rgb>(
        sides: [f32; 2],
        size: f32,
        strip: impl Fn(f32) -> C,
    ) -> Texture {
        let count = sides.map(|side| ((side / size).ceil() as usize).max(1));
        let scale = [count[0] as f32 / sides[0], count[1] as f32 / sides[1]];
        let place = |i: usize, axis: usize| (i as f32 + 0.5) / scale[axis];
        let mut pixels = Vec::with_capacity(count[0] * count[1]);
        for first in 0..count[0] {
            let colour = strip(place(first, 0));
            let colours = (0..count[1]).map(|second| colour(place(second, 1)));
            pixels.extend(colours.map(|[r, g, b]| [r as u8, g as u8, b as u8, 0]));
        }
        Texture::new(pixels, count, scale)
    }

    pub(crate) fn new(pixels: Vec<Pixel>, [first, second]: [usize; 2], scale: [f32; 2]) -> Texture {
        let full = Level {
            first,
            second,
            scale,
            pixels,
        };
        let halves = std::iter::successors(Some(full), |level| {
            if level.first <= 8 || level.second <= 8 {
                return None;
            }
            Some(level.half())
        });
        Texture {
            levels: halves.take(6).collect(),
        }
    }

    /// Returns the level whose pixels are about as large as a camera pixel, `size` metres.
    pub(crate) fn level(&self, size: f32) -> &Level {
        let mut level = &self.levels[0];
        for smaller in &self.levels[1..] {
            if size * smaller.scale[1] < 1.0 {
                break;
            }
            level = smaller;
        }
        level
    }
}

impl Level {
    fn half(&self) -> Level {
        let first = self.first / 2;
        let second = self.second / 2;
        let at = |i: usize, j: usize| self.pixels[i * self.second + j];
        let mean = |index: usize| {
            let i = index / second * 2;
            let j = index % second * 2;
            let four = [at(i, j), at(i + 1, j), at(i, j + 1), at(i + 1, j + 1)];
            std::array::from_fn(|c| (four.iter().map(|p| u16::from(p[c])).sum::<u16>() / 4) as u8)
        };
        Level {
            first,
            second,
            scale: [
                self.scale[0] * first as f32 / self.first as f32,
                self.scale[1] * second as f32 / self.second as f32,
            ],
            pixels: (0..first * second).map(mean).collect(),
        }
    }

    /// Returns the pixels along the second axis at a place on the first.
    pub(crate) fn strip(&self, place: f32) -> &[Pixel] {
        let first = ((place * self.scale[0]) as usize).min(self.first - 1);
        &self.pixels[first * self.second..][..self.second]
    }

    /// Returns the bilinearly interpolated colour at a place, in 256ths of a pixel; beyond the
    /// edge, the colour of the edge.
    pub(crate) fn smooth(&self, first: i32, second: i32) -> Pixel {
        let first = first.max(0) as usize;
        let second = second.max(0) as usize;
        let last_i = self.first - 1;
        let last_j = self.second - 1;
        let i = (first >> 8).min(last_i);
        let j = (second >> 8).min(last_j);
        let near = i * self.second;
        let far = (i + 1).min(last_i) * self.second;
        let after = (j + 1).min(last_j);
        let at = |index: usize| u32::from_le_bytes(self.pixels[index]);
        let di = (first & 255) as u32;
        let dj = (second & 255) as u32;
        let near = mix(at(near + j), at(near + after), dj);
        let far = mix(at(far + j), at(far + after), dj);
        mix(near, far, di).to_le_bytes()
    }
}

/// Mask of every other byte, to compute two channels at once.
const EVEN: u32 = 0x00FF_00FF;

/// Like [`between`], for packed pixels.
fn mix(a: u32, b: u32, share: u32) -> u32 {
    let rest = 256 - share;
    // Of 256 shares of a byte each, nothing overflows; the checks would take most of the time in tests.
    let two = |a: u32, b: u32| {
        let a = (a & EVEN).wrapping_mul(rest);
        a.wrapping_add((b & EVEN).wrapping_mul(share))
    };
    ((two(a, b) >> 8) & EVEN) | (two(a >> 8, b >> 8) & !EVEN)
}

/// Blends two pixels; `share` is the weight of the second, in 256ths.
pub(crate) fn between(a: Pixel, b: Pixel, share: u32) -> Pixel {
    mix(u32::from_le_bytes(a), u32::from_le_bytes(b), share).to_le_bytes()
}

/// Multiplies a pixel by light, of which 128 is full; the result saturates at white.
pub(crate) fn lit(pixel: Pixel, light: Pixel) -> Pixel {
    let [r, g, b, _] = light;
    if r != g || g != b {
        return std::array::from_fn(|i| {
            ((u16::from(pixel[i]) * u16::from(light[i])) >> 7).min(255) as u8
        });
    }
    let pixel = u32::from_le_bytes(pixel);
    let light = u32::from(r);
    if light <= 128 {
        let even = (pixel & EVEN) * light;
        let odd = ((pixel >> 8) & EVEN) * light;
        return (((even >> 7) & EVEN) | ((odd << 1) & !EVEN)).to_le_bytes();
    }
    let two = |channels: u32| {
        let lit = ((channels * light) >> 7) & 0x01FF_01FF;
        let over = (lit >> 8) & 0x0001_0001;
        (lit | (over * 255)) & EVEN
    };
    (two(pixel & EVEN) | (two((pixel >> 8) & EVEN) << 8)).to_le_bytes()
}

/// Applies a moving average over `length` pixels to a row.
pub(crate) fn motion_blur(row: &mut [Pixel], length: usize, sums: &mut Vec<u64>) {
    // Sixteen bits for each channel are enough for 256 pixels.
    const EVEN_SUMS: u64 = 0x0000_FFFF_0000_FFFF;
    const LOW_BYTES: u64 = 0x0000_00FF_0000_00FF;
    const HALF: u64 = 0x0000_8000_0000_8000;
    let length = length.clamp(1, 255);
    let spread = |pixel: Pixel| {
        let pixel = u64::from(u32::from_le_bytes(pixel));
        let pairs = (pixel | (pixel << 16)) & EVEN_SUMS;
        (pairs | (pairs << 8)) & 0x00FF_00FF_00FF_00FF
    };
    let (Some(first), Some(last)) = (row.first(), row.last()) else {
        return;
    };
    let before = length / 2;
    sums.clear();
    sums.extend(std::iter::repeat_n(spread(*first), before));
    sums.extend(row.iter().map(|pixel| spread(*pixel)));
    sums.extend(std::iter::repeat_n(spread(*last), length - before));
    let mut sum: u64 = sums[..length].iter().sum();
    let share = 65_536 / length as u64;
    for (index, pixel) in row.iter_mut().enumerate() {
        let even = (((sum & EVEN_SUMS) * share + HALF) >> 16) & LOW_BYTES;
        let odd = ((((sum >> 16) & EVEN_SUMS) * share + HALF) >> 16) & LOW_BYTES;
        let together = even | (odd << 8);
        *pixel = ((together | (together >> 16)) as u32).to_le_bytes();
        sum = sum + sums[index + length] - sums[index];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_are_interpolated_and_clamped_at_the_edge() {
        let texture = Texture::paint([2.0, 2.0], 0.1, |_| {
            |y| [if y < 1.0 { 0.0 } else { 200.0 }; 3]
        });
        let level = texture.level(0.0);
        assert_eq!(level.smooth(5 * 256, 3 * 256)[0], 0);
        assert_eq!(level.smooth(5 * 256, 9 * 256 + 128)[0], 100);
        assert_eq!(level.smooth(5 * 256, 15 * 256)[..3], [200; 3]);
        assert_eq!(level.smooth(i32::MAX, i32::MAX)[0], 200);
        assert_eq!(level.smooth(i32::MIN, i32::MIN)[0], 0);
    }

    #[test]
    fn white_light_and_coloured_light_agree() {
        for level in [0, 1, 77, 128, 200, 255] {
            let pixel = [3, 128, 255, 0];
            let expected = pixel
                .map(|channel: u8| ((u32::from(channel) * u32::from(level)) >> 7).min(255) as u8);
            assert_eq!(lit(pixel, [level; 4])[..3], expected[..3], "{level}");
        }
        assert_eq!(lit([100; 4], [128, 64, 255, 0])[..3], [100, 50, 199]);
    }

    #[test]
    fn a_blurred_row_is_a_moving_average_that_keeps_its_ends() {
        let mut row = [[10, 20, 30, 0]; 40];
        row[20] = [250, 20, 0, 0];
        let mut blurred = row;
        motion_blur(&mut blurred, 4, &mut Vec::new());
        assert_eq!((blurred[0], blurred[39]), (row[0], row[39]));
        let changed = blurred
            .iter()
            .filter(|pixel| **pixel == [70, 20, 23, 0])
            .count();
        assert_eq!(changed, 4, "{blurred:?}");
        let mut same = row;
        motion_blur(&mut same, 1, &mut Vec::new());
        assert_eq!(same, row);
    }

    #[test]
    fn distant_fine_lines_are_averaged() {
        let texture = Texture::paint([1.0, 1.0], 0.01, |x: f32| {
            let shade = if (x * 100.0) as i32 % 2 == 0 {
                0.0
            } else {
                200.0
            };
            move |_| [shade; 3]
        });
        assert_eq!(texture.level(0.02).strip(0.5)[10][0], 100);
        assert_ne!(texture.level(0.005).strip(0.5)[10][0], 100);
    }
}
