//! Generates the manual pages, one per subcommand, from the definition of the command line. Called
//! by `scripts/package`: `cargo bench --profile dev --bench man -- DIR`.
#![allow(missing_docs)]

use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

use clap_mangen::Man;

/// Sections of the main page that `--help` does not have.
const REST: &str = r#".SH "EXIT STATUS"
.TP
0
Done.
.TP
1
A script failed and will not be restarted, the robot did not carry out a command, or the system refused something.
.TP
2
The command line, the config or a file that the command reads is missing or invalid.
.TP
3
The robot, a run, a service or a broker cannot be reached or refused the login, or doctor found a problem.
.TP
4
A check found a mistake in a script, a config or a world, a scenario failed, or a script does not yet pass its lesson.
A notification was not delivered, or a robot did not carry out a fleet command.
.TP
5
At the end the battery was low and the watchdog had taken over.
.TP
130
Interrupted by a signal.
.SH ENVIRONMENT
.TP
SPYKEE_PASSWORD
The robot's password.
.TP
SPYKEE_CONFIG
The config file, unless \-\-config names one.
.TP
SPYKEE_ROBOT
The robot's address, which overrides the config's.
.TP
RUST_LOG
Filter for the log, such as debug.
.TP
NO_COLOR
Disables colours.
.SH FILES
.TP
spykee.yaml
The config in the current folder, used if no other is named.
.TP
/etc/spykee/spykee.yaml
The config of the service (Debian package).
.TP
/var/lib/spykee
The data of the service (Debian package).
.TP
/usr/share/spykee/behaviours
Built-in behaviours, worlds and lessons, and guide/, the chapters of the book (Debian package).
.TP
/usr/share/spykee/book/index.html
The book: learn, operate, teach, trust, reference (Debian package).
"#;

fn main() -> io::Result<()> {
    // `cargo bench` adds the argument `--bench`.
    let named = std::env::args_os().skip(1).find(|word| word != "--bench");
    let Some(folder) = named.map(PathBuf::from) else {
        return Err(io::Error::other("expected the output folder as argument"));
    };
    std::fs::create_dir_all(&folder)?;
    let mut command = spykee::cli::command().disable_help_subcommand(true);
    command.build();
    write(&command, &folder, true)
}

/// Writes the page of a command and the pages of its subcommands.
fn write(command: &clap::Command, folder: &Path, is_first: bool) -> io::Result<()> {
    let man = Man::new(command.clone()).source(concat!("spykee ", env!("CARGO_PKG_VERSION")));
    let mut page = Vec::new();
    man.render(&mut page)?;
    if is_first {
        page.write_all(REST.as_bytes())?;
    }
    std::fs::write(folder.join(man.get_filename()), page)?;
    let shown = command.get_subcommands().filter(|one| !one.is_hide_set());
    for subcommand in shown {
        write(subcommand, folder, false)?;
    }
    Ok(())
}
