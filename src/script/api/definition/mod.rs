//! What scripts can call and read, said once: names, arguments, units, ranges, results, one sentence
//! and an example each.
//!
//! From here come the fields that objects are strict about, what `spykee check` knows, completion,
//! the editor definitions and the reference page. A test walks a live VM and compares, so a call
//! that is added, renamed or removed without its definition fails loudly.

mod event;
mod keeping;
mod log;
mod luau;
mod markdown;
mod object;
mod robot;
mod script;
mod task;
mod terms;
mod text;
mod vision;

pub use super::super::arguments::Bounds;
pub use luau::luau;
pub use markdown::markdown;
pub use terms::{Choice, Constant, Event, Function, Need, Object, Type, Value};
pub use text::full;

/// Every function and method, by namespace.
pub fn functions() -> impl Iterator<Item = &'static Function> {
    let parts: [&'static [Function]; 7] = [
        script::FUNCTIONS,
        log::FUNCTIONS,
        robot::FUNCTIONS,
        task::FUNCTIONS,
        vision::FUNCTIONS,
        keeping::FUNCTIONS,
        object::METHODS,
    ];
    parts.into_iter().flatten()
}

/// Every field of a namespace that is no function.
pub fn constants() -> impl Iterator<Item = &'static Constant> {
    script::CONSTANTS.iter()
}

/// Every kind of table and object that calls give and take.
pub fn objects() -> impl Iterator<Item = &'static Object> {
    object::OBJECTS.iter()
}

/// Every event, in the order of `API.md`.
pub fn events() -> impl Iterator<Item = &'static Event> {
    event::EVENTS.iter()
}

/// Every set of names that arguments and results are taken from.
pub fn choices() -> impl Iterator<Item = &'static Choice> {
    terms::CHOICES.iter().copied()
}

/// The function or method of this path, such as `robot.move` or `Frame:save`.
pub fn function(path: &str) -> Option<&'static Function> {
    functions().find(|function| function.path == path)
}

/// The object of this name.
pub fn object(name: &str) -> Option<&'static Object> {
    objects().find(|object| object.name == name)
}

/// The event of this name.
pub fn event(name: &str) -> Option<&'static Event> {
    events().find(|event| event.name == name)
}

/// The names of an object's fields and methods.
pub fn members(object: &Object) -> Vec<&'static str> {
    let fields = object.fields.iter().map(|field| field.name);
    let methods = object.methods().map(Function::key);
    fields.chain(methods).collect()
}

/// What can be written, for completion: the path (`robot.move`, `Frame:save`, `Blob.cx`), its
/// signature in Luau's notation, and one sentence.
pub fn names() -> impl Iterator<Item = (String, String, &'static str)> {
    let functions = functions().map(|one| (one.path.to_owned(), one.signature(), one.doc));
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
