//! Reads the table of the API from its text, whose notation `namespaces.luau` explains. The text is
//! part of the program: what cannot be read is a mistake that the tests find.

use std::str::FromStr;
use std::sync::LazyLock;

use super::choices::CHOICES;
use super::model::{
    Availability, Bounds, Constant, Event, Function, Literal, Namespace, Object, Requirement, Type,
    Value,
};

pub(super) const TEXT: &str = concat!(
    include_str!("namespaces.luau"),
    "\n",
    include_str!("modules.luau"),
    "\n",
    include_str!("objects.luau"),
);

pub(super) static TABLE: LazyLock<Table> = LazyLock::new(|| Table::read(TEXT));

#[derive(Default)]
pub(super) struct Table {
    pub(super) namespaces: Vec<Namespace>,
    pub(super) modules: Vec<Namespace>,
    pub(super) objects: Vec<Object>,
    pub(super) events: Vec<Event>,
}

impl Table {
    fn read(text: &'static str) -> Table {
        let mut table = Table::default();
        // The first section begins after a comment.
        let sections = text.split("\n--- ").skip(1);
        let mut sections = sections.map(Section::read).peekable();
        while let Some(section) = sections.next() {
            let mut functions = Vec::new();
            let mut constants = Vec::new();
            let mut group = "";
            while let Some(member) =
                sections.next_if(|next| matches!(next.kind, "group" | "function" | "constant"))
            {
                match member.kind {
                    "group" => group = member.doc(),
                    "function" => functions.push(member.function(group)),
                    _ => constants.push(member.constant()),
                }
            }
            match section.kind {
                "event" => table.events.push(Event {
                    name: section.name,
                    payload: section.words.first().copied(),
                    doc: section.doc(),
                }),
                "table" | "object" => table.objects.push(Object {
                    name: section.name,
                    doc: section.doc(),
                    fields: values(&section.rows, "--."),
                    methods: functions.leak(),
                    strict: section.kind == "object",
                }),
                _ => {
                    let namespace = section.namespace(functions, constants);
                    match namespace.availability {
                        Availability::Module => table.modules.push(namespace),
                        _ => table.namespaces.push(namespace),
                    }
                }
            }
        }
        table
    }
}

/// The text from one headline to the next.
struct Section {
    kind: &'static str,
    name: &'static str,
    /// Further words of the headline.
    words: Vec<&'static str>,
    /// The lines of the description: those that begin with two hyphens.
    rows: Vec<&'static str>,
    example: &'static str,
}

impl Section {
    fn read(text: &'static str) -> Section {
        let (headline, text) = text.split_once('\n').unwrap_or((text, ""));
        let mut words = headline.split(' ');
        let rows: Vec<_> = text
            .lines()
            .take_while(|line| line.starts_with("--"))
            .collect();
        let length: usize = rows.iter().map(|row| row.len() + 1).sum();
        Section {
            kind: words.next().unwrap_or_default(),
            name: words.next().unwrap_or_default(),
            words: words.collect(),
            rows,
            example: text.get(length..).unwrap_or_default().trim_end(),
        }
    }

    /// The text of the first line with this mark.
    fn line(&self, mark: &str) -> Option<&'static str> {
        self.rows.iter().find_map(|row| row.strip_prefix(mark))
    }

    fn doc(&self) -> &'static str {
        self.line("--| ").unwrap_or_default()
    }

    fn function(self, group: &'static str) -> Function {
        Function {
            path: self.name,
            group,
            parameters: values(&self.rows, "-->"),
            rest: self.line("--* "),
            returns: values(&self.rows, "--<"),
            waits: self.words.contains(&"waits"),
            pure: self.words.contains(&"pure"),
            doc: self.doc(),
            example: self.example,
        }
    }

    fn constant(self) -> Constant {
        let kind = self.words.first().copied().unwrap_or_default();
        Constant {
            path: self.name,
            kind: type_of(kind, &[]),
            doc: self.doc(),
            example: self.example,
        }
    }

    fn namespace(self, functions: Vec<Function>, constants: Vec<Constant>) -> Namespace {
        Namespace {
            name: if self.name == "-" { "" } else { self.name },
            about: self.doc(),
            availability: match self.words.first() {
                None => Availability::Module,
                Some(&"everywhere") => Availability::Everywhere,
                Some(&"scenarios") => Availability::Scenario,
                Some(_) => Availability::Behaviour,
            },
            functions: functions.leak(),
            constants: constants.leak(),
            example: self.example,
        }
    }
}

