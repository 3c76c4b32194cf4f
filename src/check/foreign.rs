//! Help for names from other programming languages, and for functions used without their namespace.

use std::collections::BTreeSet;

use crate::api::{self, SCENARIO};

/// The object that only scenarios get.
const SIM: &str = "Sim";

/// Names from other languages, and what to write instead.
const MEANT: [(&str, &str); 35] = [
    ("null", "it is written nil"),
    ("None", "it is written nil"),
    ("undefined", "it is written nil"),
    ("True", "it is written true, in small letters"),
    ("False", "it is written false, in small letters"),
    ("TRUE", "it is written true, in small letters"),
    ("FALSE", "it is written false, in small letters"),
    ("wait", "to wait, write task.wait(seconds)"),
    ("sleep", "to wait, write task.wait(seconds)"),
    (
        "delay",
        "to wait, write task.wait(seconds); task.delay(seconds, fn) calls a function later",
    ),
    (
        "spawn",
        "to run a function in parallel, write task.spawn(fn)",
    ),
    ("import", "load a module with require(\"./name\")"),
    ("include", "load a module with require(\"./name\")"),
    (
        "frame",
        "it is a parameter of the function: robot.on(\"frame\", function(frame) ... end)",
    ),
    (
        "on",
        "for easy.light write \"on\", in quotes; for robot.led write true",
    ),
    (
        "off",
        "for easy.light write \"off\", in quotes; for robot.led write false",
    ),
    ("elif", "it is written elseif"),
    ("elsif", "it is written elseif"),
    ("def", "functions begin with the word function"),
    ("fn", "functions begin with the word function"),
    ("func", "functions begin with the word function"),
    ("var", "variables begin with the word local"),
    ("let", "variables begin with the word local"),
    ("const", "variables begin with the word local"),
    ("console", "to write something, use print(...)"),
    ("echo", "to write something, use print(...)"),
    ("printf", "to write something, use print(...)"),
    ("len", "the length of a list or text is #list"),
    ("range", "to count, write for i = 1, 10 do"),
    ("str", "tostring(value) converts a value to a string"),
    (
        "int",
        "tonumber(text) converts a string to a number; math.floor(x) rounds down",
    ),
    ("self", "only functions declared with a colon have self"),
    (
        "this",
        "only functions declared with a colon have self; there is no this",
    ),
    (
        "os",
        "scripts have no os; clock.date() is the time of day, task.now() counts seconds",
    ),
    (
        "io",
        "scripts have no files; print, log and frame:save(name) write",
    ),
];

pub(super) fn meant(name: &str) -> Option<&'static str> {
    let found = MEANT.iter().find(|(foreign, _)| *foreign == name);
    found.map(|(_, meant)| *meant)
}

/// Says where a function of this name belongs. `known` are the paths that exist in this file.
pub(super) fn belongs_to(name: &str, known: &BTreeSet<String>) -> Option<String> {
    let text = api::choices().find(|choice| (choice.names)().contains(&name));
    if let Some(choice) = text {
        return Some(format!(
            "if you mean the {}, write its name in quotes: \"{name}\"",
            choice.what
        ));
    }
    let mut functions = api::functions();
    let found = functions.find(|function| function.key() == name && known.contains(function.path));
    if let Some(found) = found {
        return Some(format!("did you mean {}?", found.path));
    }
    let mut objects =
        api::objects().filter(|object| known.contains(SCENARIO) || object.name != SIM);
    let owner = objects.find(|object| object.method(name).is_some())?;
    Some(format!("{name} is a function of {}", owner.with_article()))
}
