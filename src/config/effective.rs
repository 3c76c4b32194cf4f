//! The effective settings and their origins: the environment overrides the file, which overrides
//! the defaults. Flags override all of them; only the command line knows them.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fmt;
use std::path::{Path, PathBuf};

use serde_yaml::Value;

use super::place::{self, Step};
use super::variables::{FILE_VARIABLE, Variables, variable_of};
use super::{Config, ConfigError, in_words};

/// The config that is read if it is in the current folder and no other is named.
const DEFAULT_FILE: &str = "spykee.yaml";

/// Where a value comes from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Origin {
    /// This flag of the command line.
    Flag(&'static str),
    /// This environment variable.
    Environment(String),
    /// The config file.
    File {
        /// Its path.
        path: PathBuf,
        /// The line, from 1.
        line: usize,
    },
    /// The default.
    Default,
}

impl fmt::Display for Origin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Origin::Flag(flag) => f.write_str(flag),
            Origin::Environment(variable) => write!(f, "${variable}"),
            Origin::File { path, line } => write!(f, "{}:{line}", path.display()),
            Origin::Default => f.write_str("default"),
        }
    }
}

/// One value with its key, such as `watchdog.low`.
#[derive(Debug, Clone, PartialEq)]
pub struct Setting {
    /// Names joined by dots; elements of lists in brackets.
    pub key: String,
    /// The value.
    pub value: Value,
    /// The origin of the value.
    pub origin: Origin,
}

/// How a config was selected.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Named {
    /// A person named it.
    Chosen,
    /// It was found in the current folder, so it may come from anywhere, such as an archive.
    #[default]
    Found,
}

/// Settings with their origins.
#[derive(Debug, Clone, Default)]
pub struct Effective {
    /// The settings.
    pub config: Config,
    /// The file from which they were read, and its text.
    pub file: Option<(PathBuf, String)>,
    named: Named,
    variables: BTreeMap<String, String>,
}

impl Effective {
    /// Loads the settings from the named file, or else from `$SPYKEE_CONFIG`, or else from
    /// `spykee.yaml` in the current folder if it exists, and from the `SPYKEE_...` variables, of
    /// which an unknown one is refused.
    ///
    /// # Errors
    /// See [`ConfigError`].
    pub fn load(named: Option<&Path>) -> Result<Effective, ConfigError> {
        Effective::of(chosen(named), Path::new(DEFAULT_FILE), std::env::vars_os())
    }

    /// Loads the settings from the same file as [`Effective::load`], but not from variables.
    ///
    /// # Errors
    /// See [`ConfigError`].
    pub fn load_file(named: Option<&Path>) -> Result<Effective, ConfigError> {
        Effective::of(chosen(named), Path::new(DEFAULT_FILE), [])
    }

    /// The file that [`Effective::load`] looks for, even if it is missing.
    pub fn path(named: Option<&Path>) -> PathBuf {
        chosen(named).unwrap_or_else(|| DEFAULT_FILE.into())
    }

    fn of(
        chosen: Option<PathBuf>,
        default_file: &Path,
        environment: impl IntoIterator<Item = (OsString, OsString)>,
    ) -> Result<Effective, ConfigError> {
        let mut variables = Variables::of(environment);
        let mut effective = Effective {
            named: match chosen {
                Some(_) => Named::Chosen,
                None => Named::Found,
            },
            ..Effective::default()
        };
        let path = chosen.or_else(|| default_file.is_file().then(|| default_file.to_owned()));
        if let Some(path) = path {
            let text = Config::read(&path)?;
            effective.config = Config::of_text(&text, &path)?;
            effective.file = Some((path, text));
        }
        for key in keys() {
            let name = variable_of(&key);
            if let Some(text) = variables.take(&name)? {
                effective.config = overridden(&effective.config, &key, &text, &name)?;
                effective.variables.insert(key, name);
            }
        }
        variables.check_rest(&effective.config)?;
        let limits = effective.config.watchdog.check();
        let limits = limits.map_err(|error| error.to_string());
        let checked = limits.and_then(|()| {
            let mqtt = effective.config.mqtt.check();
            mqtt.map_err(|error| error.to_string())
        });
        checked.map_err(|reason| invalid("the environment", &reason))?;
        Ok(effective)
    }

