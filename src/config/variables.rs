//! The `SPYKEE_...` variables of the environment. One that nothing reads is refused, as an unknown
//! key of a config is: a misspelt limit must not be ignored.

use std::collections::BTreeMap;
use std::ffi::{OsStr, OsString};

use super::{Config, ConfigError};
use crate::{notify, script};

/// The variable with the robot's password.
pub const PASSWORD_VARIABLE: &str = "SPYKEE_PASSWORD";
/// The variable that tells the restarted program from which pipe to read the password.
pub const PASSWORD_PIPE_VARIABLE: &str = "SPYKEE_PASSWORD_PIPE";
/// The variable that names the config file.
pub(super) const FILE_VARIABLE: &str = "SPYKEE_CONFIG";
/// The variable with the port for the container's health check, which is a program of its own
/// (`scripts/packaging/container-health`).
const HEALTH_PORT_VARIABLE: &str = "SPYKEE_HEALTH_PORT";

/// The beginning of all names.
const PREFIX: &str = "SPYKEE_";
/// The beginnings of the names that this program's tests and benchmarks read; the programs that
/// they start inherit them.
const PREFIXES_OF_TESTS: [&str; 2] = ["SPYKEE_BENCH_", "SPYKEE_TEST_"];

/// The variable that overrides a key of the config.
pub(super) fn variable_of(key: &str) -> String {
    format!("{PREFIX}{}", key.replace('.', "_").to_uppercase())
}

/// The variables that are set. An empty one counts as not set.
pub(super) struct Variables {
    /// Those that have not been taken.
    rest: BTreeMap<String, OsString>,
    /// The names of all that can be taken.
    known: Vec<String>,
}

impl Variables {
    /// Selects the variables of this program from an environment.
    pub(super) fn of(environment: impl IntoIterator<Item = (OsString, OsString)>) -> Variables {
        let named = environment
            .into_iter()
            .map(|(name, value)| (name.to_string_lossy().into_owned(), value));
        Variables {
            rest: named
                .filter(|(name, value)| name.starts_with(PREFIX) && !value.is_empty())
                .collect(),
            known: Vec::new(),
        }
    }

    /// The value of a variable, if it is set.
    ///
    /// # Errors
    /// It is not UTF-8.
    pub(super) fn take(&mut self, name: &str) -> Result<Option<String>, ConfigError> {
        self.known.push(name.to_owned());
        let value = self.rest.remove(name).map(OsString::into_string);
        value
            .transpose()
            .map_err(|_| invalid(name, "it is not UTF-8".to_owned()))
    }

    /// Refuses a variable that was not taken and that no other part of the program reads.
    ///
    /// # Errors
    /// The first such variable, and the nearest known name.
    pub(super) fn check_rest(&self, config: &Config) -> Result<(), ConfigError> {
        let mut rest = self.rest.iter();
        let unknown = rest.find(|(name, value)| {
            !is_read_elsewhere(name, config) && !is_of_kubernetes(name, value)
        });
        match unknown {
            Some((name, _)) => Err(self.unknown(name)),
            None => Ok(()),
        }
    }

    fn unknown(&self, name: &str) -> ConfigError {
        let known = self.known.iter().map(String::as_str);
        let known = known.chain([FILE_VARIABLE, PASSWORD_VARIABLE]);
        let reason = match script::nearest(bare(name), known.map(bare)) {
            Some(near) => format!("spykee reads no such variable; did you mean {PREFIX}{near}?"),
            None => "spykee reads no such variable: unset it, or rename it if another program \
                     needs it; lists such as `behaviours` can only be set in a config file"
                .to_owned(),
        };
        invalid(name, reason)
    }
}

/// A name without the prefix, which would make all names similar.
fn bare(name: &str) -> &str {
    name.strip_prefix(PREFIX).unwrap_or(name)
}

/// Whether a variable is read by another part of the program, or set for programs that it starts.
fn is_read_elsewhere(name: &str, config: &Config) -> bool {
    let mut targets = config.notify.targets.values();
    [
        FILE_VARIABLE,
        PASSWORD_VARIABLE,
        PASSWORD_PIPE_VARIABLE,
        HEALTH_PORT_VARIABLE,
    ]
    .contains(&name)
        || notify::PROGRAM_VARIABLES.contains(&name)
        || PREFIXES_OF_TESTS
            .iter()
            .any(|prefix| name.starts_with(prefix))
        || targets.any(|target| target.token_env.as_deref() == Some(name))
}

