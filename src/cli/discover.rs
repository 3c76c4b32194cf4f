//! `spykee discover`: lists the robots on the network.

use std::net::SocketAddr;
use std::time::Duration;

use super::table::aligned;
use super::{Exit, Failure, argument, block_on, print, print_json};
use crate::link::discover::{self, Found};

const NO_ANSWER: &str = "no robot answered";
const NO_ANSWER_HELP: &str = "is the robot on, and is this computer in its Wi-Fi (SPYKEE...)? A firewall \
                           must let UDP port 9000 through. `spykee sim` starts a simulated one";

/// List the robots on the network
#[derive(Debug, Clone, clap::Args)]
pub(super) struct DiscoverArgs {
    /// Time to wait for replies, in seconds
    #[arg(long, value_name = "SECONDS", default_value = "3", value_parser = argument::seconds(60.0))]
    timeout: Duration,

    /// Print a JSON array
    #[arg(long)]
    json: bool,

    /// Query only this address instead of every network; may be repeated
    #[arg(long, value_name = "IP:PORT")]
    ask: Vec<SocketAddr>,
}

/// Sends the query and prints the robots that answered.
pub(super) fn run(args: &DiscoverArgs) -> Result<Exit, Failure> {
    let found = block_on(async {
        if args.ask.is_empty() {
            discover::discover(args.timeout, &[]).await
        } else {
            discover::ask(&args.ask, args.timeout).await
        }
    })?;
    let found = found.map_err(|error| {
        Failure::unreachable(format_args!("cannot search the network: {error}"))
    })?;
    if args.json {
        print_json(&found)?;
    } else if !found.is_empty() {
        print(&table(&found))?;
    }
    if found.is_empty() {
        return Err(Failure::unreachable(NO_ANSWER).help(NO_ANSWER_HELP));
    }
    Ok(Exit::Done)
}

fn table(found: &[Found]) -> String {
    let row = |robot: &Found| {
        let user = robot.connected_user.as_deref().unwrap_or("-");
        vec![robot.uid.clone(), robot.addr.to_string(), user.to_owned()]
    };
    aligned("ROBOT|ADDRESS|CONNECTED USER", found.iter().map(row))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_is_aligned_and_has_no_control_characters() {
        let robot = |uid: &str, port, user: Option<&str>| Found {
            addr: SocketAddr::from(([127, 0, 0, 1], port)),
            uid: uid.into(),
            connected_user: user.map(Into::into),
        };
        let found = [
            robot("SPYKEE0001", 9000, None),
            robot("S\x1b[2J\n", 80, Some("anna")),
        ];
        let expected = "ROBOT       ADDRESS         CONNECTED USER\n\
                        SPYKEE0001  127.0.0.1:9000  -\n\
                        S[2J        127.0.0.1:80    anna\n";
        assert_eq!(table(&found), expected);
    }
}
