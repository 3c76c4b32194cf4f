//! The single definition of the script API: names, arguments, units, bounds, defaults, results, and
//! for each entry a short description and an example.
//!
//! The runtime registers its native functions under these rows and reads their arguments according
//! to them. `spykee check`, `spykee api`, completion, the definitions for editors and the reference
//! of the guide use the same rows. A VM does not start if a native has no row, or a row has no
//! native.

mod bounds;
mod choices;
mod clock;
mod elsewhere;
mod events;
mod frame;
mod log;
mod luau;
mod make;
mod markdown;
mod messages;
mod model;
mod modules;
mod page;
mod robot;
mod scenario;
mod script;
mod storage;
mod tables;
mod task;
#[cfg(test)]
mod tests;
mod text;
mod vision;

pub use bounds::Bounds;
pub use elsewhere::{SCENARIO, elsewhere};
pub use events::EventName;
pub use frame::PIXELS;
pub use luau::{luau, module_stub};
pub use markdown::markdown;
pub use model::{
    Availability, Choice, Constant, Event, Function, Literal, Namespace, Object, Requirement, Type,
    Value,
};
pub use page::{known, list, page, titles};
pub use robot::LONGEST_DRIVE;

/// The namespaces that are available without `require`. Those with an empty name hold the functions
/// without a namespace.
pub fn namespaces() -> impl Iterator<Item = &'static Namespace> {
    const ALL: [&Namespace; 12] = [
        &robot::ROBOT,
        &task::TASKS,
        &vision::VISION,
        &log::LOG,
        &clock::CLOCK,
        &script::SCRIPT,
        &storage::PARAMS,
        &storage::STORE,
        &messages::JOURNAL,
        &messages::NOTIFY,
        &storage::GLOBALS,
        &scenario::SCENARIO,
    ];
    ALL.into_iter()
}

/// The documented modules of `@spykee/...`.
pub fn modules() -> impl Iterator<Item = &'static Namespace> {
    modules::MODULES.into_iter()
}

/// Every kind of table and object that calls take or return and that events carry.
pub fn objects() -> impl Iterator<Item = &'static Object> {
    const ALL: [&Object; 28] = [
        &frame::FRAME,
        &frame::BLOB,
        &frame::TRACK,
        &vision::TRACKER,
        &vision::DETECTOR,
        &vision::COLOUR,
        &vision::LEARNED,
        &task::TASK,
        &robot::SUBSCRIPTION,
        &tables::BATTERY,
        &tables::POSE_ESTIMATE,
        &tables::INFO,
        &tables::DOCK_INFO,
        &tables::USAGE,
        &clock::DATE,
        &frame::LINE,
        &frame::QR_CODE,
        &frame::CORNER,
        &frame::MOTION,
        &tables::AUDIO,
        &tables::NOISE,
        &tables::CONNECTED,
        &tables::DISCONNECTED,
        &tables::CHARGING,
        &tables::SAFETY,
        &tables::DRIVE_GRANT,
        &tables::ENGINE,
        &scenario::SIM,
    ];
    let more = scenario::TABLES.into_iter().chain(modules::OBJECTS);
    ALL.into_iter().chain(more)
}

/// Every event.
pub fn events() -> impl Iterator<Item = &'static Event> {
    events::EVENTS.iter()
}

/// Every set of names that arguments and results are taken from.
pub fn choices() -> impl Iterator<Item = &'static Choice> {
    use choices::{
        COLOUR_NAME, DOCK_CODE, LIGHT, MOTION_CODE, QUEUE, SAFETY_ACTION, SOUND, STREAM,
        TASK_STATUS,
    };
    const ALL: [&Choice; 10] = [
        LIGHT,
        SOUND,
        STREAM,
        events::EVENT,
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

/// Every method of an object.
pub fn methods() -> impl Iterator<Item = &'static Function> {
    objects().flat_map(|object| object.methods)
}

/// Every field of a namespace that is not a function.
pub fn constants() -> impl Iterator<Item = &'static Constant> {
    namespaces().flat_map(|namespace| namespace.constants)
}

/// The function, method or module function with this path, such as `robot.move`, `Frame:save`
/// or `bt.sequence`.
pub fn function(path: &str) -> Option<&'static Function> {
    let of_modules = modules().flat_map(|module| module.functions);
    let mut all = functions().chain(methods()).chain(of_modules);
    all.find(|function| function.path == path)
}

/// The namespace of this name.
pub fn namespace(name: &str) -> Option<&'static Namespace> {
    namespaces().find(|namespace| namespace.name == name)
}

/// The module of this name, without its `@spykee/`.
pub fn module(name: &str) -> Option<&'static Namespace> {
    modules().find(|module| module.name == name)
}

/// The object of this name.
pub fn object(name: &str) -> Option<&'static Object> {
    objects().find(|object| object.name == name)
}

/// The event of this name.
pub fn event(name: &str) -> Option<&'static Event> {
    events().find(|event| event.name == name)
}

/// The names that completion offers, each with its path (`robot.move`, `Frame:save`, `Blob.cx`),
/// its signature in Luau's notation, and its description.
pub fn names() -> impl Iterator<Item = (String, String, &'static str)> {
    let of_modules = modules().flat_map(|module| module.functions);
    let functions = functions().chain(methods()).chain(of_modules);
    let functions = functions.map(|one| (one.path.to_owned(), one.signature(), one.doc));
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
