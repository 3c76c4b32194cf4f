//! Conversions between sRGB and other colour spaces.

/// Hue in degrees 0..360, saturation and value in percent, of sRGB values 0..255. Greys have hue 0.
pub(crate) fn hsv_of([r, g, b]: [f64; 3]) -> [f64; 3] {
    let max = r.max(g).max(b);
    let chroma = max - r.min(g).min(b);
    if chroma == 0.0 {
        return [0.0, 0.0, max / 2.55];
    }
    let sixth = if max == r {
        ((g - b) / chroma).rem_euclid(6.0)
    } else if max == g {
        (b - r) / chroma + 2.0
    } else {
        (r - g) / chroma + 4.0
    };
    [sixth * 60.0, chroma / max * 100.0, max / 2.55]
}

/// CIE Lab under D65 of sRGB values 0..255: L 0..100, a and b about -128..127.
pub(crate) fn lab_of(rgb: [f64; 3]) -> [f64; 3] {
    lab_of_linear(rgb.map(linear))
}

/// Linear light of an sRGB value 0..255, in 0..1.
pub(crate) fn linear(value: f64) -> f64 {
    let value = value / 255.0;
    if value <= 0.04045 {
        value / 12.92
    } else {
        ((value + 0.055) / 1.055).powf(2.4)
    }
}

/// CIE Lab of linear light: sRGB primaries, white D65.
pub(crate) fn lab_of_linear([r, g, b]: [f64; 3]) -> [f64; 3] {
    let x = (0.412_456_4 * r + 0.357_576_1 * g + 0.180_437_5 * b) / 0.950_47;
    let y = 0.212_672_9 * r + 0.715_152_2 * g + 0.072_175_0 * b;
    let z = (0.019_333_9 * r + 0.119_192_0 * g + 0.950_304_1 * b) / 1.088_83;
    let [fx, fy, fz] = [x, y, z].map(lightness_curve);
    [116.0 * fy - 16.0, 500.0 * (fx - fy), 200.0 * (fy - fz)]
}

fn lightness_curve(t: f64) -> f64 {
    const KNEE: f64 = 216.0 / 24_389.0;
    if t > KNEE {
        t.cbrt()
    } else {
        (24_389.0 / 27.0 * t + 16.0) / 116.0
    }
}

/// Luma, Cb and Cr (0..255) of a pixel, as in JPEG (JFIF, full range).
pub(crate) fn ycc_of(rgb: [u8; 3]) -> [u8; 3] {
    let [r, g, b] = rgb.map(i32::from);
    let luma = 19_595 * r + 38_470 * g + 7_471 * b;
    let cb = -11_058 * r - 21_710 * g + 32_768 * b + (128 << 16);
    let cr = 32_768 * r - 27_439 * g - 5_329 * b + (128 << 16);
    [luma, cb, cr].map(|value| ((value + 32_768) >> 16).clamp(0, 255) as u8)
}

/// Red, green and blue (0..=255) of luma, Cb and Cr.
pub(crate) fn rgb_of([luma, cb, cr]: [u8; 3]) -> [i32; 3] {
    let luma = i32::from(luma) << 16;
    let cb = i32::from(cb) - 128;
    let cr = i32::from(cr) - 128;
    [
        luma + 91_881 * cr,
        luma - 22_554 * cb - 46_802 * cr,
        luma + 116_130 * cb,
    ]
    .map(|value| ((value + 32_768) >> 16).clamp(0, 255))
}

/// Like [`rgb_of`], for fractional values.
pub(crate) fn rgb_of_ycc([luma, cb, cr]: [f64; 3]) -> [f64; 3] {
    let cb = cb - 128.0;
    let cr = cr - 128.0;
    [
        luma + 1.402 * cr,
        luma - 0.344_136 * cb - 0.714_136 * cr,
        luma + 1.772 * cb,
    ]
    .map(|value| value.clamp(0.0, 255.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(found: [f64; 3], expected: [f64; 3]) {
        let far = found
            .iter()
            .zip(expected)
            .any(|(f, e)| (f - e).abs() > 0.02);
        assert!(!far, "{found:?} is not {expected:?}");
    }

    #[test]
    fn known_colours_have_their_known_lab() {
        near(lab_of([255.0, 255.0, 255.0]), [100.0, 0.0, 0.0]);
        near(lab_of([0.0, 0.0, 0.0]), [0.0, 0.0, 0.0]);
        near(lab_of([255.0, 0.0, 0.0]), [53.24, 80.09, 67.20]);
        near(lab_of([0.0, 0.0, 255.0]), [32.30, 79.19, -107.86]);
    }

    #[test]
    fn colours_survive_the_round_trip_through_luma_cb_and_cr() {
        for step in 0..4096u32 {
            let rgb = [step >> 8, step >> 4 & 15, step & 15].map(|value| (value * 17) as u8);
            let back = rgb_of(ycc_of(rgb));
            assert!(
                rgb.iter()
                    .zip(back)
                    .all(|(a, b)| i32::from(*a).abs_diff(b) <= 2),
                "{rgb:?} {back:?}"
            );
        }
        assert_eq!(ycc_of([255, 0, 0]), [76, 85, 255]);
        assert_eq!(rgb_of([76, 85, 255]).map(|value| value as u8), [254, 0, 0]);
    }

    #[test]
    fn known_colours_have_their_known_hsv() {
        near(hsv_of([255.0, 0.0, 0.0]), [0.0, 100.0, 100.0]);
        near(hsv_of([255.0, 0.0, 1.0]), [359.76, 100.0, 100.0]);
        near(hsv_of([0.0, 255.0, 255.0]), [180.0, 100.0, 100.0]);
        near(hsv_of([51.0, 51.0, 51.0]), [0.0, 0.0, 20.0]);
    }
}
