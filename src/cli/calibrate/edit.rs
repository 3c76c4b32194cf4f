//! Edits the `calibration:` mapping of a config as text: the rest of the file and its comments stay
//! as they are. Pure. The result is parsed again and compared before it is accepted.

use serde_yaml::Value;

use crate::config::Config;
use crate::script::Calibration;

const KEY: &str = "calibration";

/// The file is written in a way that this editor does not understand, or is not a valid config.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub(super) enum EditError {
    /// The file is not valid before the edit.
    #[error("{0}")]
    Invalid(String),
    /// The editor does not understand the mapping; nothing was changed.
    #[error("its `calibration:` is written in a way that cannot be edited safely")]
    NotUnderstood,
}

/// Returns the text with these two numbers in its `calibration:` mapping.
///
/// # Errors
/// See [`EditError`]; the user must then edit the file by hand.
pub(super) fn with_calibration(
    text: &str,
    name: &str,
    calibration: Calibration,
) -> Result<String, EditError> {
    Config::parse(text, name).map_err(|error| EditError::Invalid(error.to_string()))?;
    let rounded = Calibration {
        track_width: round(calibration.track_width),
        full_speed: round(calibration.full_speed),
    };
    let edited = edit(text, rounded);
    let now = Config::parse(&edited, name).map_err(|_| EditError::NotUnderstood)?;
    let same = now.calibration == rounded && rest_of(text) == rest_of(&edited);
    same.then_some(edited).ok_or(EditError::NotUnderstood)
}

/// Rounds to a tenth of a millimetre: measurements are no more precise.
fn round(number: f64) -> f64 {
    (number * 1e4).round() / 1e4
}

/// Everything in the config but the calibration; `None` if the text cannot be parsed.
fn rest_of(text: &str) -> Option<Value> {
    let said = |line: &str| !line.trim().is_empty() && !line.trim().starts_with('#');
    if !text.lines().any(said) {
        return Some(Value::Mapping(serde_yaml::Mapping::new()));
    }
    let mut value: Value = serde_yaml::from_str(text).ok()?;
    value.as_mapping_mut()?.remove(KEY);
    Some(value)
}

fn edit(text: &str, calibration: Calibration) -> String {
    let pairs = [
        ("track_width", calibration.track_width),
        ("full_speed", calibration.full_speed),
    ];
    let mut lines: Vec<String> = text.split_inclusive('\n').map(str::to_owned).collect();
    let opens = |line: &String| {
        line.strip_prefix(KEY)
            .is_some_and(|rest| rest.trim_start().starts_with(':'))
    };
    let Some(at) = lines.iter().position(opens) else {
        if lines.last().is_some_and(|line| !line.ends_with('\n')) {
            lines.push("\n".to_owned());
        }
        lines.push(format!("{}\n", line_of(calibration)));
        return lines.concat();
    };
    if lines[at].contains('{') {
        lines[at] = pairs.iter().fold(lines[at].clone(), |line, (key, value)| {
            set_in_flow(&line, key, *value)
        });
        return lines.concat();
    }
    let inside = |line: &&String| {
        line.trim().is_empty() || line.starts_with([' ', '\t']) || line.starts_with('#')
    };
    let mut end = at + 1 + lines[at + 1..].iter().take_while(inside).count();
    let indent = lines[at + 1..end]
        .iter()
        .find(|line| {
            !line.trim().is_empty() && line.starts_with(' ') && !line.trim_start().starts_with('#')
        })
        .map_or(2, |line| line.len() - line.trim_start().len());
    for (key, value) in pairs {
        let found = lines[at + 1..end].iter().position(|line| {
            line.trim_start()
                .strip_prefix(key)
                .is_some_and(|rest| rest.trim_start().starts_with(':'))
        });
        match found {
            Some(index) => {
                let line = &mut lines[at + 1 + index];
                *line = set_value(line, key, value, &['#', '\n', '\r']);
            }
            None => {
                if !lines[at].ends_with('\n') {
                    lines[at].push('\n');
                }
                lines.insert(at + 1, format!("{:indent$}{key}: {value}\n", ""));
                end += 1;
            }
        }
    }
    lines.concat()
}

/// The calibration as a line of a config.
pub(super) fn line_of(calibration: Calibration) -> String {
    let Calibration {
        track_width,
        full_speed,
    } = calibration;
    format!(
        "{KEY}: {{ track_width: {}, full_speed: {} }}",
        round(track_width),
        round(full_speed)
    )
}

fn set_in_flow(line: &str, key: &str, value: f64) -> String {
    if line.contains(&format!("{key}:")) {
        return set_value(line, key, value, &[',', '}']);
    }
    let Some((head, tail)) = line.split_once('{') else {
        return line.to_owned();
    };
    let comma = if tail.trim_start().starts_with('}') {
        ""
    } else {
        ","
    };
    format!("{head}{{ {key}: {value}{comma}{tail}")
}

