//! The command from the view of people and scripts: exit codes, output streams, messages.

use std::io::{BufRead, BufReader, Read, Write};
use std::path::Path;
use std::process::{Child, ChildStderr, ChildStdout, Command, Stdio};
use std::time::Duration;

use spykee::link;
use spykee::wire::{Command as Said, Login};

use crate::rig::{assert_contains, command, program, run_in};

/// A `spykee sim` on a free port; killed at the end of the test.
struct Sim {
    child: Child,
    address: String,
    stdout: BufReader<ChildStdout>,
}

impl Sim {
    fn start(args: &[&str], change: impl FnOnce(&mut Command)) -> Sim {
        let mut command = program(&[&["sim", "--listen", "127.0.0.1:0"], args].concat());
        command.stdout(Stdio::piped()).stderr(Stdio::piped());
        change(&mut command);
        let mut child = command.spawn().unwrap();
        let mut stdout = BufReader::new(child.stdout.take().unwrap());
        let mut greeting = String::new();
        stdout.read_line(&mut greeting).unwrap();
        let address = greeting.split_once("listens on ").unwrap().1;
        let address = address.split_once(',').unwrap().0.to_owned();
        Sim {
            child,
            address,
            stdout,
        }
    }

    fn stderr(&mut self) -> ChildStderr {
        self.child.stderr.take().unwrap()
    }

    fn signal(&self, signal: rustix::process::Signal) {
        let pid = rustix::process::Pid::from_child(&self.child);
        rustix::process::kill_process(pid, signal).unwrap();
    }

    /// Waits for its end and returns its exit code; without a limit, which the test's own limit
    /// provides.
    fn code(&mut self) -> Option<i32> {
        self.child.wait().unwrap().code()
    }

    fn log_in(&self, user: &str, password: &str) -> Result<link::Session, link::LinkError> {
        let target = self.address.parse().unwrap();
        let login = Login::new(user, password);
        let runtime = tokio::runtime::Runtime::new().unwrap();
        runtime.block_on(link::connect(
            &target,
            &login,
            vec![Said::STOP],
            &link::Options::default(),
        ))
    }
}