/// The values of the lines with exactly this mark; the lines below one that begin with a point are
/// its keys.
fn values(rows: &[&'static str], mark: &str) -> &'static [Value] {
    let inner = if mark.ends_with('.') {
        format!("{mark}.")
    } else {
        "--.".to_owned()
    };
    let mut found = Vec::new();
    for (at, row) in rows.iter().enumerate() {
        if let Some(text) = row.strip_prefix(mark).and_then(|row| row.strip_prefix(' ')) {
            let below = rows[at + 1..].iter();
            let keys: Vec<_> = below
                .take_while(|row| row.starts_with(&inner))
                .copied()
                .collect();
            found.push(value(text, values(&keys, &inner)));
        }
    }
    found.leak()
}

/// `NAME: TYPE [UNIT] -- MEANING`
fn value(text: &'static str, keys: &'static [Value]) -> Value {
    let (text, doc) = text.split_once(" -- ").unwrap_or((text, ""));
    let (name, kind) = text.split_once(": ").unwrap_or((text, ""));
    let with_unit = kind
        .strip_suffix(']')
        .and_then(|kind| kind.split_once(" ["));
    let (kind, unit) = with_unit.unwrap_or((kind, ""));
    let (name, requirement) = match name.split_once('?') {
        None => (name, Requirement::Required),
        Some((name, "")) => (name, Requirement::Optional),
        Some((name, usual)) => (name, Requirement::Default(literal(usual))),
    };
    Value {
        name,
        kind: type_of(kind, keys),
        unit,
        requirement,
        doc,
    }
}

/// `=40`, `=true` or `={0, 100}`
fn literal(text: &str) -> Literal {
    let text = text.trim_start_matches('=');
    if let Ok(on) = text.parse() {
        return Literal::Boolean(on);
    }
    match text.trim_matches(['{', '}']).split_once(", ") {
        Some((low, high)) => Literal::Range(number(low), number(high)),
        None => Literal::Number(number(text)),
    }
}

fn type_of(text: &'static str, keys: &'static [Value]) -> Type {
    if text.starts_with('(') {
        return Type::Function(text);
    }
    if let Some((one, _)) = text.split_once(" | ") {
        return Type::OneOrMore(Box::leak(Box::new(type_of(one, &[]))));
    }
    if let Some(one) = text.strip_prefix('{') {
        let one = one.trim_end_matches('}');
        return Type::List(Box::leak(Box::new(type_of(one, &[]))));
    }
    let (name, limit) = text.split_once(' ').unwrap_or((text, ""));
    match name {
        "any" => Type::Any,
        "boolean" => Type::Boolean,
        "number" => Type::Number(bounds(limit)),
        "whole" => Type::Whole(bounds(limit)),
        "string" => Type::Text(limit.parse().ok()),
        "buffer" => Type::Buffer,
        "Colours" => Type::Colours,
        "Roi" => Type::Roi,
        "range" => Type::Range,
        "fields" => Type::Fields,
        "payload" => Type::Payload,
        "handler" => Type::Handler,
        "table" => Type::Options(keys),
        "tables" => Type::Named(keys),
        _ => {
            let choice = CHOICES.iter().find(|choice| choice.name == name);
            choice.map_or(Type::Object(name), Type::Choice)
        }
    }
}

/// `0..9` or `>0..9`
fn bounds(text: &str) -> Option<Bounds> {
    let (low, high) = text.split_once("..")?;
    let high = number(high);
    Some(match low.strip_prefix('>') {
        Some(low) => Bounds::Above(number(low), high),
        None => Bounds::Between(number(low), high),
    })
}

fn number(text: &str) -> f64 {
    f64::from_str(text).unwrap_or(f64::NAN)
}
