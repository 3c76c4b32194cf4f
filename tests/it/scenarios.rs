//! `spykee test`: scenarios pass or fail as they should, with the same result every time.

use std::path::Path;
use std::time::Duration;

use quick_xml::events::Event;
use rustix::process::Signal;
use serde_json::Value;
use spykee::scenario::{Cause, RunSettings, ScenarioFile};
use tempfile::TempDir;

use crate::rig::{Rig, assert_contains, exact_yaml, run_in};

fn folder(files: &[(&str, &str)]) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (name, text) in files {
        std::fs::write(folder.path().join(name), text).unwrap();
    }
    folder
}

/// The message with which the only scenario of this source fails.
fn complaint(source: &str) -> String {
    let behaviour = "robot.move(20, 20)\ntask.wait(1000)\n";
    let folder = folder(&[("a_test.lua", source), ("a.lua", behaviour)]);
    let output = run_in(folder.path(), &["test", "--json"]);
    assert_eq!(output.code, Some(4), "{}", output.text());
    let json = output.json();
    let broken = json["broken"][0]["message"].as_str();
    let message = broken.or(json["runs"][0]["failure"]["message"].as_str());
    message.unwrap_or_else(|| panic!("{json:#}")).to_owned()
}

const WANDERS: &str = "
while true do
    robot.forward(0.2 + math.random() / 5)
    robot.turn(math.random() * 3)
    log.info('turned', { frames = if robot.frame() then 1 else 0 })
end
";

