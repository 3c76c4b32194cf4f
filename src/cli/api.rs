//! `spykee api`: the reference of the script API, for people, editors and programs.

use serde_json::{Value as Json, json};

use super::{Exit, Failure, print};
use crate::api::{self, Function, Namespace, Requirement, Type, Value};
use crate::script::suggestion;

/// Show the script API: a list, or one entry in full
#[derive(Debug, Clone, clap::Args)]
pub(super) struct ApiArgs {
    /// Function, namespace, module, object, field or event, such as robot.move, vision, bt, frame
    /// or Blob.cx; or one of the lists: events, objects, modules
    #[arg(value_name = "NAME")]
    name: Option<String>,

    /// Print a definition file for luau-lsp, for completion in editors
    #[arg(long, conflicts_with_all = ["name", "markdown", "json"])]
    luau: bool,

    /// Print the reference as Markdown, as in behaviours/README.md
    #[arg(long, conflicts_with_all = ["name", "json"])]
    markdown: bool,

    /// Print the whole API as a JSON object
    #[arg(long, conflicts_with = "name")]
    json: bool,
}

pub(super) fn run(args: &ApiArgs) -> Result<Exit, Failure> {
    let text = match &args.name {
        Some(name) => one(name)?,
        None if args.luau => api::luau(),
        None if args.markdown => api::markdown(),
        None if args.json => format!("{:#}\n", json()),
        None => api::list(),
    };
    print(&text)?;
    Ok(Exit::Done)
}

fn one(name: &str) -> Result<String, Failure> {
    api::page(name).ok_or_else(|| {
        let known = api::known();
        let near = suggestion(name, known.iter().map(String::as_str));
        let failure = Failure::usage(format_args!("nothing in the API is called '{name}'{near}"));
        failure.help("spykee api lists everything")
    })
}

fn json() -> Json {
    let functions = api::functions().chain(api::methods());
    let functions: Vec<_> = functions.map(function_json).collect();
    let modules: Vec<_> = api::modules().map(module_json).collect();
    let constants: Vec<_> = api::constants()
        .map(|one| json!({ "path": one.path, "type": one.kind.luau(), "doc": one.doc, "example": one.example }))
        .collect();
    let objects: Vec<_> = api::objects()
        .map(|one| {
            json!({
                "name": one.name, "doc": one.doc, "fields": values_json(one.fields),
                "methods": one.methods.iter().map(|method| method.path).collect::<Vec<_>>(),
            })
        })
        .collect();
    let events: Vec<_> = api::events()
        .map(|one| json!({ "name": one.name, "payload": one.payload, "doc": one.doc }))
        .collect();
    let choices: serde_json::Map<_, _> = api::choices()
        .map(|one| (one.name.to_owned(), json!((one.names)())))
        .collect();
    json!({
        "functions": functions, "constants": constants, "objects": objects, "events": events,
        "modules": modules, "names": choices,
    })
}

fn module_json(module: &Namespace) -> Json {
    json!({
        "path": format!("@spykee/{}", module.name),
        "doc": module.about,
        "functions": module.functions.iter().map(function_json).collect::<Vec<_>>(),
        "example": module.example,
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
        "accepts": value.kind.describe(),
        "optional": value.requirement != Requirement::Required,
    });
    let more = [("unit", value.unit), ("doc", value.doc)];
    for (key, text) in more.into_iter().filter(|(_, text)| !text.is_empty()) {
        json[key] = json!(text);
    }
    if let Requirement::Default(usual) = value.requirement {
        json["default"] = json!(usual.to_string());
    }
    if let Type::Options(keys) | Type::Named(keys) = value.kind {
        json["keys"] = json!(values_json(keys));
    }
    json
}
