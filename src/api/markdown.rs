//! The API as Markdown, for the reference in `behaviours/README.md`.

use std::fmt::Write as _;

use super::model::{Function, Namespace, Object, Type, Value, with_article};

/// Returns the text between the two markers in that file.
pub fn markdown() -> String {
    let mut text = String::new();
    for namespace in super::namespaces() {
        let Namespace { name, about, .. } = namespace;
        let _ = if name.is_empty() {
            writeln!(text, "### {}\n", capital(about))
        } else {
            writeln!(text, "### {name}: {about}\n")
        };
        constants(&mut text, namespace);
        each_function(&mut text, namespace.functions);
    }
    text += "### Modules\n\n";
    super::modules().for_each(|one| module(&mut text, one));
    events(&mut text);
    text += "### Objects and tables\n\n";
    super::objects().for_each(|one| object(&mut text, one));
    names(&mut text);
    text.trim_end().to_owned() + "\n"
}

fn capital(text: &str) -> String {
    let mut letters = text.chars();
    let first = letters.next().map(|letter| letter.to_ascii_uppercase());
    first.into_iter().chain(letters).collect()
}

fn module(text: &mut String, module: &Namespace) {
    let Namespace { name, about, .. } = module;
    let about = capital(about);
    let _ = writeln!(text, "#### `require(\"@spykee/{name}\")`\n\n{about}.\n");
    example(text, module.example);
    each_function(text, module.functions);
}

fn each_function(text: &mut String, functions: &[Function]) {
    functions.iter().for_each(|one| function(text, one));
}

fn constants(text: &mut String, namespace: &Namespace) {
    for constant in namespace.constants {
        let _ = writeln!(text, "#### `{}`\n\n{}\n", constant.path, constant.doc);
        example(text, constant.example);
    }
}

fn function(text: &mut String, function: &Function) {
    let waits = if function.waits { " May wait." } else { "" };
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
        "" => format!("`{}`: {}{unit}", value.name, value.kind.describe()),
        doc => format!("`{}`: {}{unit} ({doc})", value.name, value.kind.describe()),
    }
}

fn values(text: &mut String, values: &[Value]) {
    for value in values {
        if let Type::Options(keys) | Type::Named(keys) = value.kind {
            let Value { name, doc, .. } = value;
            let _ = match value.kind {
                Type::Options(_) => writeln!(text, "- options, a table:"),
                _ => writeln!(text, "- `{name}`, {doc}: a table for each, with"),
            };
            for key in keys {
                let optional = if key.is_required() { " (required)" } else { "" };
                let _ = writeln!(text, "  - `{}`{optional}: {}", key.name, key.describe());
            }
            continue;
        }
        let optional = if value.is_required() {
            ""
        } else {
            " (optional)"
        };
        let _ = writeln!(text, "- `{}`{optional}: {}", value.name, value.describe());
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
            .map_or_else(|| "an empty table".to_owned(), with_article);
        let _ = writeln!(text, "| `{}` | {} | {payload} |", event.name, event.doc);
    }
    text.push('\n');
}

fn object(text: &mut String, object: &Object) {
    let _ = writeln!(text, "#### {}\n\n{}\n", object.name, object.doc);
    for field in object.fields {
        let may = if field.is_required() {
            ""
        } else {
            " (may be nil)"
        };
        let _ = writeln!(text, "- `.{}`{may}: {}", field.name, field.describe());
    }
    if !object.fields.is_empty() {
        text.push('\n');
    }
    each_function(text, object.methods);
}

fn names(text: &mut String) {
    text.push_str("### Names\n\n| kind | names |\n| --- | --- |\n");
    for choice in super::choices() {
        let names = (choice.names)().join(", ");
        let _ = writeln!(text, "| {} | {names} |", choice.name);
    }
    text.push('\n');
}
