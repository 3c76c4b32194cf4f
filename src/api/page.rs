//! The API's entries, in full and as lists, for terminals.

use std::fmt::Write as _;

use super::model::{
    Availability, Constant, Event, Function, Namespace, Object, Type, Value, with_article,
};
use super::{all_functions, choices, constants, events, modules, namespaces, object, objects};

/// Returns every entry with this name: a function, namespace, module, object, field, event,
/// constant or set of names. `events`, `objects` and `modules` return lists. Letter case does not
/// matter.
pub fn page(name: &str) -> Option<String> {
    let same = |other: &str| !other.is_empty() && other.eq_ignore_ascii_case(name);
    let mut pages = Vec::new();
    let functions = all_functions().filter(|one| same(one.path));
    pages.extend(functions.map(of_function));
    pages.extend(constants().filter(|one| same(one.path)).map(of_constant));
    pages.extend(namespaces().filter(|one| same(one.name)).map(of_namespace));
    let module = |one: &&Namespace| same(one.name) || same(&format!("@spykee/{}", one.name));
    pages.extend(modules().filter(module).map(of_namespace));
    pages.extend(objects().filter(|one| same(one.name)).map(of_object));
    pages.extend(events().filter(|one| same(one.name)).map(of_event));
    pages.extend(fields(same));
    let choice = choices().filter(|one| same(one.name));
    pages.extend(choice.map(|one| format!("{}: one of {}\n", one.name, (one.names)().join(", "))));
    let lists = lists().into_iter().filter(|(title, _)| same(title));
    pages.extend(lists.map(|(_, text)| text));
    if pages.is_empty() {
        // Also find a function by its last part alone, such as `update`.
        let functions = all_functions().filter(|one| same(one.key()));
        pages.extend(functions.map(of_function));
    }
    (!pages.is_empty()).then(|| pages.join("\n"))
}

pub fn known() -> Vec<String> {
    let mut known: Vec<String> = titles().into_iter().map(str::to_owned).collect();
    let fields = objects().flat_map(|object| {
        let fields = object.fields.iter();
        fields.map(|field| format!("{}.{}", object.name, field.name))
    });
    known.extend(fields);
    known
}

/// Every name that [`page`] knows, without the fields of objects.
pub fn titles() -> Vec<&'static str> {
    let functions = all_functions().map(|one| one.path);
    let constants = constants().map(|one| one.path);
    let namespaces = namespaces().chain(modules()).map(|one| one.name);
    let objects = objects().map(|one| one.name);
    let events = events().map(|one| one.name);
    let lists = ["events", "objects", "modules"];
    let names = functions.chain(constants).chain(namespaces).chain(objects);
    let names = names.chain(events).chain(lists);
    let mut titles: Vec<_> = names.filter(|name| !name.is_empty()).collect();
    titles.sort_unstable();
    titles.dedup();
    titles
}

/// Returns a line for each function, constant, object, module and event.
pub fn list() -> String {
    let mut text = String::new();
    for namespace in namespaces() {
        text += &lines(namespace);
        text.push('\n');
    }
    for object in objects().filter(|object| !object.methods.is_empty()) {
        text.extend(object.methods.iter().map(|one| line(&one.call(), one.doc)));
        text.push('\n');
    }
    for (title, list) in lists() {
        let _ = writeln!(text, "{title}:\n{list}");
    }
    text + "spykee api NAME shows one in full, with an example\n"
}

