//! Malicious files, names and texts, given to the real program: each is refused or bounded with a
//! message, quickly, and nothing of it reaches a terminal, another folder or another robot.
//! `tests/hostile/README.md` lists all attacks.

use std::net::TcpListener;
use std::os::unix::fs::{PermissionsExt as _, symlink};
use std::path::Path;
use std::process::{Command as Process, Output, Stdio};

use rustix::fs::{CWD, FileType, Mode, mknodat};
use spykee::sim::{Options, Server, World};
use spykee::wire::{Command, EngineReport, Login, Report};
use tokio::time::timeout;

use crate::rig::{QUIET_WORLD, Rig, WAIT_LIMIT, assert_contains, program};

fn spykee(folder: &Path, args: &[&str]) -> Process {
    let mut process = program(args);
    process.current_dir(folder);
    process
}

/// Waits for the end; returns exit code and output. A process that hangs fails the test.
async fn end(mut process: Process) -> (Option<i32>, String) {
    process.stdout(Stdio::piped()).stderr(Stdio::piped());
    let process = tokio::process::Command::from(process)
        .kill_on_drop(true)
        .output();
    let output: Output = timeout(WAIT_LIMIT, process)
        .await
        .expect("it hangs")
        .unwrap();
    let said = [output.stdout, output.stderr].concat();
    (output.status.code(), String::from_utf8(said).unwrap())
}

async fn run(folder: &Path, args: &[&str]) -> (Option<i32>, String) {
    end(spykee(folder, args)).await
}

fn pipe(path: &Path) {
    mknodat(CWD, path, FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).unwrap();
}

const SECRET: &str = "correct-horse-battery";

