//! Runs the examples of the API table, and reads the fields of its objects.

use tokio::time::Instant;

use super::super::{Level, Options, Script};
use super::vision::{RED, picture, show};
use super::{Rig, connected};
use crate::api;
use crate::robot::EndReason;

/// Runs an example on a robot whose camera sees a red object.
#[track_caller]
fn runs(path: &str, source: &str) {
    let mut rig = Rig::new(source);
    rig.deliver(connected(false));
    show(&mut rig, 1, &picture(&[((140, 100, 40, 40), RED)]));
    rig.pass(2.0);
    if let Some(exit) = rig.script.ended() {
        let message = exit.message.unwrap_or_default();
        assert_eq!(exit.reason, EndReason::Done, "{path}: {message}");
    }
    let complaints = rig.logged(Level::Error);
    assert!(
        complaints.is_empty() || path == "log.error",
        "{path}: {complaints:?}"
    );
}

#[test]
fn every_example_runs() {
    let of_behaviours =
        api::namespaces().filter(|one| one.availability != api::Availability::Scenario);
    for namespace in of_behaviours.chain(api::modules()) {
        runs(namespace.name, namespace.example);
        for function in namespace.functions {
            runs(function.path, function.example);
        }
        for constant in namespace.constants {
            runs(constant.path, constant.example);
        }
    }
    for method in api::methods().filter(|one| one.owner() != "sim") {
        runs(method.path, method.example);
    }
}

#[test]
fn every_field_of_an_object_can_be_read() {
    for (name, made) in [
        ("Frame", "robot.wait_frame(2)"),
        ("Task", "task.spawn(print)"),
        ("Battery", "robot.battery()"),
        ("Info", "robot.info()"),
        (
            "Machine",
            "require('@spykee/fsm').new({initial = 'a', states = {a = {}}})",
        ),
    ] {
        let fields = api::object(name).unwrap().fields;
        let reads = fields
            .iter()
            .map(|field| format!("print(it.{})", field.name));
        let reads: Vec<_> = reads.collect();
        let source = format!("local it = {made}\nif it then {} end", reads.join(" "));
        runs(name, &source);
    }
}

const CHAPTER: &str = include_str!("../../../behaviours/guide/learn/18-scenarios.md");

#[test]
fn the_book_names_all_that_a_scenario_can_call_and_nothing_else() {
    let script = Script::empty_scenario(Options::new("test", "test.lua"), Instant::now()).unwrap();
    let names = script.known_names();
    let calls = names.iter().filter_map(|name| name.strip_prefix("sim."));
    let calls: Vec<&str> = calls.collect();
    assert!(calls.len() > 20, "{calls:?}");
    for call in &calls {
        assert!(
            CHAPTER.contains(&format!("`sim:{call}(")),
            "sim:{call} is not documented"
        );
    }
    let documented = CHAPTER
        .split("`sim:")
        .skip(1)
        .filter_map(|rest| rest.split('(').next());
    for name in documented {
        assert!(calls.contains(&name), "sim:{name} does not exist");
    }
    for absent in ["robot", "store", "vision", "params"] {
        assert!(!names.contains(absent), "{absent}");
    }
}
