//! `spykee calibrate camera --station`: measures the field of view from pictures of the charging
//! station at known distances.

use std::path::{Path, PathBuf};

use serde_json::json;

use crate::clean;
use crate::cli::picture;
use crate::cli::{Exit, Failure, print};
use crate::vision::{
    Blob, BlobOptions, Camera, Colour, DistanceError, FrameAnalyser, FrameError, Image, Measure,
    Size, field_of_view,
};

/// The station: a dark box with a white plate, metres.
const WIDTH: f64 = 0.36;
const HEIGHT: f64 = 0.34;
/// Tolerance of the box's aspect ratio, as a fraction.
const SHAPE: f64 = 0.25;
/// Brightness, of 255, that separates the station's dark sides from its plate and the wall behind
/// it.
const MIDDLE: f32 = 110.0;
/// Pixels beside the dark blob that may belong to it.
const BLUR: u32 = 2;
/// Distances from which the station can be measured, metres.
pub(super) const DISTANCES: std::ops::RangeInclusive<f64> = 0.3..=5.0;
const HELP: &str = "put the robot straight in front of the station, measure from the lens to the station's front, and \
                    take pictures from 0.8, 1, 1.5 and 2 m";

/// The station's front in a picture, in pixels.
struct Front {
    edges: [f64; 2],
    row: f64,
}

/// Finds the station in each picture and prints the field of view.
///
/// # Errors
/// Not one distance per picture; pictures that show no station, or contradict each other.
pub(super) fn run(images: &[PathBuf], distances: &[f64], as_json: bool) -> Result<Exit, Failure> {
    if images.len() != distances.len() {
        let what = format_args!(
            "{} distances for {} pictures",
            distances.len(),
            images.len()
        );
        return Err(
            Failure::usage(what).help("give one distance for each picture, in the same order")
        );
    }
    let camera = Camera::default();
    let mut analyser = FrameAnalyser::new(camera);
    let (mut measures, mut names, mut common) = (Vec::new(), Vec::new(), None);
    for (number, (path, distance)) in images.iter().zip(distances).enumerate() {
        let (size, station) = find_front(&mut analyser, number as u64, path)?;
        if *common.get_or_insert(size) != size {
            let what = format_args!("{} differs in size from those before it", path.display());
            return Err(Failure::usage(what).help("take all of them with the same camera"));
        }
        let Some(Front { edges, row }) = station else {
            tracing::warn!(
                "found no station in {}: the picture is ignored",
                path.display()
            );
            continue;
        };
        measures.push(Measure {
            distance: *distance,
            edges,
            row,
        });
        names.push(path.display().to_string());
    }
    let size = common.ok_or_else(|| Failure::usage("no pictures"))?;
    let found = field_of_view(&measures, WIDTH, camera.distortion, size).map_err(|error| {
        let help = match error {
            DistanceError::Apart { .. } => {
                "are the distances right, in metres, and in the order of the pictures?"
            }
            _ => HELP,
        };
        Failure::usage(error).help(help)
    })?;
    print(&if as_json {
        json_of(&found, camera, &names)
    } else {
        text_of(&found, camera, &names)
    })?;
    Ok(Exit::Done)
}

/// Returns the picture's size and the largest blob that looks like the station's front.
fn find_front(
    analyser: &mut FrameAnalyser,
    key: u64,
    path: &Path,
) -> Result<(Size, Option<Front>), Failure> {
    let jpeg = picture::read(path)?;
    let unusable = |error: FrameError| picture::unusable(path, &error);
    let size = analyser.decode(key, &jpeg).map_err(unusable)?.size();
    let dark = Colour::lab([0.0, 34.0], [-14.0, 14.0], [-18.0, 14.0]).map_err(Failure::usage)?;
    let options = BlobOptions {
        pixels_threshold: 20,
        merge: true,
        margin: 2,
        ..BlobOptions::default()
    };
    let blobs = analyser
        .find_blobs(key, &jpeg, &[dark], &options)
        .map_err(unusable)?;
    let blobs = blobs.to_vec();
    let image = analyser.decode(key, &jpeg).map_err(unusable)?;
    Ok((size, blobs.iter().find_map(|blob| station_in(image, blob))))
}

/// Returns the station's front if this dark blob is the station.
fn station_in(image: &Image, blob: &Blob) -> Option<Front> {
    let light = |x: u32, y: u32| {
        let pixel = image.pixel(x, y).unwrap_or_default().map(f32::from);
        pixel.iter().sum::<f32>() / 3.0
    };
    let columns = blob.x.saturating_sub(BLUR)..blob.x + blob.w + BLUR;
    // The upper half is in front of the wall; other dark things may touch the foot.
    let rows = blob.y + blob.h * 15 / 100..=blob.y + blob.h / 2;
    let sides: Vec<(u32, u32)> = rows
        .filter_map(|y| {
            let dark = |x: &u32| light(*x, y) < MIDDLE;
            let mut columns = columns.clone();
            let left = columns.find(dark)?;
            Some((left, columns.rfind(dark)?))
        })
        .collect();
    let middle = |side: fn(&(u32, u32)) -> u32| {
        let mut places: Vec<u32> = sides.iter().map(side).collect();
        places.sort_unstable();
        places.get(places.len() / 2).copied().map(f64::from)
    };
    let (left, right) = (middle(|side| side.0)? - 0.5, middle(|side| side.1)? + 0.5);
    let shape = (right - left) / f64::from(blob.h) / (WIDTH / HEIGHT);
    let plate = light(((left + right) / 2.0) as u32, blob.y + blob.h / 5);
    let is_it = !blob.edge && (shape - 1.0).abs() < SHAPE && plate > MIDDLE;
    is_it.then_some(Front {
        edges: [left, right],
        row: f64::from(blob.y) + f64::from(blob.h) / 3.0,
    })
}

type Found = (f64, f64, Vec<f64>);

fn text_of((hfov, sure, each): &Found, camera: Camera, names: &[String]) -> String {
    let [k1, k2] = camera.distortion;
    let widest = names.iter().map(|name| name.chars().count()).max();
    let width = widest.unwrap_or(0);
    let rows = names.iter().zip(each);
    let rows: String = rows
        .map(|(name, hfov)| {
            format!(
                "{:width$}  {:.1} degrees\n",
                clean::line(name),
                hfov.to_degrees()
            )
        })
        .collect();
    format!(
        "{rows}\nfield of view {:.1} degrees, give or take {:.1}\n\n\
         camera: {{ hfov: {hfov:.4}, distortion: [{k1:.4}, {k2:.4}] }}\n\
         Paste this line into your config. The distortion is the default; a chessboard measures yours.\n",
        hfov.to_degrees(),
        (2.0 * sure).to_degrees().max(0.1),
    )
}

fn json_of((hfov, sure, each): &Found, camera: Camera, names: &[String]) -> String {
    let pictures = names.iter().zip(each);
    let pictures: Vec<_> = pictures
        .map(|(name, hfov)| json!({ "file": name, "hfov": hfov }))
        .collect();
    let object = json!({
        "hfov": hfov, "distortion": camera.distortion, "hfov_deviation": sure, "pictures": pictures,
    });
    format!("{object}\n")
}
