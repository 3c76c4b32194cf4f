//! Errors of invalid command-line arguments, and a parser of whole numbers.

use std::ops::RangeInclusive;
use std::str::FromStr;

use crate::behaviour::MAX_NAME;
use crate::clock::ClockError;

/// An invalid command-line argument; the message says what was expected.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub(super) enum ArgumentError {
    /// A whole number, such as `test --seeds`.
    #[error("expected a whole number from {low} to {high}")]
    Whole { low: u64, high: u64 },
    /// `learn --name`.
    #[error("expected a letter followed by letters, digits, _ or -, at most {0} characters in all")]
    Colour(usize),
    /// `history --since` and `--until`.
    #[error(
        "expected an age with its unit, such as 30m, 12h, 7d or 2w, or a date such as 2026-11-01 \
         or 2026-11-01T21:30"
    )]
    Moment,
    /// The name of a picture to write.
    #[error("expected a file that ends in .png")]
    Png,
    /// `new NAME`.
    #[error(
        "expected at most {MAX_NAME} letters, digits, `_` and `-`, beginning with a letter and not \
         ending in `_test`"
    )]
    Project,
    /// `--timeout` of tests and lessons.
    #[error("expected a number of seconds, 0.1 to 86400")]
    Timeout,
    /// `discover --timeout`: not a number.
    #[error("expected a number of seconds")]
    Number,
    /// `discover --timeout`: too short or too long.
    #[error("expected 0.1 to 60 seconds")]
    Search,
    /// `--roi`.
    #[error("expected x,y,w,h in whole pixels, such as 100,80,40,30; w and h at least 1")]
    Roi,
    /// `lesson`: neither a lesson's number nor its name.
    #[error("expected a lesson's name or a number from 1 to {0}; `spykee lesson list` shows them")]
    Lesson(usize),
    /// `service --user`.
    #[error("expected a user name: at most 31 letters, digits, -, _ and dots")]
    User,
    /// `--param`.
    #[error("expected NAME=VALUE, such as speed=50, or BEHAVIOUR.NAME=VALUE")]
    Param,
    /// `behaviour start --for`: not a duration.
    #[error(transparent)]
    Span(#[from] ClockError),
    /// `behaviour start --for 0s`.
    #[error("expected a duration above zero")]
    NoTime,
}

/// A parser of whole numbers within a range. Clap's own one names it as Rust does: `1..=600`.
pub(super) fn whole<T>(
    range: RangeInclusive<T>,
) -> impl Fn(&str) -> Result<T, ArgumentError> + Clone + Send + Sync + 'static
where
    T: Copy + FromStr + Into<u64> + PartialOrd + Send + Sync + 'static,
{
    move |text: &str| {
        let number = text.parse::<T>().ok();
        let number = number.filter(|number| range.contains(number));
        number.ok_or_else(|| ArgumentError::Whole {
            low: (*range.start()).into(),
            high: (*range.end()).into(),
        })
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
            let error = parse(wrong).unwrap_err().to_string();
            assert_eq!(error, "expected a whole number from 1 to 10000", "{wrong}");
        }
    }

    /// Collects one command line for each argument of each command, with a number that is too large.
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
