//! The effective settings and their origins: the file overrides the defaults, and `$SPYKEE_ROBOT`
//! the file's robot. Flags override all of them; only the command line knows them.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use serde::Serialize;
use serde_yaml::Value;

use super::{Config, ConfigError};
use crate::notify;

/// The config that is read if it is in the current folder and no other is named.
const DEFAULT_FILE: &str = "spykee.yaml";

pub const PASSWORD_VARIABLE: &str = "SPYKEE_PASSWORD";
/// The variable that tells the restarted program from which pipe to read the password.
pub const PASSWORD_PIPE_VARIABLE: &str = "SPYKEE_PASSWORD_PIPE";
const FILE_VARIABLE: &str = "SPYKEE_CONFIG";
const ROBOT_VARIABLE: &str = "SPYKEE_ROBOT";
/// The variable for the container's health check, `scripts/packaging/container-health`.
const HEALTH_PORT_VARIABLE: &str = "SPYKEE_HEALTH_PORT";

/// The beginning of the names of all variables of this program.
const PREFIX: &str = "SPYKEE_";
/// The beginnings of other names: those of tests and benchmarks, and those that Kubernetes sets in
/// each container beside a service named `spykee`.
const OTHER_PREFIXES: [&str; 5] = [
    "SPYKEE_BENCH_",
    "SPYKEE_TEST_",
    "SPYKEE_PORT",
    "SPYKEE_SERVICE_HOST",
    "SPYKEE_SERVICE_PORT",
];

/// One value with its key, such as `watchdog.low`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Setting {
    /// Names joined by dots; elements of lists in brackets.
    pub key: String,
    pub value: Value,
    /// Where the value comes from: the file's path, the variable, or `default`.
    pub origin: String,
}

#[derive(Debug, Clone, Default)]
pub struct Effective {
    pub config: Config,
    /// The file from which they were read, and its text.
    pub file: Option<(PathBuf, String)>,
    /// The variables named `SPYKEE_...` that nothing reads.
    pub unread_variables: Vec<String>,
    is_file_named: bool,
    is_robot_from_variable: bool,
}

impl Effective {
    /// Loads the settings from the named file, or else from `$SPYKEE_CONFIG`, or else from
    /// `spykee.yaml` in the current folder if it exists, and the robot from `$SPYKEE_ROBOT`.
    pub fn load(named: Option<&Path>) -> Result<Effective, ConfigError> {
        let mut effective = Effective::load_file(named)?;
        effective.apply_environment(std::env::vars_os())?;
        Ok(effective)
    }

    /// Loads the settings from the same file as [`Effective::load`], but not from variables.
    pub fn load_file(named: Option<&Path>) -> Result<Effective, ConfigError> {
        let mut effective = Effective::default();
        let path = match chosen(named) {
            Some(path) => {
                effective.is_file_named = true;
                path
            }
            None if Path::new(DEFAULT_FILE).is_file() => DEFAULT_FILE.into(),
            None => return Ok(effective),
        };
        let text = Config::read(&path)?;
        effective.config = Config::parse_file(&text, &path)?;
        effective.file = Some((path, text));
        Ok(effective)
    }

    /// The file that [`Effective::load`] looks for, even if it is missing.
    pub fn path(named: Option<&Path>) -> PathBuf {
        chosen(named).unwrap_or_else(|| DEFAULT_FILE.into())
    }

    /// Takes the robot from its variable and notes the variables that nothing reads. An empty one
    /// counts as not set.
    fn apply_environment(
        &mut self,
        environment: impl IntoIterator<Item = (OsString, OsString)>,
    ) -> Result<(), ConfigError> {
        for (name, value) in environment {
            let name = name.to_string_lossy().into_owned();
            if value.is_empty() || !name.starts_with(PREFIX) {
                continue;
            }
            if name == ROBOT_VARIABLE {
                let robot = value.to_string_lossy().parse();
                self.config.robot = Some(robot.map_err(|error| ConfigError::Invalid {
                    path: format!("${ROBOT_VARIABLE}"),
                    reason: format!("{error}"),
                })?);
                self.is_robot_from_variable = true;
            } else if !self.is_read_elsewhere(&name) {
                self.unread_variables.push(name);
            }
        }
        Ok(())
    }

    /// Whether another part of the program reads a variable, or sets it for programs that it starts.
    fn is_read_elsewhere(&self, name: &str) -> bool {
        [
            FILE_VARIABLE,
            PASSWORD_VARIABLE,
            PASSWORD_PIPE_VARIABLE,
            HEALTH_PORT_VARIABLE,
        ]
        .contains(&name)
            || notify::PROGRAM_VARIABLES.contains(&name)
            || OTHER_PREFIXES.iter().any(|prefix| name.starts_with(prefix))
    }

    /// The config file if it was found in the current folder, not named: it may come from anywhere,
    /// such as an archive.
    pub fn found_file(&self) -> Option<&Path> {
        match &self.file {
            Some((path, _)) if !self.is_file_named => Some(path),
            _ => None,
        }
    }

