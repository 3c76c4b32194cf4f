//! A robot's address: `HOST[:PORT]` as people write it.

use std::fmt;
use std::net::Ipv6Addr;
use std::str::FromStr;

use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::wire;
use crate::yaml;

/// A robot's address: a name, an IPv4 address, or an IPv6 address in brackets, and a port
/// ([`wire::PORT`] unless given).
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Target {
    /// Name or address, without brackets.
    pub host: String,
    pub port: u16,
}

#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TargetError {
    /// The part before the port is not a host.
    #[error(
        "expected HOST[:PORT], such as 172.17.6.1, robot.local:9000 or [::1]:9000, found `{0}`"
    )]
    Host(String),
    #[error("expected a port from 1 to 65535, found `{0}`")]
    Port(String),
    #[error("write an IPv6 address in brackets: [{0}] or [{0}]:{port}", port = wire::PORT)]
    Brackets(String),
}

impl FromStr for Target {
    type Err = TargetError;

    fn from_str(text: &str) -> Result<Target, TargetError> {
        let (written, port) = match text.rsplit_once(':') {
            Some((host, port)) if host_of(text).is_none() => (host, Some(port)),
            _ => (text, None),
        };
        let host = match host_of(written) {
            Some(host) if !text.contains('/') => host,
            _ => return Err(TargetError::Host(text.to_owned())),
        };
        if written.contains(':') && !written.starts_with('[') {
            return Err(TargetError::Brackets(written.to_owned()));
        }
        Ok(Target {
            host: host.to_owned(),
            port: port.map_or(Ok(wire::PORT), parse_port)?,
        })
    }
}

fn parse_port(text: &str) -> Result<u16, TargetError> {
    let digits = text.bytes().all(|byte| byte.is_ascii_digit());
    let port = text.parse().ok().filter(|&port| digits && port != 0);
    port.ok_or_else(|| TargetError::Port(text.to_owned()))
}

impl fmt::Display for Target {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.host.contains(':') {
            write!(f, "[{}]:{}", self.host, self.port)
        } else {
            write!(f, "{}:{}", self.host, self.port)
        }
    }
}

impl Serialize for Target {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for Target {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Target, D::Error> {
        yaml::parsed_text(deserializer, "HOST[:PORT]", Target::from_str)
    }
}

/// Returns the host without brackets; `None` if the text is not one. Brackets may surround an IPv6
/// address, which may name its zone: `[fe80::1%wlan0]`.
pub fn host_of(text: &str) -> Option<&str> {
    let inside = text
        .strip_prefix('[')
        .and_then(|text| text.strip_suffix(']'));
    match inside {
        Some(address) => is_ipv6(address).then_some(address),
        None => (is_host_name(text) || is_ipv6(text)).then_some(text),
    }
}

/// Whether a text may be a name or an IPv4 address.
pub fn is_host_name(text: &str) -> bool {
    let named = |c: char| c.is_alphanumeric() || matches!(c, '.' | '-' | '_');
    !text.is_empty() && text.chars().all(named)
}

fn is_ipv6(text: &str) -> bool {
    let (address, zone) = match text.split_once('%') {
        Some((address, zone)) => (address, Some(zone)),
        None => (text, None),
    };
    address.parse::<Ipv6Addr>().is_ok() && zone.is_none_or(is_host_name)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn the_port_may_be_left_out() {
        for (text, shown) in [
            ("172.17.6.1", "172.17.6.1:9000"),
            ("robot.local:9001", "robot.local:9001"),
            ("[::1]", "[::1]:9000"),
            ("[fe80::1%wlan0]:80", "[fe80::1%wlan0]:80"),
        ] {
            assert_eq!(text.parse::<Target>().unwrap().to_string(), shown);
        }
    }

    #[test]
    fn an_invalid_address_is_refused_with_the_expected_format() {
        for text in [
            "",
            ":9000",
            "http://robot",
            "a b",
            "[::1",
            "[::1]9000",
            "admin@robot",
            "a:b:c",
            "[robot]",
            "robot%wlan0",
            "fe80::1%",
            "[fe80::1%]:9000",
        ] {
            let error = text.parse::<Target>().unwrap_err();
            assert!(matches!(error, TargetError::Host(_)), "{text}: {error}");
        }
        for text in ["robot:", "robot:0", "robot:65536", "robot:+80", "robot:x"] {
            let error = text.parse::<Target>().unwrap_err();
            assert!(matches!(error, TargetError::Port(_)), "{text}: {error}");
        }
        for (text, told) in [
            ("::1", "in brackets: [::1] or [::1]:9000"),
            ("fe80::1%wlan0:80", "in brackets: [fe80::1%wlan0] or"),
        ] {
            let error = text.parse::<Target>().unwrap_err();
            assert!(error.to_string().contains(told), "{error}");
        }
    }

    #[test]
    fn a_bad_address_in_yaml_is_refused_with_its_position() {
        let yaml = "- robot\n- robot:x";
        let error = serde_yaml::from_str::<Vec<Target>>(yaml).unwrap_err();
        assert!(error.to_string().contains("line 2"), "{error}");
    }

    proptest! {
        #[test]
        fn no_text_panics_and_accepted_ones_round_trip(text in ".{0,40}") {
            if let Ok(target) = text.parse::<Target>() {
                prop_assert_eq!(target.to_string().parse::<Target>(), Ok(target));
            }
        }
    }

    #[test]
    fn names_and_addresses_are_hosts() {
        for (text, host) in [
            ("broker.local", "broker.local"),
            ("my_robot-2", "my_robot-2"),
            ("172.17.6.1", "172.17.6.1"),
            ("::1", "::1"),
            ("[::1]", "::1"),
            ("fe80::1%wlan0", "fe80::1%wlan0"),
            ("[fe80::1%eth0.7]", "fe80::1%eth0.7"),
        ] {
            assert_eq!(host_of(text), Some(host));
        }
        for text in [
            "",
            "a b",
            "me@robot",
            "robot:80",
            "a:b:c",
            "fe80::1%",
            "[fe80::1%]",
            "fe80::1%a:b",
            "fe80::1%a%b",
            "robot%wlan0",
            "%wlan0",
            "[robot]",
            "[172.17.6.1]",
            "[]",
            "[[::1]]",
            "[::1",
            "::1]",
        ] {
            assert_eq!(host_of(text), None, "{text}");
        }
    }
}