#[tokio::test(flavor = "multi_thread")]
async fn a_config_found_in_the_current_folder_sends_no_private_file_to_its_robot() {
    let root = tempfile::tempdir().unwrap();
    let private = root.path().join("private");
    let here = root.path().join("unpacked");
    std::fs::create_dir(&here).unwrap();
    std::fs::write(&private, SECRET).unwrap();
    std::fs::set_permissions(&private, std::fs::Permissions::from_mode(0o600)).unwrap();
    std::fs::write(here.join("script.lua"), "print(1)").unwrap();
    symlink(&private, here.join("link")).unwrap();
    let attacker = TcpListener::bind("127.0.0.1:0").unwrap();
    attacker.set_nonblocking(true).unwrap();
    let address = attacker.local_addr().unwrap();
    for file in ["../private", "link", private.to_str().unwrap()] {
        let config = format!("robot: {address}\npassword_file: {file}\n");
        std::fs::write(here.join("spykee.yaml"), config).unwrap();
        let (code, said) = run(&here, &["run", "script.lua"]).await;
        assert_eq!(code, Some(2), "{said}");
        assert_contains(&said, &["password file", "--config"]);
        assert!(!said.contains(SECRET), "{said}");
        assert!(
            attacker.accept().is_err(),
            "the robot of the config was contacted"
        );
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn the_password_of_the_environment_has_precedence_over_the_config() {
    let world = World::from_yaml(QUIET_WORLD, "test world").unwrap();
    let login = Login::new("admin", SECRET);
    let options = Options {
        login,
        ..Options::default()
    };
    let server = Server::bind(world, options).await.unwrap();
    let address = server.local_addr().to_string();
    tokio::spawn(server.run());
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    std::fs::write(path("wrong"), "wrong").unwrap();
    std::fs::write(path("named.yaml"), "password_file: wrong").unwrap();
    let args = [
        "robot",
        "battery",
        "--robot",
        &address,
        "--config",
        "named.yaml",
    ];
    let (code, said) = run(folder.path(), &args).await;
    assert_eq!(code, Some(3), "{said}");
    let mut process = spykee(folder.path(), &args);
    process.env("SPYKEE_PASSWORD", SECRET);
    let (code, said) = end(process).await;
    assert_eq!(code, Some(0), "{said}");
}

#[tokio::test(flavor = "multi_thread")]
async fn names_with_path_separators_or_invisible_characters_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["...lua", "a\u{1b}[2Jb.lua", "a\nb.lua", "a\u{202e}b.lua"] {
        std::fs::write(folder.path().join(name), "store.set('a', 1)").unwrap();
        let (code, said) = run(
            folder.path(),
            &["run", name, "--sim", "--fast", "--no-check"],
        )
        .await;
        assert_eq!(code, Some(2), "{name:?}: {said}");
        assert_contains(&said, &["cannot be called"]);
        assert!(
            !said.contains('\u{1b}') && !said.contains('\u{202e}'),
            "{said:?}"
        );
    }
    assert!(!folder.path().join("store.json").exists());
    assert!(!folder.path().join("spykee-data").exists());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_link_in_the_place_of_a_data_folder_is_refused_before_the_agent_connects() {
    let rig = Rig::quiet().await;
    let elsewhere = rig.folder().join("elsewhere");
    let data = rig.folder().join("spykee-data");
    std::fs::create_dir_all(&elsewhere).unwrap();
    std::fs::create_dir_all(&data).unwrap();
    symlink(&elsewhere, data.join("script")).unwrap();
    let script = "store.set('a', 1) print(robot.wait_frame(30):save('one.jpg'))";
    let mut real = rig.run(script);
    assert_eq!(real.code().await, Some(1), "{}", real.text());
    assert_contains(&real.text(), &["symbolic link"]);
    assert_eq!(rig.commands(0), []);
    let fast = ["run", "script.lua", "--sim", "--fast", "--no-check"];
    let (code, said) = run(rig.folder(), &fast).await;
    assert_eq!(code, Some(1), "{said}");
    assert_eq!(std::fs::read_dir(&elsewhere).unwrap().count(), 0);
}

#[tokio::test(flavor = "multi_thread")]
async fn pipes_devices_and_folders_in_the_place_of_files_are_reported_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    for name in ["pipe.lua", "pipe_test.lua", "pipe.yaml", "pipe.jpg"] {
        pipe(&path(name));
    }
    std::fs::write(path("good.lua"), "print(1)").unwrap();
    std::fs::create_dir(path("folder.yaml")).unwrap();
    let long = "x".repeat(300_000);
    std::fs::write(path("long.yaml"), format!("# {long}")).unwrap();
    let cases: [(&[&str], i32, &str); 14] = [
        (&["run", "pipe.lua", "--sim"], 2, "a pipe"),
        (&["check", "pipe.lua"], 2, "a pipe"),
        (&["test", "pipe_test.lua"], 2, "a pipe"),
        (&["lesson", "check", "pipe.lua"], 2, "a pipe"),
        (&["run", "/dev/zero", "--sim"], 2, "a device"),
        (&["config", "check", "/dev/zero"], 4, "a device"),
        (
            &["run", "good.lua", "--sim", "--config", "/dev/zero"],
            2,
            "a device",
        ),
        (&["config", "check", "pipe.yaml"], 4, "a pipe"),
        (&["config", "check", "folder.yaml"], 4, "a folder"),
        (&["config", "check", "long.yaml"], 4, "longer than"),
        (&["sim", "check", "pipe.yaml"], 4, "a pipe"),
        (&["run", "good.lua", "--sim", "pipe.yaml"], 2, "a pipe"),
        (
            &["sim", "--listen", "127.0.0.1:0", "--faults", "pipe.yaml"],
            2,
            "a pipe",
        ),
        (
            &["colour", "find", "pipe.jpg", "--colour", "red"],
            2,
            "a pipe",
        ),
    ];
    for (args, code, words) in cases {
        let (ended, said) = run(folder.path(), args).await;
        assert_eq!(ended, Some(code), "{args:?}: {said}");
        assert!(said.contains(words), "{args:?}: {said}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_config_found_in_the_current_folder_sends_nothing_and_opens_no_page_to_others() {
    let rig = Rig::quiet().await;
    rig.file("a.lua", "print('hi')");
    for (config, words) in [
        (
            "notify: { targets: { phone: { url: 'http://127.0.0.1:9/', picture: body } } }\n",
            "would send messages and pictures",
        ),
        (
            "live: { listen: 0.0.0.0:0 }\n",
            "would open the page to other computers",
        ),
    ] {
        rig.file("spykee.yaml", config);
        let mut run = rig.spykee(&["run", "a.lua", "--robot", &rig.address]);
        assert_eq!(run.code().await, Some(2), "{}", run.text());
        assert_contains(&run.text(), &[words, "--config spykee.yaml"]);
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn deeply_nested_yaml_is_refused_quickly() {
    let folder = tempfile::tempdir().unwrap();
    for (name, unit) in [
        ("braces", "{a: "),
        ("brackets", "["),
        ("items", "- "),
        ("keys", "? "),
    ] {
        let file = format!("{name}.yaml");
        for length in [100_000, 800_000] {
            let text = unit.repeat(length / unit.len());
            std::fs::write(folder.path().join(&file), text).unwrap();
            for (args, code) in [
                (["config", "check", &file], 4),
                (["sim", "check", &file], 4),
            ] {
                let (ended, said) = run(folder.path(), &args).await;
                assert_eq!(ended, Some(code), "{args:?}: {said}");
                assert!(said.len() < 1000, "{args:?}: {said}");
            }
        }
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_scenario_does_not_print_the_contents_of_other_files() {
    let folder = tempfile::tempdir().unwrap();
    symlink("/etc/passwd", folder.path().join("secret.lua")).unwrap();
    symlink("/etc/passwd", folder.path().join("secret.yaml")).unwrap();
    let play = |call: &str, options: &str| {
        format!("scenario('x', {{ {options} }}, function(sim) {call} sim:wait(1) end)")
    };
    for text in [
        play("sim:run('/etc/passwd')", "limit = 5"),
        play("sim:run('secret.lua')", "limit = 5"),
        play("", "world = 'secret.yaml'"),
        play("", "world = '/etc/passwd'"),
    ] {
        std::fs::write(folder.path().join("a_test.lua"), &text).unwrap();
        let (code, said) = run(folder.path(), &["test", "a_test.lua"]).await;
        assert_eq!(code, Some(4), "{text}: {said}");
        assert!(!said.contains("root:"), "{text}: {said}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn no_text_of_a_file_controls_the_terminal_or_breaks_a_report() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let dirty = "\\27[2J\\u{9b}31m\\u{202e}<&\\u{ffff}";
    let scenario = format!(
        "scenario('a {dirty}', {{ limit = 2 }}, function() print('{dirty}') error('{dirty}') end)"
    );
    std::fs::write(path("dirty_test.lua"), scenario).unwrap();
    std::fs::write(path("world.yaml"), "name: \"a\\e[2J\\u202e\"\nroom: { width: 3, depth: 3 }\nstation: { at: [0, 1], heading_degrees: 0 }\n").unwrap();
    std::fs::write(path("spykee.yaml"), "user: \"a\\e[2J\\u202e\"\n").unwrap();
    let test = ["test", "dirty_test.lua", "--junit", "report.xml"];
    let cases: [&[&str]; 6] = [
        &test,
        &["test", "dirty_test.lua", "--json"],
        &["test", "dirty_test.lua", "--list"],
        &["sim", "check", "world.yaml"],
        &["config", "show"],
        &["config", "show", "--json"],
    ];
    for args in cases {
        let (_, said) = run(folder.path(), args).await;
        let bad = |c: char| {
            (c.is_control() && !matches!(c, '\n' | '\t')) || matches!(c, '\u{202a}'..='\u{202e}')
        };
        assert!(
            !said.is_empty() && !said.contains(bad),
            "{args:?}: {said:?}"
        );
    }
    let report = std::fs::read_to_string(path("report.xml")).unwrap();
    let mut reader = quick_xml::Reader::from_str(&report);
    let mut failures = 0;
    loop {
        match reader.read_event().expect("not well-formed") {
            quick_xml::events::Event::Eof => break,
            quick_xml::events::Event::Start(element) => {
                failures += usize::from(element.name().as_ref() == b"failure");
            }
            _ => {}
        }
    }
    assert_eq!(failures, 1, "{report}");
    let forbidden = |c: char| c.is_control() && c != '\n' && c != '\t' || c == '\u{ffff}';
    assert!(!report.contains(forbidden), "{report:?}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_script_cannot_forge_log_lines() {
    let rig = Rig::quiet().await;
    let mut run = rig.run("log.warn('hi behaviour=\"other\" line=1\\nWARN forged')");
    assert_eq!(run.code().await, Some(0), "{}", run.text());
    let text = run.text();
    let line = text
        .lines()
        .find(|line| line.contains("hi behaviour"))
        .unwrap();
    assert_contains(line, &["\"hi behaviour=\\\"other\\\" line=1"]);
    assert!(
        !text.lines().any(|line| line.starts_with("WARN forged")),
        "{text}"
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn a_robot_that_repeats_a_message_endlessly_does_not_fill_the_log() {
    let rig = Rig::quiet().await;
    let mut run = rig.run("robot.wait_for('sound_finished')");
    rig.heard(0, |command| *command == Command::STOP).await;
    run.says("connected").await;
    for code in 0..2000 {
        rig.sim
            .inject(Report::Engine(EngineReport::Unknown(200 + code as u8 % 3)));
    }
    // The event queue of a script is bounded, so the flood may have displaced the first of these
    // reports.
    while run.lives() {
        rig.sim.inject(Report::SoundFinished);
        tokio::time::sleep(std::time::Duration::from_millis(50)).await;
    }
    assert_eq!(run.code().await, Some(0), "{}", run.text());
    let text = run.text();
    for code in 200..203 {
        let said = text.matches(&format!("ENGINE {code}")).count();
        assert_eq!(said, 1, "{text}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_hundred_thousand_typos_are_counted_and_the_first_are_listed() {
    let folder = tempfile::tempdir().unwrap();
    for file in 0..5 {
        let text: String = (0..20_000).map(|line| format!("x{line}()\n")).collect();
        std::fs::write(folder.path().join(format!("{file}.lua")), text).unwrap();
    }
    let began = std::time::Instant::now();
    let (code, said) = run(folder.path(), &["check", "."]).await;
    eprintln!("100,000 typos in {:?}", began.elapsed());
    assert_eq!(code, Some(4));
    assert_eq!(
        said.matches("and 19800 more mistakes in this file").count(),
        5,
        "{}",
        said.len()
    );
    assert!(
        said.matches("unknown name").count() == 1000,
        "{}",
        said.len()
    );
}
