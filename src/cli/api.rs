//! `spykee api`: what scripts can call, for people, editors and programs.

use serde_json::{Value as Json, json};

use super::{Exit, Failure, print};
use crate::script::definition::{self, Function, Need, Type, Value};
use crate::script::suggestion;

/// Show what scripts can call: a list, or one entry in full
#[derive(Debug, Clone, clap::Args)]
pub(super) struct ApiArgs {
    /// A function, event, object or field, such as robot.move, frame, Blob or Blob.cx; or a
    /// namespace, such as vision
    #[arg(value_name = "NAME")]
    name: Option<String>,

    /// Print the definition file of luau-lsp, for completion in editors
    #[arg(long, conflicts_with_all = ["name", "markdown", "json"])]
    luau: bool,

    /// Print the reference as it stands in behaviours/README.md
    #[arg(long, conflicts_with_all = ["name", "json"])]
    markdown: bool,

    /// Print all of it as JSON
    #[arg(long, conflicts_with = "name")]
    json: bool,
}

pub(super) fn run(args: &ApiArgs) -> Result<Exit, Failure> {
    let text = match &args.name {
        Some(name) => one(name)?,
        None if args.luau => definition::luau(),
        None if args.markdown => definition::markdown(),
        None if args.json => format!("{:#}\n", json()),
        None => list(|_| true),
    };
    print(&text)?;
    Ok(Exit::Done)
}

fn one(name: &str) -> Result<String, Failure> {
    if let Some(text) = definition::full(name) {
        return Ok(text);
    }
    let inside = list(|function| function.owner() == name);
    if !inside.is_empty() {
        return Ok(inside);
    }
    let mut known: Vec<String> = definition::names().map(|(path, ..)| path).collect();
    let events = definition::events().map(|event| event.name);
    let objects = definition::objects().map(|object| object.name);
    let namespaces = definition::functions().map(Function::owner);
    known.extend(events.chain(objects).chain(namespaces).map(str::to_owned));
    let near = suggestion(name, known.iter().map(String::as_str));
    let failure = Failure::usage(format_args!("nothing in the API is called '{name}'{near}"));
    Err(failure.help("spykee api lists all of it"))
}

/// A line for each function, constant and event.
fn list(wanted: impl Fn(&Function) -> bool) -> String {
    let mut text = String::new();
    let mut owner = None;
    for function in definition::functions().filter(|function| wanted(function)) {
        if owner.is_some_and(|owner| owner != function.owner()) {
            text.push('\n');
        }
        owner = Some(function.owner());
        text += &line(&function.call(), function.doc);
    }
    let all = wanted(&EVERYTHING);
    if all {
        text.push('\n');
        for constant in definition::constants() {
            text += &line(constant.path, constant.doc);
        }
        text += "\nevents: robot.on(NAME, fn)\n";
        for event in definition::events() {
            text += &line(&format!("  {}", event.name), event.doc);
        }
        text += "\nspykee api NAME shows one in full, with an example\n";
    }
    text
}

/// Belongs to no namespace: only a list of all wants it.
const EVERYTHING: Function = Function {
    path: "\u{0}.",
    parameters: &[],
    rest: None,
    returns: &[],
    waits: false,
    doc: "",
    example: "",
};

fn line(call: &str, doc: &str) -> String {
    format!("{call:<46} {doc}\n")
}

fn json() -> Json {
    let functions: Vec<_> = definition::functions().map(function_json).collect();
    let constants: Vec<_> = definition::constants()
        .map(|one| json!({ "path": one.path, "type": one.kind.luau(), "doc": one.doc, "example": one.example }))
        .collect();
    let objects: Vec<_> = definition::objects()
        .map(|one| {
            json!({
                "name": one.name, "doc": one.doc, "fields": values_json(one.fields),
                "methods": one.methods().map(|method| method.path).collect::<Vec<_>>(),
            })
        })
        .collect();
    let events: Vec<_> = definition::events()
        .map(|one| json!({ "name": one.name, "payload": one.payload, "doc": one.doc }))
        .collect();
    let choices: serde_json::Map<_, _> = definition::choices()
        .map(|one| (one.name.to_owned(), json!((one.names)())))
        .collect();
    json!({
        "functions": functions, "constants": constants, "objects": objects, "events": events,
        "names": choices,
    })
}

fn function_json(function: &Function) -> Json {
    json!({
        "path": function.path,
        "signature": function.signature(),
        "parameters": values_json(function.parameters),
        "more": function.rest,
        "returns": values_json(function.returns),
        "waits": function.waits,
        "doc": function.doc,
        "example": function.example,
    })
}

fn values_json(values: &[Value]) -> Vec<Json> {
    values.iter().map(value_json).collect()
}

fn value_json(value: &Value) -> Json {
    let mut json = json!({
        "name": value.name,
        "type": value.kind.luau(),
        "accepts": value.kind.words(),
        "optional": value.need != Need::Required,
    });
    let more = [("unit", value.unit), ("doc", value.doc)];
    for (key, text) in more.into_iter().filter(|(_, text)| !text.is_empty()) {
        json[key] = json!(text);
    }
    if let Need::Default(usual) = value.need {
        json["default"] = json!(usual);
    }
    if let Type::Options(keys) | Type::Named(keys) = value.kind {
        json["keys"] = json!(values_json(keys));
    }
    json
}