    /// All values with their origins, in the order of the keys.
    pub fn settings(&self) -> Vec<Setting> {
        let Ok(mut tree) = serde_yaml::to_value(&self.config) else {
            return Vec::new();
        };
        let mut written = Value::Null;
        let mut file = String::new();
        if let Some((path, text)) = &self.file {
            written = serde_yaml::from_str(text).unwrap_or_default();
            file = path.display().to_string();
        }
        // Behaviours are not serialized: they are shown as the file has them.
        if let (Some(map), Some(behaviours)) = (tree.as_mapping_mut(), written.get("behaviours")) {
            map.insert("behaviours".into(), behaviours.clone());
        }
        let mut settings = Vec::new();
        collect(&tree, Some(&written), &file, String::new(), &mut settings);
        if self.is_robot_from_variable {
            for setting in settings.iter_mut().filter(|setting| setting.key == "robot") {
                setting.origin = format!("${ROBOT_VARIABLE}");
            }
        }
        settings
    }
}

/// The file that a person has chosen: the named one, or else that of the variable.
fn chosen(named: Option<&Path>) -> Option<PathBuf> {
    let of_variable = || std::env::var_os(FILE_VARIABLE).filter(|name| !name.is_empty());
    let named = named.map(Path::to_owned);
    named.or_else(|| of_variable().map(PathBuf::from))
}

/// Appends the leaves of a tree: scalars, empty mappings, and lists without mappings. `written` is
/// what the file has at this key.
fn collect(
    tree: &Value,
    written: Option<&Value>,
    file: &str,
    key: String,
    settings: &mut Vec<Setting>,
) {
    match tree {
        Value::Mapping(map) if !map.is_empty() => {
            for (name, value) in map {
                let name = name.as_str().unwrap_or_default();
                let inner = if key.is_empty() {
                    name.to_owned()
                } else {
                    format!("{key}.{name}")
                };
                let written = written.and_then(|written| written.get(name));
                collect(value, written, file, inner, settings);
            }
        }
        Value::Sequence(list) if list.iter().any(Value::is_mapping) => {
            for (index, value) in list.iter().enumerate() {
                let written = written.and_then(|written| written.get(index));
                collect(value, written, file, format!("{key}[{index}]"), settings);
            }
        }
        _ => {
            let origin = if written.is_some() { file } else { "default" };
            settings.push(Setting {
                key,
                value: tree.clone(),
                origin: origin.to_owned(),
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn load(file: &str, variables: &[(&str, &str)]) -> Result<Effective, ConfigError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(DEFAULT_FILE);
        std::fs::write(&path, file).unwrap();
        let mut effective = Effective::load_file(Some(&path))?;
        let variables = variables.iter();
        effective.apply_environment(variables.map(|(name, value)| (name.into(), value.into())))?;
        Ok(effective)
    }

    #[test]
    fn the_variable_overrides_the_file_overrides_the_default_and_origins_are_known() {
        let file = "robot: 10.0.0.1\nwatchdog:\n  low: 25\nbehaviours:\n- file: a.lua\n";
        let effective = load(file, &[("SPYKEE_ROBOT", "10.0.0.2")]).unwrap();
        assert_eq!(effective.config.watchdog.low.get(), 25);
        let robot = effective.config.robot.as_ref().unwrap();
        assert_eq!(robot.host, "10.0.0.2");
        let settings = effective.settings();
        let path = effective.file.unwrap().0.display().to_string();
        for (key, origin) in [
            ("robot", "$SPYKEE_ROBOT"),
            ("watchdog.low", &path),
            ("behaviours[0].file", &path),
            ("watchdog.critical", "default"),
        ] {
            let setting = settings.iter().find(|one| one.key == key).unwrap();
            assert_eq!(setting.origin, origin, "{key}");
        }
    }

    #[test]
    fn the_error_for_an_invalid_robot_names_the_variable_and_the_expected_form() {
        let error = load("", &[("SPYKEE_ROBOT", "http://x")]).unwrap_err();
        let text = error.to_string();
        assert!(text.starts_with("$SPYKEE_ROBOT: expected HOST"), "{text}");
    }

    #[test]
    fn variables_that_nothing_reads_are_noted() {
        let environment = [
            ("SPYKEE_WATCHDOG_LOW", "25"),
            ("SPYKEE_CONFIG", "a.yaml"),
            ("SPYKEE_PASSWORD", "b"),
            ("SPYKEE_HEALTH_PORT", "7788"),
            ("SPYKEE_ROBOT_NAME", "c"),
            ("SPYKEE_PICTURE", "d.jpg"),
            ("SPYKEE_TEST_FLEET", "1"),
            ("SPYKEE_PORT_7788_TCP", "tcp://10.96.0.7:7788"),
            ("SPYKEE_SERVICE_HOST", "10.96.0.7"),
            ("SPYKEE_USER", ""),
            ("WATCHDOG_LO", "25"),
        ];
        let effective = load("", &environment).unwrap();
        assert_eq!(effective.unread_variables, ["SPYKEE_WATCHDOG_LOW"]);
    }

    #[test]
    fn every_setting_can_be_written_and_read_back() {
        let file = "colours: { sock: { h: [270, 310], s: [30, 100], v: [20, 100] } }";
        let effective = load(file, &[]).unwrap();
        let text = serde_yaml::to_string(&effective.config).unwrap();
        let again = Config::parse(&text, "again").unwrap();
        assert_eq!(serde_yaml::to_string(&again).unwrap(), text);
    }
}
