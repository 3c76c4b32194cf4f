//! `spykee class`: lessons for a class in the browser.

use std::ffi::{OsStr, OsString};
use std::net::{Ipv4Addr, SocketAddr};
use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::assembly::{RunSetup, exit_of};
use super::connection::no_robot;
use super::interrupt::unless_interrupted;
use super::settings::CommandSettings;
use super::startup::runtime;
use super::token::address_for_others;
use super::{ConnectionArgs, Console, Exit, Failure, LoginArgs, argument, check, lesson, print};
use crate::check::{Diagnostic, Severity};
use crate::class::{ClassError, OpenClass, RobotAgent, RobotSetup, Setup, Tools};
use crate::config::{Config, Effective};
use crate::http::Options;
use crate::journal::When;
use crate::link::Target;
use crate::{files, sim};

/// The port of the class's page.
const PORT: u16 = 7799;
/// The world of robots that are simulated in the place of real ones, and their greatest number.
const WORLD: &str = "yard";
const MAX_SIMULATED: u8 = 8;
/// The robot's own port, which its name does not mention.
const USUAL_PORT: &str = ":9000";
/// Maximum length of the list of names, in bytes.
const MAX_NAMES: u64 = 1 << 20;

/// Hold a class: learners open a page in the browser, write scripts, and run them in simulations
///
/// Prints the learners' link with the class word, and the link to the teacher's wall. The learners'
/// scripts are files in the folder, one folder for each learner; `spykee lesson grade` counts their
/// points. Each run is a confined process of this computer. The page is not encrypted: see the book.
#[derive(Debug, Clone, clap::Args)]
#[command(
    after_help = "Examples:\n  spykee class robots-8b --names 8b.txt\n  spykee class robots-8b --robot 172.17.6.1 --robot 172.17.6.2\n  spykee class --listen 127.0.0.1:7799"
)]
pub(super) struct ClassArgs {
    /// Folder of the class; created if it does not exist
    #[arg(value_name = "FOLDER", default_value = "class")]
    folder: PathBuf,

    /// File with the names of the class, one per line
    #[arg(long, value_name = "FILE")]
    names: Option<PathBuf>,

    /// A real robot that learners take turns on [default port: 9000]; may be repeated
    #[arg(long = "robot", value_name = "HOST[:PORT]", conflicts_with = "sim")]
    robots: Vec<Target>,

    /// Use so many simulated robots in the place of real ones
    #[arg(long, value_name = "NUMBER", num_args = 0..=1, default_missing_value = "1",
          value_parser = argument::whole(1..=MAX_SIMULATED))]
    sim: Option<u8>,

    /// Be the agent of one of these robots, for the class that has started this process: its data folder
    #[arg(long, hide = true)]
    agent_in: Option<PathBuf>,

    /// Address of the page [default: that of this computer in its network, port 7799]
    #[arg(long, value_name = "IP:PORT")]
    listen: Option<SocketAddr>,

    #[command(flatten)]
    login: LoginArgs,
}

pub(super) fn run(
    args: &ClassArgs,
    settings: &CommandSettings,
    console: &Console,
) -> Result<Exit, Failure> {
    if let Some(data) = &args.agent_in {
        return run_agent(args, data, settings, console);
    }
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
        robots: robots(args, settings)?,
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

/// The real robots of the class, or the simulated ones in their place.
fn robots(args: &ClassArgs, settings: &CommandSettings) -> Result<Vec<RobotSetup>, Failure> {
    // A wrong password is said now.
    args.login.login(settings.load()?)?;
    let folder = std::path::absolute(&args.folder).map_err(Failure::internal)?;
    let password = args.login.password_file.as_deref();
    let flags: [(&str, Option<&OsStr>); 3] = [
        ("--config", settings.file().map(Path::as_os_str)),
        ("--user", args.login.user.as_deref().map(OsStr::new)),
        ("--password-file", password.map(Path::as_os_str)),
    ];
    let mut common: Vec<OsString> = vec!["class".into()];
    for (flag, value) in flags {
        if let Some(value) = value {
            common.extend([flag.into(), value.to_owned()]);
        }
    }
    let setup = |name: String, robot: &[OsString]| {
        let data = Setup::robot_folder(&folder, &name);
        let agent: [OsString; 2] = ["--agent-in".into(), data.clone().into()];
        RobotSetup {
            arguments: [&common[..], &agent, robot].concat(),
            name,
            data,
        }
    };
    let simulated = 1..=args.sim.unwrap_or(0);
    let simulated = simulated.map(|number| setup(format!("simulated-{number}"), &["--sim".into()]));
    let mut robots: Vec<RobotSetup> = simulated.collect();
    for target in &args.robots {
        let target = target.to_string();
        let name = target.trim_end_matches(USUAL_PORT).replace(':', "-");
        if robots.iter().any(|robot| robot.name == name) {
            let failure = Failure::usage(format_args!("the robot {target} is named twice"));
            return Err(failure.help("name each robot once: --robot A --robot B"));
        }
        robots.push(setup(name, &["--robot".into(), target.into()]));
    }
    Ok(robots)
}

/// Is the agent of one robot of a class, which tells it what to do. The notifications and the broker of
/// the config are not the class's.
fn run_agent(
    args: &ClassArgs,
    data: &Path,
    settings: &CommandSettings,
    console: &Console,
) -> Result<Exit, Failure> {
    let effective = settings.load()?;
    let mut config = Config {
        data: Some(data.to_owned()),
        ..effective.config.clone()
    };
    config.journal.record = When::Off;
    let login = args.login.login(effective)?;
    let connection = ConnectionArgs {
        robot: args.robots.first().cloned(),
        sim: args.sim.map(|_| Some(PathBuf::from(WORLD))),
        login: args.login.clone(),
    };
    let robot = connection.choose(&mut config)?.ok_or_else(no_robot)?;
    let setup = RunSetup {
        config: config.clone(),
        sim_options: sim::Options {
            login,
            seed: rand::random(),
            ..sim::Options::default()
        },
        fast: false,
        date: None,
        waits: true,
        names: "serves a class".to_owned(),
        behaviours: Vec::new(),
        specs: Vec::new(),
        limit: None,
        page: None,
        trace: None,
        events: None,
        is_service: true,
    };
    setup.run(
        robot,
        &Effective::default(),
        console,
        async move |started| {
            let agent = RobotAgent::open(started.control, &started.bus, config);
            let agent = agent.map_err(|error| Failure::io("hear the class", error))?;
            exit_of(agent.run(started.agent, started.stop).await, true)
        },
    )
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
