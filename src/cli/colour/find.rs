//! `spykee colour find`: runs a script's `find_blobs` on pictures.

use std::collections::BTreeSet;
use std::path::{MAIN_SEPARATOR, Path, PathBuf};

use image::RgbImage;
use serde_json::json;

use super::{of_names, parse_roi, part, read_picture, unusable_picture};
use crate::cli::check::same_file;
use crate::cli::settings::CommandSettings;
use crate::cli::table::aligned;
use crate::cli::world::save;
use crate::cli::{Console, Exit, Failure, argument, print, print_json};
use crate::vision::{
    Annotation, Blob, BlobOptions, Colour, FrameAnalyser, Image, Roi, Size, annotate_enlarged,
};

/// Small pictures are enlarged to about this width for people.
const SHOWN_WIDTH: u32 = 960;
const MAX_ENLARGEMENT: u32 = 6;

const HEAD: &str = "FILE|>#|COLOUR|>PIXELS|>X|>Y|>W|>H|>CX|>CY|>ROUNDNESS|>BEARING|EDGE";

/// Find blobs of a colour in pictures, as scripts do
///
/// Prints a row for each blob, the largest of each picture first: its number, box and centroid in
/// pixels from the top left, roundness (1 for a disc, 0 for a line), bearing in radians (left
/// positive) and whether it touches the edge of the picture. --json prints every field that scripts
/// see.
#[derive(Debug, Clone, clap::Args)]
pub(in crate::cli) struct FindArgs {
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

    /// Search only this part of the picture, in pixels: left column, top row, width, height
    #[arg(long, value_name = "X,Y,W,H", value_parser = parse_roi)]
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
    marked: Option<Vec<PathBuf>>,
}

/// Searches each picture and prints the blobs found. Reports an unusable picture on stderr and
/// continues with the others.
pub(super) fn run(
    args: &FindArgs,
    settings: &CommandSettings,
    console: &Console,
) -> Result<Exit, Failure> {
    let mut search = Search::new(args, settings)?;
    let mut exit = Exit::Done;
    let mut found = Vec::new();
    for (key, image) in args.images.iter().enumerate() {
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
        print_json(&json(&found, &args.colours))?;
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
    fn new(args: &'a FindArgs, settings: &CommandSettings) -> Result<Search<'a>, Failure> {
        let config = settings.config()?;
        let colours = of_names(&args.colours, config)?;
        let marked = args.annotate.as_deref();
        let marked = marked.map(|out| marked_files(out, &args.images));
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

    fn find(&mut self, number: usize, path: &Path) -> Result<Found, Failure> {
        let key = number as u64;
        let jpeg = read_picture(path)?;
        let unusable = |error| unusable_picture(path, &error);
        let image = self.analyser.decode(key, &jpeg).map_err(unusable)?;
        let size = image.size();
        if let Some(roi) = self.args.roi {
            part(roi, size, path)?;
        }
        let blobs = self
            .analyser
            .find_blobs(key, &jpeg, &self.colours, &self.options)
            .map_err(unusable)?
            .to_vec();
        if let Some(files) = &self.marked {
            let image = self.analyser.decode(key, &jpeg).map_err(unusable)?;
            save(&marked(image, &blobs, self.args), &files[number])?;
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
    let mut rows = Vec::new();
    for found in found {
        if found.blobs.is_empty() {
            rows.push(vec![found.file.clone(), "-".into(), "none".into()]);
        }
        let blobs = (1..).zip(&found.blobs);
        rows.extend(blobs.map(|(number, blob)| row(&found.file, number, blob, colours)));
    }
    aligned(HEAD, rows)
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

const ANNOTATE_HELP: &str =
    "for one picture, --annotate names a file that ends in .png; for several, a folder";

/// Where marked pictures go: to one PNG file, or to a folder with one file for each.
fn marked_files(out: &Path, images: &[PathBuf]) -> Result<Vec<PathBuf>, Failure> {
    let is_png = out
        .extension()
        .is_some_and(|extension| extension.eq_ignore_ascii_case("png"));
    let shown = out.display();
    let ends_as_folder = shown.to_string().ends_with(MAIN_SEPARATOR);
    if out.is_dir() || ends_as_folder || images.len() > 1 {
        if is_png && !out.is_dir() || out.is_file() {
            let what = format_args!("{shown} is not a folder, but there are several pictures");
            return Err(Failure::usage(what).help(ANNOTATE_HELP));
        }
        std::fs::create_dir_all(out)
            .map_err(|error| Failure::io(format_args!("create the folder {shown}"), error))?;
        let mut taken = BTreeSet::new();
        let file = |image: &PathBuf| out.join(name(image, &mut taken));
        return Ok(images.iter().map(file).collect());
    }
    if !is_png {
        let what = format_args!("{shown} does not end in .png");
        return Err(Failure::usage(what).help(ANNOTATE_HELP));
    }
    if images.iter().any(|image| same_file(image, out)) {
        let what = format_args!("{shown} is the picture itself and would be overwritten");
        return Err(Failure::usage(what).help("choose another name for --annotate"));
    }
    Ok(vec![out.to_owned()])
}

/// The file name `NAME-blobs.png`, with a number if pictures in different folders have the same
/// name.
fn name(image: &Path, taken: &mut BTreeSet<String>) -> String {
    let stem = image
        .file_stem()
        .map_or_else(|| "picture".into(), |stem| stem.to_string_lossy());
    let mut name = format!("{stem}-blobs.png");
    for number in 2.. {
        if taken.insert(name.clone()) {
            break;
        }
        name = format!("{stem}-{number}-blobs.png");
    }
    name
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_with_the_same_name_do_not_overwrite_each_other() {
        let mut taken = BTreeSet::new();
        let mut names = ["a/shot.jpg", "b/shot.jpg", "c/shot.jpg", "c/.."]
            .map(|image| name(Path::new(image), &mut taken));
        assert_eq!(names[..2], ["shot-blobs.png", "shot-2-blobs.png"]);
        names.sort_unstable();
        assert!(names.windows(2).all(|pair| pair[0] != pair[1]), "{names:?}");
    }

    #[test]
    fn several_pictures_need_a_folder_and_one_a_png() {
        let folder = tempfile::tempdir().unwrap();
        let out = |name: &str| folder.path().join(name);
        let images = ["a.jpg", "b.jpg"].map(PathBuf::from);
        let refused = |out: PathBuf, images: &[PathBuf]| {
            let report = marked_files(&out, images).unwrap_err().report();
            assert!(report.contains("--annotate"), "{report}");
        };
        refused(out("out.png"), &images);
        refused(out("out.jpg"), &images[..1]);
        refused(out("out"), &images[..1]);
        let files = |name: &str, images| marked_files(&out(name), images).unwrap();
        assert_eq!(files("out.PNG", &images[..1]), [out("out.PNG")]);
        let both = [out("new/a-blobs.png"), out("new/b-blobs.png")];
        assert_eq!(files("new", &images), both);
        assert_eq!(files("new", &images[..1]), both[..1]);
        std::fs::write(out("taken"), "").unwrap();
        refused(out("taken"), &images);
    }

    #[test]
    fn a_picture_is_never_overwritten_by_its_copy() {
        let folder = tempfile::tempdir().unwrap();
        let picture = folder.path().join("shot.png");
        std::fs::write(&picture, "picture").unwrap();
        let failure = marked_files(&picture, std::slice::from_ref(&picture)).unwrap_err();
        let said = failure.to_string();
        assert!(said.contains("would be overwritten"), "{said}");
    }
}
