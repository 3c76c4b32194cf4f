//! `spykee config`, and which settings a run uses.

use std::ffi::OsStr;
use std::os::unix::ffi::OsStrExt as _;
use std::process::Command as Process;

use spykee::wire::{Command, Stream};

use crate::rig::{Rig, assert_contains};

#[tokio::test]
async fn a_config_in_the_current_folder_is_used_and_named_in_the_log() {
    let rig = Rig::quiet().await;
    rig.file("say.lua", "print('from the config')");
    rig.file(
        "spykee.yaml",
        &format!("robot: {}\nbehaviours:\n- file: say.lua\n", rig.address),
    );
    let mut run = rig.spykee(&["run"]);
    assert_eq!(run.code().await, Some(0), "{}", run.text());
    let text = run.text();
    assert_contains(&text, &["settings from spykee.yaml", "from the config"]);
}

#[tokio::test]
async fn show_prints_the_origin_of_each_value_and_no_secret() {
    let rig = Rig::quiet().await;
    rig.file("password.txt", "hunter2\n");
    rig.file(
        "other.yaml",
        "user: ann\npassword_file: password.txt\nwatchdog:\n  low: 25\n",
    );
    let args = ["config", "show", "--origin", "--config", "other.yaml"];
    let mut run = rig.spykee_with(&args, &[("SPYKEE_ROBOT", "10.0.0.7")]);
    assert_eq!(run.code().await, Some(0), "{}", run.text());
    let text = run.text();
    let row = |key: &str| {
        let mut rows = text
            .lines()
            .map(|line| line.split_whitespace().collect::<Vec<_>>());
        rows.find(|row| row[0] == key)
            .unwrap_or_else(|| panic!("{text}"))
    };
    assert_eq!(row("robot"), ["robot", "10.0.0.7:9000", "$SPYKEE_ROBOT"]);
    assert_eq!(row("user"), ["user", "ann", "other.yaml"]);
    assert_eq!(row("watchdog.low"), ["watchdog.low", "25", "other.yaml"]);
    assert_eq!(row("watchdog.ok")[2], "default");
    assert!(!text.contains("hunter2"), "{text}");
}

#[tokio::test]
async fn an_unknown_key_is_reported_with_the_nearest_one_and_its_place() {
    let rig = Rig::quiet().await;
    rig.file("spykee.yaml", "watchdog:\n  lwo: 25\n");
    let mut run = rig.spykee(&["config", "check"]);
    assert_eq!(run.code().await, Some(4));
    let text = run.text();
    let told = [
        "spykee.yaml",
        "unknown key `lwo`",
        "line 2 column 3",
        "did you mean 'low'?",
    ];
    assert!(told.iter().all(|part| text.contains(part)), "{text}");
    rig.file("good.yaml", "watchdog: { low: 25 }\n");
    for args in [
        &["config", "check", "good.yaml"][..],
        &["config", "check", "--config", "good.yaml"],
    ] {
        let mut run = rig.spykee(args);
        assert_eq!(run.code().await, Some(0), "{}", run.text());
    }
}

#[tokio::test]
async fn a_variable_that_nothing_reads_is_warned_of() {
    let rig = Rig::quiet().await;
    rig.file("say.lua", "print('ran')");
    let told = "spykee does not read SPYKEE_WATCHDOG_LOW:";
    for args in [&["config", "show"][..], &["run", "say.lua", "--sim"]] {
        let mut run = rig.spykee_with(args, &[("SPYKEE_WATCHDOG_LOW", "25")]);
        assert_eq!(run.code().await, Some(0), "{}", run.text());
        let count = run.text().matches(told).count();
        assert_eq!(count, 1, "{args:?}: {}", run.text());
    }
    let others = [
        ("SPYKEE_PASSWORD", "hunter2"),
        ("SPYKEE_HEALTH_PORT", "7788"),
    ];
    let mut run = rig.spykee_with(&["config", "show"], &others);
    assert_eq!(run.code().await, Some(0), "{}", run.text());
    assert!(!run.text().contains("does not read"), "{}", run.text());
}

