//! The definitions against a live VM, in both directions, and against what natives say.

use std::collections::BTreeSet;

use super::vision::{RED, picture, show};
use super::{Rig, connected};
use crate::robot::EndReason;
use crate::script::definition::*;
use crate::script::events::EventName;

/// Namespaces of the language itself; `string`, `table` and `coroutine` with our replacements.
const LANGUAGE: [&str; 9] = [
    "bit32",
    "buffer",
    "coroutine",
    "math",
    "string",
    "table",
    "utf8",
    "vector",
    "_G",
];

/// Globals of the language itself.
const BASIC: [&str; 21] = [
    "_VERSION",
    "assert",
    "collectgarbage",
    "error",
    "getmetatable",
    "ipairs",
    "next",
    "pairs",
    "pcall",
    "rawequal",
    "rawget",
    "rawlen",
    "rawset",
    "select",
    "setmetatable",
    "tonumber",
    "tostring",
    "type",
    "unpack",
    "typeof",
    "xpcall",
];

/// The calls, fields and methods that `API.md` promises, as it writes them.
const PROMISED: &str = "
    script.stop script.on_stop script.name script.usage print log.debug log.info log.warn log.error
    robot.move robot.drive robot.forward robot.turn robot.stop
    robot.led robot.blink robot.play robot.stop_sound robot.volume robot.say robot.stream
    robot.battery robot.docked robot.connected robot.info robot.dock robot.undock robot.cancel_dock
    task.wait task.spawn task.delay task.every task.all task.race task.timeout task.now
    Task.status Task:cancel Task:join robot.on robot.once robot.wait_for Subscription:off
    Frame.seq Frame.age Frame.width Frame.height Frame.bytes robot.frame robot.wait_frame
    vision.lab vision.hsv Frame:find_blobs vision.tracker Tracker:update Tracker:best Tracker:reset
    vision.learn vision.motion Detector:update Frame:find_line Frame:find_qrcodes Frame:brightness
    Frame:sharpness Frame:get_pixel Frame:save Track.id Track.age Track.lost Track.vx Track.vy
    params.declare store.get store.set store.delete store.keys require
    Blob.x Blob.y Blob.w Blob.h Blob.cx Blob.cy Blob.pixels Blob.area Blob.density Blob.rotation
    Blob.elongation Blob.roundness Blob.perimeter Blob.code Blob.count Blob.colour Blob.bearing Blob.edge";

/// The events that `API.md` promises.
const EVENTS: &str = "connected disconnected battery battery_low battery_ok charging charged docked
    undocked base_not_found frame audio noise sound_finished safety loan engine";

/// What a script sees: the paths of all functions and fields of our own namespaces and globals.
fn seen_by_scripts() -> BTreeSet<String> {
    let language: BTreeSet<_> = LANGUAGE.iter().chain(&BASIC).copied().collect();
    let rig = Rig::new("robot.on('engine', print)");
    let paths = rig.script.known_names();
    let is_table = |path: &String| paths.iter().any(|one| one.starts_with(&format!("{path}.")));
    let paths = paths.iter().filter(|path| !is_table(path)).cloned();
    paths
        .filter(|path| {
            let owner = path.split('.').next().unwrap();
            !language.contains(owner) && path != "script.fault"
        })
        .collect()
}

fn defined() -> BTreeSet<String> {
    let functions = functions()
        .filter(|one| !one.is_method())
        .map(|one| one.path.to_owned());
    functions
        .chain(constants().map(|one| one.path.to_owned()))
        .collect()
}

#[test]
fn every_call_of_a_live_vm_is_defined_and_every_definition_exists() {
    let (seen, defined) = (seen_by_scripts(), defined());
    let missing: Vec<_> = seen.difference(&defined).collect();
    assert!(
        missing.is_empty(),
        "without a definition in src/script/api/definition: {missing:?}"
    );
    let extra: Vec<_> = defined.difference(&seen).collect();
    assert!(extra.is_empty(), "defined, but not there: {extra:?}");
}

#[test]
fn all_that_api_md_promises_is_defined() {
    let known: BTreeSet<String> = names().map(|(path, ..)| path).collect();
    let missing: Vec<_> = PROMISED
        .split_whitespace()
        .filter(|path| !known.contains(*path))
        .collect();
    assert!(missing.is_empty(), "{missing:?}");
    let of_runtime: Vec<_> = EventName::ALL.iter().map(|event| event.name()).collect();
    assert_eq!(EVENTS.split_whitespace().collect::<Vec<_>>(), of_runtime);
    assert_eq!(
        events().map(|event| event.name).collect::<Vec<_>>(),
        of_runtime
    );
}

