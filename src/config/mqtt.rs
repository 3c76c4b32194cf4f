//! The `mqtt:` section: the broker through which other programs see and command the robot.

use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Deserializer, Serialize};

use crate::link::{host_of, is_host_name};
use crate::yaml;

const HOST_EXPECTED: &str =
    "the name or the address of a broker, such as broker.local, without scheme and port";

/// The MQTT broker. MQTT is off without a host.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(rename = "MqttOptions")]
pub struct Mqtt {
    /// The broker's name or address, without a port.
    #[serde(deserialize_with = "host")]
    pub host: Option<String>,
    /// The broker's port [default: 1883, with TLS 8883].
    #[serde(deserialize_with = "port")]
    pub port: Option<u16>,
    /// User name for the login.
    pub user: Option<String>,
    /// A file with that user's password in its first line.
    pub password_file: Option<PathBuf>,
    /// Certificates (PEM) of the authorities that sign the broker's certificate; the connection is
    /// encrypted if it is named.
    pub ca_file: Option<PathBuf>,
}

impl Mqtt {
    /// Checks the rules that the types of the fields do not enforce.
    pub fn check(&self) -> Result<(), String> {
        if self.password_file.is_some() && self.user.is_none() {
            return Err("mqtt.password_file needs mqtt.user".to_owned());
        }
        Ok(())
    }

    pub fn address(&self) -> Option<(&str, u16)> {
        let usual = match self.ca_file {
            Some(_) => 8883,
            None => 1883,
        };
        let host = self.host.as_deref()?;
        Some((host, self.port.unwrap_or(usual)))
    }
}

fn host<'de, D: Deserializer<'de>>(from: D) -> Result<Option<String>, D::Error> {
    let host = yaml::text(HOST_EXPECTED, |text| {
        let wrong = || format!("`{text}` is not a host: {}", host_advice(text));
        host_of(text).map(str::to_owned).ok_or_else(wrong)
    });
    yaml::optional(from, host)
}

/// What to write instead of a text that is not a host.
fn host_advice(text: &str) -> String {
    let (scheme, rest) = text.split_once("://").unwrap_or(("", text));
    let rest = rest.trim_end_matches('/');
    let with_port = rest
        .rsplit_once(':')
        .and_then(|(name, port)| Some((name, port.parse::<u16>().ok().filter(|port| *port > 0)?)));
    let advice = match with_port {
        Some((name, port)) if is_host_name(name) => {
            format!("write `host: {name}` and `port: {port}`")
        }
        None if is_host_name(rest) => format!("write `host: {rest}`"),
        _ => format!("expected {HOST_EXPECTED}"),
    };
    match scheme {
        "mqtts" | "ssl" | "tls" => {
            format!("{advice}; `ca_file: ca.pem` turns encryption on")
        }
        _ => advice,
    }
}

fn port<'de, D: Deserializer<'de>>(from: D) -> Result<Option<u16>, D::Error> {
    yaml::optional(from, yaml::whole("a port from 1 to 65535", 1..=65_535))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn checked(text: &str) -> Result<Mqtt, String> {
        let options: Mqtt = serde_yaml::from_str(text).map_err(|error| error.to_string())?;
        options.check().map(|()| options)
    }

    #[test]
    fn the_error_for_an_invalid_value_names_its_key() {
        for (text, words) in [
            ("{ port: 0 }", "a port"),
            ("{ password_file: a }", "mqtt.user"),
        ] {
            let error = checked(text).unwrap_err();
            assert!(error.contains(words), "{text}: {error}");
        }
    }

    #[test]
    fn a_host_with_scheme_or_port_is_refused_with_what_to_write() {
        for (host, told) in [
            ("broker:1884", "write `host: broker` and `port: 1884`"),
            ("mqtt://broker", "write `host: broker`"),
            (
                "mqtt://10.0.0.7:1883/",
                "write `host: 10.0.0.7` and `port: 1883`",
            ),
            ("mqtts://broker", "`ca_file: ca.pem`"),
            ("broker:0", "expected the name or the address"),
            ("''", "expected the name or the address"),
            ("me@broker", "expected the name or the address"),
            ("'[::1]:1883'", "expected the name or the address"),
            ("'fe80::1%'", "expected the name or the address"),
            ("'[broker]'", "expected the name or the address"),
            ("{ name: broker }", "expected the name or the address"),
        ] {
            let error = checked(&format!("user: me\nhost: {host}\n")).unwrap_err();
            let placed = error.starts_with("host: ") && error.contains("line 2 column 7");
            assert!(placed && error.contains(told), "{host}: {error}");
        }
        for host in [
            "broker.local",
            "my_broker-2",
            "10.0.0.7",
            "'::1'",
            "'[::1]'",
            "'fe80::1%wlan0'",
        ] {
            checked(&format!("host: {host}\n")).unwrap();
        }
        let address = checked("host: '[::1]'\n").unwrap();
        assert_eq!(address.host.as_deref(), Some("::1"));
    }

    #[test]
    fn the_default_port_depends_on_the_encryption() {
        let address = |text| checked(text).unwrap().address().map(|(_, port)| port);
        assert_eq!(address("{}"), None);
        assert_eq!(address("{ host: a }"), Some(1883));
        assert_eq!(address("{ host: a, ca_file: b }"), Some(8883));
        assert_eq!(address("{ host: a, port: 7 }"), Some(7));
    }
}