#[tokio::test]
async fn a_bad_parameter_names_the_config_that_was_found() {
    let rig = Rig::quiet().await;
    let config = "behaviours:\n  - { file: a.lua, params: { speed: 500 } }\n";
    rig.file("spykee.yaml", config);
    let script = "local p = params.declare({ speed = { default = 40, max = 60 } }) print(p.speed)";
    rig.file("a.lua", script);
    let told = "spykee.yaml: params: speed: 500";
    for command in [&["run", "--sim"][..], &["check", "a.lua"]] {
        let mut run = rig.spykee(command);
        assert_eq!(run.code().await, Some(4), "{}", run.text());
        assert!(run.text().contains(told), "{command:?}: {}", run.text());
    }
}

fn switched(stream: Stream, on: bool) -> impl Fn(&Command) -> bool {
    move |command| *command == Command::Stream { stream, on }
}

#[tokio::test]
async fn a_microphone_that_is_off_in_the_config_is_never_switched_on_and_the_script_is_warned() {
    let rig = Rig::quiet().await;
    rig.file("spykee.yaml", "streams: { audio_in: off, video: on }\n");
    rig.file("deaf.lua", "robot.on('noise', print)");
    let mut run = rig.spykee(&["run", "deaf.lua", "--robot", &rig.address, "--for", "2"]);
    assert_eq!(run.code().await, Some(0), "{}", run.text());
    let text = run.text();
    let told = "'noise' never comes: the config keeps audio_in off";
    assert_eq!(text.matches(told).count(), 1, "{text}");
    rig.heard(0, switched(Stream::Video, true)).await;
    let mut commands = rig.commands(0).into_iter();
    assert!(!commands.any(|one| switched(Stream::AudioIn, true)(&one)));
}

#[tokio::test]
async fn a_camera_that_is_off_in_the_config_takes_no_snapshot() {
    let rig = Rig::quiet().await;
    rig.file("spykee.yaml", "streams: { video: off }\n");
    let asked = ["robot", "snapshot", "-o", "a.jpg", "--robot", &rig.address];
    let mut run = rig.spykee(&asked);
    assert_eq!(run.code().await, Some(2), "{}", run.text());
    assert!(run.text().contains("the config keeps video off"));
    let mut commands = rig.commands(0).into_iter();
    assert!(!commands.any(|one| switched(Stream::Video, true)(&one)));
}

#[tokio::test]
async fn streams_have_origins_and_refuse_unknown_values() {
    let rig = Rig::quiet().await;
    rig.file("spykee.yaml", "streams:\n  audio_in: off\n");
    let mut run = rig.spykee(&["config", "show", "--origin"]);
    assert_eq!(run.code().await, Some(0), "{}", run.text());
    let text = run.text();
    let rows: Vec<Vec<&str>> = text
        .lines()
        .map(|row| row.split_whitespace().collect())
        .collect();
    for row in [
        ["streams.video", "auto", "default"],
        ["streams.audio_in", "off", "spykee.yaml"],
    ] {
        assert!(rows.iter().any(|one| *one == row), "{text}");
    }
    rig.file("spykee.yaml", "streams: { video: sometimes }\n");
    let mut run = rig.spykee(&["config", "check"]);
    assert_eq!(run.code().await, Some(4));
    assert_contains(&run.text(), &["valid are on, auto, off"]);
}

#[tokio::test]
async fn a_config_can_be_named_before_or_after_any_command_and_must_exist() {
    let rig = Rig::quiet().await;
    rig.file("other.yaml", "user: ann\n");
    for words in [
        &["--config", "other.yaml", "config", "show"][..],
        &["config", "--config", "other.yaml", "show"],
        &["config", "show", "--config", "other.yaml"],
    ] {
        let mut run = rig.spykee(words);
        assert_eq!(run.code().await, Some(0), "{words:?}: {}", run.text());
        assert!(run.text().contains("ann"), "{words:?}: {}", run.text());
    }
    for command in [&["config", "show"][..], &["config", "schema"], &["api"]] {
        let mut run = rig.spykee(&[&["--config", "missing.yaml"], command].concat());
        assert_eq!(run.code().await, Some(2), "{command:?}: {}", run.text());
        let text = run.text();
        assert!(text.contains("missing.yaml"), "{command:?}: {text}");
    }
}