/// Whether this is one of the variables that Kubernetes sets in each container beside a service
/// named `spykee`, such as `SPYKEE_SERVICE_HOST` and `SPYKEE_PORT_7788_TCP`.
fn is_of_kubernetes(name: &str, value: &OsStr) -> bool {
    let (name, value) = (bare(name), value.to_string_lossy());
    let of_service = name.ends_with("SERVICE_HOST") || name.contains("SERVICE_PORT");
    let mut protocols = ["TCP", "UDP", "SCTP"].into_iter();
    let of_port = protocols.any(|protocol| {
        let is_part = name.contains("PORT_") && name.contains(&format!("_{protocol}"));
        let url = format!("{}://", protocol.to_lowercase());
        is_part || name.ends_with("PORT") && value.starts_with(&url)
    });
    of_service || of_port
}

fn invalid(name: &str, reason: String) -> ConfigError {
    ConfigError::Invalid {
        path: format!("${name}"),
        reason,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::ffi::OsStringExt as _;

    /// The error for one variable, after these two have been taken.
    fn refusal(name: &str, value: OsString, config: &str) -> Option<String> {
        let mut variables = Variables::of([(name.into(), value)]);
        for key in ["watchdog.low", "limits.memory_bytes"] {
            if let Err(error) = variables.take(&variable_of(key)) {
                return Some(error.to_string());
            }
        }
        let config = Config::parse(config, "test").unwrap();
        let refused = variables.check_rest(&config);
        refused.err().map(|error| error.to_string())
    }

    #[test]
    fn an_unknown_variable_is_refused_with_the_nearest_one() {
        for (name, told) in [
            ("SPYKEE_WATCHDOG_LO", "did you mean SPYKEE_WATCHDOG_LOW?"),
            ("SPYKEE_watchdog_low", "did you mean SPYKEE_WATCHDOG_LOW?"),
            (
                "SPYKEE_LIMIT_MEMORY_BYTES",
                "did you mean SPYKEE_LIMITS_MEMORY_BYTES?",
            ),
            ("SPYKEE_PASWORD", "did you mean SPYKEE_PASSWORD?"),
            ("SPYKEE_BEHAVIOURS", "unset it"),
            ("SPYKEE_", "unset it"),
        ] {
            let text = refusal(name, "25".into(), "").unwrap();
            let begins = text.starts_with(&format!("${name}: "));
            assert!(begins && text.contains(told), "{text}");
        }
        let broken = OsString::from_vec(vec![b'2', 0xff]);
        let text = refusal("SPYKEE_WATCHDOG_LOW", broken, "").unwrap();
        assert!(text.contains("not UTF-8"), "{text}");
    }

    #[test]
    fn variables_of_other_parts_and_of_other_programs_are_accepted() {
        for name in [
            "SPYKEE_WATCHDOG_LOW",
            "SPYKEE_CONFIG",
            "SPYKEE_PASSWORD",
            "SPYKEE_PASSWORD_PIPE",
            "SPYKEE_HEALTH_PORT",
            "SPYKEE_EVENT",
            "SPYKEE_ROBOT_NAME",
            "SPYKEE_TIME",
            "SPYKEE_PICTURE",
            "SPYKEE_TEST_FLEET",
            "SPYKEE_BENCH_VIEWERS",
            "WATCHDOG_LO",
        ] {
            assert_eq!(refusal(name, "25".into(), ""), None);
        }
        assert_eq!(refusal("SPYKEE_WATCHDOG_LO", OsString::new(), ""), None);
        for (name, value) in [
            ("SPYKEE_SERVICE_HOST", "10.96.0.7"),
            ("SPYKEE_SERVICE_PORT", "7788"),
            ("SPYKEE_SERVICE_PORT_HTTP", "7788"),
            ("SPYKEE_PORT", "tcp://10.96.0.7:7788"),
            ("SPYKEE_PORT_7788_TCP", "tcp://10.96.0.7:7788"),
            ("SPYKEE_PORT_7788_TCP_ADDR", "10.96.0.7"),
        ] {
            assert_eq!(refusal(name, value.into(), ""), None, "{name}");
        }
        assert!(refusal("SPYKEE_PORT", "7788".into(), "").is_some());
        let token = "notify: { targets: { phone: { url: 'https://a/{token}', \
                     token_env: SPYKEE_TOKEN } } }";
        assert_eq!(refusal("SPYKEE_TOKEN", "x".into(), token), None);
        assert!(refusal("SPYKEE_TOKEN", "x".into(), "").is_some());
    }
}
