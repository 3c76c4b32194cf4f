//! `--for` of `run` and `serve`: how long something may last.

use std::time::Duration;

use super::argument::ArgumentError;
use crate::clock::Span;

/// Parses a duration. Unlike a [`Span`] it can have a fraction of a second.
///
/// # Errors
/// Neither a number of seconds nor a duration with units; longer than a year.
pub(super) fn parse(text: &str) -> Result<Duration, ArgumentError> {
    let seconds: Option<f64> = text.parse().ok();
    let duration = seconds.and_then(|seconds| Duration::try_from_secs_f64(seconds).ok());
    match duration.filter(|duration| *duration <= Span::MAX.get()) {
        Some(duration) => Ok(duration),
        None => Ok(text.parse::<Span>()?.get()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seconds_and_durations_with_units_are_understood() {
        for (text, seconds) in [
            ("30", 30.0),
            ("0.5", 0.5),
            ("1e3", 1000.0),
            ("1h30m", 5400.0),
        ] {
            assert_eq!(parse(text), Ok(Duration::from_secs_f64(seconds)), "{text}");
        }
        for wrong in ["", "soon", "-1", "nan", "inf", "367d", "1h30", "31622401"] {
            let error = parse(wrong).unwrap_err().to_string();
            assert!(
                error.contains("or a number of seconds, at most 366d"),
                "{error}"
            );
        }
    }
}
