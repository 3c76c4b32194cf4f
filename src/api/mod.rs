//! The single definition of the script API: the runtime reads arguments by these rows, and `check`,
//! `spykee api`, the editor's definitions and the book's reference come from them. A VM does not
//! start if a native has no row, or a row has no native.

mod events;
mod luau;
mod markdown;
mod model;
mod modules;
mod page;
mod robot;
mod scenario;
mod script;
mod vision;

pub use events::EventName;
pub use luau::{luau, module_stub};
pub use markdown::{Page, pages};
pub use model::{
    Availability, Bounds, Choice, Constant, Event, Function, Literal, Namespace, Object,
    Requirement, Type, Value,
};
pub use page::{known, list, page, titles};
pub use robot::LONGEST_DRIVE;
pub use vision::PIXELS;

/// The namespaces that are available without `require`. Those with an empty name hold the functions
/// without a namespace.
pub fn namespaces() -> impl Iterator<Item = &'static Namespace> {
    const ALL: [&Namespace; 12] = [
        &robot::ROBOT,
        &script::TASKS,
        &vision::VISION,
        &script::LOG,
        &script::CLOCK,
        &script::SCRIPT,
        &script::PARAMS,
        &script::STORE,
        &script::JOURNAL,
        &script::NOTIFY,
        &script::GLOBALS,
        &scenario::SCENARIO,
    ];
    ALL.into_iter()
}

pub fn modules() -> impl Iterator<Item = &'static Namespace> {
    modules::MODULES.into_iter()
}

/// Every kind of table and object that calls take or return and that events carry.
pub fn objects() -> impl Iterator<Item = &'static Object> {
    const ALL: [&Object; 28] = [
        &vision::FRAME,
        &vision::BLOB,
        &vision::TRACK,
        &vision::TRACKER,
        &vision::DETECTOR,
        &vision::COLOUR,
        &vision::LEARNED,
        &script::TASK,
        &robot::SUBSCRIPTION,
        &events::BATTERY,
        &events::POSE_ESTIMATE,
        &events::INFO,
        &events::DOCK_INFO,
        &events::USAGE,
        &script::DATE,
        &vision::LINE,
        &vision::QR_CODE,
        &vision::CORNER,
        &vision::MOTION,
        &events::AUDIO,
        &events::NOISE,
        &events::CONNECTED,
        &events::DISCONNECTED,
        &events::CHARGING,
        &events::SAFETY,
        &events::DRIVE_GRANT,
        &events::ENGINE,
        &scenario::SIM,
    ];
    let more = scenario::TABLES.into_iter().chain(modules::OBJECTS);
    ALL.into_iter().chain(more)
}

pub fn events() -> impl Iterator<Item = &'static Event> {
    events::EVENTS.iter()
}

/// Every set of names that arguments and results are taken from.
pub fn choices() -> impl Iterator<Item = &'static Choice> {
    use events::{
        COLOUR_NAME, DOCK_CODE, EVENT, LIGHT, MOTION_CODE, QUEUE, SAFETY_ACTION, SOUND, STREAM,
        TASK_STATUS,
    };
    const ALL: [&Choice; 10] = [
        LIGHT,
        SOUND,
        STREAM,
        EVENT,
        QUEUE,
        COLOUR_NAME,
        MOTION_CODE,
        DOCK_CODE,
        SAFETY_ACTION,
        TASK_STATUS,
    ];
    ALL.into_iter()
}

/// Every function that is called without an object and without `require`.
pub fn functions() -> impl Iterator<Item = &'static Function> {
    namespaces().flat_map(|namespace| namespace.functions)
}

pub fn methods() -> impl Iterator<Item = &'static Function> {
    objects().flat_map(|object| object.methods)
}

/// Every function: of namespaces, objects and modules.
fn all_functions() -> impl Iterator<Item = &'static Function> {
    let of_modules = modules().flat_map(|module| module.functions);
    functions().chain(methods()).chain(of_modules)
}