fn lists() -> [(&'static str, String); 3] {
    let events = events()
        .map(|one| line(one.name, one.doc))
        .collect::<String>();
    let modules = modules().map(|one| line(&format!("@spykee/{}", one.name), one.about));
    let objects = objects().map(|one| line(one.name, one.doc)).collect();
    [
        ("objects", objects),
        ("modules", modules.collect()),
        (
            "events",
            format!("robot.on(NAME, fn), robot.wait_for(NAME)\n\n{events}"),
        ),
    ]
}

fn line(call: &str, doc: &str) -> String {
    format!("{call:<46} {doc}\n")
}

fn lines(namespace: &Namespace) -> String {
    let functions = namespace.functions.iter();
    let functions = functions.map(|one| line(&one.call(), one.doc));
    let constants = namespace.constants.iter();
    let constants = constants.map(|one| line(one.path, one.doc));
    functions.chain(constants).collect()
}

fn of_namespace(namespace: &Namespace) -> String {
    let Namespace { name, about, .. } = namespace;
    let title = if namespace.availability == Availability::Module {
        format!("require(\"@spykee/{name}\"): {about}\n\n")
    } else {
        format!("{name}: {about}\n\n")
    };
    let mut text = title + &lines(namespace);
    for object in made_by(namespace) {
        text.push('\n');
        text += &of_object(object);
    }
    if !namespace.example.is_empty() {
        example(&mut text, namespace.example);
    }
    text
}

/// The objects with methods that a module's functions return.
fn made_by(namespace: &Namespace) -> Vec<&'static Object> {
    if namespace.availability != Availability::Module {
        return Vec::new();
    }
    let returns = namespace.functions.iter().flat_map(|one| one.returns);
    let objects = returns.filter_map(|value| match value.kind {
        Type::Object(name) => object(name),
        _ => None,
    });
    objects.collect()
}

fn fields(same: impl Fn(&str) -> bool) -> Vec<String> {
    let mut found = Vec::new();
    for object in objects() {
        for field in object.fields {
            let path = format!("{}.{}", object.name, field.name);
            if same(&path) {
                found.push(format!(
                    "{path}: {}\n\n{}\n",
                    field.luau(),
                    field.describe()
                ));
            }
        }
    }
    found
}

fn of_function(function: &Function) -> String {
    let mut text = format!("{}\n\n{}\n", function.signature(), function.doc);
    if function.waits {
        text += "May wait: other tasks run in the meantime, and a task that is cancelled ends at this call.\n";
    }
    section(&mut text, "takes", function.parameters);
    if let Some(rest) = function.rest {
        if function.parameters.is_empty() {
            text += "\ntakes\n";
        }
        let _ = writeln!(text, "  ...  {rest}");
    }
    for parameter in function.parameters {
        if let Type::Options(keys) | Type::Named(keys) = parameter.kind {
            section(&mut text, "keys", keys);
        }
    }
    section(&mut text, "returns", function.returns);
    example(&mut text, function.example);
    text
}

fn of_constant(constant: &Constant) -> String {
    let kind = constant.kind.luau();
    let mut text = format!("{}: {kind}\n\n{}\n", constant.path, constant.doc);
    example(&mut text, constant.example);
    text
}

fn of_object(object: &Object) -> String {
    let mut text = format!("{}\n\n{}\n", object.name, object.doc);
    section(&mut text, "fields", object.fields);
    if !object.methods.is_empty() {
        text += "\nmethods\n";
    }
    for method in object.methods {
        let _ = writeln!(text, "  {}\n      {}", method.call(), method.doc);
    }
    text
}

fn of_event(event: &Event) -> String {
    let name = event.name;
    let payload = match event.payload {
        Some(name) => format!("Handlers get {}", with_article(name)),
        None => "Handlers get an empty table".to_owned(),
    };
    format!(
        "event {name}\n\n{} {payload}.\n\nexample\n  robot.on(\"{name}\", function(event)\n  \tprint(\"{name}\", event)\n  end)\n",
        event.doc,
    )
}

fn section(text: &mut String, title: &str, values: &[Value]) {
    if values.is_empty() {
        return;
    }
    let _ = writeln!(text, "\n{title}");
    let width = values.iter().map(|value| value.name.len()).max();
    let width = width.unwrap_or(0) + 1;
    for value in values {
        let optional = if value.is_required() { "" } else { "?" };
        let name = format!("{}{optional}", value.name);
        let _ = writeln!(text, "  {name:width$}  {}", value.describe());
    }
}

fn example(text: &mut String, example: &str) {
    *text += "\nexample\n";
    for line in example.lines() {
        let _ = writeln!(text, "  {line}");
    }
}
