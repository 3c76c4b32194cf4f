//! What a host is: a name, an IPv4 address, or an IPv6 address.

use std::net::Ipv6Addr;

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
    use super::*;

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