impl Drop for Sim {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[test]
fn help_names_every_subcommand_and_succeeds() {
    let output = command(&["--help"]);
    assert_eq!(output.code, Some(0));
    let help = output.out;
    for word in ["sim", "discover", "--log-format"] {
        assert_contains(&help, &[word]);
    }
}

#[test]
fn a_command_also_prints_its_help() {
    let output = command(&["help", "run"]);
    assert_eq!(output.code, Some(0));
    assert_eq!(
        output.out,
        command(&["run", "--help"]).out,
        "`spykee help run` is `spykee run --help`"
    );
}

#[test]
fn only_commands_that_work_through_a_service_accept_its_address() {
    for name in ["calibrate", "robot log", "robot config", "robot wifi"] {
        let words = name.split(' ').chain(["--url", "http://127.0.0.1:1"]);
        let output = command(&words.collect::<Vec<&str>>());
        assert_eq!(output.code, Some(2), "{name}");
        let told = output.err;
        assert!(
            told.contains("unexpected argument '--url'"),
            "{name}: {told}"
        );
    }
    let help = command(&["robot", "battery", "--help"]).out;
    assert_contains(&help, &["--url"]);
}

#[test]
fn an_invalid_command_line_ends_with_2_on_stderr() {
    for args in [
        &["nonsense"][..],
        &[],
        &["discover", "--timeout", "0"],
        &["discover", "--timeout", "nan"],
        &["discover", "--ask", "nowhere"],
        &["sim", "--seed", "-1"],
        &["sim", "--listen", "9000"],
        &["discover", "--log-format", "xml"],
    ] {
        let output = command(args);
        assert_eq!(output.code, Some(2), "{args:?}");
        assert!(output.out.is_empty() && !output.err.is_empty(), "{args:?}");
    }
}

#[test]
fn discover_without_a_result_gives_advice_and_ends_with_3() {
    // A port that is bound and does not answer.
    let silent = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
    let address = silent.local_addr().unwrap().to_string();
    let output = command(&["discover", "--timeout", "0.2", "--ask", &address]);
    assert_eq!(output.code, Some(3));
    let error = output.err;
    assert!(
        error.starts_with("error: no robot answered\n  help: "),
        "{error}"
    );
    assert!(!error.contains('\x1b'), "{error}");
    let output = command(&["discover", "--timeout", "0.2", "--json", "--ask", &address]);
    assert_eq!((output.code, output.out.as_str()), (Some(3), "[]\n"));
}

#[test]
fn discover_finds_a_simulator_and_its_connected_user() {
    let sim = Sim::start(&["--user", "anna"], |_| ());
    let session = sim.log_in("anna", "admin").unwrap();
    let output = command(&["discover", "--timeout", "0.5", "--ask", &sim.address]);
    assert_eq!(output.code, Some(0));
    let table = output.out;
    let row = table.lines().nth(1).unwrap();
    for word in ["SPYKEE0001", &sim.address, "anna"] {
        assert!(row.contains(word), "{table}");
    }
    let output = command(&[
        "discover",
        "--timeout",
        "0.5",
        "--json",
        "--ask",
        &sim.address,
    ]);
    let json = output.json();
    let expected = serde_json::json!([
        { "addr": sim.address, "uid": "SPYKEE0001", "connected_user": "anna" }
    ]);
    assert_eq!(json, expected);
    drop(session);
}

#[test]
fn a_reader_that_closes_the_pipe_is_not_a_failure() {
    let sim = Sim::start(&[], |_| ());
    let mut command = program(&["discover", "--timeout", "0.3", "--ask", &sim.address]);
    let mut child = command.stdout(Stdio::piped()).spawn().unwrap();
    drop(child.stdout.take());
    assert_eq!(child.wait().unwrap().code(), Some(0));
}

#[test]
fn the_simulator_ends_on_a_signal_with_130() {
    for signal in [rustix::process::Signal::INT, rustix::process::Signal::TERM] {
        let mut sim = Sim::start(&[], |_| ());
        sim.signal(signal);
        assert_eq!(sim.code(), Some(130));
        let mut rest = String::new();
        sim.stdout.read_to_string(&mut rest).unwrap();
        assert_contains(&rest, &["--robot", "Ctrl-C"]);
    }
}

#[test]
fn a_port_in_use_is_named_with_advice() {
    let sim = Sim::start(&[], |_| ());
    let output = run_in(Path::new("."), &["sim", "--listen", &sim.address]);
    assert_eq!(output.code, Some(1));
    let error = output.err;
    assert!(
        error.contains(&sim.address) && error.contains("  help: "),
        "{error}"
    );
}

#[test]
fn a_simulated_robot_has_the_identity_that_it_is_given() {
    let sim = Sim::start(&["--uid", "ROVER7"], |_| ());
    let output = run_in(Path::new("."), &["robot", "info", "--robot", &sim.address]);
    assert_contains(&output.out, &["ROVER7"]);
    for wrong in ["", "a/b", "#"] {
        assert_eq!(command(&["sim", "--uid", wrong]).code, Some(2), "{wrong}");
    }
}

#[test]
fn an_invalid_world_is_named_with_line_and_column() {
    let folder = tempfile::tempdir().unwrap();
    let missing = folder.path().join("none.yaml");
    let broken = folder.path().join("broken.yaml");
    std::fs::write(&broken, "room:\n  width: wide\n").unwrap();
    for (path, expected) in [(&missing, "none.yaml"), (&broken, "broken.yaml:2:")] {
        let output = command(&["sim", path.to_str().unwrap()]);
        assert_eq!(output.code, Some(2));
        let error = output.err;
        assert_contains(&error, &[expected]);
    }
}

fn password_file(folder: &Path, content: &str, mode: u32) -> String {
    use std::os::unix::fs::PermissionsExt;
    let path = folder.join("password");
    std::fs::write(&path, content).unwrap();
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(mode)).unwrap();
    path.to_str().unwrap().to_owned()
}

