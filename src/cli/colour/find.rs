//! `spykee colour find`: runs a script's `find_blobs` on pictures.

use std::path::{Path, PathBuf};

use image::RgbImage;
use serde_json::json;

use super::marked_pictures::MarkedPictures;
use super::{of_names, picture};
use crate::cli::settings::SettingsArgs;
use crate::cli::table::{Side, aligned};
use crate::cli::{Console, Exit, Failure, argument, print};
use crate::vision::{
    Annotation, Blob, BlobOptions, Colour, FrameAnalyser, Image, Roi, Size, annotate_enlarged,
};

/// Small pictures are enlarged to about this width for people.
const SHOWN_WIDTH: u32 = 960;
/// Largest enlargement factor.
const MAX_ENLARGEMENT: u32 = 6;

const HEAD: [(&str, Side); 13] = [
    ("FILE", Side::Left),
    ("#", Side::Right),
    ("COLOUR", Side::Left),
    ("PIXELS", Side::Right),
    ("X", Side::Right),
    ("Y", Side::Right),
    ("W", Side::Right),
    ("H", Side::Right),
    ("CX", Side::Right),
    ("CY", Side::Right),
    ("ROUNDNESS", Side::Right),
    ("BEARING", Side::Right),
    ("EDGE", Side::Left),
];

/// Find blobs of a colour in pictures, as scripts do
///
/// Prints a row for each blob, the largest of each picture first: its number, box and centroid in
/// pixels from the top left, roundness (1 for a disc, 0 for a line), bearing in radians (left
/// positive) and whether it touches the edge of the picture. --json prints every field that scripts
/// see.
#[derive(Debug, Clone, clap::Args)]
pub(super) struct FindArgs {
    /// JPEG pictures, such as scripts save with frame:save
    #[arg(value_name = "IMAGE.jpg", required = true)]
    images: Vec<PathBuf>,

    /// Colour to look for: red, orange, yellow, green, cyan, blue, magenta, white, black, or a
    /// colour from the config; may be repeated
    #[arg(
        long = "colour",
        alias = "color",
        value_name = "NAME",
        required = true,
        value_delimiter = ','
    )]
    colours: Vec<String>,

    #[command(flatten)]
    pub(super) settings: SettingsArgs,

    /// Search only this part of the picture, in pixels: left column, top row, width, height
    #[arg(long, value_name = "X,Y,W,H", value_parser = picture::parse_roi)]
    roi: Option<Roi>,

    /// Omit blobs with fewer pixels
    #[arg(long, value_name = "COUNT", default_value_t = BlobOptions::default().pixels_threshold,
          value_parser = argument::whole::<u32>(0..=u32::MAX))]
    min_pixels: u32,

    /// Maximum number of blobs per picture; the largest are shown
    #[arg(long, value_name = "COUNT", default_value_t = BlobOptions::default().max_blobs)]
    max_blobs: usize,

    /// Print a JSON array
    #[arg(long)]
    json: bool,

    /// Write a marked copy with boxes, numbers and names: for one picture the PNG file to write;
    /// for several pictures a folder, created if missing, which gets NAME-blobs.png for each
    #[arg(long, value_name = "OUT.png|DIR")]
    annotate: Option<PathBuf>,
}

/// The blobs found in one picture.
struct Found {
    file: String,
    size: Size,
    blobs: Vec<Blob>,
}

struct Search<'a> {
    args: &'a FindArgs,
    colours: Vec<Colour>,
    options: BlobOptions,
    analyser: FrameAnalyser,
    marked: Option<MarkedPictures>,
}

/// Searches each picture and prints the blobs found. Reports an unusable picture on stderr and
/// continues with the others.
pub(super) fn run(args: &FindArgs, console: &Console) -> Result<Exit, Failure> {
    let mut search = Search::new(args)?;
    let mut exit = Exit::Done;
    let mut found = Vec::new();
    for (key, image) in (0..).zip(&args.images) {
        match search.find(key, image) {
            Ok(one) => {
                if one.blobs.len() == args.max_blobs {
                    console.write_line("WARN", &limit_note(&one));
                }
                found.push(one);
            }
            Err(failure) => {
                console.write_line("ERROR", &failure.report());
                exit = failure.exit;
            }
        }
    }
    if args.json {
        print(&format!("{}\n", json(&found, &args.colours)))?;
    } else if !found.is_empty() {
        print(&table(&found, &args.colours))?;
    }
    Ok(exit)
}

fn limit_note(found: &Found) -> String {
    let number = found.blobs.len();
    let file = &found.file;
    format!(
        "note: only the {number} largest blobs of {file} are shown; there may be more: --max-blobs \
         raises the limit, --min-pixels omits small ones"
    )
}

