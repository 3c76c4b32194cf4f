//! Measures how far a picture has shifted sideways, assuming that it changed in no other way.

use super::profiles::Profiles;

/// The shift of the picture to the right in half-size pixels, searched within `least..=most` and
/// assuming that the camera only turned.
pub fn swayed(before: &Profiles, now: &Profiles, least: isize, most: isize) -> isize {
    let difference = |by: isize| {
        let bands = before.bands.iter().zip(&now.bands);
        bands
            .map(|(before, now)| shifted_difference(before, now, by))
            .sum::<f32>()
    };
    let farthest = now.width() as isize / 2;
    let all = (least.max(-farthest)..=most.min(farthest)).map(|by| (by, difference(by)));
    let best = all.min_by(|one, other| one.1.total_cmp(&other.1));
    best.map_or(0, |(by, _)| by)
}

/// The mean absolute difference of two rows if the second is shifted to the right by `by` samples.
fn shifted_difference(before: &[f32], now: &[f32], by: isize) -> f32 {
    let (before, now) = match usize::try_from(by) {
        Ok(by) => (before, now.get(by..).unwrap_or_default()),
        Err(_) => (before.get(by.unsigned_abs()..).unwrap_or_default(), now),
    };
    let count = before.len().min(now.len()).max(1) as f32;
    let sum: f32 = before
        .iter()
        .zip(now)
        .map(|(one, other)| (one - other).abs())
        .sum();
    sum / count
}