    /// The config file and how it was selected; `None` if there is no file or a variable overrides
    /// this key.
    pub fn file_of(&self, key: &str) -> Option<(&Path, Named)> {
        let (path, _) = self.file.as_ref()?;
        (!self.variables.contains_key(key)).then_some((path, self.named))
    }

    /// All values with their origins, in the order of the keys.
    pub fn settings(&self) -> Vec<Setting> {
        let mut settings = Vec::new();
        if let Ok(mut tree) = serde_yaml::to_value(&self.config) {
            if let (Some(map), Some(behaviours)) = (tree.as_mapping_mut(), self.behaviours()) {
                map.insert("behaviours".into(), behaviours);
            }
            leaves(&tree, &mut Vec::new(), &mut |steps, value| {
                let (key, value) = (dotted_key(steps), value.clone());
                let origin = self.origin(&key, steps);
                settings.push(Setting { key, value, origin });
            });
        }
        settings
    }

    /// The `behaviours:` as written in the file.
    fn behaviours(&self) -> Option<Value> {
        let (_, text) = self.file.as_ref()?;
        let tree: Value = serde_yaml::from_str(text).ok()?;
        tree.get("behaviours").cloned()
    }

    fn origin(&self, key: &str, steps: &[Step]) -> Origin {
        if let Some(variable) = self.variables.get(key) {
            return Origin::Environment(variable.clone());
        }
        let in_file = self.file.as_ref().and_then(|(path, text)| {
            let (line, _) = place::find(text, steps)?;
            let path = path.clone();
            Some(Origin::File { path, line })
        });
        in_file.unwrap_or(Origin::Default)
    }
}

/// The file that a person has chosen: the named one, or else that of the variable.
fn chosen(named: Option<&Path>) -> Option<PathBuf> {
    let of_variable = || std::env::var_os(FILE_VARIABLE).filter(|name| !name.is_empty());
    let named = named.map(Path::to_owned);
    named.or_else(|| of_variable().map(PathBuf::from))
}

/// All keys with a single value, as opposed to a list or a mapping.
pub(super) fn keys() -> Vec<String> {
    let mut keys = Vec::new();
    if let Ok(tree) = serde_yaml::to_value(Config::default()) {
        leaves(&tree, &mut Vec::new(), &mut |steps, value| {
            if !value.is_sequence() && !value.is_mapping() {
                keys.push(dotted_key(steps));
            }
        });
    }
    keys
}

/// Calls `found` for each leaf of the tree: scalars, empty mappings, and lists without mappings.
fn leaves(tree: &Value, steps: &mut Vec<Step>, found: &mut impl FnMut(&[Step], &Value)) {
    match tree {
        Value::Mapping(map) if !map.is_empty() => {
            for (key, value) in map {
                steps.push(Step::Key(key.as_str().unwrap_or_default().to_owned()));
                leaves(value, steps, found);
                steps.pop();
            }
        }
        Value::Sequence(list) if list.iter().any(|item| item.is_mapping()) => {
            for (index, value) in list.iter().enumerate() {
                steps.push(Step::Index(index));
                leaves(value, steps, found);
                steps.pop();
            }
        }
        value => found(steps, value),
    }
}

fn dotted_key(steps: &[Step]) -> String {
    let mut key = String::new();
    for step in steps {
        match step {
            Step::Key(name) if key.is_empty() => key.push_str(name),
            Step::Key(name) => key.push_str(&format!(".{name}")),
            Step::Index(index) => key.push_str(&format!("[{index}]")),
        }
    }
    key
}

/// The config with one value replaced by this text. Errors come from the config's own types.
fn overridden(
    config: &Config,
    key: &str,
    text: &str,
    variable: &str,
) -> Result<Config, ConfigError> {
    let whole = serde_yaml::to_value(config);
    let mut tree = whole.map_err(|error| invalid(variable, &error.to_string()))?;
    let as_yaml = serde_yaml::from_str(text).unwrap_or(Value::Null);
    let as_text = Value::String(text.to_owned());
    let mut refusal = String::new();
    for value in [as_yaml, as_text] {
        if let Some(place) = value_at(&mut tree, key) {
            *place = value;
        }
        match serde_yaml::from_value(tree.clone()) {
            // Behaviours are not serialized, so copy them. No variable can change them.
            Ok(read) => {
                let behaviours = config.behaviours.clone();
                return Ok(Config { behaviours, ..read });
            }
            Err(error) if refusal.is_empty() => refusal = error.to_string(),
            Err(_) => {}
        }
    }
    Err(invalid(&format!("${variable}"), &in_words(&refusal)))
}

