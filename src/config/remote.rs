//! The `remote:` section: a service on another computer.

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

use schemars::JsonSchema;
use serde::{Deserialize, Deserializer, Serialize};
use ureq::http::Uri;

use crate::{sanitize, yaml};

/// The service on another computer that `spykee status`, `behaviour` and `robot` use; the command
/// line can name another.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Remote {
    /// The address of its JSON API, such as `http://10.0.0.7:7788`.
    #[schemars(with = "Option<String>")]
    pub url: Option<ServiceUrl>,
    /// A file with a token of that service in its first line.
    pub token_file: Option<PathBuf>,
}

/// The address of a service, `http://HOST:PORT` or `https://HOST`, without a trailing slash.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct ServiceUrl(String);

impl FromStr for ServiceUrl {
    type Err = String;

    fn from_str(text: &str) -> Result<ServiceUrl, String> {
        let wrong = || {
            format!(
                "expected http://HOST:PORT or https://HOST, such as http://10.0.0.7:7788, found `{}`",
                sanitize::line(text)
            )
        };
        let url = text.trim_end_matches('/');
        let parsed: Uri = url.parse().map_err(|_| wrong())?;
        let known = matches!(parsed.scheme_str(), Some("http" | "https"));
        let host = parsed.host().is_some_and(|host| !host.is_empty());
        let port = parsed.port_u16().is_some_and(|port| port > 0);
        let bare = parsed.authority().map(|one| one.as_str()) == parsed.host();
        let plain = parsed.path() == "/" && parsed.query().is_none();
        if !(known && host && plain && (port || bare)) || url.contains(['@', '#']) {
            return Err(wrong());
        }
        Ok(ServiceUrl(url.to_owned()))
    }
}

impl fmt::Display for ServiceUrl {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl<'de> Deserialize<'de> for ServiceUrl {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<ServiceUrl, D::Error> {
        let expected = "http://HOST:PORT or https://HOST";
        yaml::parsed_text(from, expected, ServiceUrl::from_str)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_checked_when_the_config_is_read() {
        for (written, url) in [
            ("http://10.0.0.7:7788/", "http://10.0.0.7:7788"),
            ("https://robot.example", "https://robot.example"),
            ("http://[::1]:7788", "http://[::1]:7788"),
            ("http://[::1]", "http://[::1]"),
        ] {
            let remote: Remote = serde_yaml::from_str(&format!("url: {written}\n")).unwrap();
            assert_eq!(remote.url.unwrap().to_string(), url);
        }
        for wrong in [
            "''",
            "10.0.0.7:7788",
            "robot.local",
            "ftp://host",
            "http://",
            "http://host/path",
            "http://host?x=1",
            "'http://host:7788/#x'",
            "'http://host:'",
            "http://host:0",
            "http://host:77880",
            "http://user:word@host",
        ] {
            let read = serde_yaml::from_str::<Remote>(&format!("token_file: a\nurl: {wrong}\n"));
            let error = read.unwrap_err().to_string();
            let told = error.starts_with("url: expected http://HOST:PORT or https://HOST");
            assert!(told && error.contains("line 2 column 6"), "{error}");
        }
    }
}