impl<'a> Search<'a> {
    fn new(args: &'a FindArgs) -> Result<Search<'a>, Failure> {
        let config = args.settings.config()?;
        let colours = of_names(&args.colours, config)?;
        let marked = args.annotate.as_deref();
        let marked = marked.map(|out| MarkedPictures::open(out, &args.images));
        Ok(Search {
            args,
            colours,
            options: BlobOptions {
                roi: args.roi,
                // A box has at least as many pixels as its blob.
                area_threshold: args.min_pixels,
                pixels_threshold: args.min_pixels,
                max_blobs: args.max_blobs,
                ..BlobOptions::default()
            },
            analyser: FrameAnalyser::new(config.camera),
            marked: marked.transpose()?,
        })
    }

    fn find(&mut self, key: u64, path: &Path) -> Result<Found, Failure> {
        let jpeg = picture::read(path)?;
        let unusable = |error| picture::unusable(path, &error);
        let image = self.analyser.decode(key, &jpeg).map_err(unusable)?;
        let size = image.size();
        if let Some(roi) = self.args.roi {
            picture::part(roi, size, path)?;
        }
        let blobs = self
            .analyser
            .find_blobs(key, &jpeg, &self.colours, &self.options)
            .map_err(unusable)?
            .to_vec();
        if let Some(pictures) = &mut self.marked {
            let image = self.analyser.decode(key, &jpeg).map_err(unusable)?;
            pictures.save(path, &marked(image, &blobs, self.args))?;
        }
        Ok(Found {
            file: path.display().to_string(),
            size,
            blobs,
        })
    }
}

/// A copy for people: enlarged, the part outside the searched region dimmed, and a box with number
/// and name around each blob.
fn marked(image: &Image, blobs: &[Blob], args: &FindArgs) -> RgbImage {
    let texts: Vec<String> = (1..)
        .zip(blobs)
        .map(|(number, blob)| format!("{number} {}", args.colours[blob.colour]))
        .collect();
    let marks = blobs.iter().zip(&texts);
    let marks: Vec<Annotation<'_>> = marks
        .map(|(blob, text)| Annotation { blob, text })
        .collect();
    let times = (SHOWN_WIDTH / image.size().width).clamp(1, MAX_ENLARGEMENT);
    match args.roi {
        Some(roi) => annotate_enlarged(&dimmed(image, roi), &marks, times),
        None => annotate_enlarged(image, &marks, times),
    }
}

fn dimmed(image: &Image, bright: Roi) -> Image {
    let within = |start: u32, length, at| at >= start && at < start.saturating_add(length);
    let mut pixels = image.to_rgb();
    for (x, y, pixel) in pixels.enumerate_pixels_mut() {
        if !(within(bright.x, bright.w, x) && within(bright.y, bright.h, y)) {
            pixel.0 = pixel.0.map(|channel| channel / 3);
        }
    }
    Image::from_rgb(&pixels)
}

fn json(found: &[Found], colours: &[String]) -> serde_json::Value {
    let blob = |blob: &Blob| {
        let mut value = json!(blob);
        value["colour"] = json!(colours[blob.colour]);
        value
    };
    let picture = |found: &Found| {
        let blobs: Vec<_> = found.blobs.iter().map(blob).collect();
        json!({ "file": found.file, "size": found.size, "blobs": blobs })
    };
    found.iter().map(picture).collect()
}

fn table(found: &[Found], colours: &[String]) -> String {
    let rows: Vec<Vec<String>> = found
        .iter()
        .flat_map(|found| {
            if found.blobs.is_empty() {
                return vec![vec![found.file.clone(), "-".into(), "none".into()]];
            }
            let blobs = (1..).zip(&found.blobs);
            let rows = blobs.map(|(number, blob)| row(&found.file, number, blob, colours));
            rows.collect()
        })
        .collect();
    aligned(&HEAD, &rows)
}

fn row(file: &str, number: usize, blob: &Blob, colours: &[String]) -> Vec<String> {
    let edge = if blob.edge { "yes" } else { "no" };
    vec![
        file.to_owned(),
        number.to_string(),
        colours[blob.colour].clone(),
        blob.pixels.to_string(),
        blob.x.to_string(),
        blob.y.to_string(),
        blob.w.to_string(),
        blob.h.to_string(),
        format!("{:.1}", blob.cx),
        format!("{:.1}", blob.cy),
        format!("{:.2}", blob.roundness),
        format!("{:+.3}", blob.bearing),
        edge.to_owned(),
    ]
}
