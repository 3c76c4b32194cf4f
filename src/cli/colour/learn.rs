//! `spykee colour learn`: learns a colour for the config from pictures of an object.

use std::path::{Path, PathBuf};

use serde::Serialize;
use serde_json::json;

use super::{parse_roi, part, read_picture, unusable_picture};
use crate::cli::table::aligned;
use crate::cli::{Console, Exit, Failure, print, print_json};
use crate::vision::{
    self, Blob, BlobFinder, BlobOptions, Camera, Colour, Decoder, Image, LearnRefusal, Learned,
    Palette, Roi,
};

/// Lowest quality of a colour that is very good, good or usable; a lower one is poor.
const VERY_GOOD: f64 = 0.9;
const GOOD: f64 = 0.75;
const USABLE: f64 = 0.5;

const HEAD: &str = "# PICTURE|>INSIDE|>OF|>OUTSIDE|>OF|LARGEST BLOB";

/// Learn a colour from pictures and print it for the config
///
/// Prints YAML: the colour under `colours:`, and in comments how many pixels of each picture it
/// matches inside and outside the given part, and whether the largest blob is the object. Pictures
/// in different light, with the object in the same part, make the colour more reliable.
#[derive(Debug, Clone, clap::Args)]
pub(in crate::cli) struct LearnArgs {
    /// JPEG pictures of the object, such as scripts save with frame:save
    #[arg(value_name = "IMAGE.jpg", required = true)]
    images: Vec<PathBuf>,

    /// Part of the picture that the object fills, in pixels: left column, top row, width, height
    #[arg(long, value_name = "X,Y,W,H", value_parser = parse_roi)]
    roi: Roi,

    /// Name of the colour in scripts: letters, digits, _ and -. A built-in name such as red
    /// redefines that colour for all scripts that run with this config
    #[arg(long, value_name = "NAME", default_value = "thing", value_parser = parse_name)]
    name: String,

    /// Print a JSON object instead of YAML
    #[arg(long)]
    json: bool,
}

fn parse_name(text: &str) -> Result<String, String> {
    const MAX_LETTERS: usize = 40;
    let fits = |c: char| c.is_alphanumeric() || matches!(c, '_' | '-');
    let begins_well = text.starts_with(char::is_alphabetic);
    if begins_well && text.chars().all(fits) && text.chars().count() <= MAX_LETTERS {
        return Ok(text.to_owned());
    }
    Err(format!(
        "expected a letter followed by letters, digits, _ or -, at most {MAX_LETTERS} characters in \
         all"
    ))
}

/// The matches of the learned colour in one picture.
#[derive(Debug, Serialize)]
struct ColourCheck {
    file: String,
    inside: Count,
    outside: Count,
    /// Whether the largest blob is the object; `None` if there is no blob.
    largest_is_inside: Option<bool>,
}

/// The number of pixels that have the colour, and of all pixels.
#[derive(Debug, Serialize)]
struct Count {
    pixels: u32,
    of: u32,
}

/// Learns the colour and prints it as YAML to paste into a config, or as JSON.
pub(super) fn run(args: &LearnArgs, console: &Console) -> Result<Exit, Failure> {
    let mut exit = Exit::Done;
    let mut images = Vec::new();
    for path in &args.images {
        match load(path, args.roi) {
            Ok(image) => images.push((path.as_path(), image)),
            Err(failure) => {
                console.write_line("ERROR", &failure.report());
                exit = failure.exit;
            }
        }
    }
    if images.is_empty() {
        return Ok(exit);
    }
    let pixels: Vec<&Image> = images.iter().map(|(_, image)| image).collect();
    let learned = match vision::learn(&pixels, args.roi) {
        Ok(learned) => learned,
        Err(refusal) => return refuse(refusal, args.json),
    };
    let checks = check_pictures(&images, args.roi, &learned.colour);
    if args.json {
        print_json(&json!({
            "name": args.name,
            "colour": learned.colour,
            "quality": learned.quality,
            "verdict": verdict(learned.quality, &checks),
            "pictures": checks,
        }))?;
    } else {
        print(&yaml(&args.name, &learned, &checks))?;
    }
    Ok(exit)
}

