//! Secrets and privacy: the password appears nowhere, files belong to the user alone, and no script
//! controls the terminal.

use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::{Command as Process, Stdio};

use rustix::process::Pid;
use spykee::sim::{Handle, Options, Server, World};
use spykee::wire::{Command, Login};
use tokio::time::timeout;

use crate::rig::{QUIET_WORLD, Rig, WAIT_LIMIT, assert_contains, children_of};

/// A text that no other output contains by chance.
const PASSWORD: &str = "correct-horse-battery";

fn spykee(args: &[&str]) -> Process {
    let mut process = Process::new(env!("CARGO_BIN_EXE_spykee"));
    process.args(args).stdin(Stdio::null());
    process
        .env("SPYKEE_PASSWORD", PASSWORD)
        .env("RUST_LOG", "trace");
    process
}

/// Everything that it writes to both streams until its end.
fn said(mut process: Process) -> String {
    let output = process.output().unwrap();
    let out = [output.stdout, output.stderr].concat();
    String::from_utf8_lossy(&out).into_owned()
}

#[track_caller]
fn assert_silent(what: &str, text: &str) {
    assert!(
        !text.contains(PASSWORD),
        "{what} contains the password:\n{text}"
    );
}

/// A robot whose password is the secret one.
async fn guarded_robot() -> (String, Handle) {
    let world = World::from_yaml(QUIET_WORLD, "test world").unwrap();
    let login = Login::new("admin", PASSWORD);
    let options = Options {
        login,
        ..Options::default()
    };
    let server = Server::bind(world, options).await.unwrap();
    let address = server.local_addr().to_string();
    let sim = server.handle();
    tokio::spawn(server.run());
    (address, sim)
}

#[tokio::test(flavor = "multi_thread")]
async fn the_password_is_in_no_output_at_the_finest_level() {
    let rig = Rig::quiet().await;
    let (guarded, _) = guarded_robot().await;
    let script = rig.file(
        "script.lua",
        "print(robot.info().name) task.wait(0.2) error('end')",
    );
    let script = script.to_str().unwrap().to_owned();
    let right = ["run", &script, "--robot", &guarded, "--log-format"];
    let runs: [Vec<&str>; 7] = [
        [&right[..], &["text"]].concat(),
        [&right[..], &["json"]].concat(),
        // Refused, because the robot has another password.
        vec!["run", &script, "--robot", &rig.address],
        vec!["run", &script, "--sim"],
        vec!["run", "--help"],
        vec!["--help"],
        vec!["discover", "--timeout", "0.2", "--ask", &guarded],
    ];
    for args in runs {
        let text = timeout(
            WAIT_LIMIT,
            tokio::task::spawn_blocking({
                let process = spykee(&args);
                move || said(process)
            }),
        );
        let text = text.await.unwrap().unwrap();
        assert!(!text.is_empty(), "{args:?} prints nothing");
        assert_silent(&format!("{args:?}"), &text);
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn the_password_is_in_no_process_list_and_not_in_any_host() {
    let rig = Rig::quiet().await;
    let (guarded, sim) = guarded_robot().await;
    let script = rig.file("script.lua", "robot.led('flash', true) task.wait(60)");
    let mut agent = spykee(&["run", script.to_str().unwrap(), "--robot", &guarded]);
    agent.stdout(Stdio::null()).stderr(Stdio::null());
    let mut agent = agent.current_dir(rig.folder()).spawn().unwrap();
    let lit = sim.wait_heard(0, |command| matches!(command, Command::Led { .. }));
    timeout(WAIT_LIMIT, lit).await.unwrap();
    let pid = Pid::from_child(&agent);
    let read = |pid: Pid, file: &str| {
        let path = format!("/proc/{}/{file}", pid.as_raw_nonzero());
        String::from_utf8_lossy(&std::fs::read(path).unwrap()).into_owned()
    };
    assert_silent("the agent's command line", &read(pid, "cmdline"));
    // The robot accepted the login, so the agent does have the password.
    assert_silent("the agent's environment", &read(pid, "environ"));
    let children = children_of(pid);
    assert_eq!(children.len(), 2, "a host and the guardian");
    for child in children {
        let line = read(child, "cmdline");
        let environment = read(child, "environ");
        let known = ["__host", "__guardian"]
            .iter()
            .any(|name| line.contains(name));
        assert!(known, "{line}");
        assert_silent("a child's command line", &line);
        assert_silent("a child's environment", &environment);
    }
    agent.kill().unwrap();
    agent.wait().unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn saved_files_are_accessible_to_their_user_only() {
    let rig = Rig::quiet().await;
    let mut run = rig.run("print('saved', robot.wait_frame(30):save('one.jpg'))");
    assert_eq!(run.code().await, Some(0), "{}", run.text());
    assert_contains(&run.text(), &["saved /"]);
    let found = modes(&rig.folder().join("spykee-data"));
    assert!(
        found.iter().any(|(path, _)| path.ends_with("one.jpg")),
        "{found:?}"
    );
    let room = rig.folder().join("room.jpg");
    let output = room.to_str().unwrap();
    let snapshot = ["robot", "snapshot", "-o", output, "--robot", &rig.address];
    let mut run = rig.spykee(&snapshot);
    assert_eq!(run.code().await, Some(0), "{}", run.text());
    for (path, mode) in found.into_iter().chain(modes(&room)) {
        assert_eq!(mode & 0o077, 0, "others can use {path}: {mode:o}");
    }
}

/// Every file and folder below this path, with its permissions.
fn modes(path: &Path) -> Vec<(String, u32)> {
    let metadata = std::fs::metadata(path).unwrap();
    let mut found = vec![(
        path.display().to_string(),
        metadata.permissions().mode() & 0o777,
    )];
    if metadata.is_dir() {
        let entries = std::fs::read_dir(path).unwrap();
        found.extend(entries.flat_map(|entry| modes(&entry.unwrap().path())));
    }
    found
}

#[tokio::test(flavor = "multi_thread")]
async fn scripts_cannot_control_the_terminal() {
    let rig = Rig::quiet().await;
    let evil = r#"local evil = "\27[2Jone\27]0;two\7\155\49m\r\n\8\127\u{9b}3m\u{202e}three"
        print(evil) log.warn(evil, {[evil] = evil}) pcall(print, setmetatable({}, {__tostring =
        function() return evil end})) robot.on("docked", print):off() error(evil)"#;
    let script = rig.file("script.lua", evil);
    for format in ["text", "json"] {
        let args = ["run", script.to_str().unwrap(), "--robot", &rig.address];
        let mut run = rig.spykee(&[&args[..], &["--log-format", format]].concat());
        assert_eq!(run.code().await, Some(1), "{}", run.text());
        let text = run.text();
        assert_contains(&text, &["one", "three"]);
        let bad = text.chars().find(|c| {
            (c.is_control() && !matches!(c, '\n' | '\t')) || ('\u{202a}'..='\u{202e}').contains(c)
        });
        assert_eq!(bad, None, "{text:?}");
        if format == "json" {
            let decoded = text
                .lines()
                .map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap());
            for record in decoded {
                let told = record["message"].as_str().unwrap_or_default();
                let bad = told
                    .chars()
                    .find(|c| c.is_control() && !matches!(c, '\n' | '\t'));
                assert_eq!(bad, None, "{told:?}");
            }
        }
    }
}