#[test]
fn a_variable_names_the_config_unless_a_flag_does() {
    let folder = tempfile::tempdir().unwrap();
    let ann = OsStr::new("ann.yaml");
    let missing = OsStr::new("missing.yaml");
    let latin = OsStr::from_bytes(b"caf\xe9.yaml");
    for name in [ann, latin] {
        std::fs::write(folder.path().join(name), "user: ann\n").unwrap();
    }
    for (variable, words, code, told) in [
        (ann, &["config", "show"][..], 0, "ann"),
        (ann, &["config", "check"], 0, "ann.yaml: valid"),
        (latin, &["config", "show"], 0, "ann"),
        (latin, &["config", "check"], 0, "valid"),
        (missing, &["config", "show"], 2, "missing.yaml"),
        (missing, &["config", "check"], 4, "missing.yaml"),
        (
            missing,
            &["--config", "ann.yaml", "config", "show"],
            0,
            "ann",
        ),
    ] {
        let mut process = Process::new(env!("CARGO_BIN_EXE_spykee"));
        process.args(words).current_dir(folder.path());
        let output = process.env("SPYKEE_CONFIG", variable).output().unwrap();
        let text = [output.stdout, output.stderr].concat();
        let text = String::from_utf8_lossy(&text);
        assert_eq!(output.status.code(), Some(code), "{words:?}: {text}");
        assert!(text.contains(told), "{words:?}: {text}");
    }
}

#[tokio::test]
async fn the_guard_works_without_a_microphone_and_without_a_camera() {
    let guard = concat!(env!("CARGO_MANIFEST_DIR"), "/behaviours/guard.lua");
    for (stream, event, seen) in [("audio_in", "noise", true), ("video", "frame", false)] {
        let rig = Rig::quiet().await;
        rig.file("spykee.yaml", &format!("streams: {{ {stream}: off }}\n"));
        // Ada walks by within six seconds.
        let mut run = rig.spykee(&[
            "run", guard, "--sim", "hall", "--fast", "--for", "15", "--seed", "1",
        ]);
        assert_eq!(run.code().await, Some(0), "{}", run.text());
        let text = run.text();
        let told = format!("'{event}' never comes");
        assert_eq!(text.matches(&told).count(), 1, "{text}");
        assert_eq!(text.contains("something moves"), seen, "{text}");
    }
}

/// What a service refuses, `config check` and `doctor` refuse too, with the same words.
#[tokio::test]
async fn a_config_that_a_service_refuses_does_not_pass_the_check() {
    let rig = Rig::quiet().await;
    let speed = "params.declare({ speed = { default = 1, min = 0, max = 2 } })";
    rig.file("go.lua", speed);
    for (config, words) in [
        ("live: { listen: 0.0.0.0:7788 }\n", "there is no token"),
        (
            "behaviours: [{ file: go.lua, params: { speed: 9 } }]\n",
            "speed",
        ),
        (
            "behaviours: [{ file: go.lua }]\nschedule: [{ run: go, at: '0 9 * * *', for: 0m }]\n",
            "must be above zero",
        ),
        (
            "mqtt: { host: 127.0.0.1, user: anna, password_file: none.password }\n",
            "none.password",
        ),
    ] {
        let config = format!("service: {{ user: root }}\n{config}");
        rig.file("spykee.yaml", &config);
        for (command, code) in [
            (&["config", "check", "spykee.yaml"][..], 4),
            (&["doctor", "--config", "spykee.yaml"], 3),
        ] {
            let mut run = rig.spykee(command);
            assert_eq!(run.code().await, Some(code), "{config}{}", run.text());
            assert_contains(&run.text(), &[words]);
        }
        let serve = ["serve", "--config", "spykee.yaml", "--robot", &rig.address];
        let mut run = rig.spykee(&serve);
        assert_ne!(run.code().await, Some(0), "{config}{}", run.text());
        assert_contains(&run.text(), &[words]);
    }
    rig.file("spykee.yaml", "behaviours: [{ file: go.lua }]\n");
    let mut run = rig.spykee(&["config", "check"]);
    assert_eq!(run.code().await, Some(0), "{}", run.text());
}
