//! `spykee calibrate camera`: measures where the camera is, from one picture of sheets of paper.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use clap::builder::{PossibleValuesParser, TypedValueParser as _};
use serde_json::json;

use crate::cli::colour::{read_picture, unusable_picture};
use crate::cli::robot::with_pictures;
use crate::cli::running::SharedTargetArgs;
use crate::cli::settings::CommandSettings;
use crate::cli::{Exit, Failure, print, print_json};
use crate::vision::{Camera, Decoder, Paper, SheetError, SheetPose, pose_from_sheets};

/// Time to wait for a picture from the robot.
const SECONDS: u64 = 5;
/// The camera's noise moves the sides of the paper, so the pose is the middle one of so many pictures.
const MEASURED: usize = 5;
/// Pictures on which noise may hide the paper.
const MAX_REFUSED: usize = 9;

/// Measure the camera's height, pitch and roll for the config
///
/// Lay a sheet of white paper (it may be printed) flat on a darker floor, about a metre in front of
/// the robot, all of it in the picture. Two sheets, one nearer than the other, tell more than one.
/// Takes pictures, and computes `camera:` from the sides of the paper. The robot does not move.
/// Repeat it when somebody has bent the robot's head.
#[derive(Debug, Clone, clap::Args)]
#[command(
    after_help = "Examples:\n  spykee calibrate camera --robot 172.17.6.1\n  \
                        spykee calibrate camera sheet.jpg --paper letter"
)]
pub(in crate::cli) struct CameraArgs {
    /// Picture of the paper, as the robot's camera sends it [default: take some]
    #[arg(value_name = "PICTURE.jpg", conflicts_with_all = ["robot", "sim"])]
    picture: Option<PathBuf>,

    /// Size of the paper (A4: 297 x 210 mm, Letter: 11 x 8.5 inches); it cannot be seen, and the wrong one makes the height wrong by a tenth
    #[arg(long, default_value = "a4", value_parser = PossibleValuesParser::new(["a4", "letter"]).map(paper))]
    paper: Paper,

    /// Print a JSON object
    #[arg(long)]
    json: bool,

    #[command(flatten)]
    target: SharedTargetArgs,
}

pub(super) fn run(args: &CameraArgs, settings: &CommandSettings) -> Result<Exit, Failure> {
    let camera = settings.config()?.camera;
    if let Some(path) = &args.picture {
        let found = measure(path, camera, args.paper, &read_picture(path)?)?;
        return report(args, &found, camera);
    }
    let mut measured = Vec::new();
    let mut refused = 0;
    with_pictures(&args.target, settings, SECONDS, |shot| {
        match measure(Path::new("the picture"), camera, args.paper, &shot.jpeg) {
            Ok(found) => measured.push(found),
            Err(failure) if refused == MAX_REFUSED => return Err(failure),
            Err(_) => refused += 1,
        }
        if measured.len() < MEASURED {
            return Ok(None);
        }
        measured.sort_by(|one, other| one.camera.pitch.total_cmp(&other.camera.pitch));
        report(args, &measured[MEASURED / 2], camera).map(Some)
    })
}

fn paper(name: String) -> Paper {
    match name.as_str() {
        "letter" => Paper::Letter,
        _ => Paper::A4,
    }
}

fn measure(source: &Path, camera: Camera, paper: Paper, jpeg: &[u8]) -> Result<SheetPose, Failure> {
    let mut decoder = Decoder::default();
    let image = decoder
        .decode(jpeg)
        .map_err(|error| unusable_picture(source, &error))?;
    pose_from_sheets(image, camera, paper).map_err(|error| {
        Failure::new(Exit::Failed, format!("{}: {error}", source.display())).help(help(error))
    })
}

fn report(args: &CameraArgs, found: &SheetPose, configured: Camera) -> Result<Exit, Failure> {
    if args.json {
        print_json(&as_json(found))
    } else {
        print(&as_text(found, configured))
    }
}

fn help(error: SheetError) -> &'static str {
    match error {
        SheetError::NoSheet => {
            "lay white paper flat on a darker floor, a metre in front of the robot, all four \
             corners in the picture; walls, doors and windows do not count"
        }
        SheetError::OtherShape => {
            "lay one whole sheet of A4 paper flat on the floor, with nothing on it; for US paper \
             say --paper letter"
        }
        SheetError::NotFlat => {
            "lay it flat, a metre in front of the robot: paper that leans, hangs or is far away \
             tells another pose"
        }
        SheetError::TooSmall => "lay it nearer, half a metre to a metre in front of the robot",
    }
}

fn as_json(found: &SheetPose) -> serde_json::Value {
    let [height, pitch, roll] = found.uncertainty;
    let sheets = found.sheets.iter().map(|sheet| {
        json!({ "ahead": sheet.middle.ahead, "left": sheet.middle.left,
                "height": sheet.camera.height, "pitch": sheet.camera.pitch,
                "roll": sheet.camera.roll })
    });
    json!({
        "height": found.camera.height,
        "pitch": found.camera.pitch,
        "roll": found.camera.roll,
        "uncertainty": { "height": height, "pitch": pitch, "roll": roll },
        "agree": found.agree,
        "sheets": sheets.collect::<Vec<_>>(),
    })
}

fn as_text(found: &SheetPose, configured: Camera) -> String {
    let pose = |camera: &Camera| {
        let Camera {
            height,
            pitch,
            roll,
            ..
        } = camera;
        format!("height: {height:.3}, pitch: {pitch:.1}, roll: {roll:.1}")
    };
    let [height, pitch, roll] = found.uncertainty;
    let mut text = format!(
        "camera: {{ {} }}\n\
         Paste these keys into your config, in place of those of its `camera:` if it has one.\n\
         In 95 of 100 cases the truth is within {height:.3} m, {pitch:.1} and {roll:.1} degrees.\n",
        pose(&found.camera)
    );
    for sheet in &found.sheets {
        let side = if sheet.middle.left < 0.0 {
            "right"
        } else {
            "left"
        };
        let ahead = sheet.middle.ahead;
        let aside = 100.0 * sheet.middle.left.abs();
        let alone = pose(&sheet.camera);
        let _ = writeln!(
            text,
            "Paper {ahead:.2} m ahead of the camera, {aside:.0} cm to the {side}: {alone}"
        );
    }
    text.push_str("If there is no paper at such a place, take another picture.\n");
    if !found.agree {
        text.push_str(
            "The sheets DO NOT AGREE: do all lie flat, and are all of the same size? Better take \
             another picture.\n",
        );
    }
    let verdict = if found.fits(&configured) {
        "fits"
    } else {
        "does not fit"
    };
    let _ = writeln!(
        text,
        "What the config says {verdict}: {}",
        pose(&configured)
    );
    text
}
