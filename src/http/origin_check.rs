//! Checks that a request is addressed to us and comes from our own page. Pure.
//!
//! The owner of another web page can make its host name resolve to our address (DNS rebinding), and
//! any page can send requests to us. The first case is detected by a `Host` that is not ours, the
//! second by an `Origin` that differs from the `Host`; browsers do not let a page forge either
//! header.

use std::net::{IpAddr, SocketAddr};

#[derive(Debug, Clone, Copy, Default)]
pub(super) struct OriginHeaders<'a> {
    pub host: Option<&'a str>,
    pub origin: Option<&'a str>,
    /// Its `Sec-Fetch-Site`, if it has one.
    pub site: Option<&'a str>,
    /// Whether it is more than a GET or HEAD request, opens a WebSocket, or switches the camera on.
    pub changes_state: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub(super) enum Reason {
    /// The `Host` is not one of our names, or is missing.
    #[error(
        "unknown host name in the request: add it to the config with `live: {{ hosts: [NAME] }}`"
    )]
    Host,
    #[error("the request comes from another site's page")]
    Origin,
}

#[derive(Debug, Clone)]
pub(super) struct Names {
    listen: SocketAddr,
    /// From the config.
    more: Vec<String>,
    /// This computer's, without a domain.
    own: String,
}

/// Domains of home networks, which nobody can register: the names in them are given by the network
/// of the visitor.
const HOME_DOMAINS: [&str; 3] = ["local", "lan", "home.arpa"];

impl Names {
    /// `host_name` is that of this computer.
    pub(super) fn new(listen: SocketAddr, more: &[String], host_name: &str) -> Names {
        let more = more.iter().map(|name| name.to_ascii_lowercase()).collect();
        let own = host_name.split('.').next().unwrap_or_default();
        Names {
            listen,
            more,
            own: own.to_ascii_lowercase(),
        }
    }

    pub(super) fn validate(&self, request: OriginHeaders<'_>) -> Result<(), Reason> {
        let host = request.host.ok_or(Reason::Host)?.to_ascii_lowercase();
        if !self.is_ours(&host) {
            return Err(Reason::Host);
        }
        let same = |origin: &str| {
            let authority = origin
                .strip_prefix("http://")
                .or(origin.strip_prefix("https://"));
            authority.is_some_and(|authority| authority.eq_ignore_ascii_case(&host))
        };
        let foreign = matches!(request.site, Some("cross-site" | "same-site"));
        match request.origin {
            Some(origin) if !same(origin) => Err(Reason::Origin),
            None if request.changes_state && foreign => Err(Reason::Origin),
            _ => Ok(()),
        }
    }

    /// `localhost` and the numeric addresses of this machine are ours: no other site can have them
    /// as a name. On loopback the port may be that of a tunnel, such as `ssh -L`. Our host name is
    /// ours in home networks, and only where a token is required: a neighbour may lie about it.
    /// Other names must be listed in the config.
    fn is_ours(&self, host: &str) -> bool {
        let (name, port) = split(host);
        if self.more.iter().any(|more| more == host || more == name) {
            return true;
        }
        let bare = name.trim_start_matches('[').trim_end_matches(']');
        let address = bare.parse::<IpAddr>().ok();
        if name == "localhost" || address.is_some_and(|address| address.is_loopback()) {
            return true;
        }
        if port.is_some_and(|port| port != self.listen.port().to_string()) {
            return false;
        }
        match address {
            Some(address) if self.listen.ip().is_unspecified() => !address.is_unspecified(),
            Some(address) => address == self.listen.ip(),
            None => !self.listen.ip().is_loopback() && self.is_own(name),
        }
    }

    /// Whether this is the host name of this computer, alone or in a home network.
    fn is_own(&self, name: &str) -> bool {
        let (label, domain) = name.split_once('.').unwrap_or((name, ""));
        let at_home = domain.is_empty() || HOME_DOMAINS.contains(&domain);
        !label.is_empty() && label == self.own && at_home
    }
}