#[test]
fn the_password_comes_from_a_file_or_the_environment_and_is_never_shown() {
    let folder = tempfile::tempdir().unwrap();
    let file = password_file(folder.path(), "s3cret\r\nnot this\n", 0o600);
    let environment = |command: &mut Command| {
        command
            .env("SPYKEE_PASSWORD", "from-environment")
            .env("RUST_LOG", "trace");
    };
    let mut sim = Sim::start(&["--password-file", &file], environment);
    assert!(matches!(
        sim.log_in("admin", "wrong"),
        Err(link::LinkError::WrongPassword { .. })
    ));
    drop(sim.log_in("admin", "s3cret").unwrap());
    sim.signal(rustix::process::Signal::INT);
    let mut log = String::new();
    sim.stderr().read_to_string(&mut log).unwrap();
    assert!(
        !log.contains("s3cret") && !log.contains("wrong") && !log.contains("from-env"),
        "{log}"
    );

    let sim = Sim::start(&[], environment);
    drop(sim.log_in("admin", "from-environment").unwrap());
    drop(sim);
    let sim = Sim::start(&[], |_| ());
    drop(sim.log_in("admin", "admin").unwrap());
}

#[test]
fn no_flag_takes_the_password_itself() {
    let output = command(&["sim", "--password", "x"]);
    assert_eq!(output.code, Some(2));
}

#[test]
fn a_password_file_that_others_can_read_causes_a_warning() {
    let folder = tempfile::tempdir().unwrap();
    let file = password_file(folder.path(), "s3cret\n", 0o644);
    let mut sim = Sim::start(&["--password-file", &file], |_| ());
    sim.signal(rustix::process::Signal::INT);
    let mut log = String::new();
    sim.stderr().read_to_string(&mut log).unwrap();
    assert_contains(&log, &["WARN", "chmod 600"]);
    assert!(!log.contains("s3cret"), "{log}");
}

#[test]
fn an_unusable_password_is_refused_without_being_shown() {
    let folder = tempfile::tempdir().unwrap();
    let long = "x".repeat(300);
    for content in ["", "\ns3cret", "p\u{20ac}ss", &long] {
        let file = password_file(folder.path(), content, 0o600);
        let output = command(&["sim", "--listen", "127.0.0.1:0", "--password-file", &file]);
        assert_eq!(output.code, Some(2), "{content}");
        let error = output.err;
        assert!(error.starts_with("error: "), "{error}");
        assert!(
            content.trim().is_empty() || !error.contains(content.trim()),
            "{error}"
        );
    }
}

#[test]
fn json_logs_have_one_object_per_line_also_for_errors() {
    let output = command(&["sim", "none.yaml", "--log-format", "json"]);
    assert_eq!(output.code, Some(2));
    let mut levels = Vec::new();
    for line in output.err.lines() {
        let value: serde_json::Value = serde_json::from_str(line).unwrap();
        levels.push(value["level"].as_str().unwrap().to_owned());
        for key in ["timestamp", "level", "message", "target"] {
            assert!(value[key].is_string(), "{key}: {line}");
        }
    }
    assert_eq!(levels, ["ERROR"]);
}

#[test]
fn an_invalid_rust_log_is_reported_and_ignored() {
    let mut sim = Sim::start(&[], |command| {
        command.env("RUST_LOG", "spykee=loud");
    });
    sim.signal(rustix::process::Signal::INT);
    assert_eq!(sim.code(), Some(130));
    let mut log = String::new();
    sim.stderr().read_to_string(&mut log).unwrap();
    assert_contains(&log, &["RUST_LOG is ignored"]);
}

/// The capacity of a pipe: beyond it, writing blocks.
const PIPE_LEN: usize = 60_000;

/// With a stderr that is never read, the pipe fills and log lines are lost, but the simulator keeps
/// running and ends in time.
#[test]
fn a_stderr_that_is_never_read_does_not_block_the_simulator() {
    let mut sim = Sim::start(&[], |command| {
        command.env("RUST_LOG", "trace");
    });
    let mut stderr = sim.stderr();
    for _ in 0..1500 {
        let mut client = std::net::TcpStream::connect(&sim.address).unwrap();
        client.write_all(b"PK\x0A\x00\x04\x01a\x01b").unwrap();
        let mut answer = Vec::new();
        client.read_to_end(&mut answer).unwrap();
        assert_eq!(answer, b"PK\x0B\x00\x02\x00\x01");
    }
    sim.signal(rustix::process::Signal::INT);
    let (done, wait) = std::sync::mpsc::channel();
    let thread = std::thread::spawn(move || {
        let _ = done.send(sim.code());
    });
    let code = wait
        .recv_timeout(Duration::from_secs(30))
        .expect("did not end");
    assert_eq!(code, Some(130));
    thread.join().unwrap();
    let mut log = Vec::new();
    stderr.read_to_end(&mut log).unwrap();
    assert!(
        log.len() >= PIPE_LEN,
        "the pipe was not full: {} bytes",
        log.len()
    );
}

