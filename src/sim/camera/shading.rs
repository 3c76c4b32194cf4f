//! Shading: colours and light of rendered things.

use super::light::Light;
use super::scene::RoundKind;
use super::surface::{Rgb, scaled};
use super::texture::Pixel;

/// The value of a light channel that means full light.
const FULL: f32 = 128.0;

/// Converts light to its pixel representation.
pub(super) fn light(light: Light) -> Pixel {
    let [r, g, b] = light.map(|channel| (channel * FULL) as u8);
    [r, g, b, 0]
}

/// Returns the colour of a post or a person at a height; `aside` is the horizontal offset from the
/// middle as a share of the radius, and `shine` is the lamp's specular reflection.
pub(super) fn pillar(kind: RoundKind, paint: Rgb, height: f32, aside: f32, shine: f32) -> Rgb {
    match kind {
        RoundKind::Person { top } => clothes(paint, height / top, aside),
        RoundKind::Post { top } => {
            let foot = 0.7 + 0.3 * (height / 0.06).clamp(0.0, 1.0);
            let cap = if top - height < 0.02 { 1.15 } else { 1.0 };
            scaled(paint, foot * cap).map(|channel| channel + shine)
        }
        RoundKind::Ball => paint,
    }
}

/// Returns the colour of a ball where its surface normal is `normal`; `lamp` is the direction of
/// the lamp.
pub(super) fn ball(paint: Rgb, normal: Rgb, lamp: Rgb) -> Rgb {
    let facing = dot(normal, lamp);
    let lit = facing.max(0.0);
    let lit4 = lit * lit * lit * lit;
    let lit8 = lit * lit * lit * lit * lit * lit * lit * lit;
    let shine = lit4 * lit4 * lit8 * lit8 * 90.0;
    let body = scaled(paint, 0.50 + 0.28 * (facing + 1.0) * 0.5 + 0.34 * lit);
    body.map(|channel| channel + shine)
}

/// Returns the colour of a person, clothes included, at a share of their height.
fn clothes(paint: Rgb, share: f32, aside: f32) -> Rgb {
    match share {
        _ if share < 0.05 => [40.0, 36.0, 34.0],
        _ if share < 0.45 && aside.abs() < 0.08 => [38.0, 40.0, 46.0],
        _ if share < 0.45 => scaled(paint, 0.62),
        _ if share < 0.82 => paint,
        _ if share > 0.95 => [70.0, 56.0, 44.0],
        _ => [186.0, 158.0, 140.0],
    }
}

/// Returns the surface normal of a sphere where a ray from the origin hits it; `None` if it misses.
pub(super) fn sphere_normal(ray: Rgb, middle: Rgb, radius: f32) -> Option<Rgb> {
    let a = dot(ray, ray);
    let b = dot(ray, middle);
    let under = b * b - a * (dot(middle, middle) - radius * radius);
    if under < 0.0 {
        return None;
    }
    let depth = (b - under.sqrt()) / a;
    Some(std::array::from_fn(|i| {
        (depth * ray[i] - middle[i]) / radius
    }))
}

/// Normalizes a vector to length 1.
pub(super) fn direction(way: Rgb) -> Rgb {
    scaled(way, 1.0 / dot(way, way).sqrt().max(1e-3))
}

fn dot(a: Rgb, b: Rgb) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