#[test]
fn nothing_is_without_words() {
    for function in functions() {
        assert!(
            function.doc.ends_with('.') && !function.example.is_empty(),
            "{}",
            function.path
        );
    }
    let docs = objects()
        .map(|one| (one.name, one.doc))
        .chain(events().map(|one| (one.name, one.doc)));
    for (name, doc) in docs {
        assert!(doc.ends_with('.'), "{name}: {doc:?}");
    }
    let named: Vec<_> = functions()
        .flat_map(|one| one.parameters.iter().chain(one.returns))
        .chain(objects().flat_map(|one| one.fields))
        .collect();
    for value in named {
        let kind = match value.kind {
            Type::List(of) | Type::OneOrMore(of) => *of,
            kind => kind,
        };
        if let Type::Object(name) = kind {
            assert!(object(name).is_some(), "{name}");
        }
    }
}

#[test]
fn the_waiting_calls_are_those_that_wait() {
    let waits: BTreeSet<_> = functions()
        .filter(|one| one.waits)
        .map(|one| one.path)
        .collect();
    let expected =
        "robot.move robot.drive robot.forward robot.turn robot.dock robot.undock robot.wait_for
        robot.wait_frame require task.wait task.all task.race task.timeout Task:join";
    assert_eq!(waits, expected.split_whitespace().collect());
}

/// A value that a parameter takes, as it is written in a script.
fn sample(kind: &Type) -> Option<String> {
    Some(match kind {
        Type::Number(bounds) | Type::Whole(bounds) => match bounds {
            Some(Bounds::Between(low, high)) => format!("{}", 1_f64.clamp(*low, *high)),
            Some(Bounds::Above(low, _)) => format!("{}", low + 1.0),
            None => "1".to_owned(),
        },
        Type::Text => "'x'".to_owned(),
        Type::Boolean => "true".to_owned(),
        Type::Function(_) | Type::Handler => "function() end".to_owned(),
        Type::Buffer => "buffer.create(2)".to_owned(),
        Type::Choice(choice) => format!("'{}'", (choice.names)()[0]),
        Type::Colour | Type::Colours => "'red'".to_owned(),
        Type::Roi => "{1, 1, 9, 9}".to_owned(),
        Type::Range => "{0, 1}".to_owned(),
        Type::Options(_) | Type::Fields | Type::Named(_) => "{}".to_owned(),
        Type::Any | Type::Object(_) | Type::List(_) | Type::OneOrMore(_) | Type::Payload => {
            return None;
        }
    })
}

/// A number just outside of bounds.
fn outside(bounds: Bounds) -> f64 {
    match bounds {
        Bounds::Between(low, _) => low - 1.0,
        Bounds::Above(low, _) => low,
    }
}

/// The script's failure, called on a live robot.
fn failure_of(call: &str) -> String {
    let mut rig = Rig::new(&format!("robot.wait_for('connected') {call}"));
    rig.deliver(connected(false));
    match rig.script.ended() {
        Some(ending) => ending.message.unwrap_or_default(),
        None => String::new(),
    }
}

/// Each call of a namespace with one argument replaced.
fn calls_with(of: impl Fn(&Value) -> Option<(String, String)>) -> Vec<(String, String)> {
    let mut calls = Vec::new();
    for function in functions().filter(|one| !one.is_method() && one.path != "task.every") {
        for (at, parameter) in function.parameters.iter().enumerate() {
            let Some((literal, expected)) = of(parameter) else {
                continue;
            };
            let before: Option<Vec<_>> = function.parameters[..at]
                .iter()
                .map(|one| sample(&one.kind))
                .collect();
            let Some(mut arguments) = before else {
                continue;
            };
            arguments.push(literal);
            let after = function.parameters[at + 1..]
                .iter()
                .map_while(|one| sample(&one.kind));
            arguments.extend(after);
            calls.push((
                format!("{}({})", function.path, arguments.join(", ")),
                expected,
            ));
        }
    }
    calls
}

#[test]
fn natives_refuse_numbers_outside_of_the_defined_range_in_the_same_words() {
    let calls = calls_with(|parameter| {
        let Type::Number(Some(bounds)) = parameter.kind else {
            return None;
        };
        let words = format!("{} must be {}, got", parameter.name, bounds.words());
        Some((outside(bounds).to_string(), words))
    });
    assert!(calls.len() > 15, "{calls:?}");
    for (call, expected) in calls {
        let failure = failure_of(&call);
        assert!(
            failure.contains(&expected),
            "{call}: {failure:?} lacks {expected:?}"
        );
    }
}