/// Every field of a namespace that is not a function.
pub fn constants() -> impl Iterator<Item = &'static Constant> {
    namespaces().flat_map(|namespace| namespace.constants)
}

/// The function, method or module function with this path, such as `robot.move`, `Frame:save`
/// or `bt.sequence`.
pub fn function(path: &str) -> Option<&'static Function> {
    all_functions().find(|function| function.path == path)
}

pub fn namespace(name: &str) -> Option<&'static Namespace> {
    namespaces().find(|namespace| namespace.name == name)
}

pub fn module(name: &str) -> Option<&'static Namespace> {
    modules().find(|module| module.name == name)
}

pub fn object(name: &str) -> Option<&'static Object> {
    objects().find(|object| object.name == name)
}

pub fn event(name: &str) -> Option<&'static Event> {
    events().find(|event| event.name == name)
}

/// The names that completion offers, each with its path (`robot.move`, `Frame:save`, `Blob.cx`),
/// its signature in Luau's notation, and its description.
pub fn names() -> impl Iterator<Item = (String, String, &'static str)> {
    let functions = all_functions().map(|one| (one.path.to_owned(), one.signature(), one.doc));
    let constants = constants().map(|one| {
        let signature = format!("{}: {}", one.path, one.kind.luau());
        (one.path.to_owned(), signature, one.doc)
    });
    let fields = objects().flat_map(|object| {
        object.fields.iter().map(move |field| {
            let path = format!("{}.{}", object.name, field.name);
            let signature = format!("{path}: {}", field.luau());
            (path, signature, field.doc)
        })
    });
    functions.chain(constants).chain(fields)
}

/// The function that only files with scenarios have.
pub const SCENARIO: &str = "scenario";

/// Says where a global name exists that a file does not have: in a module that must be loaded first,
/// or in another kind of file. `None` if the API has no such name.
pub fn elsewhere(name: &str, in_scenario: bool) -> Option<String> {
    if module(name).is_some() {
        return Some(format!(
            "if you mean the module, load it first: local {name} = require(\"@spykee/{name}\")"
        ));
    }
    if in_scenario && namespace(name).is_some() {
        return Some(format!(
            "only behaviours have {name}; a scenario uses sim, such as sim:run(FILE)"
        ));
    }
    if in_scenario || function(name).is_none() {
        return None;
    }
    Some(format!(
        "{name} exists only in files with scenarios, whose names end in _test.lua"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_entry_has_a_description_and_functions_have_an_example() {
        for function in all_functions() {
            let path = function.path;
            assert!(function.doc.ends_with('.'), "{path}");
            assert!(!function.example().is_empty(), "{path}");
        }
        let objects = objects().map(|one| (one.name, one.doc));
        for (name, doc) in objects.chain(events().map(|one| (one.name, one.doc))) {
            assert!(doc.ends_with('.'), "{name}: {doc:?}");
        }
        for module in modules() {
            assert!(
                module
                    .example()
                    .contains(&format!("@spykee/{}", module.name))
            );
        }
    }

    #[test]
    fn every_example_belongs_to_an_entry() {
        for path in model::EXAMPLES.keys() {
            let is_constant = constants().any(|one| one.path == *path);
            let is_module = path
                .strip_prefix("@spykee/")
                .is_some_and(|name| module(name).is_some());
            assert!(
                function(path).is_some() || is_constant || is_module,
                "{path}"
            );
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
        for function in all_functions() {
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
    fn every_object_is_on_one_page_of_the_reference() {
        for object in objects() {
            let titles = [
                format!("# {}\n", object.name),
                format!("\n## {}\n", object.name),
            ];
            let pages = pages()
                .into_iter()
                .filter(|page| page.text.starts_with(&titles[0]) || page.text.contains(&titles[1]));
            assert_eq!(pages.count(), 1, "{}", object.name);
        }
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
}
