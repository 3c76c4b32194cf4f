//! `spykee check`, `spykee api`, and the check before a run, from the command line.

use std::path::Path;

use crate::rig::{Ended, Rig, assert_contains, command, run_in};

fn spykee(args: &[&str]) -> Ended {
    run_in(Path::new(env!("CARGO_MANIFEST_DIR")), args)
}

#[test]
fn a_finding_shows_place_message_line_and_caret() {
    let output = spykee(&["check", "tests/broken/too_much_power.lua"]);
    assert_eq!(output.code, Some(4));
    let expected = "tests/broken/too_much_power.lua:3:12: error: robot.move: left must be between -100 and 100, got 140\n\
                    3 | robot.move(140, 100)\n  |            ^^^\n\n1 error\n";
    assert_eq!(output.out, expected);
}

#[test]
fn ready_made_behaviours_and_the_scripts_of_the_readme_are_clean() {
    let output = spykee(&["check", "behaviours"]);
    assert_eq!(output.code, Some(0), "{}", output.out);
    let folder = tempfile::tempdir().unwrap();
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let readme = std::fs::read_to_string(root.join("README.md")).unwrap();
    let blocks: Vec<&str> = readme
        .split("```lua\n")
        .skip(1)
        .filter_map(|rest| rest.split("```").next())
        .collect();
    assert!(!blocks.is_empty());
    for (number, block) in blocks.iter().enumerate() {
        std::fs::write(folder.path().join(format!("{number}.lua")), block).unwrap();
    }
    let output = spykee(&["check", folder.path().to_str().unwrap()]);
    assert_eq!(output.code, Some(0), "{}", output.out);
}

#[test]
fn findings_are_printed_as_json_too_and_unreadable_files_end_with_2() {
    let output = spykee(&["check", "--json", "tests/broken/typo_in_a_call.lua"]);
    assert_eq!(output.code, Some(4));
    let diagnostics: serde_json::Value = output.json();
    let diagnostic = &diagnostics[0];
    assert_eq!(diagnostic["line"], 3);
    assert_eq!(diagnostic["column"], 7);
    assert_eq!(diagnostic["severity"], "error");
    let output = spykee(&["check", "no/such/file.lua"]);
    assert_eq!(output.code, Some(2));
    let output = spykee(&["check", "tests/hostile"]);
    assert_eq!(output.code, Some(4));
}

/// Writes a file into a folder and returns its path.
fn written(folder: &Path, name: &str, text: &str) -> String {
    let path = folder.join(name);
    std::fs::write(&path, text).unwrap();
    path.to_str().unwrap().to_owned()
}

#[test]
fn the_colours_of_the_config_are_known() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, text: &str| written(folder.path(), name, text);
    let script = file(
        "a.lua",
        "robot.on('frame', function(frame) print(#frame:find_blobs('sock')) end)",
    );
    let config = file("spykee.yaml", "colours: { sock: { h: [270, 310] } }");
    assert_eq!(spykee(&["check", &script]).code, Some(4));
    let output = spykee(&["check", &script, "--config", &config]);
    assert_eq!(output.code, Some(0), "{}", output.out);
}

#[test]
fn params_of_the_config_are_checked_against_the_declarations_of_the_script() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, text: &str| written(folder.path(), name, text);
    let script = file(
        "a.lua",
        "local p = params.declare({ speed = { default = 40, max = 100 } })\nprint(p.speed)\n",
    );
    let good = file(
        "good.yaml",
        "behaviours: [ { file: a.lua, params: { speed: 50 } } ]",
    );
    let output = spykee(&["check", &script, "--config", &good]);
    assert_eq!(output.code, Some(0), "{}", output.out);
    let bad = file(
        "bad.yaml",
        "behaviours: [ { file: a.lua, params: { sped: 50 } } ]",
    );
    let output = spykee(&["check", &script, "--config", &bad]);
    assert_eq!(output.code, Some(4), "{}", output.out);
    assert_contains(&output.out, &["did you mean 'speed'?"]);
}