#[test]
fn natives_refuse_names_that_are_not_defined_and_know_those_that_are() {
    let calls = calls_with(|parameter| {
        let Type::Choice(choice) = parameter.kind else {
            return None;
        };
        let names = (choice.names)().join(", ");
        Some((
            "'xyzzy'".to_owned(),
            format!("unknown {} 'xyzzy' (known: {names})", choice.what),
        ))
    });
    assert!(calls.len() > 5);
    for (call, expected) in calls {
        let failure = failure_of(&call);
        assert!(
            failure.contains(&expected),
            "{call}: {failure:?} lacks {expected:?}"
        );
    }
}

#[test]
fn natives_know_the_defined_option_keys_and_ranges_and_no_others() {
    let mut options = 0;
    for function in functions().filter(|one| !one.is_method()) {
        let Some(at) = function
            .parameters
            .iter()
            .position(|one| matches!(one.kind, Type::Options(_)))
        else {
            continue;
        };
        let Type::Options(keys) = function.parameters[at].kind else {
            continue;
        };
        options += 1;
        let before: Vec<_> = function.parameters[..at]
            .iter()
            .filter_map(|one| sample(&one.kind))
            .collect();
        let call = |table: String| {
            format!(
                "{}({})",
                function.path,
                [before.clone(), vec![table]].concat().join(", ")
            )
        };
        let names: Vec<_> = keys.iter().map(|key| key.name).collect();
        let failure = failure_of(&call("{xyzzy = 1}".to_owned()));
        let expected = format!("unknown option 'xyzzy' (known: {})", names.join(", "));
        assert!(
            failure.contains(&expected),
            "{failure:?} lacks {expected:?}"
        );
        for key in keys {
            let (Type::Number(Some(bounds)) | Type::Whole(Some(bounds))) = key.kind else {
                continue;
            };
            let colour = if names.contains(&"colour") {
                "colour = 'red', "
            } else {
                ""
            };
            let failure = failure_of(&call(format!(
                "{{{colour}{} = {}}}",
                key.name,
                outside(bounds)
            )));
            let expected = format!("{} must be {}", key.name, bounds.words());
            assert!(
                failure.contains(&expected),
                "{failure:?} lacks {expected:?}"
            );
        }
    }
    assert!(options >= 6, "{options}");
}

#[test]
fn every_example_runs() {
    let examples = functions()
        .map(|one| {
            (
                one.path,
                one.example,
                one.path.starts_with("Frame:")
                    || one.path.contains("er:")
                    || one.path.contains("or:"),
            )
        })
        .chain(constants().map(|one| (one.path, one.example, false)));
    let thing = picture(&[((140, 100, 40, 40), RED)]);
    for (path, example, with_frame) in examples {
        let source = match with_frame {
            true => format!("robot.on('frame', function(frame)\n{example}\nend)"),
            false => example.to_owned(),
        };
        let mut rig = Rig::new(&source);
        rig.deliver(connected(false));
        show(&mut rig, 1, &thing);
        rig.pass(2.0);
        if let Some(ending) = rig.script.ended() {
            assert_eq!(
                ending.reason,
                EndReason::Done,
                "{path}: {:?}",
                ending.message
            );
        }
        let complaints = rig.logged(crate::script::Level::Error);
        assert!(
            complaints.is_empty() || path == "log.error",
            "{path}: {complaints:?}"
        );
    }
}

#[test]
fn signatures_read_as_people_write_them() {
    let call = |path| function(path).unwrap().call();
    assert_eq!(call("robot.move"), "robot.move(left, right [, seconds])");
    assert_eq!(call("robot.stop"), "robot.stop()");
    assert_eq!(call("task.wait"), "task.wait([seconds])");
    assert_eq!(call("task.delay"), "task.delay(seconds, fn, ...)");
    assert_eq!(call("task.all"), "task.all(...)");
    assert_eq!(
        function("robot.led").unwrap().signature(),
        "robot.led(name: Light, on: boolean): ()"
    );
    assert!(full("Blob.cx").unwrap().contains("column of its centroid"));
    assert!(full("frame").unwrap().contains("a Frame"));
    assert_eq!(full("robot.fly"), None);
}

#[test]
fn the_reference_in_the_readme_is_the_generated_one() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/behaviours/README.md");
    let text = std::fs::read_to_string(path).unwrap();
    let (_, rest) = text
        .split_once("<!-- reference: spykee api --markdown -->\n")
        .unwrap();
    let (reference, _) = rest.split_once("<!-- end of reference -->").unwrap();
    assert!(
        reference.trim() == markdown().trim(),
        "behaviours/README.md is not what `spykee api --markdown` prints; put that between the markers"
    );
}
