//! `spykee run` from a person's view: its messages, and how it ends.

use std::time::Duration;

use spykee::wire::{Command, Login};

use crate::rig::{Rig, Stopwatch, assert_contains};

#[tokio::test(flavor = "multi_thread")]
async fn a_script_that_ends_normally_ends_the_run_with_0() {
    let rig = Rig::quiet().await;
    let mut run = rig.run("print('hello', robot.battery().percent > 80)");
    assert_eq!(run.code().await, Some(0), "{}", run.text());
    assert_contains(&run.text(), &["hello true"]);
}

#[tokio::test(flavor = "multi_thread")]
async fn an_error_names_file_line_and_remedy() {
    for (script, words) in [
        (
            "local x = 1\nrobot.moev(1, 2)\n",
            ["script.lua:2", "moev", "did you mean", "move"],
        ),
        (
            "robot.move(140, 0)\n",
            ["script.lua:1", "robot.move", "between -100 and 100", "140"],
        ),
        (
            "robot.on('battrey', print)\n",
            ["script.lua:1", "battrey", "battery", "robot.on"],
        ),
        ("if true\n", ["script.lua:", "then", "error", "script.lua"]),
        (
            "pirnt('x')\n",
            ["script.lua:1", "pirnt", "did you mean", "print"],
        ),
    ] {
        let rig = Rig::quiet().await;
        let mut run = rig.run(script);
        assert_eq!(run.code().await, Some(4), "{script}: {}", run.text());
        for word in words {
            assert!(
                run.text().contains(word),
                "`{word}` for {script}: {}",
                run.text()
            );
        }
        assert!(!run.text().contains("stack backtrace"), "{}", run.text());
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_run_with_a_script_that_cannot_be_loaded_never_connects() {
    let rig = Rig::quiet().await;
    let mut run = rig.run("x = = 1");
    assert_eq!(run.code().await, Some(4), "{}", run.text());
    assert_eq!(rig.commands(0), []);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_time_limit_ends_the_run_with_0_after_on_stop() {
    let rig = Rig::quiet().await;
    let script = rig.file(
        "script.lua",
        "script.on_stop(function(reason) print('bye', reason) robot.led('right', true) end)\n\
         while true do task.wait(1) end",
    );
    let script = script.to_str().unwrap();
    let mut run = rig.spykee(&["run", script, "--robot", &rig.address, "--for", "1"]);
    assert_eq!(run.code().await, Some(0), "{}", run.text());
    assert_contains(&run.text(), &["bye shutdown"]);
}

#[tokio::test(flavor = "multi_thread")]
async fn the_embedded_simulator_needs_nothing_else() {
    let rig = Rig::quiet().await;
    let script = rig.file(
        "script.lua",
        "print('sim', robot.info().simulated, robot.move(30, 30, 0.3))",
    );
    let mut run = rig.spykee(&["run", script.to_str().unwrap(), "--sim"]);
    assert_eq!(run.code().await, Some(0), "{}", run.text());
    assert_contains(&run.text(), &["sim true true done"]);
}

#[tokio::test(flavor = "multi_thread")]
async fn the_same_seed_gives_the_same_random_numbers() {
    let rig = Rig::quiet().await;
    let script = rig.file(
        "script.lua",
        "print('dice', math.random(1e6), math.random(1e6))",
    );
    let script = script.to_str().unwrap();
    let mut dice = Vec::new();
    for seed in ["5", "5", "6"] {
        let mut run = rig.spykee(&["run", script, "--robot", &rig.address, "--seed", seed]);
        assert_eq!(run.code().await, Some(0), "{}", run.text());
        let text = run.text();
        dice.push(
            text[text.find("dice").unwrap()..]
                .lines()
                .next()
                .unwrap()
                .to_owned(),
        );
    }
    assert_eq!(dice[0], dice[1]);
    assert_ne!(dice[0], dice[2]);
}

#[tokio::test(flavor = "multi_thread")]
async fn without_a_robot_both_options_are_named() {
    let rig = Rig::quiet().await;
    let script = rig.file("script.lua", "print('never')");
    let mut run = rig.spykee(&["run", script.to_str().unwrap()]);
    assert_eq!(run.code().await, Some(2), "{}", run.text());
    assert_contains(&run.text(), &["--robot", "--sim"]);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_robot_out_of_reach_is_exit_code_3() {
    let rig = Rig::quiet().await;
    let script = rig.file("script.lua", "print('never')");
    let args = ["run", script.to_str().unwrap(), "--robot", "127.0.0.1:1"];
    let mut run = rig.spykee(&args);
    assert_eq!(run.code().await, Some(3), "{}", run.text());
    assert_contains(&run.text(), &["127.0.0.1:1"]);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_wrong_password_is_exit_code_3_and_is_not_shown() {
    let rig = Rig::quiet().await;
    let script = rig.file("script.lua", "print('never')");
    let secret = rig.file("password", "hunter2-the-secret\n");
    let script = script.to_str().unwrap();
    let secret = secret.to_str().unwrap();
    let args = [
        "run",
        script,
        "--robot",
        &rig.address,
        "--password-file",
        secret,
    ];
    let mut run = rig.spykee(&args);
    assert_eq!(run.code().await, Some(3), "{}", run.text());
    assert_contains(&run.text(), &["password"]);
    assert!(!run.text().contains("hunter2"), "{}", run.text());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_robot_in_use_is_exit_code_3_and_its_user_is_named() {
    let rig = Rig::quiet().await;
    let target = rig.address.parse().unwrap();
    let login = Login::new("admin", "admin");
    let options = spykee::link::Options::default();
    let _held = spykee::link::connect(&target, &login, vec![Command::STOP], &options)
        .await
        .unwrap();
    let mut run = rig.run("print('never')");
    assert_eq!(run.code().await, Some(3), "{}", run.text());
    assert_contains(&run.text(), &["in use", "admin"]);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_wrong_config_is_refused_with_line_and_column() {
    let rig = Rig::quiet().await;
    let script = rig.file("script.lua", "print('never')");
    for (config, words) in [
        (
            "watchdog:\n  lwo: 20\n",
            ["spykee.yaml", "lwo", "line 2 column 3"],
        ),
        (
            "camera:\n  hfov: wide\n",
            ["spykee.yaml", "camera", "line 2 column"],
        ),
        (
            "watchdog:\n  dock_timeout: -1\n",
            ["spykee.yaml", "dock_timeout", "line 2 column"],
        ),
        (
            "colours:\n  sky: { lab: { l: [200, 300] } }\n",
            ["spykee.yaml", "colours", "line 2"],
        ),
    ] {
        let path = rig.file("spykee.yaml", config);
        let script = script.to_str().unwrap();
        let path = path.to_str().unwrap();
        let mut run = rig.spykee(&["run", script, "--sim", "--config", path]);
        assert_eq!(run.code().await, Some(2), "{config}: {}", run.text());
        for word in words {
            assert!(
                run.text().contains(word),
                "`{word}` for {config}: {}",
                run.text()
            );
        }
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_script_file_too_large_is_refused() {
    let rig = Rig::quiet().await;
    let mut run = rig.run(&"-- padding\n".repeat(30_000));
    assert_eq!(run.code().await, Some(4), "{}", run.text());
    assert_contains(&run.text(), &["256 KiB"]);
}

#[tokio::test(flavor = "multi_thread")]
async fn logs_as_json_are_one_object_a_line() {
    let rig = Rig::quiet().await;
    let script = rig.file("script.lua", "print('hello')");
    let script = script.to_str().unwrap();
    let mut run = rig.spykee(&[
        "run",
        script,
        "--robot",
        &rig.address,
        "--log-format",
        "json",
    ]);
    assert_eq!(run.code().await, Some(0), "{}", run.text());
    for line in run.text().lines() {
        let value: Result<serde_json::Value, _> = serde_json::from_str(line);
        assert!(value.is_ok_and(|value| value.is_object()), "{line}");
    }
    assert_contains(&run.text(), &["hello"]);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_flood_of_log_lines_is_summarised() {
    let rig = Rig::quiet().await;
    let begun = Stopwatch::start();
    let mut run = rig.run("for i = 1, 5000 do print('line', i) end task.wait(1.2)");
    assert_eq!(run.code().await, Some(0), "{}", run.text());
    assert!(
        run.text().lines().count() < 1000,
        "{}",
        run.text().lines().count()
    );
    assert_contains(&run.text(), &["more lines"]);
    assert!(begun.elapsed() < Duration::from_secs(30));
}

/// The first block of a language in a page.
fn block(page: &'static str, language: &str) -> &'static str {
    let start = page.split(&format!("```{language}\n")).nth(1).unwrap();
    start.split("```").next().unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn the_readmes_behaviour_runs_with_the_config_of_the_book() {
    let rig = Rig::quiet().await;
    let readme = include_str!("../../README.md");
    let chapter = include_str!("../../behaviours/guide/operate/config.md");
    let config = block(chapter, "yaml").replace("172.17.6.1", &rig.address);
    let config = rig.file("spykee.yaml", &config);
    let script = rig.file("script.lua", block(readme, "lua"));
    let config = config.to_str().unwrap();
    let script = script.to_str().unwrap();
    let mut run = rig.spykee(&["run", script, "--config", config, "--for", "2"]);
    rig.heard_motion(0).await;
    assert_eq!(run.code().await, Some(0), "{}", run.text());
}
