//! Tests of the table's texts. A VM checks when it starts that its natives and modules match the
//! table.

use super::*;

#[test]
fn every_entry_has_a_description_and_functions_have_an_example() {
    let of_modules = modules().flat_map(|module| module.functions);
    for function in functions().chain(methods()).chain(of_modules) {
        let path = function.path;
        assert!(function.doc.ends_with('.'), "{path}");
        assert!(!function.example.is_empty(), "{path}");
    }
    let objects = objects().map(|one| (one.name, one.doc));
    for (name, doc) in objects.chain(events().map(|one| (one.name, one.doc))) {
        assert!(doc.ends_with('.'), "{name}: {doc:?}");
    }
    for module in modules() {
        assert!(module.example.contains(&format!("@spykee/{}", module.name)));
    }
}

#[test]
fn names_are_unique() {
    let mut names: Vec<String> = names().map(|(path, ..)| path).collect();
    names.extend(objects().map(|object| object.name.to_owned()));
    names.sort();
    let count = names.len();
    names.dedup();
    assert_eq!(names.len(), count);
}

/// Collects the names of all objects that a type refers to, including those in the objects' fields.
fn named(kind: &Type, found: &mut Vec<&'static str>) {
    match kind {
        Type::Object(object) => {
            found.push(object.name);
            let fields = object.fields.iter();
            fields.for_each(|field| named(&field.kind, found));
        }
        Type::List(of) | Type::OneOrMore(of) => named(of, found),
        _ => {}
    }
}

#[test]
fn every_object_of_calls_and_events_is_listed() {
    let mut found = Vec::new();
    let of_modules = modules().flat_map(|module| module.functions);
    for function in functions().chain(methods()).chain(of_modules) {
        let values = function.parameters.iter().chain(function.returns);
        values.for_each(|value| named(&value.kind, &mut found));
    }
    let payloads = events().filter_map(|event| event.payload);
    payloads.for_each(|object| named(&Type::Object(object), &mut found));
    assert!(found.len() > 30);
    for name in found {
        assert!(object(name).is_some(), "{name}");
    }
}

#[test]
fn calls_and_signatures_are_readable() {
    let call = |path| function(path).unwrap().call();
    assert_eq!(call("robot.move"), "robot.move(left, right [, seconds])");
    assert_eq!(call("robot.stop"), "robot.stop()");
    assert_eq!(call("task.wait"), "task.wait([seconds])");
    assert_eq!(call("task.delay"), "task.delay(seconds, fn, ...)");
    assert_eq!(call("task.all"), "task.all(...)");
    assert_eq!(call("scenario"), "scenario(name [, options], fn)");
    let led = function("robot.led").unwrap().signature();
    assert_eq!(led, "robot.led(name: Light, on: boolean): ()");
}

#[test]
fn a_page_shows_every_entry_of_a_name() {
    for (name, words) in [
        ("Blob.cx", "column of its centroid"),
        ("frame", "event frame"),
        ("frame", "Frame:find_blobs(colour [, options])"),
        ("battery", "until it is empty"),
        ("bt", "bt.sequence(node, ...)"),
        ("@spykee/fsm", "machine:go(state)"),
        ("bt.parallel", "succeed?"),
        ("pid", "controller:update(measurement [, setpoint])"),
        ("sim", "sim:wait_until(fn, seconds)"),
        ("sim:place", "heading?"),
        ("scenario", "may_fail?"),
        ("expect", "unless the condition is true"),
        ("events", "battery_low"),
        ("modules", "@spykee/easy"),
        ("objects", "Tracker"),
        ("Light", "flash, left, right, all"),
        ("VISION", "vision.tracker(options)"),
        ("tracker", "Tracker:best()"),
        ("find_blobs", "Frame:find_blobs"),
    ] {
        let page = page(name).unwrap_or_default();
        assert!(page.contains(words), "{name}: {words:?} is not in\n{page}");
    }
    assert_eq!(page("robot.fly"), None);
    assert_eq!(page(""), None);
    for name in known() {
        assert!(page(&name).is_some(), "{name}");
    }
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

#[test]
fn editor_definitions_are_complete() {
    let text = luau();
    for method in objects().flat_map(|object| object.methods) {
        let declared = format!("\tfunction {}(self", method.key());
        assert!(text.contains(&declared), "{}", method.path);
    }
    assert!(text.contains("declare scenario: ((name: string, options: "));
    for module in modules() {
        let stub = module_stub(module);
        assert!(
            stub.contains(&format!("function {}.", module.name)),
            "{stub}"
        );
        assert!(
            stub.trim_end()
                .ends_with(&format!("return {}", module.name))
        );
    }
}
