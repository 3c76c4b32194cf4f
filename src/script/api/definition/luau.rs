//! The API as a definition file of luau-lsp: completion and types in editors.

use std::fmt::Write as _;

use super::terms::{Function, Object, Type, Value};

/// What scripts of scenarios can call, for editors.
const STAGE: &str = include_str!("stage.d.luau");

/// The text of `spykee.d.luau`.
pub fn luau() -> String {
    let mut text = String::from(
        "-- What scripts of spykee can call. Written by `spykee api --luau`; do not edit.\n",
    );
    types(&mut text);
    text += "export type Colours = string | Colour | { string | Colour }\n";
    for name in namespaces() {
        namespace(&mut text, name);
    }
    for function in super::functions().filter(|one| one.owner().is_empty() && one.path != "print") {
        let _ = writeln!(text, "\n--- {}", function.doc);
        let luau = function.luau_type(": ");
        let _ = writeln!(text, "declare function {}{luau}", function.path);
    }
    text + STAGE
}

/// The types: choices of names, plain tables, and objects with methods.
fn types(text: &mut String) {
    for choice in super::choices() {
        let names: Vec<_> = (choice.names)()
            .iter()
            .map(|name| format!("\"{name}\""))
            .collect();
        let _ = writeln!(text, "export type {} = {}", choice.name, names.join(" | "));
    }
    *text += "export type Roi = { number } | { x: number, y: number, w: number, h: number }\n";
    for object in super::objects().filter(|object| !object.strict) {
        record(text, object);
    }
    for object in super::objects().filter(|object| object.strict) {
        class(text, object);
    }
}

/// The namespaces, in the order of their first call.
fn namespaces() -> Vec<&'static str> {
    let mut names = Vec::new();
    let owners = super::functions()
        .filter(|function| !function.is_method())
        .map(Function::owner);
    for owner in owners {
        if !owner.is_empty() && !names.contains(&owner) {
            names.push(owner);
        }
    }
    names
}

fn record(text: &mut String, object: &Object) {
    let _ = writeln!(
        text,
        "\n--- {}\nexport type {} = {{",
        object.doc, object.name
    );
    for field in object.fields {
        let _ = writeln!(text, "\t{}: {},{}", field.name, field.luau(), remark(field));
    }
    *text += "}\n";
}

fn class(text: &mut String, object: &Object) {
    let _ = writeln!(text, "\n--- {}\ndeclare class {}", object.doc, object.name);
    for field in object.fields {
        let _ = writeln!(text, "\t{}: {}{}", field.name, field.luau(), remark(field));
    }
    for method in object.methods() {
        let comma = if method.parameters.is_empty() {
            ""
        } else {
            ", "
        };
        let _ = writeln!(
            text,
            "\t--- {}\n\tfunction {}(self{comma}{}): {}",
            method.doc,
            method.key(),
            method.parameters_luau(),
            method.returns_luau()
        );
    }
    *text += "end\n";
}

fn remark(value: &Value) -> String {
    match (value.doc, value.unit) {
        ("", "") => String::new(),
        (doc, "") => format!(" -- {doc}"),
        ("", unit) => format!(" -- {unit}"),
        (doc, unit) => format!(" -- {doc}, in {unit}"),
    }
}

fn namespace(text: &mut String, name: &str) {
    let _ = writeln!(text, "\ndeclare {name}: {{");
    for constant in super::constants() {
        if let Some(key) = constant
            .path
            .strip_prefix(name)
            .and_then(|rest| rest.strip_prefix('.'))
        {
            let _ = writeln!(
                text,
                "\t--- {}\n\t{key}: {},",
                constant.doc,
                constant.kind.luau()
            );
        }
    }
    for function in super::functions().filter(|one| one.owner() == name && !one.is_method()) {
        let _ = writeln!(text, "\t--- {}", function.doc);
        let _ = writeln!(text, "\t{}: {},", function.key(), field_type(function));
    }
    *text += "}\n";
}

/// A function's type; one that takes an event is overloaded, a case for each payload.
fn field_type(function: &Function) -> String {
    let by_event = |value: &Value| matches!(value.kind, Type::Handler | Type::Payload);
    let mut values = function.parameters.iter().chain(function.returns);
    if !values.any(by_event) {
        return function.luau_type(" -> ");
    }
    let cases: Vec<_> = super::events()
        .map(|event| {
            let payload = event.payload.unwrap_or("{}");
            let one = function.luau_type(" -> ");
            let one = one.replacen("EventName", &format!("\"{}\"", event.name), 1);
            let one = one.replace("payload: any", &format!("payload: {payload}"));
            match function.returns.iter().any(by_event) {
                true => one.replacen("(any,", &format!("({payload}?,"), 1),
                false => one,
            }
        })
        .map(|case| format!("({case})"))
        .collect();
    cases.join("\n\t\t& ")
}