fn value_at<'a>(tree: &'a mut Value, key: &str) -> Option<&'a mut Value> {
    key.split('.')
        .try_fold(tree, |tree, name| tree.as_mapping_mut()?.get_mut(name))
}

fn invalid(path: &str, reason: &str) -> ConfigError {
    ConfigError::Invalid {
        path: path.to_owned(),
        reason: reason.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn load(file: &str, variables: &[(&str, &str)]) -> Result<Effective, ConfigError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(DEFAULT_FILE);
        std::fs::write(&path, file).unwrap();
        let environment = variables
            .iter()
            .map(|(name, value)| (OsString::from(name), OsString::from(value)));
        Effective::of(None, &path, environment)
    }

    fn setting(effective: &Effective, key: &str) -> Setting {
        let mut all = effective.settings().into_iter();
        all.find(|setting| setting.key == key).unwrap()
    }

    #[test]
    fn environment_overrides_file_overrides_default_and_origins_are_known() {
        let file = "robot: 10.0.0.1\nwatchdog:\n  low: 25\n  ok: 60\nbehaviours:\n- file: a.lua\n";
        let effective = load(file, &[("SPYKEE_WATCHDOG_LOW", "30"), ("SPYKEE_USER", "7")]).unwrap();
        assert_eq!(effective.config.watchdog.low.get(), 30);
        assert_eq!(effective.config.user.as_deref(), Some("7"));
        assert_eq!(
            setting(&effective, "watchdog.low").origin,
            Origin::Environment("SPYKEE_WATCHDOG_LOW".to_owned())
        );
        let line = |key| match setting(&effective, key).origin {
            Origin::File { line, .. } => line,
            other => panic!("{other}"),
        };
        assert_eq!((line("robot"), line("watchdog.ok")), (1, 4));
        assert_eq!(line("behaviours[0].file"), 6);
        assert_eq!(
            setting(&effective, "watchdog.critical").origin,
            Origin::Default
        );
    }

    #[test]
    fn the_error_for_an_invalid_variable_names_it_and_the_expected_form() {
        for (variable, value) in [
            ("SPYKEE_WATCHDOG_LOW", "150"),
            ("SPYKEE_CALIBRATION_FULL_SPEED", "fast"),
            ("SPYKEE_ROBOT", "http://x"),
            ("SPYKEE_LOGGING_LEVEL", "loud"),
            ("SPYKEE_LIVE_VIEWERS", "many"),
            ("SPYKEE_LIVE_LISTEN", "7788"),
            ("SPYKEE_LIVE_LISTEN", "localhost"),
        ] {
            let text = load("", &[(variable, value)]).unwrap_err().to_string();
            let told = text.contains(variable) && text.contains("expected");
            let technical = text.contains("u64") || text.contains("socket address");
            assert!(told && !technical, "{text}");
        }
        let text = load("", &[("SPYKEE_WATCHDOG_LOW", "90")]).unwrap_err();
        assert!(text.to_string().contains("must rise"), "{text}");
    }

    #[test]
    fn every_setting_has_a_variable_and_a_misspelt_one_is_refused() {
        let names = keys().into_iter().map(|key| variable_of(&key));
        for name in names.chain([FILE_VARIABLE.to_owned()]) {
            let misspelt = format!("{name}X");
            let text = load("", &[(misspelt.as_str(), "1")])
                .unwrap_err()
                .to_string();
            let told = format!("${misspelt}: spykee reads no such variable; did you mean {name}?");
            assert_eq!(text, told);
        }
    }

    #[test]
    fn every_setting_can_be_written_and_read_back() {
        let effective = load(
            "colours: { sock: { h: [270, 310], s: [30, 100], v: [20, 100] } }",
            &[],
        )
        .unwrap();
        let text = serde_yaml::to_string(&effective.config).unwrap();
        let again = Config::parse(&text, "again").unwrap();
        assert_eq!(serde_yaml::to_string(&again).unwrap(), text);
    }
}
