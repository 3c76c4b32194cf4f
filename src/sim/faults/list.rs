//! Reads lists of faults from YAML; errors name line and column.

use std::path::Path;

use serde::Deserialize;

use super::entry::Entry;
use super::fault::Fault;
use crate::sim::yaml::document::{self, DocumentError, DocumentKind};
use crate::sim::yaml::locate::{self, Step};

/// Maximum number of faults in a list; each is polled at every step.
const MAX_FAULTS: usize = 200;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Document {
    faults: Vec<Entry>,
}

impl Fault {
    /// Parses a list of faults; `name` is the name of the text in errors, usually its file name.
    ///
    /// # Errors
    /// [`DocumentError::Invalid`] with line and column: unknown keys and faults, values out of
    /// range, keys that do not apply to the fault.
    pub fn list_from_yaml(text: &str, name: &str) -> Result<Vec<Fault>, DocumentError> {
        let invalid = |path: &[Step], message| {
            DocumentError::invalid(name, locate::find(text, path), message)
        };
        let Document { faults } = locate::read(text, name)?;
        if faults.len() > MAX_FAULTS {
            let message = format!("{} faults are too many: at most {MAX_FAULTS}", faults.len());
            return Err(invalid(&[Step::Key("faults")], message));
        }
        for (index, entry) in faults.iter().enumerate() {
            entry.check().map_err(|(key, message)| {
                let path = [Step::Key("faults"), Step::Index(index), Step::Key(key)];
                invalid(&path, message)
            })?;
        }
        Ok(faults.iter().map(Entry::fault).collect())
    }

    /// Reads a list of faults from a file.
    ///
    /// # Errors
    /// As [`Fault::list_from_yaml`], or the file cannot be read.
    pub fn load_list(path: &Path) -> Result<Vec<Fault>, DocumentError> {
        document::load(path, DocumentKind::Faults, Fault::list_from_yaml)
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::super::fault::{Direction, FaultKind};
    use super::super::timing::Timing;
    use super::*;

    fn read(text: &str) -> Vec<Fault> {
        Fault::list_from_yaml(text, "f.yaml").unwrap()
    }

    fn mistake(text: &str) -> String {
        let error = Fault::list_from_yaml(text, "f.yaml").unwrap_err();
        error.to_string()
    }

    #[test]
    fn missing_keys_have_defaults() {
        let faults = read("faults: [{fault: drop}, {fault: take_over}, {fault: split}]");
        assert_eq!(faults[0], Fault::new(FaultKind::Drop));
        assert_eq!(faults[1].timing.lasts, Some(Duration::from_secs(5)));
        assert_eq!(faults[2].timing.lasts, None);
    }

    #[test]
    fn given_keys_are_used() {
        let text = "faults:\n  - { fault: delay, seconds: 0.5, jitter: 1, towards: robot, after: 2, \
                    for: 3, every: 10, chance: 0.5 }\n  - { fault: length_lie, bytes: 0 }\n";
        let faults = read(text);
        let seconds = Duration::from_secs;
        let by = Duration::from_millis(500);
        let jitter = seconds(1);
        let expected = Fault {
            kind: FaultKind::Delay { by, jitter },
            towards: Direction::Robot,
            timing: Timing {
                after: seconds(2),
                lasts: Some(seconds(3)),
                every: Some(seconds(10)),
            },
            chance: 0.5,
        };
        assert_eq!(faults[0], expected);
        assert_eq!(faults[1].kind, FaultKind::LengthLie { claim: Some(0) });
        assert_eq!(faults[1].towards, Direction::Client);
    }

    #[test]
    fn errors_name_their_place() {
        for (text, start, words) in [
            (
                "faults:\n  - fault: dlay\n",
                "f.yaml:2:",
                "did you mean `delay`?",
            ),
            (
                "faults:\n  - fault: drop\n    afetr: 1\n",
                "f.yaml:3:5: ",
                "did you mean `after`?",
            ),
            (
                "faults:\n  - fault: drop\n    after: -1\n",
                "f.yaml:3:12: ",
                "0 to 86400",
            ),
            (
                "faults:\n  - fault: drop\n    for: 3\n",
                "f.yaml:3:10: ",
                "`for` does not apply to this fault",
            ),
            (
                "faults: [{fault: split, percent: 3}]",
                "f.yaml:1:34: ",
                "`towards`, `for`, `after`",
            ),
            (
                "faults: [{fault: split, every: 3}]",
                "f.yaml:1:32: ",
                "needs `for`",
            ),
            (
                "faults: [{fault: reboot, every: 3}]",
                "f.yaml:1:33: ",
                "longer than the 5s",
            ),
            (
                "faults: [{fault: garbage, bytes: 0}]",
                "f.yaml:1:34: ",
                "at least 1 byte",
            ),
            (
                "faults: [{fault: drop, chance: .nan}]",
                "f.yaml:1:32: ",
                "1 is always",
            ),
            ("faults: 3", "f.yaml:1:9: ", "expected a sequence"),
        ] {
            let text = mistake(text);
            assert!(text.starts_with(start) && text.contains(words), "{text}");
        }
    }

    #[test]
    fn too_many_faults_are_rejected() {
        let text = format!("faults:\n{}", "  - fault: drop\n".repeat(MAX_FAULTS + 1));
        assert!(mistake(&text).contains("201 faults are too many"));
    }

    #[test]
    fn the_error_names_a_missing_file() {
        let error = Fault::load_list(Path::new("no/such/faults.yaml")).unwrap_err();
        assert!(error.to_string().contains("no/such/faults.yaml"), "{error}");
    }

    proptest::proptest! {
        #[test]
        fn no_text_causes_a_panic(text in ".{0,200}", more in "[a-z_:{}\\[\\], 0-9.&*-]{0,80}") {
            let _ = Fault::list_from_yaml(&text, "random");
            let _ = Fault::list_from_yaml(&format!("faults:\n  - fault: {more}"), "random");
        }
    }
}
