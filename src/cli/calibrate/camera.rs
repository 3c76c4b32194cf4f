//! `spykee calibrate camera`: measures where the camera is, from one picture of a sheet of paper.

use std::path::PathBuf;

use serde_json::json;

use crate::cli::colour::picture;
use crate::cli::settings::SettingsArgs;
use crate::cli::{Exit, Failure, print};
use crate::vision::{A4, Decoder, SheetError, SheetPose, pose_from_sheet};

/// A larger uncertainty is mentioned: metres, degrees.
const WELL_KNOWN: [f64; 3] = [0.02, 2.0, 2.0];

/// Measure the camera's height, pitch and roll for the config
///
/// Put one sheet of white A4 paper (it may be printed) flat on a darker floor, about a metre in
/// front of the robot, so that the whole sheet is in the picture, and take a picture with `spykee
/// robot snapshot`. Computes `camera:` from the sheet's four corners. Repeat it when somebody has
/// bent the robot's head. The robot does not move.
#[derive(Debug, Clone, clap::Args)]
#[command(
    after_help = "Examples:\n  spykee robot snapshot --robot 172.17.6.1 -o sheet.jpg\n  \
                        spykee calibrate camera sheet.jpg"
)]
pub(in crate::cli) struct CameraArgs {
    /// Picture of the sheet, as the robot's camera sends it
    #[arg(value_name = "IMAGE.jpg")]
    image: PathBuf,

    /// Print a JSON object
    #[arg(long)]
    json: bool,

    #[command(flatten)]
    pub(in crate::cli) settings: SettingsArgs,
}

pub(super) fn run(args: &CameraArgs) -> Result<Exit, Failure> {
    let camera = args.settings.config()?.camera;
    let jpeg = picture::read(&args.image)?;
    let mut decoder = Decoder::default();
    let image = decoder
        .decode(&jpeg)
        .map_err(|error| picture::unusable(&args.image, &error))?;
    let found = pose_from_sheet(image, camera, A4).map_err(|error| refused(args, error))?;
    let text = if args.json {
        format!("{}\n", as_json(&found))
    } else {
        as_text(&found)
    };
    print(&text)?;
    Ok(Exit::Done)
}

fn refused(args: &CameraArgs, error: SheetError) -> Failure {
    let what = format!("{}: {error}", args.image.display());
    let help = match error {
        SheetError::NoSheet => {
            "put white A4 paper flat on a darker floor, a metre in front of the robot; all four \
             corners must be in the picture, with floor around them and no glare"
        }
        SheetError::OtherShape { .. } => {
            "use one whole sheet of A4 paper, 297 x 210 mm, that lies flat, and nothing else that is \
             bright on the floor"
        }
    };
    Failure::new(Exit::Failed, what).help(help)
}

fn as_json(found: &SheetPose) -> serde_json::Value {
    let [height, pitch, roll] = found.uncertainty;
    json!({
        "height": found.camera.height,
        "pitch": found.camera.pitch,
        "roll": found.camera.roll,
        "uncertainty": { "height": height, "pitch": pitch, "roll": roll },
        "sheet": { "ahead": found.middle.ahead, "left": found.middle.left },
        "error": found.error,
    })
}

fn as_text(found: &SheetPose) -> String {
    let [height, pitch, roll] = found.uncertainty;
    let camera = found.camera;
    let ahead = found.middle.ahead;
    let side = if found.middle.left < 0.0 {
        "right"
    } else {
        "left"
    };
    let aside = 100.0 * found.middle.left.abs();
    let mut text = format!(
        "camera: {{ height: {:.3}, pitch: {:.1}, roll: {:.1} }}\n\
         Paste these keys into your config, in place of those of its `camera:` if it has one.\n\
         The middle of the sheet is {ahead:.2} m ahead of the camera and {aside:.0} cm to the {side}: \
         if not, take another picture.\n\
         Uncertainty: height {height:.3} m, pitch {pitch:.1} and roll {roll:.1} degrees.\n",
        camera.height, camera.pitch, camera.roll
    );
    let is_vague = found
        .uncertainty
        .iter()
        .zip(WELL_KNOWN)
        .any(|(uncertainty, most)| *uncertainty > most);
    if is_vague {
        text.push_str("That is much: put the sheet nearer, so that it is larger in the picture.\n");
    }
    text
}
