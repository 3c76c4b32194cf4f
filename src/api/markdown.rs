//! The API as Markdown: the book's reference in `behaviours/guide/reference/`, a page for each
//! namespace, or for each group of its calls.

use std::fmt::Write as _;

use super::model::{Function, Namespace, Object, Type, Value, with_article};

#[derive(Debug)]
pub struct Page {
    /// Its file's name without the extension.
    pub name: String,
    pub text: String,
}

/// Objects with a page of their own. Others are on that of the events, the namespace or the object
/// that they belong to.
const OWN_PAGES: [&str; 2] = ["Frame", "Sim"];
const EVENTS: &str = "events";

/// Returns all pages in their order, the list of them first.
pub fn pages() -> Vec<Page> {
    let namespaces = super::namespaces().chain(super::modules());
    let mut pages: Vec<Page> = namespaces.flat_map(namespace).collect();
    pages.push(events());
    pages.extend(own_objects().flat_map(own_pages));
    pages.push(names());
    let mut list = "# Reference\n\nEvery call, event and table that scripts can use; \
                    `spykee api NAME` prints the same in a terminal.\n\n"
        .to_owned();
    for Page { name, text } in &pages {
        let title = text.lines().next().unwrap_or_default();
        let title = title.trim_start_matches("# ");
        let _ = writeln!(list, "- [{title}]({name}.md)");
    }
    pages.insert(0, page("README", list));
    pages
}

fn page(name: &str, text: String) -> Page {
    Page {
        name: name.to_owned(),
        text: text.trim_end().to_owned() + "\n",
    }
}

fn own_objects() -> impl Iterator<Item = &'static Object> {
    super::objects().filter(|object| OWN_PAGES.contains(&object.name))
}

fn page_name(namespace: &Namespace) -> &'static str {
    match namespace.name {
        "" if namespace
            .functions
            .iter()
            .any(|one| one.path == super::SCENARIO) =>
        {
            "scenario"
        }
        "" => "globals",
        name => name,
    }
}

/// The name of a group's page; without a group, of the namespace's or object's page.
fn group_name(owner: &str, group: &str) -> String {
    match group {
        "" => owner.to_owned(),
        group => format!("{owner}-{}", group.replace(' ', "-")),
    }
}

/// The page of an object: its own, that of the events if one carries it, that of the namespace of
/// the same name, or that of the first call which takes or returns it.
fn home(object: &Object) -> String {
    let own = |object: &Object| object.name.to_lowercase();
    if OWN_PAGES.contains(&object.name) {
        return own(object);
    }
    let mut payloads = super::events().filter_map(|event| event.payload);
    if payloads.any(|payload| payload == object.name) {
        return EVENTS.to_owned();
    }
    if super::namespace(&own(object)).is_some() {
        return own(object);
    }
    let mut namespaces = super::namespaces().chain(super::modules());
    let of_namespace = namespaces.find_map(|one| {
        let group = first_group(one.functions, object.name)?;
        Some(group_name(page_name(one), group))
    });
    if let Some(page) = of_namespace {
        return page;
    }
    let mut owners = super::objects().filter(|one| one.name != object.name);
    let of_owner = owners.find_map(|owner| {
        let group = first_group(owner.methods, object.name)?;
        Some(group_name(&home(owner), group))
    });
    of_owner.unwrap_or_else(|| own(object))
}

/// The group of the first of these functions that takes or returns an object.
fn first_group(functions: &[Function], object: &str) -> Option<&'static str> {
    let article = format!("a {object}");
    let first = functions.iter().find(|one| {
        let mut values = one.parameters.iter().chain(one.returns);
        values.any(|value| is_or_contains(&value.kind, object) || value.doc.starts_with(&article))
    });
    first.map(|one| one.group)
}

fn is_or_contains(kind: &Type, name: &str) -> bool {
    match kind {
        Type::Object(other) => {
            let fields = super::object(other).map_or(&[][..], |object| object.fields);
            *other == name || fields.iter().any(|field| is_or_contains(&field.kind, name))
        }
        Type::List(of) | Type::OneOrMore(of) => is_or_contains(of, name),
        _ => false,
    }
}