#[test]
fn required_modules_are_checked_once_each_under_their_own_names() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("lib")).unwrap();
    let file = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    file(
        "main.lua",
        "local a, b = require('./lib/a'), require('./lib/b')\nprint(a, b)\n",
    );
    file("lib/a.lua", "require('./b')\nrobot.moev(1, 1)\nreturn {}\n");
    file("lib/b.luau", "require('../main')\nlocal x = = 3\n");
    let found = |args: &[&str]| {
        let text = run_in(folder.path(), &[&["check"], args].concat()).out;
        let lines = text.lines().filter(|line| line.contains("error"));
        lines.map(str::to_owned).collect::<Vec<_>>()
    };
    for args in [&["main.lua"][..], &["main.lua", "lib"], &["."]] {
        let lines = found(args);
        let count = |words: &str| lines.iter().filter(|line| line.contains(words)).count();
        assert_eq!(count("lib/a.lua:2:7: error: robot.moev"), 1, "{lines:#?}");
        assert_eq!(count("lib/b.luau:2:9: error: "), 1, "{lines:#?}");
        assert_eq!(lines.last().unwrap(), "2 errors");
    }
}

#[test]
fn a_module_that_cannot_be_loaded_is_reported_where_it_is_required() {
    let folder = tempfile::tempdir().unwrap();
    let main = folder.path().join("main.lua");
    std::fs::write(&main, "print(require('./link'))\n").unwrap();
    std::os::unix::fs::symlink("main.lua", folder.path().join("link.lua")).unwrap();
    let output = spykee(&["check", main.to_str().unwrap()]);
    assert_eq!(output.code, Some(4));
    let text = output.out;
    assert_contains(&text, &["main.lua:1:15: error: ", "link"]);
}

#[tokio::test(flavor = "multi_thread")]
async fn an_error_in_a_module_shows_that_modules_line() {
    let rig = Rig::quiet().await;
    std::fs::create_dir_all(rig.folder().join("lib")).unwrap();
    rig.file(
        "lib/far.lua",
        "return function(goal)\n\treturn goal.x + 1\nend\n",
    );
    let mut run = rig.run("local far = require('./lib/far')\nprint(far({}))\n");
    assert_eq!(run.code().await, Some(1), "{}", run.text());
    let said = run.text();
    for words in ["lib/far.lua:2: ", "2 | \treturn goal.x + 1", "^^^^"] {
        assert_contains(&said, &[words]);
    }
    assert!(!said.contains("attempt to"), "{said}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_run_refuses_a_faulty_script_before_it_connects_to_the_robot() {
    let rig = Rig::quiet().await;
    let script = rig.file(
        "broken.lua",
        "robot.led('left', true)\nrobot.moev(50, 50)\n",
    );
    let script = script.to_str().unwrap();
    let mut run = rig.spykee(&["run", script, "--robot", &rig.address]);
    assert_eq!(run.code().await, Some(4), "{}", run.text());
    let said = run.text();
    for words in [
        "broken.lua:2:7: robot.moev does not exist; did you mean 'move'?",
        "2 | robot.moev(50, 50)",
        "--no-check",
    ] {
        assert_contains(&said, &[words]);
    }
    assert!(rig.commands(0).is_empty(), "{:?}", rig.commands(0));
    let mut run = rig.spykee(&["run", script, "--robot", &rig.address, "--no-check"]);
    assert_eq!(run.code().await, Some(1), "{}", run.text());
    assert_contains(&run.text(), &["robot.moev does not exist"]);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_failed_run_shows_the_line_with_a_caret() {
    let rig = Rig::quiet().await;
    let mut run = rig.run("local goals = {}\nlocal left = goals.left\nprint(left + 1)\n");
    assert_eq!(run.code().await, Some(1), "{}", run.text());
    let said = run.text();
    for words in [
        "script.lua:3: `left` is nil here",
        "3 | print(left + 1)",
        "^^^^",
    ] {
        assert_contains(&said, &[words]);
    }
    assert!(!said.contains("attempt to"), "{said}");
}

#[test]
fn the_api_is_shown_in_full_and_by_name() {
    let whole = command(&["api"]).out;
    for words in [
        "robot.move(left, right [, seconds])",
        "Frame:find_blobs(colour [, options])",
        "battery_low",
    ] {
        assert_contains(&whole, &[words]);
    }
    let one = command(&["api", "robot.move"]).out;
    for words in ["power of the left track", "between -100 and 100", "example"] {
        assert_contains(&one, &[words]);
    }
    for (name, words) in [
        ("bt", "bt.sequence(node, ...)"),
        ("frame", "Frame:save(name)"),
        ("events", "battery_low"),
        ("sim", "sim:wait_until(fn, seconds)"),
    ] {
        let page = command(&["api", name]).out;
        assert!(page.contains(words), "{name}: {page}");
    }
    let output = command(&["api", "robot.mvoe"]);
    assert_eq!(output.code, Some(2));
    assert!(output.err.contains("did you mean 'robot.move'?"));
    assert_contains(&command(&["api", "qr"]).err, &["Frame:find_qrcodes"]);
}
