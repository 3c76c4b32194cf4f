//! Luau's type checker, a program of its own beside `spykee`: what it finds, and that it may be
//! absent, slow or broken.

use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::Duration;

use tempfile::TempDir;

/// A copy of `spykee` in a folder of its own, with a checker that is this shell script.
struct Beside {
    folder: TempDir,
}

impl Beside {
    fn new(checker: Option<&str>) -> Beside {
        let folder = tempfile::tempdir().unwrap();
        let own = Path::new(env!("CARGO_BIN_EXE_spykee"));
        let copy = folder.path().join("spykee");
        std::fs::hard_link(own, &copy)
            .or_else(|_| std::fs::copy(own, &copy).map(|_| ()))
            .unwrap();
        if let Some(script) = checker {
            let file = folder.path().join("spykee-luau-check");
            std::fs::write(&file, format!("#!/bin/sh\n{script}\n")).unwrap();
            std::fs::set_permissions(&file, PermissionsExt::from_mode(0o755)).unwrap();
        }
        Beside { folder }
    }

    fn script(&self, text: &str) -> PathBuf {
        let file = self.folder.path().join("a.lua");
        std::fs::write(&file, text).unwrap();
        file
    }

    fn check(&self, text: &str) -> Output {
        let mut command = Command::new(self.folder.path().join("spykee"));
        command.arg("check").arg(self.script(text));
        command.stdin(Stdio::null()).env_remove("RUST_LOG");
        command.output().unwrap()
    }
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

#[test]
fn without_a_checker_nothing_is_said_of_types() {
    let output = Beside::new(None).check("local n: number = robot.battery()\nprint(n)\n");
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stdout));
    assert_eq!(text(&output.stderr), "");
}

#[test]
fn a_checker_that_crashes_or_babbles_is_a_note_and_the_rest_is_still_checked() {
    for checker in ["kill -SEGV $$", "echo hello", "exit 2", "cat", "yes"] {
        let output = Beside::new(Some(checker)).check("robot.moev(1, 1)\n");
        let said = text(&output.stderr);
        assert!(said.contains("types were not checked"), "{checker}: {said}");
        assert_eq!(output.status.code(), Some(4), "{checker}");
        let found = text(&output.stdout);
        assert!(found.contains("did you mean 'move'?"), "{checker}: {found}");
        let output = Beside::new(Some(checker)).check("robot.stop()\n");
        assert_eq!(output.status.code(), Some(0), "{checker}");
    }
}

#[test]
fn a_checker_that_hangs_is_ended() {
    let beside = Beside::new(Some("exec sleep 1000"));
    let began = std::time::Instant::now();
    let output = beside.check("robot.stop()\n");
    assert!(began.elapsed() < Duration::from_secs(60));
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stdout));
    let said = text(&output.stderr);
    assert!(said.contains("did not answer within 5 s"), "{said}");
}

#[cfg(feature = "check")]
mod real {
    use super::*;
    use crate::rig::Rig;

    fn spykee(args: &[&str]) -> Output {
        // Beside the one that is tested; naming it has it built.
        assert!(Path::new(env!("CARGO_BIN_EXE_spykee-luau-check")).is_file());
        let mut command = Command::new(env!("CARGO_BIN_EXE_spykee"));
        command.args(args).stdin(Stdio::null());
        command.env_remove("RUST_LOG");
        command.current_dir(env!("CARGO_MANIFEST_DIR"));
        command.output().unwrap()
    }

    fn found(script: &str) -> Vec<String> {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.lua");
        std::fs::write(&file, script).unwrap();
        let output = spykee(&["check", "--json", file.to_str().unwrap()]);
        assert_eq!(text(&output.stderr), "");
        let findings: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        let one = |finding: &serde_json::Value| {
            let (line, column) = (&finding["line"], &finding["column"]);
            format!("{line}:{column} {}", finding["message"].as_str().unwrap())
        };
        findings.as_array().unwrap().iter().map(one).collect()
    }

    #[test]
    fn a_value_that_is_not_of_the_type_written_to_it_is_found() {
        let script = "local n: number = robot.battery()\nprint(n)\n";
        assert_eq!(found(script), ["1:19 expected number, got Battery?"]);
        let script = "local function f()\n\tlocal s, n: string = 'ä', robot.turn(1)\n\tprint(s, n)\nend\nf()\n";
        assert_eq!(found(script), ["2:28 expected string, got boolean"]);
    }