const LOOKS_ON: &str = "
scenario('wanders', { world = 'playpen', battery = 80, seeds = 2, limit = 40 }, function(sim)
    sim:place({ x = 1, y = 1, heading = 0 })
    sim:run('wander.lua')
    sim:wait(20)
    print(sim:distance(), sim:pose().heading, sim:battery(), #sim:log('turned'))
end)
scenario('never comes to an end', { limit = 15 }, function(sim)
    sim:run('wander.lua')
    sim:wait_until(function() return sim:ended() end, 100)
end)
";

#[test]
fn a_failure_is_reported_with_place_time_and_picture() {
    let source = "scenario('it moves', { battery = 80 }, function(sim)\n\
                  \tsim:run()\n\tsim:wait(2)\n\
                  \texpect(sim:distance() > 0.1)\n\
                  end)\n\
                  scenario('it flies', { battery = 80, seeds = 2 }, function(sim)\n\
                  \tsim:run()\n\tsim:wait(2)\n\
                  \texpect(sim:distance() > 100, `{math.floor(sim:distance())} m are not enough`)\n\
                  end)\n";
    let behaviour = "robot.drive(0.2, 1)\ntask.wait(1000)\n";
    let folder = folder(&[("fly_test.lua", source), ("fly.lua", behaviour)]);
    let output = run_in(folder.path(), &["test"]);
    assert_eq!(output.code, Some(4), "{}", output.text());
    let text = output.text();
    for part in [
        "fly_test.lua\n",
        "  ok    it moves (seed 1, 0:00:02)",
        "  FAIL  it flies (0 of 2 seeds, ",
        "fly_test.lua:9: 0 m are not enough",
        "9 | \texpect(sim:distance() > 100,",
        "with seed 1 after 2.0 s: robot at ",
        "the robot receives Move",
        "the scenario also fails with seed 2",
        "1 run passed, 2 failed",
    ] {
        assert!(text.contains(part), "{part:?} is missing in\n{text}");
    }
    let picture = folder
        .path()
        .join("spykee-data/scenarios/fly-test-it-flies-1.png");
    let picture = image::open(picture).unwrap();
    assert!(picture.width() > 300 && picture.height() > 300);
    let output = run_in(folder.path(), &["test", "--filter", "moves"]);
    assert_eq!(output.code, Some(0));
}

#[test]
fn files_of_one_name_in_two_folders_write_two_pictures() {
    let source = "scenario('it flies', { battery = 80 }, function(sim) expect(false) end)\n";
    let folder = tempfile::tempdir().unwrap();
    for name in ["one", "two"] {
        std::fs::create_dir(folder.path().join(name)).unwrap();
        std::fs::write(folder.path().join(name).join("fly_test.lua"), source).unwrap();
    }
    let output = run_in(folder.path(), &["test"]);
    assert_eq!(output.code, Some(4), "{}", output.text());
    let pictures = folder.path().join("spykee-data/scenarios");
    for name in ["one-fly-test-it-flies-1.png", "two-fly-test-it-flies-1.png"] {
        assert!(pictures.join(name).exists(), "{name}: {}", output.text());
    }
}

#[test]
fn the_same_seed_gives_the_same_result_with_any_number_of_jobs() {
    let folder = folder(&[("wander.lua", WANDERS), ("wander_test.lua", LOOKS_ON)]);
    let play = |jobs| {
        let output = run_in(folder.path(), &["test", "--json", "--jobs", jobs]);
        let mut json = output.json();
        for run in json["runs"].as_array_mut().unwrap() {
            run["seconds"] = Value::Null;
        }
        json
    };
    let first = play("1");
    assert_eq!(first, play("3"));
    let lines = |run: usize| first["runs"][run]["lines"][0].as_str().unwrap();
    assert_ne!(lines(0), lines(1), "two seeds are two runs");
    assert_eq!(first["failed"], 1);
}

#[test]
fn every_query_and_every_change_reaches_the_simulated_robot() {
    let source = r#"
scenario("all of it", { world = "exact.yaml", battery = 70, limit = 600, seeds = 1 }, function(sim)
    expect(sim:seed() == 1 and sim:time() == 0)
    sim:place({ x = 1, y = 1, heading = 0 })
    local pose = sim:pose()
    expect(pose.x == 1 and pose.y == 1 and pose.heading == 0, "place, pose")
    expect(not sim:docked() and not sim:charging() and not sim:connected())
    sim:place_ball(1, { x = 1.5, y = 1.4 })
    expect(math.abs(sim:ball(1).y - 1.4) < 0.01, "place_ball, ball")
    expect(math.abs(sim:battery() - 70) < 1, "battery at the start")
    expect(math.abs(sim:battery(60) - 60) < 1, "battery")

    sim:run("ears.lua", { "other.lua", name = "second", priority = 3, params = { speed = 15 } })
    expect(sim:wait_until(function() return sim:connected() end, 5), "connected")
    expect(sim:ended() == nil and sim:ended("ears") == nil)
    expect(sim:wait_until(function() return sim:leds().left end, 5), "leds")
    expect(#sim:log("speed 15") == 1, "params, log")
    expect(sim:log("speed 15")[1].behaviour == "second")
    expect(sim:wait_until(function() return sim:ended("second") == "done" end, 10), "ended")
    expect(sim:distance() > 0.05, "distance")
    expect(sim:wait_until(function() return not sim:moving() end, 5), "moving")
    expect(math.abs(sim:turned()) < 0.3, `turned: {sim:turned()}`)
    local photos = sim:photos()
    expect(photos == 1, `photos: {photos}`)
    local sounds = sim:sounds()
    expect(sounds[1].name == "laser" and sounds[1].time > 0, "sounds")
    expect(sim:collisions() == 0)

    sim:wait(2)
    local loud = #sim:log("noise")
    sim:wait(2)
    expect(#sim:log("noise") == loud, "it is quiet")
    sim:noise(-10, 1)
    expect(sim:wait_until(function() return #sim:log("noise") > loud end, 3), "noise")
    local bright = tonumber(sim:log("bright")[1].text:match("%d+"))
    sim:light(0.2)
    sim:wait(2)
    local lines = sim:log("bright")
    expect(tonumber(lines[#lines].text:match("%d+")) < bright / 2, "light")

    sim:fault({ fault = "drop" })
    expect(sim:wait_until(function() return #sim:log("disconnected") == 1 end, 5), "fault")
    expect(sim:wait_until(function() return sim:connected() end, 20), "it comes back")

    sim:break_charger(true)
    sim:battery(15)
    expect(sim:wait_until(function() return sim:docked() end, 200), "it goes home")
    sim:wait(3)
    expect(not sim:charging(), "break_charger")
    sim:break_charger(false)
    expect(sim:wait_until(function() return sim:charging() end, 10), "it charges again")

    sim:stop()
    expect(sim:ended("ears") == "shutdown", "stop")
    sim:wait(1)
    expect(not sim:connected())
    sim:run("ears.lua")
    expect(sim:wait_until(function() return #sim:log("life 2") == 1 end, 5), "the store is kept")
    sim:kill()
    expect(not sim:wait_until(function() return sim:connected() end, 2), "kill")

    sim:hide_station(true)
    sim:battery(80)
    sim:place({ x = 1, y = 1, heading = 0 })
    sim:run("home.lua")
    expect(sim:wait_until(function() return #sim:log("base_not_found") == 1 end, 300), "hide_station")
    print("all of it was run")
end)
"#;
    let ears = r#"
local lives = store.get("lives", 0) + 1
store.set("lives", lives)
log.info(`life {lives}`)
robot.led("left", true)
robot.on("noise", function() log.info("noise") end)
robot.on("disconnected", function() log.info("disconnected") end)
robot.on("frame", function(frame)
    log.info(`bright {math.round(1000 * frame:brightness())}`)
end, { rate = 2 })
"#;
    let other = r#"
local p = params.declare({ speed = { default = 1, min = 1, max = 50 } })
log.info(`speed {p.speed}`)
robot.wait_frame(5):save("here")
robot.play("laser")
robot.move(p.speed, p.speed, 1)
robot.stop()
"#;
    let home = "local ok, code = robot.dock({ retries = 0 })\nlog.info(code)\n";
    let folder = folder(&[
        ("all_test.lua", source),
        ("exact.yaml", exact_yaml("playpen").as_str()),
        ("ears.lua", ears),
        ("other.lua", other),
        ("home.lua", home),
    ]);
    let output = run_in(folder.path(), &["test", "--json"]);
    let result = &output.json()["runs"][0];
    assert_eq!(result["passed"], true, "{result:#}");
    assert_eq!(result["lines"][0], "all of it was run");
}

#[test]
fn invalid_files_are_refused_with_file_line_and_advice() {
    for (source, words) in [
        ("", "a_test.lua: it declares no scenario"),
        ("scenario(", "a_test.lua:1"),
        (
            "scenario('x')",
            "a_test.lua:1: scenario: the last argument must be a function",
        ),
        (
            "scenario('', {}, print)",
            "a_test.lua:1: scenario: the name must have 1 to 200 bytes",
        ),
        (
            "scenario('x', {}, print)\nscenario('x', {}, print)",
            "a_test.lua:2: scenario: 'x' is already declared in line 1",
        ),
        (
            "scenario('x', { batery = 3 }, print)",
            "did you mean 'battery'",
        ),
        (
            "scenario('x', { world = 'playpan' }, print)",
            "did you mean 'playpen'",
        ),
        ("scenario('x', { world = 'no.yaml' }, print)", "no.yaml"),
        (
            "sim:wait(3)",
            "a_test.lua:1: sim:wait: this call works only inside a scenario",
        ),
        (
            "task.wait(1)\nscenario('x', {}, print)",
            "it waits before its scenarios are declared",
        ),
        ("robot.move(1, 1)", "a_test.lua:1: unknown name 'robot'"),
    ] {
        let text = complaint(source);
        assert!(text.contains(words), "{source}\n{text}");
    }
}

#[test]
fn invalid_calls_and_misbehaving_scripts_fail_their_scenario_with_a_message() {
    for (body, words) in [
        (
            "sim:palce({})",
            "sim.palce does not exist; did you mean 'place'?",
        ),
        ("sim.wait(3)", "call it with a colon, sim:wait(seconds)"),
        ("sim:place({ x = 1 })", "y is missing"),
        (
            "sim:place_ball(7, { x = 1, y = 1 })",
            "the ball's number must be between 1 and",
        ),
        (
            "sim:battery(101)",
            "percent must be between 0 and 100, got 101",
        ),
        ("sim:noise(3, 1)", "dbfs must be between -90 and -3, got 3"),
        ("sim:fault({ fault = 'dorp' })", "drop"),
        ("sim:fault({ fault = 'drop', byte = 3 })", "byte"),
        ("sim:run('b.lua')", "there is no b.lua"),
        ("sim:run({ 'a.lua', prio = 3 })", "unknown field `prio`"),
        ("sim:run('a.lua', 'a.lua')", "two behaviours are called 'a'"),
        ("sim:run() sim:run()", "behaviours are running already"),
        ("scenario('y', {}, print)", "not inside another"),
        ("sim:wait_until(3, 4)", "must be a function, got 3"),
        ("sim:wait_until(print)", "seconds is missing"),
        ("while true do end", "ran longer than"),
        (
            "sim:wait(1000)",
            "it did not finish within its limit of 30 s",
        ),
        ("local t = {} while true do t = { t, t } end", "memory"),
        ("error({})", "it failed with a table"),
        ("script.stop()", "its script ended before it ran"),
    ] {
        let source =
            format!("scenario('x', {{ world = 'playpen', limit = 30 }}, function(sim) {body} end)");
        let text = complaint(&source);
        assert!(text.contains(words), "{body}\n{text}");
    }
}

#[test]
fn a_mistake_in_a_scenario_is_explained_below_its_line() {
    for (line, words, help) in [
        (
            "sim:wait_until(sim:docked(), 60)",
            "sim:wait_until: the function must be a function, got false",
            "to call it later, pass a function: function() return sim:docked() end",
        ),
        (
            "print(sim:log('x')[1].text)",
            "`sim:log('x')[1]` is nil here, so `sim:log('x')[1].text` cannot be read",
            "",
        ),
    ] {
        let source = format!("scenario('x', {{ limit = 30 }}, function(sim)\n{line}\nend)");
        let folder = folder(&[("a_test.lua", &source)]);
        let text = run_in(folder.path(), &["test"]).text();
        let shown =
            format!("        a_test.lua:2: {words}\n        2 | {line}\n          = help: {help}");
        assert!(text.contains(&shown), "{shown}\n\n{text}");
    }
}

#[test]
fn a_behaviour_that_fails_makes_its_scenario_fail_unless_that_is_expected() {
    let source = "scenario('x', {}, function(sim) sim:run() sim:wait(5) end)\n\
                  scenario('y', { may_fail = true }, function(sim)\n\
                      sim:run() sim:wait(5) expect(sim:ended() == 'error')\n\
                  end)";
    let behaviour = "task.wait(1)\nerror('boom')\n";
    let folder = folder(&[("b_test.lua", source), ("b.lua", behaviour)]);
    let result = run_in(folder.path(), &["test", "--json"]).json();
    let message = result["runs"][0]["failure"]["message"].as_str().unwrap();
    assert_contains(message, &["the behaviour b failed: ", "b.lua:2"]);
    assert_eq!(result["runs"][1]["passed"], true, "{result:#}");
    let behaviour = "task.spawn(function() local list = nil print(list.x) end)\ntask.wait(1)\n";
    let of_a_task = self::folder(&[("d_test.lua", source), ("d.lua", behaviour)]);
    let result = run_in(of_a_task.path(), &["test", "--json"]).json();
    let message = result["runs"][0]["failure"]["message"].as_str().unwrap();
    assert_contains(
        message,
        &["the behaviour d failed: ", "d.lua:1", "a task failed"],
    );
    let run = run_in(of_a_task.path(), &["run", "d.lua", "--sim", "--fast"]);
    assert_eq!(run.code, Some(1), "{}", run.text());
    let mistaken = self::folder(&[("c_test.lua", source), ("c.lua", "robot.moev(1, 1)")]);
    let result = run_in(mistaken.path(), &["test", "--json"]).json();
    let message = result["runs"][0]["failure"]["message"].as_str().unwrap();
    assert_contains(message, &["did you mean 'move'"]);
}

#[test]
fn a_behaviour_cannot_see_its_scenario() {
    let source = "scenario('x', {}, function(sim)\n\
                      secret = 7\n\
                      sim:run()\n\
                      expect(sim:wait_until(function() return sim:ended() == 'done' end, 5))\n\
                      expect(#sim:log('none of it') == 1)\n\
                  end)";
    let behaviour = "local names = { 'sim', 'scenario', 'expect', 'secret' }\n\
                     for _, name in names do\n\
                         assert(not pcall(function() return _G[name] end), name)\n\
                     end\n\
                     log.info('none of it')\n";
    let folder = folder(&[("c_test.lua", source), ("c.lua", behaviour)]);
    let output = run_in(folder.path(), &["test"]);
    assert_eq!(output.code, Some(0), "{}", output.text());
}

#[test]
fn the_junit_report_is_xml_with_a_case_for_each_run() {
    let folder = folder(&[
        ("wander.lua", WANDERS),
        ("wander_test.lua", LOOKS_ON),
        ("z_test.lua", "scenario('<&\">')"),
    ]);
    let output = run_in(folder.path(), &["test", "--junit", "out.xml"]);
    assert_eq!(output.code, Some(4), "{}", output.text());
    let xml = std::fs::read_to_string(folder.path().join("out.xml")).unwrap();
    let mut reader = quick_xml::Reader::from_str(&xml);
    let mut cases = 0;
    let mut failures = 0;
    let mut errors = 0;
    loop {
        match reader.read_event().unwrap() {
            Event::Start(element) | Event::Empty(element) => match element.name().as_ref() {
                b"testcase" => cases += 1,
                b"failure" => failures += 1,
                b"error" => errors += 1,
                _ => {}
            },
            Event::Eof => break,
            _ => {}
        }
    }
    assert_eq!((cases, failures, errors), (4, 1, 1), "{xml}");
}

#[test]
fn what_cannot_be_played_ends_with_2_and_an_unwritable_report_with_1() {
    let folder = folder(&[("a_test.lua", "scenario('x', {}, print)")]);
    for args in [
        &["test", "nowhere"][..],
        &["test", "--filter", "nothing of this name"],
        &["test", "--seeds", "0"],
    ] {
        let output = run_in(folder.path(), args);
        assert_eq!(output.code, Some(2), "{args:?}\n{}", output.text());
    }
    let output = run_in(folder.path(), &["test", "--junit", "no/such/folder.xml"]);
    assert_eq!(output.code, Some(1), "{}", output.text());
    let empty = tempfile::tempdir().unwrap();
    let output = run_in(empty.path(), &["test"]);
    assert_eq!(output.code, Some(2));
    assert_contains(&output.text(), &["no *_test.lua file"]);
}

#[tokio::test]
async fn an_interruption_ends_everything_that_runs() {
    let rig = Rig::quiet().await;
    let source = "scenario('for ever', { limit = 2592000 }, function(sim)\n\
                      while true do sim:wait(0.1) end\n\
                  end)";
    rig.file("ever_test.lua", source);
    let mut run = rig.spykee(&["test", "--jobs", "1"]);
    tokio::time::sleep(Duration::from_millis(300)).await;
    assert!(run.lives(), "{}", run.text());
    run.signal(Signal::INT);
    assert_eq!(run.code().await, Some(130), "{}", run.text());
}

#[test]
fn a_new_project_passes_its_own_scenarios() {
    let folder = tempfile::tempdir().unwrap();
    for template in ["patrol", "follow", "empty"] {
        let made = run_in(folder.path(), &["new", template, "--template", template]);
        assert_eq!(made.code, Some(0), "{}", made.text());
    }
    let output = run_in(folder.path(), &["test"]);
    assert_eq!(output.code, Some(0), "{}", output.text());
    let checked = run_in(folder.path(), &["check", "patrol", "follow", "empty"]);
    assert_eq!(checked.code, Some(0), "{}", checked.text());
}

#[test]
fn the_behaviour_beside_a_file_is_found_from_any_folder() {
    let test = "scenario('x', {}, function(sim) sim:run() expect(sim:wait_until(function()\n\
                return sim:ended() end, 5), 'late') end)";
    let folder = folder(&[("a.lua", "task.wait(1)"), ("a_test.lua", test)]);
    let elsewhere = tempfile::tempdir().unwrap();
    let path = folder.path().join("a_test.lua");
    let output = run_in(elsewhere.path(), &["test", path.to_str().unwrap()]);
    assert_eq!(output.code, Some(0), "{}", output.text());
}

#[test]
fn rust_tests_play_scenarios_too() {
    let folder = folder(&[("wander.lua", WANDERS), ("wander_test.lua", LOOKS_ON)]);
    let scenario_file = ScenarioFile::read(&folder.path().join("wander_test.lua")).unwrap();
    let [wanders, endless] = scenario_file.scenarios() else {
        panic!("two scenarios");
    };
    let settings = RunSettings::default();
    let result = scenario_file.run(wanders, 1, &settings).unwrap();
    assert!(result.failure.is_none());
    let failure = scenario_file
        .run(endless, 1, &settings)
        .unwrap()
        .failure
        .unwrap();
    assert_eq!(failure.snapshot.unwrap().at, Duration::from_secs(15));
    assert_eq!(failure.cause, Cause::Scenario);
    let unmet = ScenarioFile::of_text(
        "unmet",
        "scenario('x', {}, function(sim) expect(sim:docked()) end)",
    );
    let unmet = unmet.unwrap();
    let result = unmet.run(&unmet.scenarios()[0], 1, &settings).unwrap();
    let failure = result.failure.unwrap();
    assert_eq!(failure.cause, Cause::Expectation);
    assert_eq!(failure.message, "this is not true");
}

/// Its POWER is a voltage, which does not look low at this energy: the config says so, as after
/// `doctor --first`.
#[test]
fn a_low_battery_of_a_genuine_robot_is_low_in_a_scenario_too() {
    let home = "scenario('x', { world = 'laboratory', battery = 18 }, function(sim) \
                sim:run('stands.lua') \
                expect(sim:wait_until(function() return sim:docked() end, 200), 'it is not home') end)";
    let folder = folder(&[("stands.lua", "task.wait(1000)"), ("low_test.lua", home)]);
    let file = ScenarioFile::read(&folder.path().join("low_test.lua")).unwrap();
    let settings = RunSettings::default();
    let result = file.run(&file.scenarios()[0], 1, &settings).unwrap();
    let failure = result.failure.map(|failure| failure.message);
    assert_eq!(failure, None);
}

#[test]
fn an_expectation_that_is_caught_still_fails_its_scenario() {
    for source in [
        "scenario('x', function(sim) pcall(expect, false, 'caught') end)",
        "scenario('x', function(sim) pcall(function() expect(nil, 'caught') end) sim:wait(2) end)",
        "scenario('x', function(sim) task.spawn(function() pcall(expect, 1 > 2, 'caught') end) sim:wait(1) end)",
        "scenario('x', function(sim) xpcall(expect, print, false, 'caught') expect(true) error('other') end)",
        "scenario('x', function(sim) pcall(expect, false, 'caught') pcall(expect, false, 'later') end)",
    ] {
        assert_eq!(complaint(source), "caught", "{source}");
    }
}

#[test]
fn a_scenario_and_its_scripts_cannot_read_other_folders() {
    if !spykee::sandbox::Restrictions::supported().files {
        eprintln!("this kernel has no landlock: nothing keeps them from it");
        return;
    }
    let elsewhere = folder(&[("secret.lua", "SECRET = 1"), ("secret.yaml", "SECRET: 1")]);
    let elsewhere = elsewhere.path().display();
    for (call, why) in [
        ("sim:run('/etc/passwd')".to_owned(), "must end in .lua"),
        (
            "sim:run('/proc/self/environ')".to_owned(),
            "must end in .lua",
        ),
        (
            format!("sim:run('{elsewhere}/secret.lua')"),
            "Permission denied",
        ),
    ] {
        let said = complaint(&format!("scenario('x', function(sim) {call} end)"));
        assert!(said.contains(why), "{call}: {said}");
    }
    let world = format!("{{ world = '{elsewhere}/secret.yaml' }}");
    let said = complaint(&format!("scenario('x', {world}, function(sim) end)"));
    assert!(
        said.contains("Permission denied") && !said.contains("SECRET"),
        "{said}"
    );
}

#[test]
fn a_scenario_below_the_working_folder_may_run_a_script_above_itself() {
    let folder = folder(&[("a.lua", "robot.drive(0.2, 0) task.wait(100)")]);
    std::fs::create_dir(folder.path().join("tests")).unwrap();
    let source = "scenario('x', { battery = 80 }, function(sim) sim:run('../a.lua') sim:wait(1)
                  expect(sim:distance() > 0.05) end)";
    std::fs::write(folder.path().join("tests/a_test.lua"), source).unwrap();
    let output = run_in(folder.path(), &["test"]);
    assert_eq!(output.code, Some(0), "{}", output.text());
}

#[test]
fn a_run_that_exceeds_the_real_time_limit_is_ended_and_the_others_are_run() {
    let source = "scenario('for ever', { limit = 2000000, battery = 90 }, function(sim)
                      sim:run('wander.lua') sim:wait(1900000)
                  end)
                  scenario('quick', function(sim) sim:wait(1) end)";
    let folder = folder(&[("wander.lua", WANDERS), ("a_test.lua", source)]);
    let output = run_in(folder.path(), &["test", "--json", "--timeout", "3"]);
    assert_eq!(output.code, Some(4), "{}", output.text());
    let json = output.json();
    let message = json["runs"][0]["failure"]["message"].as_str().unwrap();
    assert_contains(message, &["within 3 s of real time"]);
    assert_eq!(json["runs"][0]["failure"]["pose"], Value::Null);
    assert_eq!((&json["passed"], &json["failed"]), (&1.into(), &1.into()));
    let output = run_in(
        folder.path(),
        &["test", "--timeout", "3", "--filter", "ever"],
    );
    assert_contains(&output.text(), &["--timeout sets a longer limit"]);
}

/// The processes that run scenarios.
async fn scenario_processes(run: &crate::rig::Run) -> Vec<rustix::process::Pid> {
    let begun = std::time::Instant::now();
    loop {
        let mut scenario_processes = crate::rig::children_of(run.pid());
        scenario_processes.retain(|pid| {
            let line = std::fs::read(format!("/proc/{}/cmdline", pid.as_raw_nonzero()));
            line.is_ok_and(|line| String::from_utf8_lossy(&line).contains("__worker\x00scenario"))
        });
        if !scenario_processes.is_empty() {
            return scenario_processes;
        }
        assert!(begun.elapsed() < crate::rig::WAIT_LIMIT, "{}", run.text());
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
}

const ENDLESS: &str = "scenario('endless', { limit = 2000000, battery = 90 }, function(sim)
        sim:run('wander.lua') sim:wait(1900000)
    end)";

#[tokio::test(flavor = "multi_thread")]
async fn a_run_whose_process_dies_has_failed_and_one_that_hangs_can_be_interrupted() {
    let rig = Rig::quiet().await;
    rig.file("wander.lua", WANDERS);
    rig.file("endless_test.lua", ENDLESS);
    let mut run = rig.spykee(&["test"]);
    // The first process only reads the file.
    wait_until_running(&run).await;
    let process = scenario_processes(&run).await[0];
    rustix::process::kill_process(process, Signal::KILL).unwrap();
    assert_eq!(run.code().await, Some(4), "{}", run.text());
    assert_contains(&run.text(), &["its process ended unexpectedly"]);
    let mut run = rig.spykee(&["test"]);
    wait_until_running(&run).await;
    rustix::process::kill_process(scenario_processes(&run).await[0], Signal::STOP).unwrap();
    run.signal(Signal::INT);
    assert_eq!(run.code().await, Some(130), "{}", run.text());
}

/// Waits until a scenario runs and is no longer only read: its process may then compute for longer.
async fn wait_until_running(run: &crate::rig::Run) {
    let begun = std::time::Instant::now();
    loop {
        let process = scenario_processes(run).await[0];
        let line = std::fs::read(format!("/proc/{}/cmdline", process.as_raw_nonzero()));
        if line.is_ok_and(|line| String::from_utf8_lossy(&line).contains("\x00601\x00")) {
            return;
        }
        assert!(begun.elapsed() < crate::rig::WAIT_LIMIT, "{}", run.text());
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
}

#[test]
fn scripts_that_stay_in_library_functions_are_ended_in_a_scenario_too() {
    let hostile = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/hostile");
    let names = [
        "sort_by_library_function",
        "foreach_of_foreach",
        "equality_in_the_library",
        "gsub_with_library_callback",
        "library_tree_in_on_stop",
        "loop",
    ];
    let folder = folder(&[]);
    let mut source = String::new();
    for name in names {
        let file = format!("{name}.lua");
        std::fs::copy(hostile.join(&file), folder.path().join(&file)).unwrap();
        source += &format!(
            "scenario('{name}', {{ may_fail = true, limit = 20 }}, function(sim)
                 sim:run('{file}')
                 expect(sim:wait_until(function() return sim:ended() end, 10), 'it runs on')
             end)\n"
        );
    }
    std::fs::write(folder.path().join("ends_test.lua"), source).unwrap();
    let output = run_in(folder.path(), &["test", "--timeout", "60"]);
    assert_eq!(output.code, Some(0), "{}", output.text());
}
