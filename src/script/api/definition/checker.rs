//! The API as Luau's type checker reads it. Looser than what editors get where the checker would
//! complain about scripts that are right, and without overloads: a case for each event is more than
//! it can take, so that each event has a function of its own here.

use std::fmt::Write as _;

use super::luau::{STAGE, namespaces, types};
use super::terms::{Event, Function, Need, Type, Value};

/// What stands for `require(...)` of whatever: a call that gives anything.
pub const MODULE_CALL: &str = "_module()";

/// The declarations of all that scripts can call.
pub fn checker() -> String {
    let mut text = String::new();
    types(&mut text, parameters);
    text +=
        "export type Colours = string | Colour | { string | Colour } | { string } | { Colour }\n";
    for name in namespaces() {
        namespace(&mut text, name);
    }
    text += "declare function _module(): any\ndeclare function require(path: string): any\n";
    for function in super::functions().filter(|one| takes_an_event(one)) {
        for event in super::events() {
            text += &event_call(function, event);
        }
    }
    text + STAGE
}

/// What a call such as `robot.on` is called for one event.
pub fn event_name(function: &Function, event: &str) -> Option<String> {
    if !takes_an_event(function) {
        return None;
    }
    let number = super::events().position(|one| one.name == event)?;
    Some(format!("_{}_{number}", function.key()))
}

/// The call that [`event_name`] has named so.
pub fn event_path(name: &str) -> Option<&'static str> {
    let (key, number) = name.strip_prefix('_')?.rsplit_once('_')?;
    number.parse::<usize>().ok()?;
    let mut found = super::functions().filter(|one| takes_an_event(one));
    found.find(|one| one.key() == key).map(|one| one.path)
}

/// Whether its first argument names an event, on which its handler or what it returns depends.
pub fn takes_an_event(function: &Function) -> bool {
    let mut values = function.parameters.iter().chain(function.returns);
    values.any(|value| matches!(value.kind, Type::Handler | Type::Payload))
}

fn event_call(function: &Function, event: &Event) -> String {
    let payload = event.payload.unwrap_or("{}");
    let name = event_name(function, event.name).unwrap_or_default();
    let parameters = parameters(function).replace("payload: any", &format!("payload: {payload}"));
    let returns = match function.returns.iter().any(is_payload) {
        true => (function.returns_luau()).replacen("any", &format!("{payload}?"), 1),
        false => function.returns_luau(),
    };
    format!("declare function {name}({parameters}): {returns}\n")
}

fn is_payload(value: &Value) -> bool {
    matches!(value.kind, Type::Payload)
}

fn namespace(text: &mut String, name: &str) {
    let _ = writeln!(text, "declare {name}: {{");
    let prefix = format!("{name}.");
    for constant in super::constants() {
        if let Some(key) = constant.path.strip_prefix(&prefix) {
            let _ = writeln!(text, "\t{key}: {},", constant.kind.luau());
        }
    }
    for function in super::functions().filter(|one| one.owner() == name && !one.is_method()) {
        let (parameters, returns) = (parameters(function), function.returns_luau());
        let (key, checked) = (function.key(), checked(function));
        let _ = writeln!(text, "\t{key}: {checked}({parameters}) -> {returns},");
    }
    *text += "}\n";
}

/// Its arguments are judged in scripts that are not strict, too. The checker can only do that for
/// what a script could ask `type` about.
fn checked(function: &Function) -> &'static str {
    let plain = |one: &Value| {
        use Type as T;
        let kind = one.kind;
        matches!(
            kind,
            T::Any | T::Boolean | T::Number(_) | T::Whole(_) | T::Text | T::Choice(_)
        )
    };
    match function.parameters.iter().all(plain) && function.rest.is_none() {
        true => "@checked ",
        false => "",
    }
}

fn parameters(function: &Function) -> String {
    let named = |one: &Value| format!("{}: {}", one.name, value(one));
    let mut parameters: Vec<_> = function.parameters.iter().map(named).collect();
    if function.rest.is_some() {
        parameters.push("...any".to_owned());
    }
    parameters.join(", ")
}

fn value(value: &Value) -> String {
    match (value.need, &value.kind) {
        (_, Type::Any) => "any".to_owned(),
        (Need::Required, kind) => parameter(kind),
        (_, kind @ (Type::Colour | Type::Function(_))) => format!("({})?", parameter(kind)),
        (_, kind) => format!("{}?", parameter(kind)),
    }
}

/// A name may come from a table or a calculation; whether it is right the run tells, and of one
/// that is written out our own check. Options are only read, so that one key alone will do.
fn parameter(kind: &Type) -> String {
    match kind {
        Type::Choice(_) => "string".to_owned(),
        Type::Named(_) => "{ [string]: any }".to_owned(),
        Type::Options(keys) => {
            let key = |key: &Value| format!("read {}: {}", key.name, value(key));
            let keys: Vec<_> = keys.iter().map(key).collect();
            format!("{{ {} }}", keys.join(", "))
        }
        kind => kind.luau(),
    }
}