    #[test]
    fn a_call_that_fails_whichever_way_the_script_goes_is_found() {
        let script = "local p = 'x'\nif math.random() > 0.5 then p = 'y' end\nrobot.move(p, 3)\n";
        let expected = "3:12 robot.move: the 1st argument must be a number, got a string";
        assert_eq!(found(script), [expected]);
    }

    #[test]
    fn what_may_be_nil_is_found_in_strict_scripts_only() {
        let script = "print(robot.frame():brightness())\n";
        assert_eq!(found(script), [""; 0]);
        let strict = format!("--!strict\n{script}");
        assert_eq!(found(&strict), ["2:7 this may be nil: it is Frame?"]);
    }

    #[test]
    fn handlers_get_what_their_event_gives() {
        let script = "--!strict\nrobot.on('battery', function(b)\n\tlocal t: string = b.percent\n\tprint(t)\nend, { rate = 1 })\n";
        assert_eq!(found(script), ["3:20 expected string, got number"]);
        let script = "--!strict\nlocal b = robot.wait_for('battery', 3)\nif b then print(b.percent + 1) end\nprint(b.age)\n";
        assert_eq!(found(script), ["4:7 this may be nil: it is Battery?"]);
    }

    #[test]
    fn usual_strict_code_is_not_complained_about() {
        let script = r#"--!strict
local easy = require("@spykee/easy")
local list = { "red", "blue" }
for _, light in { "left", "right" } do
	robot.led(light, true)
	robot.blink(light, { count = 2 })
end
task.spawn(function(seconds: number) task.wait(seconds) end, 3)
task.every(1, function() easy.stop() end)
robot.on("frame", function(frame)
	local ball = frame:find_blobs(list, { roi = { 0, 0, 32, 32 }, merge = true })[1]
	if ball then robot.drive(0.2, 2 * ball.bearing) end
end, { rate = 5, queue = "latest" })
local p = params.declare({ speed = { default = 40, max = 100 } })
local ok, code = robot.forward(0.5, p.speed / 100)
if not ok then log.warn(`it was {code}`, { ok = ok }) end
local learned, quality = vision.learn({}, { x = 1, y = 1, w = 9, h = 9 })
if learned then print(vision.tracker({ colour = learned }):best(), quality) end
"#;
        assert_eq!(found(script), [""; 0]);
    }

    #[test]
    fn ready_made_behaviours_the_library_and_the_guide_are_clean() {
        let output = spykee(&["check", "behaviours"]);
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stdout));
        let folder = tempfile::tempdir().unwrap();
        let root = Path::new(env!("CARGO_MANIFEST_DIR"));
        for name in ["bt", "easy", "fsm", "pid"] {
            let file = root.join(format!("src/script/stdlib/{name}.luau"));
            std::fs::copy(file, folder.path().join(format!("{name}.lua"))).unwrap();
        }
        for page in ["README.md", "behaviours/README.md"] {
            let page = std::fs::read_to_string(root.join(page)).unwrap();
            let blocks = page.split("```lua\n").skip(1);
            for (number, rest) in blocks.enumerate() {
                let name = format!("{number}_{}.lua", page.len());
                let block = rest.split("```").next().unwrap();
                std::fs::write(folder.path().join(name), block).unwrap();
            }
        }
        let with = spykee(&["check", folder.path().to_str().unwrap()]);
        let without = Beside::new(None);
        let mut command = Command::new(without.folder.path().join("spykee"));
        let without = command.arg("check").arg(folder.path()).output().unwrap();
        assert_eq!(text(&with.stdout), text(&without.stdout));
    }

    #[test]
    fn hostile_scripts_break_the_checker_at_most_and_not_the_check() {
        let output = spykee(&["check", "tests/hostile"]);
        assert_eq!(output.status.code(), Some(4));
        for note in text(&output.stderr).lines() {
            assert!(note.contains("has broken down over this script"), "{note}");
        }
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn a_run_refuses_wrong_types() {
        let rig = Rig::quiet().await;
        let mut run = rig.run("local n: number = robot.battery()\nrobot.move(n, 1)\n");
        assert_eq!(run.code().await, Some(4), "{}", run.text());
        assert!(run.text().contains("expected number, got Battery?"));
        assert!(rig.commands(0).is_empty(), "{:?}", rig.commands(0));
    }
}
