//! `spykee token`: manages the tokens with which people open the page, and programs use its API.

use std::io::{self, IsTerminal as _};
use std::net::{IpAddr, Ipv4Addr, SocketAddr, UdpSocket};

use clap::Subcommand;
use qrcode::render::unicode::Dense1x2;
use qrcode::{EcLevel, QrCode};

use super::settings::CommandSettings;
use super::table::aligned;
use super::{Exit, Failure, print, print_coloured};
use crate::http::{AccessError, Key, Keyring, Role};

#[derive(Debug, Clone, Subcommand)]
pub(super) enum Action {
    /// Create a token and print it; it is shown only once
    New {
        /// Name of your choice, such as the device or program that uses the token
        name: String,
        /// Role of the token
        #[arg(long, value_enum, default_value_t = Role::Viewer)]
        role: Role,
    },
    /// List the tokens by name
    List,
    /// Revoke a token; an active run refuses it within a second
    Revoke {
        /// Name of the token
        name: String,
    },
}

pub(super) fn run(action: &Action, settings: &CommandSettings) -> Result<Exit, Failure> {
    let config = settings.config()?;
    let mut keys = Keyring::open(config.data_folder()).map_err(refused)?;
    match action {
        Action::New { name, role } => {
            let token = keys.make(name, *role).map_err(refused)?;
            tracing::info!(
                "the token is shown only this once; its role is {}",
                role.name()
            );
            print(&format!("{token}\n"))?;
            if std::io::stdout().is_terminal() {
                let address = address_for_others(config.live.address());
                print_coloured(&invitation(address, &token), true)?;
            }
        }
        Action::List if keys.list().is_empty() => return print("there are no tokens\n"),
        Action::List => {
            let row = |key: &Key| vec![key.name.clone(), key.role.name().to_owned()];
            return print(&aligned("NAME|ROLE", keys.list().iter().map(row)));
        }
        Action::Revoke { name } => {
            if !keys.revoke(name).map_err(refused)? {
                let failure = Failure::usage(format_args!("there is no token `{name}`"));
                return Err(failure.help("spykee token list"));
            }
        }
    }
    Ok(Exit::Done)
}

fn refused(error: AccessError) -> Failure {
    let help = match &error {
        AccessError::Broken { .. } => {
            "use this command as the user of the service, or remove the file and create new tokens"
        }
        AccessError::Write { .. } => "`data:` in the config sets the data folder",
        AccessError::Foreign { .. } => "use this command as that user: sudo -u USER spykee token",
        AccessError::Open(_) | AccessError::Refused(_) => "spykee token list",
    };
    Failure::usage(error).help(help)
}

/// Returns the address of a page that listens here, as other computers know it: instead of all
/// addresses of this computer, the one from which it reaches other networks, or its first one in a
/// network: the robot's own Wi-Fi, where no phone is, leads nowhere else.
pub(super) fn address_for_others(listen: SocketAddr) -> SocketAddr {
    if !listen.ip().is_unspecified() {
        return listen;
    }
    let interfaces = if_addrs::get_if_addrs().unwrap_or_default();
    let mut addresses = interfaces.iter().map(if_addrs::Interface::ip);
    let first = || addresses.find(|ip| ip.is_ipv4() && !ip.is_loopback());
    let ip = address_to_elsewhere().ok().or_else(first);
    SocketAddr::new(ip.unwrap_or(listen.ip()), listen.port())
}

/// The address of this computer on the way to another network. Nothing is sent.
fn address_to_elsewhere() -> io::Result<IpAddr> {
    /// An address for documentation, which is in no network of this computer.
    const ELSEWHERE: (Ipv4Addr, u16) = (Ipv4Addr::new(192, 0, 2, 1), 9);
    let socket = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0))?;
    socket.connect(ELSEWHERE)?;
    Ok(socket.local_addr()?.ip())
}

/// The link that opens the page with this token, for a phone as a QR code. A browser does not send
/// what follows the `#`, so no log of a server or proxy contains the token.
fn invitation(address: SocketAddr, token: &str) -> String {
    let link = format!("http://{address}/#token={token}");
    if address.ip().is_loopback() {
        return format!(
            "This link opens the page on this computer; for others, set `live: {{ listen: \
             0.0.0.0:{} }}` in the config:\n{link}\n",
            address.port()
        );
    }
    let code = QrCode::with_error_correction_level(&link, EcLevel::L);
    // A link is shorter than the longest text of a code.
    let code = code.map_or_else(|_| String::new(), |code| black_on_white(&code));
    format!("This link, or its QR code, opens the page:\n{link}\n{code}")
}

/// A QR code with the right colours on every terminal.
fn black_on_white(code: &QrCode) -> String {
    let text = code.render::<Dense1x2>().build();
    let lines = text
        .lines()
        .map(|line| format!("\x1b[30;107m{line}\x1b[0m\n"));
    lines.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Reads the code as a camera sees it: black and white, eight pixels a module.
    fn read(code: &str) -> String {
        let lines = code
            .lines()
            .filter_map(|line| line.strip_prefix("\x1b[30;107m"));
        let lines = lines.map(|line| line.strip_suffix("\x1b[0m").unwrap());
        let rows: Vec<Vec<char>> = lines.map(|line| line.chars().collect()).collect();
        let size = 8 * rows[0].len();
        let dark = |x: usize, y: usize| match rows.get(y / 16).map(|row| row[x / 8]) {
            Some('█') => true,
            Some('▀') => y % 16 < 8,
            Some('▄') => y % 16 >= 8,
            _ => false,
        };
        let grey = |x, y| if dark(x, y) { 0 } else { 255 };
        let mut image = rqrr::PreparedImage::prepare_from_greyscale(size, size, grey);
        image.detect_grids()[0].decode().unwrap().1
    }

    #[test]
    fn the_qr_code_is_the_link_with_the_token_behind_the_hash() {
        let token = format!("spykee_{}", "0123456789abcdef".repeat(4));
        let text = invitation("192.168.178.123:7788".parse().unwrap(), &token);
        let link = text.lines().nth(1).unwrap();
        assert_eq!(link, format!("http://192.168.178.123:7788/#token={token}"));
        assert_eq!(read(&text), link);
        let widest = text.lines().map(|line| line.chars().count()).max().unwrap();
        assert!(widest <= 120, "{widest}");
        let here = invitation("127.0.0.1:7788".parse().unwrap(), &token);
        assert!(
            here.contains("0.0.0.0:7788") && !here.contains('█'),
            "{here}"
        );
    }
}
