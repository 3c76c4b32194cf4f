//! `spykee lesson` as learners and teachers use it: every starter is incomplete and the check says
//! why, every solution has all points, and no script can grade itself.

use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};

use serde_json::Value;
use tempfile::TempDir;

use crate::rig::{Ended, assert_contains, run_in, sized};

/// A learner with one script.
struct Learner(TempDir);

impl Learner {
    fn with(script: &str) -> Learner {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("mine.lua"), script).unwrap();
        Learner(folder)
    }

    fn checks(&self, args: &[&str]) -> Ended {
        run_in(
            self.0.path(),
            &[&["lesson", "check", "mine.lua"], args].concat(),
        )
    }
}

/// The folders of all lessons, in order.
fn lessons() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("behaviours/lessons");
    let entries = fs::read_dir(folder).unwrap();
    let paths = entries.map(|entry| entry.unwrap().path());
    let mut folders: Vec<PathBuf> = paths.filter(|path| path.is_dir()).collect();
    folders.sort();
    folders
}

/// The messages about all scenarios that are not passed.
fn messages(result: &Value) -> Vec<&str> {
    let scenarios = result["scenarios"].as_array().unwrap();
    scenarios
        .iter()
        .filter(|one| one["passed"] == false)
        .map(|one| one["message"].as_str().unwrap())
        .collect()
}

fn assert_sentence(text: &str) {
    let whole = text.starts_with(|c: char| c.is_uppercase()) && text.ends_with(['.', '?', ')']);
    assert!(whole && !text.contains("limit"), "{text}");
}

/// A script and the check of its lesson.
type Checked = (PathBuf, PathBuf);

/// A script of each lesson.
fn of_each_lesson(script: &str) -> Vec<Checked> {
    let checked = |lesson: &PathBuf| (lesson.join(script), lesson.join("check.lua"));
    lessons().iter().map(checked).collect()
}

/// Plays each script with its check, as `spykee lesson check` does, but with so many seeds; returns, for
/// each script, the messages of the runs that are not passed.
fn play_each(scripts: &[Checked], seeds: &str) -> Vec<Vec<String>> {
    let class = tempfile::tempdir().unwrap();
    for (index, (script, check)) in scripts.iter().enumerate() {
        let copy = |from, to: String| fs::copy(from, class.path().join(to)).unwrap();
        copy(script, format!("{index}.lua"));
        copy(check, format!("{index}_test.lua"));
    }
    let said = run_in(class.path(), &["test", "--json", "--seeds", seeds]);
    let runs = said.json()["runs"].take();
    let Some(runs) = runs.as_array() else {
        panic!("{}{}", said.out, said.err);
    };
    let mut failures = vec![Vec::new(); scripts.len()];
    let mut played = vec![0; scripts.len()];
    for run in runs {
        let file = run["file"].as_str().unwrap().rsplit('/').next().unwrap();
        let index: usize = file.strip_suffix("_test.lua").unwrap().parse().unwrap();
        played[index] += 1;
        let message = run["failure"]["message"].as_str();
        failures[index].extend(message.map(str::to_owned));
    }
    assert!(!played.contains(&0), "{}{}", said.out, said.err);
    failures
}

/// The messages of a check, without those that a failed script itself has caused.
fn of_the_check(messages: &[String]) -> impl Iterator<Item = &str> {
    let all = messages.iter().map(String::as_str);
    all.filter(|message| !message.starts_with("the behaviour "))
}

#[test]
fn every_solution_passes_each_scenario_of_its_lesson() {
    let played = play_each(&of_each_lesson("solution.lua"), "1");
    for (index, failures) in played.iter().enumerate() {
        assert!(failures.is_empty(), "lesson {}: {failures:#?}", index + 1);
    }
}

/// For each change of the first lesson, in `scripts/nightly` of all.
#[test]
fn every_solution_has_all_points_with_every_seed() {
    assert_eq!(lessons().len(), 12);
    for (index, lesson) in lessons().iter().enumerate().take(sized(1, 12)) {
        let said = run_in(lesson, &["lesson", "check", "solution.lua", "--json"]);
        let result = said.json();
        assert_eq!(said.code, Some(0), "{}{}", said.out, said.err);
        assert_eq!(result["lesson"], index + 1);
        assert_eq!(
            (&result["points"], &result["mistakes"]),
            (&10.into(), &Value::Array(vec![])),
            "{}",
            said.out
        );
    }
}

