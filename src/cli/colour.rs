//! `spykee colour`: finds and learns colours in pictures. Colours by name: those of the config and
//! the nine built-in ones.

mod find;
mod learn;

use std::path::Path;

use super::settings::CommandSettings;
use super::{Console, Exit, Failure};
use crate::config::Config;
use crate::files;
use crate::vision::{Colour, FrameError, MAX_COLOURS, MAX_JPEG_LEN, Roi, Size};
use crate::yaml::suggestion;

/// Messages cut longer names to this many characters.
const MAX_SHOWN: usize = 40;

#[derive(Debug, Clone, clap::Subcommand)]
pub(super) enum Action {
    Find(find::FindArgs),
    Learn(learn::LearnArgs),
}

impl Action {
    pub(super) fn uses_settings(&self) -> bool {
        matches!(self, Action::Find(_))
    }
}

pub(super) fn run(
    action: &Action,
    settings: &CommandSettings,
    console: &Console,
) -> Result<Exit, Failure> {
    match action {
        Action::Find(args) => find::run(args, settings, console),
        Action::Learn(args) => learn::run(args, console),
    }
}

/// The colours with these names, in the same order. The config's names override built-in ones.
fn of_names(names: &[String], config: &Config) -> Result<Vec<Colour>, Failure> {
    if names.len() > MAX_COLOURS {
        return Err(Failure::usage(format_args!(
            "{} colours; at most {MAX_COLOURS} can be distinguished at once",
            names.len()
        )));
    }
    names.iter().map(|name| of_name(name, config)).collect()
}

fn of_name(name: &str, config: &Config) -> Result<Colour, Failure> {
    let known = config.colours.get(name).copied();
    known
        .or_else(|| Colour::named(name))
        .ok_or_else(|| unknown(name, config))
}

fn unknown(name: &str, config: &Config) -> Failure {
    let own: Vec<&str> = config.colours.keys().map(String::as_str).collect();
    let shown: String = name.chars().take(MAX_SHOWN).collect();
    let known = own.iter().copied().chain(Colour::NAMES);
    let what = format!("there is no colour '{shown}'{}", suggestion(name, known));
    let built_in = Colour::NAMES.join(", ");
    let help = if own.is_empty() {
        format!("colours: {built_in}, and those under `colours:` of --config FILE")
    } else {
        format!("colours: {built_in}; from the config: {}", own.join(", "))
    };
    Failure::usage(what).help(help)
}

const NO_JPEG_HELP: &str = "only JPEG is supported, as the robot's camera sends it and scripts save \
                            it; convert other pictures";
const TOO_LARGE_HELP: &str = "scale it down; the robot's own pictures are 320x240";

/// Reads a file, at most one byte more than the maximum length of a JPEG, so that a longer one can
/// be reported as too long.
pub(super) fn read_picture(path: &Path) -> Result<Vec<u8>, Failure> {
    files::read_beginning(path, MAX_JPEG_LEN as u64 + 1)
        .map_err(|error| Failure::unreadable_file("the picture", path, error))
}

pub(super) fn unusable_picture(path: &Path, error: &FrameError) -> Failure {
    let failure = Failure::usage(format_args!("cannot use {}: {error}", path.display()));
    match error {
        FrameError::NoStart | FrameError::Unsupported(_) => failure.help(NO_JPEG_HELP),
        FrameError::TooLarge { .. } | FrameError::TooLong(_) => failure.help(TOO_LARGE_HELP),
        _ => failure,
    }
}

fn part(roi: Roi, size: Size, path: &Path) -> Result<Roi, Failure> {
    roi.within(size).ok_or_else(|| {
        let Roi { x, y, w, h } = roi;
        let Size { width, height } = size;
        let path = path.display();
        Failure::usage(format_args!(
            "the part {x},{y},{w},{h} is outside {path}, which is {width}x{height}"
        ))
        .help("--roi is left column, top row, width, height; 0,0 is the top left")
    })
}

/// Parses `x,y,w,h`, as for `--roi`.
fn parse_roi(text: &str) -> Result<Roi, &'static str> {
    let numbers: Option<Vec<u32>> = text
        .split(',')
        .map(|number| number.trim().parse().ok())
        .collect();
    match numbers.as_deref() {
        Some(&[x, y, w, h]) if w > 0 && h > 0 => Ok(Roi { x, y, w, h }),
        _ => Err("expected x,y,w,h in whole pixels, such as 100,80,40,30; w and h at least 1"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn config() -> Config {
        Config::parse("colours: { sock: { h: [270, 310] } }", "test").unwrap()
    }

    #[test]
    fn names_are_found_in_the_config_and_among_the_nine() {
        let names = ["sock", "red"].map(str::to_owned);
        let colours = of_names(&names, &config()).unwrap();
        assert_eq!(colours[1], Colour::named("red").unwrap());
        assert_ne!(colours[0], colours[1]);
    }

    #[test]
    fn the_error_for_a_long_name_is_short() {
        let report = of_name(&"r".repeat(100_000), &config())
            .unwrap_err()
            .report();
        assert!(report.len() < 400, "{report}");
    }

    #[test]
    fn more_colours_than_the_maximum_are_refused() {
        let names = vec!["red".to_owned(); MAX_COLOURS + 1];
        assert!(of_names(&names, &config()).is_err());
    }

    #[test]
    fn a_part_is_four_numbers_and_not_empty() {
        let roi = Roi {
            x: 1,
            y: 2,
            w: 30,
            h: 4,
        };
        assert_eq!(parse_roi("1,2, 30,4"), Ok(roi));
        for wrong in ["", "1,2,3", "1,2,3,4,5", "1,2,0,4", "-1,2,3,4", "a,b,c,d"] {
            assert!(parse_roi(wrong).is_err(), "{wrong}");
        }
    }

    proptest! {
        #[test]
        fn no_text_causes_a_panic(text in "[-0-9, x]{0,40}", width in 1u32..2000) {
            if let Ok(roi) = parse_roi(&text) {
                let size = Size { width, height: 240 };
                let inside = part(roi, size, Path::new("a.jpg"));
                prop_assert!(inside.map_or(true, |part| part.x + part.w <= width));
            }
        }
    }
}