/// A folder with this script and this config.
fn place(script: &str, config: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("lights.lua"), script).unwrap();
    std::fs::write(folder.path().join("spykee.yaml"), config).unwrap();
    folder
}

fn logs_of(folder: &tempfile::TempDir, args: &[&str]) -> String {
    let args = [&["run", "lights.lua", "--sim"], args].concat();
    let output = run_in(folder.path(), &args);
    let said = output.err;
    assert_eq!(output.code, Some(0), "{said}");
    said
}

const LIGHTS: &str = "robot.led('left', true) robot.led('left', true) robot.play('laugh')\n\
                      task.wait(0.2) robot.led('left', false)\n";

#[test]
fn lights_and_sounds_of_a_simulated_robot_are_in_its_log_and_the_seed_is_not() {
    let folder = place(LIGHTS, "");
    for fast in [&[][..], &["--fast"]] {
        let said = logs_of(&folder, fast);
        for words in ["left light on", "plays laugh", "left light off"] {
            // The status line shows them too.
            let told = |line: &&str| line.contains("INFO") && line.contains(words);
            assert_eq!(said.lines().filter(told).count(), 1, "{words}: {said}");
        }
        assert!(!said.contains("seed"), "{said}");
    }
    let said = logs_of(&folder, &["--log-format", "json"]);
    assert_contains(&said, &["\"seed\":"]);
}

#[test]
fn log_lines_in_files_begin_with_the_time_in_utc() {
    let said = logs_of(&place(LIGHTS, ""), &[]);
    let line = said.lines().find(|line| line.contains("plays laugh"));
    let stamp = &line.unwrap()[..30];
    assert!(stamp.starts_with("20") && stamp.contains("Z "), "{said}");
}

#[test]
fn the_yaml_of_a_world_is_printed_for_changes() {
    for (args, first) in [
        (&["hall"][..], "# Two rooms"),
        (&[], "# The built-in world"),
    ] {
        let output = command(&[&["sim", "show", "--yaml"], args].concat());
        assert_eq!(output.code, Some(0), "{}", output.err);
        let yaml = output.out;
        assert!(yaml.starts_with(first), "{yaml}");
        spykee::sim::World::from_yaml(&yaml, "printed").unwrap();
    }
    let unknown = command(&["sim", "show", "haal", "--yaml"]);
    assert_eq!(unknown.code, Some(2), "{}", unknown.err);
}

#[test]
fn a_start_inside_furniture_is_refused() {
    let world = "name: inside\nroom: { width: 4, depth: 4 }\nstation: { at: [0, 2], heading_degrees: 0 }\n\
                 furniture:\n  - { at: [2, 2], length: 2, width: 2, height: 0.5, colour: red }\n\
                 start: { at: [2, 2], heading_degrees: 0 }\n";
    let error = spykee::sim::World::from_yaml(world, "inside.yaml").unwrap_err();
    assert!(
        error.to_string().contains("start inside something"),
        "{error}"
    );
}

#[test]
fn shells_complete_worlds_lessons_and_names_of_the_api() {
    for shell in ["bash", "zsh", "fish"] {
        let script = command(&["completions", shell]).out;
        for names in ["living_room", "line_loop", "patrol-and-dock", "robot.move"] {
            assert!(script.contains(names), "{shell}: {names}");
        }
        // Names of behaviours are queried at completion time.
        assert!(script.contains("spykee behaviour list --names"), "{shell}");
        assert!(!script.contains("__spykee_behaviours"), "{shell}");
    }
    let help = command(&["run", "--help"]).out;
    assert!(!help.contains("line_loop"), "{help}");
}
