//! `spykee calibrate camera`: measures the camera's field of view and distortion from pictures of a
//! chessboard, or only its field of view from pictures of the station.

use std::path::{Path, PathBuf};

use image::GrayImage;
use serde_json::json;

use super::station;
use crate::clean;
use crate::cli::argument::ArgumentError;
use crate::cli::picture;
use crate::cli::{Exit, Failure, print};
use crate::vision::{
    Board, Calibrated, CalibrationError, Decoder, Sighting, Size, calibrate, find_chessboard,
};

/// Help for pictures from which the camera cannot be computed.
const HELP: &str = "ten pictures with the whole board in each, from near, tilted to another side in each, \
                    and some with it in the corners of the picture: `spykee robot snapshot` takes them";

/// Measure the camera's field of view and distortion from pictures of a chessboard
///
/// Print a chessboard, glue it to something flat, and take about ten pictures that each show the
/// whole board: tilted differently in each, close enough to fill most of the picture, in some of
/// them near the picture's corners. The size of the squares does not matter. The command prints a
/// `camera:` line for the config.
///
/// Without a chessboard you can measure the field of view, but not the distortion, with the
/// charging station: put the robot straight in front of it, and give with --station the distance
/// from the lens to the front of the station for each picture.
#[derive(Debug, Clone, clap::Args)]
#[command(
    after_help = "Examples:\n  spykee calibrate camera board/*.jpg --board 9x6\n  \
                        spykee calibrate camera near.jpg far.jpg --station 1,1.5"
)]
pub(super) struct CameraArgs {
    /// Unchanged camera pictures of the board, all of the same size
    #[arg(value_name = "IMAGE.jpg", required = true)]
    images: Vec<PathBuf>,

    /// Number of the board's inner corners, across and down: one less than its squares
    #[arg(long, value_name = "COLUMNSxROWS", default_value = "9x6", value_parser = parse_board)]
    board: Board,

    /// Measure from pictures of the charging station: the distance of each picture, in metres
    #[arg(long, value_name = "METRES,...", value_delimiter = ',', value_parser = parse_distance,
          conflicts_with = "board")]
    station: Vec<f64>,

    /// Print a JSON object
    #[arg(long)]
    json: bool,
}

fn parse_distance(text: &str) -> Result<f64, ArgumentError> {
    let distance = text.trim().parse().ok();
    let known = distance.filter(|distance| station::DISTANCES.contains(distance));
    let (near, far) = (*station::DISTANCES.start(), *station::DISTANCES.end());
    known.ok_or(ArgumentError::Distance(near, far))
}

fn parse_board(text: &str) -> Result<Board, ArgumentError> {
    let sides = text.split_once(['x', 'X']);
    let side = |text: &str| {
        text.trim()
            .parse()
            .ok()
            .filter(|side| (3..=40).contains(side))
    };
    sides
        .and_then(|(columns, rows)| {
            Some(Board {
                columns: side(columns)?,
                rows: side(rows)?,
            })
        })
        .ok_or(ArgumentError::Board)
}

/// Finds the board in each picture and prints the camera's parameters.
///
/// # Errors
/// Files that are not pictures, pictures of different sizes, too few pictures with the board or too
/// similar ones.
pub(super) fn run(args: &CameraArgs) -> Result<Exit, Failure> {
    if !args.station.is_empty() {
        return station::run(&args.images, &args.station, args.json);
    }
    let mut seen: Vec<(&Path, Sighting)> = Vec::new();
    let mut missed: Vec<&Path> = Vec::new();
    let mut common: Option<Size> = None;
    for path in &args.images {
        let (luma, size) = load(path)?;
        let first = *common.get_or_insert(size);
        if first != size {
            let shown = path.display();
            let failure = Failure::usage(format_args!(
                "{shown} is {}x{}, the pictures before it are {}x{}",
                size.width, size.height, first.width, first.height
            ));
            return Err(failure.help("take all of them with the same camera"));
        }
        match find_chessboard(&luma, args.board) {
            Some(corners) => seen.push((path, corners)),
            None => missed.push(path),
        }
    }
    for path in &missed {
        let Board { columns, rows } = args.board;
        tracing::warn!(
            "found no board of {columns}x{rows} inner corners in {}: the picture is ignored",
            path.display()
        );
    }
    let size = common.ok_or_else(|| Failure::usage("no pictures"))?;
    let sightings: Vec<Sighting> = seen.iter().map(|(_, corners)| corners.clone()).collect();
    let found = calibrate(&sightings, args.board, size).map_err(|error| {
        let help = match error {
            CalibrationError::Bent { .. } => "give the number of inner corners with --board",
            _ => HELP,
        };
        Failure::usage(error).help(help)
    })?;
    let names: Vec<String> = seen
        .iter()
        .map(|(path, _)| path.display().to_string())
        .collect();
    print(&if args.json {
        as_json(&found, &names, &missed)
    } else {
        as_text(&found, &names)
    })?;
    Ok(Exit::Done)
}

fn load(path: &Path) -> Result<(GrayImage, Size), Failure> {
    let bytes = picture::read(path)?;
    let mut decoder = Decoder::default();
    let image = decoder
        .decode(&bytes)
        .map_err(|error| picture::unusable(path, &error))?;
    let size = image.size();
    let luma = GrayImage::from_fn(size.width, size.height, |x, y| {
        let [r, g, b] = image.pixel(x, y).unwrap_or_default().map(f32::from);
        image::Luma([(0.299 * r + 0.587 * g + 0.114 * b).round() as u8])
    });
    Ok((luma, size))
}

fn as_text(found: &Calibrated, names: &[String]) -> String {
    let [k1, k2] = found.camera.distortion;
    let (hfov, sure) = (found.camera.hfov, found.uncertainty);
    let width = names
        .iter()
        .map(|name| name.chars().count())
        .max()
        .unwrap_or(0);
    let rows = names.iter().zip(&found.errors);
    let rows: String = rows
        .map(|(name, error)| format!("{:width$}  {error:.2} px\n", clean::line(name)))
        .collect();
    format!(
        "{rows}\nfield of view {:.1} degrees, give or take {:.1}\n\n\
         camera: {{ hfov: {hfov:.4}, distortion: [{k1:.4}, {k2:.4}] }}\n\
         Paste this line into your config. Leave out pictures with much larger errors than the others.\n",
        hfov.to_degrees(),
        (2.0 * sure).to_degrees().max(0.1),
    )
}

fn as_json(found: &Calibrated, names: &[String], missed: &[&Path]) -> String {
    let pictures = names.iter().zip(&found.errors);
    let pictures: Vec<_> = pictures
        .map(|(name, error)| json!({ "file": name, "error_px": error }))
        .collect();
    let missed: Vec<String> = missed
        .iter()
        .map(|path| path.display().to_string())
        .collect();
    let object = json!({
        "hfov": found.camera.hfov, "distortion": found.camera.distortion,
        "hfov_deviation": found.uncertainty, "pictures": pictures, "without_board": missed,
    });
    format!("{object}\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_board_is_two_numbers_of_inner_corners() {
        assert_eq!(
            parse_board("9x6"),
            Ok(Board {
                columns: 9,
                rows: 6
            })
        );
        for wrong in ["", "9", "2x6", "9x", "9x6x3", "-9x6", "41x6"] {
            assert!(parse_board(wrong).is_err(), "{wrong}");
        }
    }
}