#[test]
fn the_lessons_about_the_station_are_right_for_robots_that_leave_it_forward() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("behaviours");
    let world = fs::read_to_string(root.join("worlds/playpen.yaml")).unwrap();
    let forward = world.replace("station: {", "station: { leaves: forward,");
    assert_ne!(forward, world);
    for lesson in ["09-docking", "10-patrol-and-dock"] {
        let lesson = root.join("lessons").join(lesson);
        let folder = tempfile::tempdir().unwrap();
        let check = fs::read_to_string(lesson.join("check.lua")).unwrap();
        let check = check.replace("world = \"playpen\"", "world = \"forward.yaml\"");
        assert!(check.contains("forward.yaml"));
        fs::write(folder.path().join("forward.yaml"), &forward).unwrap();
        fs::write(folder.path().join("solution_test.lua"), check).unwrap();
        fs::copy(
            lesson.join("solution.lua"),
            folder.path().join("solution.lua"),
        )
        .unwrap();
        let said = run_in(folder.path(), &["test", "."]);
        assert_eq!(said.code, Some(0), "{}{}", said.out, said.err);
    }
}

/// Plays all other solutions of a lesson with its check: right ones pass it; wrong ones do not, and the
/// check says why. For each change every twelfth one with one seed, in `scripts/nightly` all with four.
fn judges_other_solutions(lesson: &str) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let check = root
        .join("behaviours/lessons")
        .join(lesson)
        .join("check.lua");
    let mut expected = BTreeMap::new();
    let solutions = root.join("tests/lessons").join(lesson);
    for entry in fs::read_dir(&solutions).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_stem().unwrap().to_str().unwrap().to_owned();
        let source = fs::read_to_string(&path).unwrap();
        let headline = source.lines().next().unwrap();
        let words = headline.strip_prefix("-- wrong: ");
        assert!(words.is_some() || headline == "-- right", "{name}");
        expected.insert(name, words.map(str::to_owned));
    }
    let wrong = expected.values().flatten().count();
    let right = expected.len() - wrong;
    assert!(right >= 6 && wrong >= 12, "{right} right, {wrong} wrong");
    let expected: BTreeMap<_, _> = expected.into_iter().step_by(sized(12, 1)).collect();
    let checked = |name: &String| (solutions.join(format!("{name}.lua")), check.clone());
    let scripts: Vec<Checked> = expected.keys().map(checked).collect();
    let played = play_each(&scripts, sized("1", "4"));
    for ((name, words), messages) in expected.iter().zip(&played) {
        let Some(words) = words else {
            assert!(messages.is_empty(), "{lesson}/{name}: {messages:#?}");
            continue;
        };
        let says_so = |message: &String| words.split('|').any(|words| message.contains(words));
        assert!(
            messages.iter().any(says_so),
            "{lesson}/{name}: {messages:#?}"
        );
        of_the_check(messages).for_each(assert_sentence);
    }
}

