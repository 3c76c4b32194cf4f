//! Parsers of arguments that several commands have, with errors that say what was expected.

use std::ops::RangeInclusive;
use std::path::PathBuf;
use std::str::FromStr;
use std::time::Duration;

/// A parser of whole numbers within a range. Clap's own one names it as Rust does: `1..=600`.
pub(super) fn whole<T>(
    range: RangeInclusive<T>,
) -> impl Fn(&str) -> Result<T, String> + Clone + Send + Sync + 'static
where
    T: Copy + FromStr + Into<u64> + PartialOrd + Send + Sync + 'static,
{
    move |text: &str| {
        let number = text.parse::<T>().ok();
        let number = number.filter(|number| range.contains(number));
        number.ok_or_else(|| {
            let low: u64 = (*range.start()).into();
            let high: u64 = (*range.end()).into();
            format!("expected a whole number from {low} to {high}")
        })
    }
}

/// A parser of a time limit in seconds, from a tenth up to this many.
pub(super) fn seconds(
    most: f64,
) -> impl Fn(&str) -> Result<Duration, String> + Clone + Send + Sync + 'static {
    move |text: &str| match text.parse() {
        Ok(seconds) if (0.1..=most).contains(&seconds) => Ok(Duration::from_secs_f64(seconds)),
        _ => Err(format!("expected a number of seconds, 0.1 to {most}")),
    }
}

/// Parses the name of a file that ends in `.png`.
pub(super) fn png(text: &str) -> Result<PathBuf, &'static str> {
    let path = PathBuf::from(text);
    match path.extension() {
        Some(ending) if ending.eq_ignore_ascii_case("png") => Ok(path),
        _ => Err("expected a file that ends in .png"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::command;

    #[test]
    fn the_error_names_the_range_in_words() {
        let parse = whole::<u16>(1..=10_000);
        assert_eq!((parse("1"), parse("10000")), (Ok(1), Ok(10_000)));
        for wrong in ["0", "10001", "70000", "-1", "1.5", "", "ten"] {
            let error = parse(wrong).unwrap_err();
            assert_eq!(error, "expected a whole number from 1 to 10000", "{wrong}");
        }
    }

    /// Collects one command line for each argument of each command, with a number that is too
    /// large.
    fn attempts(path: &[String], command: &clap::Command, found: &mut Vec<Vec<String>>) {
        for argument in command.get_arguments() {
            let value = "9999999999";
            let word = match argument.get_long() {
                Some(long) => format!("--{long}={value}"),
                None => value.to_owned(),
            };
            found.push([path, &[word]].concat());
        }
        for inner in command.get_subcommands() {
            let path = [path, &[inner.get_name().to_owned()]].concat();
            attempts(&path, inner, found);
        }
    }

    #[test]
    fn no_option_names_its_range_as_rust_does() {
        let mut found = Vec::new();
        attempts(&["spykee".to_owned()], &command(), &mut found);
        let mut refused = 0;
        let wanted = "expected a whole number from ";
        for words in found {
            if let Err(error) = command().try_get_matches_from(&words) {
                let error = error.to_string();
                assert!(!error.contains("..="), "{words:?}: {error}");
                refused += usize::from(error.contains(wanted));
            }
        }
        assert!(refused >= 10, "{refused}");
    }
}