/// Splits name and port; an IPv6 address is in brackets.
pub(super) fn split(host: &str) -> (&str, Option<&str>) {
    match host.rsplit_once(':') {
        Some((name, port)) if !port.contains(']') => (name, Some(port)),
        _ => (host, None),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn names(listen: &str) -> Names {
        let more = ["Robot.Example.org".to_owned()];
        Names::new(listen.parse().unwrap(), &more, "Pi.example.org")
    }

    fn validate(listen: &str, host: &str, origin: Option<&str>) -> Result<(), Reason> {
        let host = Some(host);
        names(listen).validate(OriginHeaders {
            host,
            origin,
            site: None,
            changes_state: true,
        })
    }

    #[test]
    fn only_our_own_names_are_accepted() {
        let here = "127.0.0.1:7788";
        for good in [
            "127.0.0.1:7788",
            "localhost:7788",
            "LOCALHOST:7788",
            "robot.example.org",
            // Through a tunnel.
            "localhost:8080",
            "127.0.0.1:80",
            "[::1]:8080",
        ] {
            assert_eq!(validate(here, good, None), Ok(()), "{good}");
        }
        for bad in [
            "evil.example",
            "evil.example:7788",
            "localhost.evil.example:7788",
            "127.0.0.1.evil.example:7788",
            "10.0.0.5:7788",
            "",
            ":",
            // A neighbour could lie about it, and no token is required here.
            "pi:7788",
            "pi.local:7788",
        ] {
            assert_eq!(validate(here, bad, None), Err(Reason::Host), "{bad}");
        }
        assert_eq!(validate("0.0.0.0:7788", "192.168.1.7:7788", None), Ok(()));
        assert_eq!(
            validate("0.0.0.0:7788", "evil.example:7788", None),
            Err(Reason::Host)
        );
        assert_eq!(validate("[::1]:7788", "[::1]:7788", None), Ok(()));
        let nobody = names(here).validate(OriginHeaders::default());
        assert_eq!(nobody, Err(Reason::Host));
    }

    #[test]
    fn beyond_loopback_the_own_host_name_is_accepted_in_home_networks_only() {
        for listen in ["0.0.0.0:7788", "[::]:7788", "192.168.1.7:7788"] {
            for good in ["pi:7788", "PI.local:7788", "pi.lan", "pi.home.arpa:7788"] {
                assert_eq!(validate(listen, good, None), Ok(()), "{good}");
            }
            for bad in [
                "pi.local:8080",
                "pi.example.org:7788",
                "pi.evil.example:7788",
                "pi.local.evil.example:7788",
                "api.local:7788",
                "local:7788",
                ".local:7788",
            ] {
                assert_eq!(validate(listen, bad, None), Err(Reason::Host), "{bad}");
            }
        }
        let nameless = Names::new("0.0.0.0:7788".parse().unwrap(), &[], "");
        let host = Some(".local:7788");
        let request = OriginHeaders {
            host,
            ..OriginHeaders::default()
        };
        assert_eq!(nameless.validate(request), Err(Reason::Host));
    }

    #[test]
    fn requests_of_another_sites_page_are_rejected() {
        let here = "127.0.0.1:7788";
        let ask = |origin| validate(here, here, Some(origin));
        assert_eq!(ask("http://127.0.0.1:7788"), Ok(()));
        for bad in [
            "http://evil.example",
            "http://localhost:7788",
            "http://127.0.0.1:8080",
            "null",
            "",
            "http://127.0.0.1:7788.evil.example",
            "file://",
        ] {
            assert_eq!(ask(bad), Err(Reason::Origin), "{bad}");
        }
        let host = Some(here);
        let origin = None;
        let from = |site, changes_state| {
            names(here).validate(OriginHeaders {
                host,
                origin,
                site,
                changes_state,
            })
        };
        assert_eq!(from(Some("cross-site"), true), Err(Reason::Origin));
        assert_eq!(
            from(Some("cross-site"), false),
            Ok(()),
            "a link may lead here"
        );
        assert_eq!(from(Some("same-origin"), true), Ok(()));
        assert_eq!(from(None, true), Ok(()), "a program is not a page");
    }

    proptest! {
        #[test]
        fn no_header_causes_a_panic_and_unknown_hosts_are_rejected(host in "\\PC{0,40}", origin in "\\PC{0,40}") {
            let verdict = validate("127.0.0.1:7788", &host, Some(&origin));
            let known = host.to_ascii_lowercase();
            let ours = ["127.", "[::1]", "::1", "localhost", "robot.example.org"]
                .iter()
                .any(|start| known.starts_with(start));
            prop_assert!(ours || verdict.is_err());
        }
    }
}
