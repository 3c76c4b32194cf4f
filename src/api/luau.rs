//! The API as definitions of luau-lsp: completion and types in editors.

use std::fmt::Write as _;

use super::terms::{Constant, Function, Namespace, Object, Type, Value};

/// The text of `spykee.d.luau`.
pub fn luau() -> String {
    let mut text = String::from(
        "-- What scripts of spykee can call. Written by `spykee api --luau`; do not edit.\n",
    );
    types(&mut text);
    for namespace in super::namespaces() {
        if namespace.name.is_empty() {
            functions(&mut text, namespace);
        } else {
            declare(&mut text, namespace);
        }
    }
    text + "\ndeclare sim: Sim\n"
}

/// The file that stands for `@spykee/NAME` in editors: its types, without what it does.
pub fn module_stub(module: &Namespace) -> String {
    let name = module.name;
    let mut text = format!(
        "-- For editors; written by `spykee new`. The runtime has its own.\n-- {}\nlocal {name} = {{}}\n",
        module.about
    );
    for function in module.functions {
        let mut parameters: Vec<_> = function.parameters.iter().map(Value::named).collect();
        parameters.extend(function.rest.map(|_| "...: any".to_owned()));
        let _ = writeln!(
            text,
            "\n--- {}\nfunction {}({}): {}\n\treturn nil :: any\nend",
            function.doc,
            function.path,
            parameters.join(", "),
            function.returns_luau()
        );
    }
    let _ = writeln!(text, "\nreturn {name}");
    text
}

/// The types: choices of names, plain tables, and objects with methods.
fn types(text: &mut String) {
    for choice in super::choices() {
        let quoted = |name: &&str| format!("\"{name}\"");
        let names: Vec<_> = (choice.names)().iter().map(quoted).collect();
        let _ = writeln!(text, "export type {} = {}", choice.name, names.join(" | "));
    }
    *text += "export type Roi = { number } | { x: number, y: number, w: number, h: number }\n";
    let is_record = |object: &&Object| !object.strict && object.methods.is_empty();
    for object in super::objects().filter(is_record) {
        record(text, object);
    }
    for object in super::objects().filter(|object| !is_record(object)) {
        class(text, object);
    }
    *text += "export type Colours = string | Colour | { string | Colour }\n";
}

fn record(text: &mut String, object: &Object) {
    let Object { doc, name, .. } = object;
    let _ = writeln!(text, "\n--- {doc}\nexport type {name} = {{");
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
    for method in object.methods {
        let parameters = method.parameters_luau();
        let comma = if parameters.is_empty() { "" } else { ", " };
        let _ = writeln!(
            text,
            "\t--- {}\n\tfunction {}(self{comma}{parameters}): {}",
            method.doc,
            method.key(),
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

fn functions(text: &mut String, namespace: &Namespace) {
    // The checker knows `print`, and `require` by the files that it finds.
    let builtin = |one: &&Function| one.path == "print" || one.path == "require";
    for function in namespace.functions.iter().filter(|one| !builtin(one)) {
        let _ = writeln!(text, "\n--- {}", function.doc);
        let forms = function.forms();
        if let [_, short] = forms.as_slice() {
            let long = function.luau_type(" -> ");
            let short: Vec<_> = short.iter().map(|one| one.named()).collect();
            let returns = function.returns_luau();
            let short = format!("({}) -> {returns}", short.join(", "));
            let _ = writeln!(text, "declare {}: ({long}) & ({short})", function.path);
            continue;
        }
        let _ = writeln!(text, "declare function {}", function.signature());
    }
}

fn declare(text: &mut String, namespace: &Namespace) {
    let _ = writeln!(text, "\ndeclare {}: {{", namespace.name);
    for Constant {
        path, kind, doc, ..
    } in namespace.constants
    {
        let key = path.rsplit('.').next().unwrap_or(path);
        let _ = writeln!(text, "\t--- {doc}\n\t{key}: {},", kind.luau());
    }
    for function in namespace.functions {
        let _ = writeln!(text, "\t--- {}", function.doc);
        let _ = writeln!(text, "\t{}: {},", function.key(), field_type(function));
    }
    *text += "}\n";
}

/// A function's type; one that takes an event is overloaded, a case for each payload.
fn field_type(function: &Function) -> String {
    if !function.takes_an_event() {
        return function.luau_type(" -> ");
    }
    let gives_it = |value: &Value| matches!(value.kind, Type::Payload);
    let gives_it = function.returns.iter().any(gives_it);
    let cases: Vec<_> = super::events()
        .map(|event| {
            let payload = event.payload.map_or("{}", |object| object.name);
            let one = function.luau_type(" -> ");
            let one = one.replacen("EventName", &format!("\"{}\"", event.name), 1);
            let one = one.replace("payload: any", &format!("payload: {payload}"));
            if gives_it {
                one.replacen("(any,", &format!("({payload}?,"), 1)
            } else {
                one
            }
        })
        .map(|case| format!("({case})"))
        .collect();
    cases.join("\n\t\t& ")
}
