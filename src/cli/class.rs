//! `spykee class`: lessons for a class in the browser.

use std::net::{Ipv4Addr, SocketAddr};
use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::interrupt::unless_interrupted;
use super::settings::CommandSettings;
use super::startup::runtime;
use super::token::address_for_others;
use super::{Console, Exit, Failure, check, lesson, print};
use crate::check::{Diagnostic, Severity};
use crate::class::{ClassError, OpenClass, Setup, Tools};
use crate::config::Config;
use crate::files;
use crate::http::Options;

/// The port of the class's page.
const PORT: u16 = 7799;
/// Maximum length of the list of names, in bytes.
const MAX_NAMES: u64 = 1 << 20;

/// Hold a class: learners open a page in the browser, write scripts, and run them in simulations
///
/// Prints the learners' link with the class word, and the link to the teacher's wall. The learners'
/// scripts are files in the folder, one folder for each learner; `spykee lesson grade` counts their
/// points. Each run is a confined process of this computer. The page is not encrypted: see the book.
#[derive(Debug, Clone, clap::Args)]
#[command(
    after_help = "Examples:\n  spykee class robots-8b --names 8b.txt\n  spykee class --listen 127.0.0.1:7799"
)]
pub(super) struct ClassArgs {
    /// Folder of the class; created if it does not exist
    #[arg(value_name = "FOLDER", default_value = "class")]
    folder: PathBuf,

    /// File with the names of the class, one per line
    #[arg(long, value_name = "FILE")]
    names: Option<PathBuf>,

    /// Address of the page [default: that of this computer in its network, port 7799]
    #[arg(long, value_name = "IP:PORT")]
    listen: Option<SocketAddr>,
}

pub(super) fn run(
    args: &ClassArgs,
    settings: &CommandSettings,
    console: &Console,
) -> Result<Exit, Failure> {
    let names = match &args.names {
        Some(path) => names(path)?,
        None => Vec::new(),
    };
    let all = SocketAddr::from((Ipv4Addr::UNSPECIFIED, PORT));
    let setup = Setup {
        folder: args.folder.clone(),
        names,
        options: Options {
            listen: Some(args.listen.unwrap_or_else(|| address_for_others(all))),
            hosts: settings.config()?.live.hosts.clone(),
        },
        tools: tools(console),
    };
    // Runs die with the thread that starts them: this one.
    runtime()?.block_on(async {
        let link = |address| format!("http://{}/", address_for_others(address));
        let class = OpenClass::open(setup, link).await.map_err(refused)?;
        print(&invitation(&class))?;
        Ok(match unless_interrupted(class.serve()).await? {
            Some(()) => Exit::Done,
            None => Exit::Interrupted,
        })
    })
}

/// The names in a file, one per line.
pub(super) fn names(path: &Path) -> Result<Vec<String>, Failure> {
    let text = files::read_text(path, MAX_NAMES).map_err(|error| {
        Failure::unreadable(path, error).help("--names needs a text file with one name per line")
    })?;
    // Some editors put a byte order mark at the beginning.
    let text = text.trim_start_matches('\u{feff}');
    let names = text.lines().map(str::trim).filter(|name| !name.is_empty());
    Ok(names.map(str::to_owned).collect())
}

fn tools(console: &Console) -> Tools {
    let console = console.clone();
    Tools {
        lessons: lesson::of_class(),
        check: Box::new(move |name, file| lesson::judge(name, file, &console)),
        marks: Box::new(marks),
    }
}

/// The mistakes in a text, for an editor.
fn marks(text: &str, file: &Path) -> Result<Value, String> {
    let options = Config::default().script("check", file.display().to_string(), 0);
    let found = check::of_source(text.as_bytes(), options).map_err(|failure| failure.what)?;
    let mark = |one: &Diagnostic| {
        let severity = match one.severity {
            Severity::Error => "error",
            Severity::Warning => "warning",
        };
        json!({
            "line": one.line, "column": one.column, "end_column": one.column + one.width,
            "message": one.message, "help": one.help, "severity": severity,
        })
    };
    // What is wrong in a module beside the script has no line here.
    let here = found.iter().filter(|one| Path::new(&one.file) == file);
    Ok(here.map(mark).collect())
}

fn invitation(class: &OpenClass) -> String {
    let address = address_for_others(class.address);
    let word = &class.word;
    let token = &class.token;
    format!(
        "The class is open at http://{address}/ and nowhere else.\n\
         Class word: {word}\n\
         Wall, for the teacher only: http://{address}/wall#token={token}\n\n\
         The page is not encrypted: who can listen in this network can read along. The chapter \"A class \
         in the browser\" of the book shows how to put a proxy with TLS in front of it.\n\
         Ctrl-C ends the class; the scripts stay in their folder.\n"
    )
}

fn refused(error: ClassError) -> Failure {
    match &error {
        ClassError::Folder { .. } => Failure::usage(error).help("name a folder of your own"),
        ClassError::Socket { .. } => {
            Failure::internal(error).help("--listen names another address: --listen 127.0.0.1:7799")
        }
        ClassError::Access(_) => Failure::internal(error),
    }
}