macro_rules! other_solutions {
    ($($name:ident: $lesson:literal,)+) => {
        /// One test per lesson, so that they run in parallel.
        mod other_solutions {
            $(#[test] fn $name() { super::judges_other_solutions($lesson); })+
        }

        #[test]
        fn every_lesson_has_other_solutions() {
            let names = lessons().into_iter().map(|path| path.file_name().unwrap().to_owned());
            assert_eq!(names.collect::<Vec<_>>(), [$($lesson),+]);
        }
    };
}

other_solutions! {
    lights: "01-lights",
    sounds: "02-sounds",
    moving: "03-moving",
    square: "04-square",
    events: "05-events",
    seeing: "06-seeing",
    following: "07-following",
    line: "08-line",
    docking: "09-docking",
    patrol_and_dock: "10-patrol-and-dock",
    guard: "11-guard",
    states: "12-states",
}

#[test]
fn a_class_is_graded_with_missing_and_copied_scripts() {
    let class = tempfile::tempdir().unwrap();
    let own = "-- my very own way to drive there and back again, with a rest in the middle of it\n";
    let right = format!("{own}robot.move(40, 40, 2)\ntask.wait(1)\nrobot.move(-40, -40, 2)\n");
    let folder = |name: &str| {
        let path = class.path().join("class").join(name);
        fs::create_dir_all(&path).unwrap();
        path
    };
    fs::write(folder("Ada").join("moving.lua"), &right).unwrap();
    fs::write(
        folder("Ben").join("moving.lua"),
        right.replace("40, 40, 2", "40,  40, 2"),
    )
    .unwrap();
    fs::write(folder("=Cem").join("mine.lua"), "robot.moev(40, 40, 2)\n").unwrap();
    folder("Dora");
    let other_lesson = "-- spykee lesson 1\nrobot.move(40, 40, 2)\n";
    fs::write(folder("").join("Eva.lua"), other_lesson).unwrap();
    symlink(folder("Ada").join("moving.lua"), folder("").join("Gus.lua")).unwrap();
    fs::write(class.path().join("names.txt"), "\u{feff}Ada\nBen\n\nFinn\n").unwrap();
    let grade = |form: &[&str]| {
        let args = [
            "lesson",
            "grade",
            "class",
            "--lesson",
            "3",
            "--names",
            "names.txt",
        ];
        let said = run_in(class.path(), &[&args[..], form].concat());
        assert_eq!(said.code, Some(0), "{}{}", said.out, said.err);
        said
    };
    let text = grade(&[]).out;
    for words in [
        "Lesson 3, Moving: 10 points",
        "Ada       10",
        "Eva        2  The script names lesson 1, Lights, at its top. It drives away and stays there",
        "Gus        -  handed in as a symbolic link, which is not followed",
        "=Cem       0  The script cannot run: line 1: robot.moev does not exist",
        "No script to check from: Dora, Finn, Gus",
        "Nearly the same text (",
        "): Ada and Ben",
    ] {
        assert!(text.contains(words), "{words}: {text}");
    }
    let csv = grade(&["--csv"]).out;
    let lines: Vec<&str> = csv.lines().collect();
    assert_eq!(lines[0], "name,points,max_points,missing,file,same_text_as");
    assert!(lines[1].starts_with("'=Cem,0,10,"), "{csv}");
    assert_eq!(lines[2], "Ada,10,10,,class/Ada/moving.lua,Ben");
    assert!(lines.contains(&"Finn,0,10,nothing handed in,,"), "{csv}");
    let json = grade(&["--json"]).json();
    assert_eq!(json["learners"].as_array().unwrap().len(), 7);
    assert_eq!(json["learners"][1]["points"], 10);
    assert_eq!(json["learners"][3]["handed_in"], false);
    assert_eq!(
        json["same_text"][0]["names"],
        serde_json::json!(["Ada", "Ben"])
    );
    let said = run_in(
        class.path(),
        &["lesson", "grade", "nowhere", "--lesson", "3"],
    );
    assert_eq!(said.code, Some(2), "{}", said.err);
}

/// Scripts side by side cannot `require` each other; what pupils' editors and `lesson start` make of
/// names is found; nothing is lost without a line.
#[test]
fn each_script_of_a_class_is_played_in_a_folder_of_its_own() {
    let class = tempfile::tempdir().unwrap();
    let right = "robot.move(40, 40, 2)\ntask.wait(1)\nrobot.move(-40, -40, 2)\n";
    let utf16: Vec<u8> = format!("\u{feff}{right}")
        .encode_utf16()
        .flat_map(u16::to_le_bytes)
        .collect();
    let copies = "pcall(require, './Ada')\npcall(require, './Ben/lesson-03-moving/moving')\n";
    fs::create_dir_all(class.path().join("Ben/lesson-03-moving")).unwrap();
    for (name, text) in [
        ("Ada.lua", right.as_bytes()),
        ("Ben/lesson-03-moving/moving.lua", right.as_bytes()),
        ("Cem.lua.txt", right.as_bytes()),
        ("Dora.lua", copies.as_bytes()),
        ("Eva.lua", &utf16),
        ("report.pdf", b"%PDF"),
    ] {
        fs::write(class.path().join(name), text).unwrap();
    }
    let folder = class.path().to_str().unwrap();
    let said = run_in(
        class.path(),
        &["lesson", "grade", folder, "--lesson", "3", "--json"],
    );
    assert_eq!(said.code, Some(0), "{}{}", said.out, said.err);
    let result = said.json();
    let learners = result["learners"].as_array().unwrap();
    let points = |one: &Value| one["points"].as_u64().unwrap();
    let points: Vec<u64> = learners.iter().map(points).collect();
    assert_eq!(points, [10, 10, 10, 0, 0], "{}", said.out);
    let why = learners[4]["missing"][0].as_str().unwrap();
    assert!(why.contains("save the file as UTF-8"), "{why}");
    assert_eq!(result["not_read"], serde_json::json!(["report.pdf"]));
}

/// For each change of every second lesson, in `scripts/nightly` of all.
#[test]
fn every_starter_fails_a_scenario_of_its_lesson_which_says_why() {
    let starters = of_each_lesson("starter.lua").into_iter();
    let starters: Vec<Checked> = starters.step_by(sized(2, 1)).collect();
    for ((starter, _), messages) in starters.iter().zip(&play_each(&starters, "1")) {
        assert!(of_the_check(messages).count() > 0, "{}", starter.display());
        of_the_check(messages).for_each(assert_sentence);
    }
}

/// For each change the first starter is checked, in `scripts/nightly` all are, with every seed.
#[test]
fn every_starter_is_incomplete_and_the_check_says_why() {
    let folder = tempfile::tempdir().unwrap();
    for (index, lesson) in lessons().iter().enumerate() {
        let number = (index + 1).to_string();
        let said = run_in(folder.path(), &["lesson", "start", &number, &number]);
        assert_eq!(said.code, Some(0), "{}", said.err);
        let own = folder.path().join(&number);
        let mut files = fs::read_dir(&own).unwrap().map(|one| one.unwrap().path());
        let script = files.find(|path| path.extension().unwrap() == "lua");
        let script = script.unwrap();
        assert_eq!(
            fs::read(&script).unwrap(),
            fs::read(lesson.join("starter.lua")).unwrap()
        );
        let name = script.file_name().unwrap().to_str().unwrap();
        assert!(said.out.contains(&format!("spykee lesson check {name}")));
        if index >= sized(1, 12) {
            continue;
        }
        let said = run_in(&own, &["lesson", "check", name, "--json"]);
        let result = said.json();
        assert_eq!(said.code, Some(4), "{}", said.out);
        assert!(result["error"].is_null(), "{}", said.out);
        assert_eq!(result["mistakes"], Value::Array(vec![]), "{}", said.out);
        assert!(!messages(&result).is_empty(), "{}", said.out);
        messages(&result).into_iter().for_each(assert_sentence);
    }
}

#[test]
fn a_script_that_does_nothing_gets_no_points_and_an_explanation() {
    for (name, script) in [
        ("at once over", ""),
        ("idle", "while true do task.wait(1) end"),
    ] {
        let learner = Learner::with(script);
        for number in (1..=12).step_by(sized(3, 1)) {
            let said = learner.checks(&["--json", "--lesson", &number.to_string()]);
            let result = said.json();
            assert_eq!(result["points"], 0, "{name}: {}", said.out);
            messages(&result).into_iter().for_each(assert_sentence);
        }
    }
}

#[test]
fn the_check_prints_points_sentences_and_where_to_find_a_hint() {
    let script = "-- Spykee lesson 3\nrobot.move(40, 40, 2)\n";
    let learner = Learner::with(script);
    let said = learner.checks(&[]);
    assert_eq!(
        said.out,
        "Lesson 3, Moving: mine.lua\n\n  \
         ok       2 of 2  It drives away\n  \
         not yet  0 of 3  It rests for a second\n           \
         It drives away and stays there: it should come back.\n  \
         not yet  0 of 5  It comes back to where it started\n           \
         At the end it is 32 centimetres from where it started.\n\n\
         2 of 10 points. A hint: spykee lesson check mine.lua --hint 1\n"
    );
    let said = learner.checks(&["--hint", "3", "--picture", "way.png"]);
    assert_contains(&said.out, &["\nHint: Three lines: `easy.forward(2)`"]);
    assert!(image::open(learner.0.path().join("way.png")).is_ok());
}

#[test]
fn a_script_that_names_another_lesson_is_checked_with_a_remark() {
    for (script, remark) in [
        (
            "-- spykee lesson 9\n",
            "The script names lesson 9, Going home, at its top.",
        ),
        (
            "-- spykee lesson 99\n",
            "The script names lesson 99 at its top, which does not exist.",
        ),
    ] {
        let learner = Learner::with(script);
        let said = learner.checks(&["--lesson", "3", "--gradescope", "out.json"]);
        let shown =
            format!("Lesson 3, Moving: mine.lua\n\n{remark} Is it the right script?\n\n  not");
        assert!(said.out.starts_with(&shown), "{}", said.out);
        let next = "A hint: spykee lesson check mine.lua --lesson 3 --hint 1\n";
        assert!(said.out.ends_with(next), "{}", said.out);
        assert_eq!(said.code, Some(4), "{}", said.err);
        let text = fs::read_to_string(learner.0.path().join("out.json")).unwrap();
        let results: Value = serde_json::from_str(&text).unwrap();
        let output = format!("Lesson 3, Moving\n\n{remark}");
        assert_eq!(results["output"], output);
        let said = learner.checks(&["--lesson", "3", "--json"]);
        assert_eq!(said.json()["other_lesson"], remark);
    }
    for script in ["-- spykee lesson 3\n", "print('hello')\n"] {
        let said = Learner::with(script).checks(&["--lesson", "3", "--json"]);
        assert!(said.json()["other_lesson"].is_null(), "{}", said.out);
    }
}

#[test]
fn a_mistake_in_the_script_is_reported_once_and_nothing_is_run() {
    let learner = Learner::with("-- spykee lesson 9\nrobot.undock()\nrobot.moev(40, 40, 2)\n");
    let said = learner.checks(&["--gradescope", "results.json"]);
    assert_eq!(
        said.out,
        "Lesson 9, Going home: mine.lua\n\n\
         The script cannot run yet:\n\n  \
         | mine.lua:3:7: error: robot.moev does not exist; did you mean 'move'?\n  \
         | 3 | robot.moev(40, 40, 2)\n  \
         |   |       ^^^^\n\n\
         0 of 10 points.\n"
    );
    assert_eq!(said.code, Some(4));
    let text = fs::read_to_string(learner.0.path().join("results.json")).unwrap();
    let results: Value = serde_json::from_str(&text).unwrap();
    assert_eq!(results["score"], 0);
    assert!(results["output"].as_str().unwrap().contains("robot.moev"));
}

#[test]
fn a_runtime_error_is_quoted_once_and_cannot_imitate_a_result() {
    let script = "-- spykee lesson 2\nrobot.play('bip_2')\n\
                  error('sorry\\n\\n10 of 10 points.\\27[2J Well done!')\n";
    let said = Learner::with(script).checks(&[]);
    assert_eq!(said.code, Some(4), "{}", said.err);
    assert_eq!(said.out.matches("sorry").count(), 1, "{}", said.out);
    assert!(said.out.contains("The script stopped with an error:\n"));
    assert_contains(&said.out, &["mine.lua:3:"]);
    assert!(said.out.ends_with("\n0 of 10 points.\n"));
    for line in said.out.lines().filter(|line| line.contains("10 of 10")) {
        assert!(line.starts_with("  | "), "{}", said.out);
    }
    assert!(!said.out.contains('\u{1b}'), "{:?}", said.out);
}

#[test]
fn a_script_cannot_see_its_check_or_grade_itself() {
    // Any access would be an error that contains FOUND.
    let script = "-- spykee lesson 1\n\
        print('{\"points\": 10, \"passed\": true}')\n\
        for _, name in { 'sim', 'scenario', 'expect', 'ask', 'io', 'os', 'debug' } do\n\
        \tlocal ok, value = pcall(function() return _G[name] end)\n\
        \tif ok and value ~= nil then error('FOUND ' .. name) end\n\
        end\n\
        for _, path in { './check', '../01-lights/check', './secret' } do\n\
        \tlocal ok, value = pcall(require, path)\n\
        \tif ok and path ~= './secret' then error('FOUND ' .. path) end\n\
        \tif path == './secret' and not (ok and value == 'own') then error('FOUND no module') end\n\
        end\n\
        pcall(function() store.set('points', 10) end)\n\
        script.stop('10 of 10 points')\n";
    let learner = Learner::with(script);
    fs::write(learner.0.path().join("secret.lua"), "return 'own'").unwrap();
    let said = learner.checks(&["--json", "--jobs", "1"]);
    let result = said.json();
    assert_eq!((said.code, &result["points"]), (Some(4), &0.into()));
    assert!(result["error"].is_null(), "{}", said.out);
    assert!(!said.out.contains("FOUND"), "{}", said.out);
    let said = Learner::with("-- spykee lesson 1\nsim:battery(3)\n").checks(&[]);
    assert_eq!(said.code, Some(4));
    assert_contains(&said.out, &["cannot run yet"]);
}

#[test]
fn a_config_in_the_folder_changes_nothing() {
    let learner = Learner::with("-- spykee lesson 3\nrobot.forward(0.3)\n");
    let before = learner.checks(&["--json"]).out;
    let config =
        "calibration: { track_width: 0.9, full_speed: 0.05 }\nwatchdog: { low: 95, ok: 99 }\n";
    fs::write(learner.0.path().join("spykee.yaml"), config).unwrap();
    assert_eq!(learner.checks(&["--json"]).out, before);
}

#[test]
fn gradescope_gets_a_score_for_each_scenario() {
    let learner = Learner::with("robot.move(40, 40, 2)\n");
    let said = learner.checks(&["--lesson", "03-moving", "--gradescope", "out.json"]);
    assert_eq!(said.code, Some(4), "{}", said.err);
    let text = fs::read_to_string(learner.0.path().join("out.json")).unwrap();
    let results: Value = serde_json::from_str(&text).unwrap();
    assert_eq!(results["score"], 2);
    let tests = results["tests"].as_array().unwrap();
    let sum = |key: &str| -> i64 { tests.iter().map(|one| one[key].as_i64().unwrap()).sum() };
    assert_eq!((sum("score"), sum("max_score")), (2, 10));
    for test in tests {
        let passed = test["score"] == test["max_score"];
        assert_eq!(test["status"], if passed { "passed" } else { "failed" });
        assert!(!test["name"].as_str().unwrap().is_empty());
        assert!(!test["output"].as_str().unwrap().is_empty());
    }
}

#[test]
fn lessons_are_listed_with_their_topics() {
    let folder = tempfile::tempdir().unwrap();
    let said = run_in(folder.path(), &["lesson", "list"]);
    assert_eq!(said.code, Some(0));
    for words in [
        "     1  Lights",
        "    10  Patrol and dock",
        "    12  Extra: states",
        "spykee lesson start 1",
    ] {
        assert_contains(&said.out, &[words]);
    }
}

#[test]
fn invalid_requests_are_explained_and_nothing_is_overwritten() {
    let folder = tempfile::tempdir().unwrap();
    let tells = |args: &[&str], words: &[&str]| {
        let said = run_in(folder.path(), args);
        assert_eq!(said.code, Some(2), "{}{}", said.out, said.err);
        for word in words {
            assert!(said.err.contains(word), "{args:?}: {}", said.err);
        }
    };
    for wrong in ["0", "13", "-1", "moveing", ""] {
        tells(
            &["lesson", "start", "--", wrong],
            &["from 1 to 12", "lesson list"],
        );
    }
    assert_eq!(
        run_in(folder.path(), &["lesson", "start", "moving"]).code,
        Some(0)
    );
    let own = folder.path().join("lesson-03-moving");
    fs::write(own.join("moving.lua"), "-- all my work").unwrap();
    tells(
        &["lesson", "start", "3"],
        &[
            "lesson-03-moving already exists",
            "nothing was changed",
            "spykee lesson start 3 DIR",
        ],
    );
    assert_eq!(
        fs::read_to_string(own.join("moving.lua")).unwrap(),
        "-- all my work"
    );
    tells(
        &["lesson", "check", "lesson-03-moving/moving.lua"],
        &["does not say which lesson", "-- spykee lesson 3"],
    );
    fs::write(own.join("moving.lua"), "-- spykee lesson 99\n").unwrap();
    tells(
        &["lesson", "check", "lesson-03-moving/moving.lua"],
        &["names lesson 99", "the lessons are 1 to 12", "lesson list"],
    );
    symlink(own.join("moving.lua"), folder.path().join("link.lua")).unwrap();
    tells(
        &["lesson", "check", "link.lua"],
        &[
            "cannot read link.lua: it is a symbolic link",
            "the file itself",
        ],
    );
    tells(
        &["lesson", "check", "nowhere.lua"],
        &["cannot read nowhere.lua", "lesson start 1"],
    );
    tells(
        &["lesson", "check", "lesson-03-moving"],
        &["name the script in this folder"],
    );
    fs::write(folder.path().join("check.lua"), "-- spykee lesson 1\n").unwrap();
    tells(
        &["lesson", "check", "check.lua"],
        &["cannot be called check.lua"],
    );
}
