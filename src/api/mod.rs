//! The single definition of the script API: the runtime reads arguments by these rows, and `check`,
//! `spykee api`, the editor's definitions and the book's reference come from them. A VM does not
//! start if a native has no row, or a row has no native.

mod choices;
mod luau;
mod markdown;
mod model;
mod page;
mod table;

pub use choices::EventName;
pub use luau::{luau, module_stub};
pub use markdown::{Page, pages};
pub use model::{
    Availability, Bounds, Choice, Constant, Event, Function, Literal, Namespace, Object,
    Requirement, Type, Value, with_article,
};
pub use page::{known, list, page, titles};

use table::TABLE;

/// The namespaces that are available without `require`. Those with an empty name hold the functions
/// without a namespace.
pub fn namespaces() -> impl Iterator<Item = &'static Namespace> {
    TABLE.namespaces.iter()
}

/// The documented modules. The modules that these use internally, such as `@spykee/compass`, are
/// not documented.
pub fn modules() -> impl Iterator<Item = &'static Namespace> {
    TABLE.modules.iter()
}

/// Every kind of table and object that calls take or return and that events carry.
pub fn objects() -> impl Iterator<Item = &'static Object> {
    TABLE.objects.iter()
}

pub fn events() -> impl Iterator<Item = &'static Event> {
    TABLE.events.iter()
}

/// Every set of names that arguments and results are taken from.
pub fn choices() -> impl Iterator<Item = &'static Choice> {
    choices::CHOICES.iter()
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
    use crate::robot::DockPlan;
    use crate::vision::{BlobOptions, MotionOptions, TrackerOptions};

    #[test]
    fn every_entry_has_a_description_and_functions_have_an_example() {
        for function in all_functions() {
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
    fn every_row_of_the_table_is_read() {
        let count = |mark: &str| {
            let lines = table::TEXT.lines();
            lines.filter(|line| line.starts_with(mark)).count()
        };
        assert_eq!(all_functions().count(), count("--- function "));
        assert_eq!(constants().count(), count("--- constant "));
        let parameters = |one: &Function| one.parameters.len();
        assert_eq!(
            all_functions().map(parameters).sum::<usize>(),
            count("--> ")
        );
        let returns = |one: &Function| one.returns.len();
        assert_eq!(all_functions().map(returns).sum::<usize>(), count("--< "));
        let rest = all_functions().filter(|one| one.rest.is_some());
        assert_eq!(rest.count(), count("--* "));
        let keys = all_functions().flat_map(|one| one.parameters).map(keys);
        let fields = objects().map(|object| object.fields.len());
        let found = keys.chain(fields).sum::<usize>();
        assert_eq!(found, count("--. ") + count("--.. "));
        let headlines = table::TEXT.lines();
        for headline in headlines.filter_map(|line| line.strip_prefix("--- ")) {
            let mut words = headline.split(' ');
            let known: &[&str] = match words.next() {
                Some("function") => &["waits", "pure"],
                Some("namespace") => &["everywhere", "behaviours", "scenarios"],
                Some("module" | "group" | "object" | "table") => &[],
                Some("constant" | "event") => continue,
                other => panic!("{other:?}"),
            };
            let are_known = words.skip(1).all(|word| known.contains(&word));
            assert!(are_known, "{headline}");
        }
        let named = EventName::ALL.iter().map(|event| event.name());
        assert!(events().map(|event| event.name).eq(named));
        let values = all_functions().flat_map(|one| one.parameters.iter().chain(one.returns));
        let fields = objects().flat_map(|object| object.fields);
        for value in values.chain(fields) {
            let words = value.describe();
            assert!(!words.contains("NaN"), "{}: {words}", value.name);
        }
    }

    /// The number of keys of a table, and of the tables in it.
    fn keys(value: &Value) -> usize {
        match value.kind {
            Type::Options(all) | Type::Named(all) => {
                all.len() + all.iter().map(keys).sum::<usize>()
            }
            _ => 0,
        }
    }

    /// The natives read their options' defaults from the rows, other code uses constants.
    #[test]
    fn the_defaults_of_rows_are_those_of_the_code() {
        let default = |path: &str, key: &str| {
            let options = function(path).unwrap().parameters.last().unwrap();
            let Type::Options(keys) = options.kind else {
                panic!("{path} has no options");
            };
            let row = keys.iter().find(|row| row.name == key).unwrap();
            match row.requirement {
                Requirement::Default(literal) => literal.to_string(),
                other => panic!("{path} {key}: {other:?}"),
            }
        };
        let blobs = BlobOptions::DEFAULT;
        let tracks = TrackerOptions::DEFAULT;
        let motion = MotionOptions::DEFAULT;
        let dock = DockPlan::DEFAULT;
        for (path, key, usual) in [
            ("Frame:find_blobs", "invert", blobs.invert.to_string()),
            (
                "Frame:find_blobs",
                "area_threshold",
                blobs.area_threshold.to_string(),
            ),
            (
                "Frame:find_blobs",
                "pixels_threshold",
                blobs.pixels_threshold.to_string(),
            ),
            ("Frame:find_blobs", "merge", blobs.merge.to_string()),
            ("Frame:find_blobs", "margin", blobs.margin.to_string()),
            ("Frame:find_blobs", "max_blobs", blobs.max_blobs.to_string()),
            ("vision.tracker", "min_age", tracks.min_age.to_string()),
            ("vision.tracker", "max_lost", tracks.max_lost.to_string()),
            ("vision.tracker", "max_jump", tracks.max_jump.to_string()),
            ("vision.motion", "threshold", motion.threshold.to_string()),
            ("vision.motion", "min_pixels", motion.min_pixels.to_string()),
            ("robot.dock", "timeout", dock.timeout.as_secs().to_string()),
            ("robot.dock", "retries", dock.retries.to_string()),
            (
                "robot.dock",
                "charge_timeout",
                dock.charge_timeout.as_secs().to_string(),
            ),
        ] {
            assert_eq!(default(path, key), usual, "{path} {key}");
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

    /// The object or table that a type names.
    fn named(kind: &Type) -> Option<&'static str> {
        match kind {
            Type::Object(name) => Some(name),
            Type::List(of) | Type::OneOrMore(of) => named(of),
            _ => None,
        }
    }

    #[test]
    fn every_object_of_calls_and_events_is_listed() {
        let values = all_functions().flat_map(|one| one.parameters.iter().chain(one.returns));
        let fields = objects().flat_map(|object| object.fields);
        let named = values.chain(fields).filter_map(|value| named(&value.kind));
        let payloads = events().filter_map(|event| event.payload);
        let found: Vec<_> = named.chain(payloads).collect();
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
        // Luau has no `declare class` any more, and a declaration names the type of its `...`.
        assert!(text.contains("\ndeclare extern type Frame with\n"));
        assert!(!text.contains("declare class"));
        assert!(text.contains("\tfunction run(self, ...: any): ()\n"));
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
