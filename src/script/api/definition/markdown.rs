//! The API as the reference of `behaviours/README.md`.

use std::fmt::Write as _;

use super::terms::{Function, Need, Object, Type, Value};

/// What each namespace is for.
const SECTIONS: [(&str, &str); 8] = [
    (
        "robot",
        "the robot: motion, lights, sounds, docking, events, pictures",
    ),
    ("task", "time, and functions side by side"),
    (
        "vision",
        "colours, and what looks at one frame after the other",
    ),
    ("log", "what the script has to say"),
    ("script", "the script's own life"),
    ("params", "what a person may set from outside"),
    ("store", "what is kept from run to run"),
    ("", ""),
];

/// The text between the two markers.
pub fn markdown() -> String {
    let mut text = String::new();
    let mut owners: Vec<(&str, &str)> = SECTIONS.to_vec();
    for function in super::functions().filter(|one| !one.is_method()) {
        if owners.iter().all(|(name, _)| *name != function.owner()) {
            owners.push((function.owner(), ""));
        }
    }
    for (name, about) in owners {
        let functions = super::functions().filter(|one| one.owner() == name && !one.is_method());
        let _ = match (name, about) {
            ("", _) => writeln!(text, "### Functions without a namespace\n"),
            (_, "") => writeln!(text, "### {name}\n"),
            _ => writeln!(text, "### {name}: {about}\n"),
        };
        constants(&mut text, name);
        functions.for_each(|one| function(&mut text, one));
    }
    events(&mut text);
    text += "### Objects and tables\n\n";
    super::objects().for_each(|one| object(&mut text, one));
    names(&mut text);
    text.trim_end().to_owned() + "\n"
}

fn constants(text: &mut String, owner: &str) {
    for constant in super::constants() {
        if constant.path.starts_with(owner) && !owner.is_empty() {
            let _ = writeln!(text, "#### `{}`\n\n{}\n", constant.path, constant.doc);
            example(text, constant.example);
        }
    }
}

fn function(text: &mut String, function: &Function) {
    let waits = if function.waits { " It may wait." } else { "" };
    let _ = writeln!(
        text,
        "#### `{}`\n\n{}{waits}\n",
        function.call(),
        function.doc
    );
    values(text, function.parameters);
    if let Some(rest) = function.rest {
        let _ = writeln!(text, "- `...`: {rest}");
    }
    if !function.returns.is_empty() {
        let returns: Vec<_> = function.returns.iter().map(result).collect();
        let _ = writeln!(text, "- returns {}", returns.join("; "));
    }
    if !(function.parameters.is_empty() && function.returns.is_empty() && function.rest.is_none()) {
        text.push('\n');
    }
    example(text, function.example);
}

fn result(value: &Value) -> String {
    let unit = if value.unit.is_empty() {
        String::new()
    } else {
        format!(", in {}", value.unit)
    };
    match value.doc {
        "" => format!("`{}`: {}{unit}", value.name, value.kind.words()),
        doc => format!("`{}`: {}{unit} ({doc})", value.name, value.kind.words()),
    }
}

fn values(text: &mut String, values: &[Value]) {
    for value in values {
        if let Type::Options(keys) | Type::Named(keys) = value.kind {
            let _ = match value.kind {
                Type::Options(_) => writeln!(text, "- options, a table:"),
                _ => writeln!(
                    text,
                    "- `{}`, {}: a table for each, with",
                    value.name, value.doc
                ),
            };
            for key in keys {
                let optional = if key.need == Need::Required {
                    " (needed)"
                } else {
                    ""
                };
                let _ = writeln!(text, "  - `{}`{optional}: {}", key.name, key.words());
            }
            continue;
        }
        let optional = if value.need == Need::Required {
            ""
        } else {
            " (may be left out)"
        };
        let _ = writeln!(text, "- `{}`{optional}: {}", value.name, value.words());
    }
}

fn example(text: &mut String, example: &str) {
    let _ = writeln!(text, "```lua\n{example}\n```\n");
}

fn events(text: &mut String) {
    text.push_str("### Events\n\n| event | when | handlers get |\n| --- | --- | --- |\n");
    for event in super::events() {
        let payload = event
            .payload
            .map_or_else(|| "an empty table".to_owned(), |name| format!("a {name}"));
        let _ = writeln!(text, "| `{}` | {} | {payload} |", event.name, event.doc);
    }
    text.push('\n');
}

fn object(text: &mut String, object: &Object) {
    let _ = writeln!(text, "#### {}\n\n{}\n", object.name, object.doc);
    for field in object.fields {
        let may = if field.need == Need::Required {
            ""
        } else {
            " (may be nil)"
        };
        let _ = writeln!(text, "- `.{}`{may}: {}", field.name, field.words());
    }
    if !object.fields.is_empty() {
        text.push('\n');
    }
    object.methods().for_each(|method| function(text, method));
}

fn names(text: &mut String) {
    text.push_str("### Names\n\n| kind | names |\n| --- | --- |\n");
    for choice in super::choices() {
        let _ = writeln!(
            text,
            "| {} | {} |",
            choice.name,
            (choice.names)().join(", ")
        );
    }
    text.push('\n');
}
