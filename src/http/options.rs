//! The config's options for the page and the API.

use std::net::{IpAddr, Ipv4Addr, SocketAddr};

use schemars::JsonSchema;
use serde::{Deserialize, Deserializer, Serialize};

/// Default address of the page.
const LISTEN: SocketAddr = SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), 7788);
/// Default maximum number of viewers.
const VIEWERS: u16 = 32;
const MAX_VIEWERS: u16 = 1000;

/// `live:` of the config.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Options {
    /// The address of the page and the API, `IP:PORT`. Beyond loopback a token is required.
    #[schemars(with = "Option<String>")]
    pub listen: Option<SocketAddr>,
    /// Host names of the page besides that address, such as that of a proxy in front of it.
    pub hosts: Vec<String>,
    /// The maximum number of viewers at a time, from 1 to 1000.
    #[serde(deserialize_with = "viewers")]
    #[schemars(range(min = 1, max = 1000))]
    pub viewers: u16,
}

impl Default for Options {
    fn default() -> Options {
        Options {
            listen: None,
            hosts: Vec::new(),
            viewers: VIEWERS,
        }
    }
}

impl Options {
    /// Returns the address to listen on.
    pub fn address(&self) -> SocketAddr {
        self.listen.unwrap_or(LISTEN)
    }
}

fn viewers<'de, D: Deserializer<'de>>(from: D) -> Result<u16, D::Error> {
    let number = u64::deserialize(from)?;
    match u16::try_from(number) {
        Ok(viewers @ 1..=MAX_VIEWERS) => Ok(viewers),
        _ => {
            let expected = "a whole number of viewers from 1 to 1000";
            let found = serde::de::Unexpected::Unsigned(number);
            Err(serde::de::Error::invalid_value(found, &expected))
        }
    }
}
