//! Determines the field of view from pictures of one object of known width, such as the charging
//! station, each taken from a known distance straight in front of it. The distortion cannot be
//! determined this way: the given one is assumed.

use crate::vision::{Camera, Size};

/// Least number of pictures.
const FEWEST: usize = 2;
/// Plausible fields of view of a lens, radians.
const FIELDS_OF_VIEW: std::ops::RangeInclusive<f64> = 0.1..=3.0;
/// Largest standard deviation of the pictures' results, as a share of the field of view.
const MAX_APART: f64 = 0.04;
const HALVINGS: u32 = 60;

/// An object as seen in a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measure {
    /// Distance from the lens to the object's front, metres.
    pub distance: f64,
    /// Columns of its left and right edge, pixels; the centre of the first column is 0.
    pub edges: [f64; 2],
    /// The row of the measurement, pixels.
    pub row: f64,
}

/// Why the pictures do not determine the field of view.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum DistanceError {
    /// Too few pictures.
    #[error("the object was found in {found} pictures; expected {FEWEST} or more")]
    Number {
        /// The number of pictures in which it was found.
        found: usize,
    },
    /// No camera sees the object as wide from that distance.
    #[error("an object {width:.2} m wide cannot look like that from {distance} m")]
    Impossible {
        /// The given width, metres.
        width: f64,
        /// The given distance, metres.
        distance: f64,
    },
    /// The pictures give different fields of view.
    #[error("the pictures give different fields of view, from {least:.1} to {most:.1} degrees")]
    Apart {
        /// The smallest, in degrees.
        least: f64,
        /// The largest, in degrees.
        most: f64,
    },
}

/// Returns the field of view in radians, its standard deviation, and the result of each picture.
/// `width` is the object's, in metres.
///
/// # Errors
/// See [`DistanceError`].
pub fn field_of_view(
    measures: &[Measure],
    width: f64,
    distortion: [f64; 2],
    size: Size,
) -> Result<(f64, f64, Vec<f64>), DistanceError> {
    if measures.len() < FEWEST {
        let found = measures.len();
        return Err(DistanceError::Number { found });
    }
    let each: Result<Vec<f64>, DistanceError> = measures
        .iter()
        .map(|measure| of_one(measure, width, distortion, size))
        .collect();
    let each = each?;
    let count = each.len() as f64;
    let mean = each.iter().sum::<f64>() / count;
    let squares: f64 = each.iter().map(|one| (one - mean) * (one - mean)).sum();
    let spread = (squares / (count - 1.0)).sqrt();
    if spread > MAX_APART * mean {
        let degrees =
            |fold: fn(f64, f64) -> f64, from| each.iter().copied().fold(from, fold).to_degrees();
        return Err(DistanceError::Apart {
            least: degrees(f64::min, f64::INFINITY),
            most: degrees(f64::max, 0.0),
        });
    }
    Ok((mean, spread / count.sqrt(), each))
}

fn of_one(
    measure: &Measure,
    width: f64,
    distortion: [f64; 2],
    size: Size,
) -> Result<f64, DistanceError> {
    // The object's width that this field of view implies; it grows with the field of view.
    let wide = |hfov: f64| {
        let camera = Camera { hfov, distortion };
        let [left, right] = measure
            .edges
            .map(|column| camera.bearing(column, measure.row, size).tan());
        measure.distance * (left - right)
    };
    let (mut low, mut high) = (*FIELDS_OF_VIEW.start(), *FIELDS_OF_VIEW.end());
    let possible = wide(low) < width && width < wide(high);
    if !possible {
        let distance = measure.distance;
        return Err(DistanceError::Impossible { width, distance });
    }
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if wide(middle) < width {
            low = middle;
        } else {
            high = middle;
        }
    }
    Ok(0.5 * (low + high))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::Direction;
    use proptest::prelude::*;

    const SIZE: Size = Size {
        width: 320,
        height: 240,
    };

    /// An object of this width, seen from straight in front of it.
    fn seen(camera: Camera, width: f64, distance: f64) -> Measure {
        let column = |aside: f64| {
            let direction = Direction {
                bearing: (aside / distance).atan(),
                elevation: 0.0,
            };
            camera.pixel(direction, SIZE).unwrap().0
        };
        Measure {
            distance,
            edges: [column(width / 2.0), column(-width / 2.0)],
            row: 119.5,
        }
    }

    #[test]
    fn known_distances_give_the_field_of_view() {
        let camera = Camera::default();
        let measures = [0.8, 1.0, 1.5, 2.0].map(|distance| seen(camera, 0.36, distance));
        let (hfov, sure, each) = field_of_view(&measures, 0.36, camera.distortion, SIZE).unwrap();
        assert!((hfov - camera.hfov).abs() < 1e-6 && sure < 1e-6, "{hfov}");
        assert_eq!(each.len(), 4);
    }

    #[test]
    fn wrong_distances_and_too_few_are_refused() {
        let camera = Camera::default();
        let mut measures = [0.8, 1.0, 1.5].map(|distance| seen(camera, 0.36, distance));
        measures[1].distance = 1.5;
        let refused = |measures: &[Measure], width| {
            field_of_view(measures, width, camera.distortion, SIZE).unwrap_err()
        };
        assert!(matches!(
            refused(&measures, 0.36),
            DistanceError::Apart { .. }
        ));
        assert_eq!(
            refused(&measures[..1], 0.36),
            DistanceError::Number { found: 1 }
        );
        assert!(matches!(
            refused(&measures, 1e9),
            DistanceError::Impossible { .. }
        ));
    }

    proptest! {
        #[test]
        fn any_measures_are_accepted_without_panic(
            distance in -1e3f64..1e3, left in -1e3f64..1e3, right in -1e3f64..1e3, width in -1.0f64..10.0,
        ) {
            let measure = Measure { distance, edges: [left, right], row: 100.0 };
            let _ = field_of_view(&[measure, measure], width, [-0.25, 0.08], SIZE);
        }
    }
}