/// Replaces the scalar after `key:`; keeps the blanks after it.
fn set_value(line: &str, key: &str, value: f64, ends: &[char]) -> String {
    let Some(start) = line.find(key).map(|at| at + key.len()) else {
        return line.to_owned();
    };
    let Some(colon) = line[start..].find(':').map(|at| start + at + 1) else {
        return line.to_owned();
    };
    let tail = &line[colon..];
    let scalar = &tail[..tail.find(ends).unwrap_or(tail.len())];
    let blanks = &scalar[scalar
        .trim_end()
        .len()
        .max(scalar.len() - scalar.trim_start().len())..];
    format!(
        "{} {value}{blanks}{}",
        &line[..colon],
        &tail[scalar.len()..]
    )
}

/// The changed lines: removed ones with `-`, added ones with `+`.
pub(super) fn diff(before: &str, after: &str) -> String {
    let (old, new): (Vec<&str>, Vec<&str>) = (before.lines().collect(), after.lines().collect());
    let head = old.iter().zip(&new).take_while(|(a, b)| a == b).count();
    let tails = old[head..].iter().rev().zip(new[head..].iter().rev());
    let tail = tails.take_while(|(a, b)| a == b).count();
    let gone = old[head..old.len() - tail]
        .iter()
        .map(|line| format!("-{line}\n"));
    let come = new[head..new.len() - tail]
        .iter()
        .map(|line| format!("+{line}\n"));
    gone.chain(come).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const MEASURED: Calibration = Calibration {
        track_width: 0.25004,
        full_speed: 0.4,
    };

    fn edited(text: &str) -> String {
        with_calibration(text, "spykee.yaml", MEASURED).unwrap()
    }

    #[test]
    fn only_the_two_numbers_change() {
        for (before, after) in [
            (
                "# mine\nrobot: 10.0.0.1 # den\ncalibration: { track_width: 0.3, full_speed: 0.5 } # old\ndata: x\n",
                "# mine\nrobot: 10.0.0.1 # den\ncalibration: { track_width: 0.25, full_speed: 0.4 } # old\ndata: x\n",
            ),
            (
                "calibration:\n  # measured on wood\n  full_speed: 0.5   # m/s\n\n  track_width: 0.3\ndata: x",
                "calibration:\n  # measured on wood\n  full_speed: 0.4   # m/s\n\n  track_width: 0.25\ndata: x",
            ),
            (
                "calibration:\n    full_speed: 0.5",
                "calibration:\n    track_width: 0.25\n    full_speed: 0.4",
            ),
            (
                "calibration: {full_speed: 0.5}\n",
                "calibration: { track_width: 0.25,full_speed: 0.4}\n",
            ),
            (
                "data: x",
                "data: x\ncalibration: { track_width: 0.25, full_speed: 0.4 }\n",
            ),
            ("", "calibration: { track_width: 0.25, full_speed: 0.4 }\n"),
        ] {
            assert_eq!(edited(before), after);
        }
    }

    #[test]
    fn text_that_is_not_understood_is_an_error() {
        let odd = "calibration: { track_width: 0.3,\n  full_speed: 0.5 }\n";
        assert_eq!(
            with_calibration(odd, "x", MEASURED),
            Err(EditError::NotUnderstood)
        );
        assert!(matches!(
            with_calibration("nonsense: 1", "x", MEASURED),
            Err(EditError::Invalid(_))
        ));
    }

    #[test]
    fn diff_shows_removed_and_added_lines() {
        let before = "a: 1\ncalibration: { full_speed: 1 }\nb: 2\n";
        let shown = diff(before, "a: 1\ncalibration: { full_speed: 2 }\nb: 2\n");
        assert_eq!(
            shown,
            "-calibration: { full_speed: 1 }\n+calibration: { full_speed: 2 }\n"
        );
        assert_eq!(diff("a", "a"), "");
    }

    proptest! {
        #[test]
        fn the_rest_of_the_file_stays_the_same(
            lines in prop::collection::vec(prop::sample::select(vec![
                "# note", "", "calibration:", "  track_width: 0.3 # m", "  full_speed: 0.5",
                "calibration: {}", "calibration: { full_speed: 0.2 } # c", "data: x", "  # in",
                "camera: { hfov: 1 }", "robot: 1.2.3.4", "calibration:   # none",
            ]), 0..8),
        ) {
            let text = lines.join("\n");
            if let Ok(edited) = with_calibration(&text, "x", MEASURED) {
                prop_assert_eq!(rest_of(&edited), rest_of(&text));
                let comments = |text: &str| text.matches('#').count();
                prop_assert_eq!(comments(&edited), comments(&text));
                prop_assert_eq!(edit(&edited, Calibration { track_width: 0.25, ..MEASURED }), edited);
            }
        }
    }
}