fn load(path: &Path, roi: Roi) -> Result<Image, Failure> {
    let jpeg = read_picture(path)?;
    let mut decoder = Decoder::default();
    let image = decoder
        .decode(&jpeg)
        .map_err(|error| unusable_picture(path, &error))?;
    part(roi, image.size(), path)?;
    Ok(image.clone())
}

fn refuse(refusal: LearnRefusal, as_json: bool) -> Result<Exit, Failure> {
    let help = match refusal {
        LearnRefusal::TooGrey => {
            "choose --roi inside an object of a strong colour and switch on a light; for white, grey \
             and black objects use the built-in colours white and black, or lab ranges"
        }
        LearnRefusal::TooMixed => {
            "spykee colour find PICTURE --colour NAME --roi X,Y,W,H --annotate OUT.png shows the contents \
             of a part; with several pictures the object must be in the same part of all"
        }
    };
    if as_json {
        print_json(&json!({ "refused": refusal.code(), "reason": refusal.to_string() }))?;
    }
    Err(Failure::usage(refusal).help(help))
}

/// Counts the colour's pixels in each picture with the blob finder that scripts use.
fn check_pictures(images: &[(&Path, Image)], roi: Roi, colour: &Colour) -> Vec<ColourCheck> {
    let mut palette = Palette::compile(&[*colour], false);
    let mut finder = BlobFinder::default();
    let mut find = |image: &Image, options: &BlobOptions| {
        finder
            .find(image, &mut palette, options, Camera::default())
            .to_vec()
    };
    let check_picture = |(path, image): &(&Path, Image)| {
        let mut count = |roi| {
            let blobs = find(image, &every_pixel(roi));
            blobs.iter().map(|blob| blob.pixels).sum()
        };
        let (inside, all): (u32, u32) = (count(Some(roi)), count(None));
        let size = image.size();
        let of = roi.within(size).map_or(0, |part| part.w * part.h);
        let largest = find(image, &BlobOptions::default()).first().copied();
        ColourCheck {
            file: path.display().to_string(),
            inside: Count { pixels: inside, of },
            outside: Count {
                pixels: all - inside,
                of: size.width * size.height - of,
            },
            largest_is_inside: largest.map(|blob| overlaps(&blob, roi)),
        }
    };
    images.iter().map(check_picture).collect()
}

fn every_pixel(roi: Option<Roi>) -> BlobOptions {
    BlobOptions {
        roi,
        area_threshold: 0,
        pixels_threshold: 0,
        max_blobs: usize::MAX,
        ..BlobOptions::default()
    }
}

fn overlaps(blob: &Blob, roi: Roi) -> bool {
    let right = roi.x.saturating_add(roi.w);
    let bottom = roi.y.saturating_add(roi.h);
    blob.x < right && roi.x < blob.x + blob.w && blob.y < bottom && roi.y < blob.y + blob.h
}

/// Whether some picture has hardly any of the colour where the object should be.
fn object_missing(checks: &[ColourCheck]) -> bool {
    const LEAST_PERCENT: u32 = 20;
    let hardly = |inside: &Count| inside.pixels * 100 < inside.of * LEAST_PERCENT;
    checks.iter().any(|check| hardly(&check.inside))
}

fn largest_is_elsewhere(checks: &[ColourCheck]) -> bool {
    checks
        .iter()
        .any(|check| check.largest_is_inside != Some(true))
}

/// Rates the colour, with advice if it is poor.
fn verdict(quality: f64, checks: &[ColourCheck]) -> &'static str {
    match quality {
        _ if object_missing(checks) => {
            "poor: not every picture shows the object in this part; leave out those that do not"
        }
        _ if largest_is_elsewhere(checks) => {
            "poor: the largest blob is not the object; add pictures in different light, choose \
             --roi well inside the object, or an object of a rarer colour"
        }
        VERY_GOOD.. => "very good",
        GOOD.. => "good",
        USABLE.. => "usable; pictures in different light may improve it",
        _ => {
            "poor: the colour matches too little of the part, or too much outside it; choose --roi \
             well inside the object"
        }
    }
}

