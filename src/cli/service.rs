//! `spykee service`: creates the unit with which systemd starts `spykee serve`.

use std::io::Write as _;
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::{Path, PathBuf};

use clap::Subcommand;

use super::{Exit, Failure, print};
use crate::config::Config;
use crate::service::{Credential, unit};

#[derive(Debug, Clone, Subcommand)]
pub(super) enum Action {
    /// Print the unit
    Print(UnitArgs),
    /// Write the unit where systemd finds it, and print the next steps
    Install {
        #[command(flatten)]
        unit: UnitArgs,
        /// File to write the unit to
        #[arg(
            long,
            value_name = "FILE",
            default_value = "/etc/systemd/system/spykee.service"
        )]
        to: PathBuf,
        /// Replace an existing file
        #[arg(long)]
        force: bool,
    },
}

#[derive(Debug, Clone, clap::Args)]
pub(super) struct UnitArgs {
    /// Config of the service
    #[arg(long, value_name = "FILE", default_value = "/etc/spykee/spykee.yaml")]
    config: PathBuf,

    /// File with the robot's password in its first line, which systemd passes to this service only;
    /// it may belong to root (chmod 600)
    #[arg(long, value_name = "FILE")]
    password_file: Option<PathBuf>,

    /// User that runs the service [default: one that systemd creates]
    #[arg(long, value_name = "NAME", value_parser = user)]
    user: Option<String>,

    /// Program that the unit starts [default: this one]
    #[arg(long, value_name = "FILE")]
    program: Option<PathBuf>,
}

pub(super) fn run(action: &Action) -> Result<Exit, Failure> {
    match action {
        Action::Print(unit) => print(&unit.text()?),
        Action::Install { unit, to, force } => install(&unit.text()?, &unit.config, to, *force),
    }
}

impl UnitArgs {
    fn text(&self) -> Result<String, Failure> {
        let program = match &self.program {
            Some(program) => program.clone(),
            None => std::env::current_exe().map_err(Failure::internal)?,
        };
        for path in [&program, &self.config]
            .into_iter()
            .chain(&self.password_file)
        {
            if !path.is_absolute() {
                let what = format_args!(
                    "a unit needs absolute paths, but {} is relative",
                    path.display()
                );
                return Err(Failure::usage(what).help("give a path that begins with /"));
            }
        }
        if ["/home", "/root", "/run/user"]
            .iter()
            .any(|home| program.starts_with(home))
        {
            tracing::warn!(
                "the unit cannot read home folders, but {} is in one: copy it with \
                 `sudo install {} /usr/local/bin/` and add --program /usr/local/bin/spykee",
                program.display(),
                program.display()
            );
        }
        let password = self.password_file.clone().map(Credential::password);
        // A package makes its unit before there is a config.
        let secrets = if self.config.exists() {
            let config = Config::load(&self.config);
            secrets(&config.map_err(|error| Failure::new(Exit::Check, error))?)
        } else {
            Vec::new()
        };
        let secrets = secrets.into_iter().map(Credential::of_config);
        let credentials: Vec<Credential> = password.into_iter().chain(secrets).collect();
        let user = self.user.as_deref();
        Ok(unit(&program, &self.config, &credentials, user))
    }
}

/// The files with secrets that the config names. systemd passes them to the service, whose user could
/// not read files of root.
pub(super) fn secrets(config: &Config) -> Vec<PathBuf> {
    let tokens = config.notify.targets.values().map(|one| &one.token_file);
    let passwords = [&config.password_file, &config.mqtt.password_file];
    passwords
        .into_iter()
        .chain(tokens)
        .flatten()
        .cloned()
        .collect()
}

/// Parses a user name for systemd: it must be a single word on one line.
fn user(name: &str) -> Result<String, &'static str> {
    let plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.');
    if !name.is_empty() && name.len() <= 31 && name.chars().all(plain) {
        Ok(name.to_owned())
    } else {
        Err("expected a user name: at most 31 letters, digits, -, _ and dots")
    }
}

fn install(text: &str, config: &Path, to: &Path, force: bool) -> Result<Exit, Failure> {
    let mut options = std::fs::OpenOptions::new();
    options.write(true).mode(0o644);
    if force {
        options.create(true).truncate(true)
    } else {
        options.create_new(true)
    };
    let written = options
        .open(to)
        .and_then(|mut file| file.write_all(text.as_bytes()));
    written.map_err(|error| match error.kind() {
        std::io::ErrorKind::AlreadyExists => {
            Failure::usage(format_args!("{} already exists", to.display()))
                .help("--force replaces it")
        }
        std::io::ErrorKind::PermissionDenied => {
            Failure::unwritable(to, error).help("sudo spykee service install")
        }
        _ => Failure::unwritable(to, error),
    })?;
    let name = to.file_name().unwrap_or_default().to_string_lossy();
    let config = if config.exists() {
        String::new()
    } else {
        format!(
            "write its config, {}; if it names files with secrets, install the unit again with --force; \
             and then\n",
            config.display()
        )
    };
    print(&format!(
        "wrote {}\n{config}sudo systemctl daemon-reload\nsudo systemctl enable --now {name}\n",
        to.display()
    ))
}