fn capital(text: &str) -> String {
    let mut letters = text.chars();
    let first = letters.next().map(|letter| letter.to_ascii_uppercase());
    first.into_iter().chain(letters).collect()
}

fn namespace(namespace: &'static Namespace) -> Vec<Page> {
    let Namespace { name, about, .. } = namespace;
    let name_of_page = page_name(namespace);
    let is_module = super::module(name).is_some();
    let mut text = match *name {
        "" => format!("# {}\n\n", capital(about)),
        name if is_module => format!("# `require(\"@spykee/{name}\")`\n\n{}.\n\n", capital(about)),
        name => format!("# {name}: {about}\n\n"),
    };
    if is_module {
        example(&mut text, namespace.example);
    }
    constants(&mut text, namespace);
    grouped(name_of_page, text, namespace.functions)
}

/// The page that begins with this text, with the functions without a group, and a page for each
/// group.
fn grouped(name: &str, mut text: String, functions: &[Function]) -> Vec<Page> {
    let mut pages = Vec::new();
    for calls in functions.chunk_by(|one, next| one.group == next.group) {
        let group = calls[0].group;
        if group.is_empty() {
            each_function(&mut text, calls);
            continue;
        }
        let name_of_page = group_name(name, group);
        let paths = calls.iter().map(|one| format!("`{}`", one.path));
        let paths = paths.collect::<Vec<_>>().join(", ");
        let _ = writeln!(text, "- [{group}]({name_of_page}.md): {paths}");
        let mut of_group = format!("# {name}: {group}\n\n");
        each_function(&mut of_group, calls);
        objects_of(&mut of_group, &name_of_page);
        pages.push(page(&name_of_page, of_group));
    }
    objects_of(&mut text, name);
    pages.insert(0, page(name, text));
    pages
}

/// The objects whose home is this page.
fn objects_of(text: &mut String, page: &str) {
    let objects = super::objects().filter(|one| !OWN_PAGES.contains(&one.name));
    objects.filter(|one| home(one) == page).for_each(|one| {
        description(text, one, "##");
        each_function(text, one.methods);
    });
}

fn own_pages(own: &'static Object) -> Vec<Page> {
    let mut text = String::new();
    description(&mut text, own, "#");
    grouped(&home(own), text, own.methods)
}

fn each_function(text: &mut String, functions: &[Function]) {
    functions.iter().for_each(|one| function(text, one));
}

fn constants(text: &mut String, namespace: &Namespace) {
    for constant in namespace.constants {
        let _ = writeln!(text, "## `{}`\n\n{}\n", constant.path, constant.doc);
        example(text, constant.example);
    }
}

fn function(text: &mut String, function: &Function) {
    let waits = if function.waits { " May wait." } else { "" };
    // The book's search knows whole words only, and the call is one.
    let name = function.path.rsplit([':', '.']).next().unwrap_or_default();
    let _ = writeln!(
        text,
        "## `{name}`\n\n`{}`\n\n{}{waits}\n",
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

fn events() -> Page {
    let mut text = "# Events\n\n| event | when | handlers get |\n| --- | --- | --- |\n".to_owned();
    for event in super::events() {
        let payload = event
            .payload
            .map_or_else(|| "an empty table".to_owned(), with_article);
        let _ = writeln!(text, "| `{}` | {} | {payload} |", event.name, event.doc);
    }
    text.push('\n');
    if let Some(on) = super::function("robot.on") {
        example(&mut text, on.example);
    }
    objects_of(&mut text, EVENTS);
    page(EVENTS, text)
}

fn description(text: &mut String, object: &Object, level: &str) {
    let _ = writeln!(text, "{level} {}\n\n{}\n", object.name, object.doc);
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
}

fn names() -> Page {
    let mut text = "# Names\n\n| kind | names |\n| --- | --- |\n".to_owned();
    for choice in super::choices() {
        let names = (choice.names)().join(", ");
        let _ = writeln!(text, "| {} | {names} |", choice.name);
    }
    page("names", text)
}