/// The result as YAML to paste into a config: everything except the colour is a comment.
fn yaml(name: &str, learned: &Learned, checks: &[ColourCheck]) -> String {
    let verdict = verdict(learned.quality, checks);
    let quality = learned.quality;
    format!(
        "# Pixels that have the learned colour:\n{}# Quality {quality:.2} of 1: {verdict}\n\
         colours:\n  {}: {}\n",
        aligned(HEAD, checks.iter().map(row)),
        key(name),
        learned.colour
    )
}

fn row(check: &ColourCheck) -> Vec<String> {
    let largest = match check.largest_is_inside {
        Some(true) => "the object",
        Some(false) => "elsewhere",
        None => "none",
    };
    vec![
        format!("# {}", commented(&check.file)),
        check.inside.pixels.to_string(),
        check.inside.of.to_string(),
        check.outside.pixels.to_string(),
        check.outside.of.to_string(),
        largest.to_owned(),
    ]
}

/// Replaces characters of a file name that would end a comment or are invalid in YAML.
fn commented(text: &str) -> String {
    let harmless = |c: char| c == ' ' || c.is_ascii_graphic() || c.is_alphanumeric();
    let shown = text.chars().map(|c| if harmless(c) { c } else { '?' });
    shown.collect()
}

/// Quotes the name if necessary: `null` or `true` mean something else in YAML.
fn key(name: &str) -> String {
    match serde_yaml::from_str::<String>(name) {
        Ok(read) if read == name => name.to_owned(),
        _ => format!("\"{name}\""),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;
    use proptest::prelude::*;

    fn check(file: &str) -> ColourCheck {
        ColourCheck {
            file: file.to_owned(),
            inside: Count {
                pixels: 390,
                of: 400,
            },
            outside: Count {
                pixels: 12,
                of: 76_400,
            },
            largest_is_inside: Some(true),
        }
    }

    fn learned() -> Learned {
        Learned {
            colour: Colour::hsv([345.0, 12.0], [40.0, 100.0], [20.0, 100.0]).unwrap(),
            quality: 0.97,
        }
    }

    #[test]
    fn names_with_a_meaning_in_yaml_are_quoted() {
        for name in ["null", "true", "false", "Null", "y", "no", "e3", "red"] {
            let text = yaml(&parse_name(name).unwrap(), &learned(), &[check("a.jpg")]);
            let config = Config::parse(&text, "learned").unwrap();
            assert_eq!(config.colours[name], learned().colour, "{text}");
        }
        for wrong in ["", "a b", "a:", "-a", "1st", "#", &"x".repeat(41)] {
            assert!(parse_name(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn a_colour_whose_largest_blob_is_elsewhere_is_poor_whatever_its_quality() {
        let mut elsewhere = check("a.jpg");
        assert_eq!(verdict(0.97, &[check("b.jpg")]), "very good");
        elsewhere.largest_is_inside = Some(false);
        assert!(verdict(0.97, &[check("b.jpg"), elsewhere]).starts_with("poor"));
        assert!(verdict(0.3, &[check("b.jpg")]).starts_with("poor"));
        let mut object_missing = check("c.jpg");
        object_missing.inside.pixels = 3;
        assert!(verdict(0.5, &[check("b.jpg"), object_missing]).contains("not every picture"));
    }

    proptest! {
        #[test]
        fn the_output_is_a_valid_config_for_all_names(
            name in "\\PC{1,12}|[a-z]{1,5}",
            file in "[^\\x00]{0,40}|[a \\n\u{2028}\u{85}\u{fffe}\u{feff}#:]{1,9}"
        ) {
            if let Ok(name) = parse_name(&name) {
                let text = yaml(&name, &learned(), &[check(&file)]);
                let config = Config::parse(&text, "learned");
                prop_assert!(config.is_ok(), "{:?} {}", config, text);
                prop_assert_eq!(config.unwrap().colours[&name], learned().colour);
            }
        }
    }
}
