//! Definitions as text for people: signatures in Luau's notation, and one entry in full.

use std::fmt::Write as _;

use super::terms::{Constant, Event, Function, Need, Object, Type, Value};

impl Type {
    /// In Luau's notation.
    pub fn luau(&self) -> String {
        match self {
            Type::Any => "any".to_owned(),
            Type::Boolean => "boolean".to_owned(),
            Type::Number(_) | Type::Whole(_) => "number".to_owned(),
            Type::Text => "string".to_owned(),
            Type::Function(luau) => format!("({luau})"),
            Type::Buffer => "buffer".to_owned(),
            Type::Choice(choice) => choice.name.to_owned(),
            Type::Colour => "string | Colour".to_owned(),
            Type::Colours => "Colours".to_owned(),
            Type::Roi => "Roi".to_owned(),
            Type::Range => "{ number }".to_owned(),
            Type::Fields => "{ [string]: any }".to_owned(),
            Type::Object(name) => (*name).to_owned(),
            Type::List(of) => format!("{{ {} }}", of.luau()),
            Type::OneOrMore(of) => format!("({} | {{ {} }})", of.luau(), of.luau()),
            Type::Payload => "any".to_owned(),
            Type::Handler => "((payload: any) -> ...any)".to_owned(),
            Type::Named(keys) => format!("{{ [string]: {} }}", Type::Options(keys).luau()),
            Type::Options(keys) => {
                let keys: Vec<_> = keys
                    .iter()
                    .map(|key| format!("{}: {}", key.name, key.luau()))
                    .collect();
                format!("{{ {} }}", keys.join(", "))
            }
        }
    }

    /// What is accepted, in words: `a number between 0 and 100`, `one of ...`.
    pub fn words(&self) -> String {
        match self {
            Type::Any => "anything".to_owned(),
            Type::Boolean => "true or false".to_owned(),
            Type::Number(None) => "a number".to_owned(),
            Type::Number(Some(bounds)) => format!("a number {}", bounds.words()),
            Type::Whole(None) => "a whole number".to_owned(),
            Type::Whole(Some(bounds)) => format!("a whole number {}", bounds.words()),
            Type::Text => "a string".to_owned(),
            Type::Function(_) | Type::Handler => "a function".to_owned(),
            Type::Buffer => "a buffer".to_owned(),
            Type::Choice(choice) => format!("one of {}", (choice.names)().join(", ")),
            Type::Colour => "a colour".to_owned(),
            Type::Colours => "a colour or a list of colours".to_owned(),
            Type::Roi => "a table {x, y, w, h}".to_owned(),
            Type::Range => "two numbers {low, high}".to_owned(),
            Type::Fields => "a table of named values".to_owned(),
            Type::Object(name) => format!("a {name}"),
            Type::List(of) => format!("a list, each {}", of.words()),
            Type::OneOrMore(of) => format!("{}, or a list of them", of.words()),
            Type::Payload => "the event's payload".to_owned(),
            Type::Named(_) => "a table of tables".to_owned(),
            Type::Options(_) => "a table".to_owned(),
        }
    }
}

impl Value {
    /// Its type in Luau's notation, with a `?` where it may be nil.
    pub fn luau(&self) -> String {
        match (self.need, &self.kind) {
            (Need::Required, kind) => kind.luau(),
            (_, Type::Any | Type::Payload) => "any".to_owned(),
            (_, kind @ Type::Colour) => format!("({})?", kind.luau()),
            (_, kind) => format!("{}?", kind.luau()),
        }
    }

    /// All that is known of it in one line, such as `a number between -100 and 100, in %: power`.
    pub fn words(&self) -> String {
        let mut words = self.kind.words();
        if !self.unit.is_empty() {
            let _ = write!(words, ", in {}", self.unit);
        }
        if let Need::Default(usual) = self.need {
            let _ = write!(words, ", {usual} unless given");
        }
        if !self.doc.is_empty() {
            let _ = write!(words, ": {}", self.doc);
        }
        words
    }
}

impl Function {
    /// Such as `robot.led(name: Light, on: boolean): ()`.
    pub fn signature(&self) -> String {
        format!("{}{}", self.path, self.luau_type(": "))
    }

    /// Its parameters and results in Luau's notation, the object of a method left out.
    pub fn luau_type(&self, arrow: &str) -> String {
        format!("({}){arrow}{}", self.parameters_luau(), self.returns_luau())
    }

    pub(super) fn parameters_luau(&self) -> String {
        let named = |value: &Value| format!("{}: {}", value.name, value.luau());
        let mut parameters: Vec<_> = self.parameters.iter().map(named).collect();
        if self.rest.is_some() {
            parameters.push("...any".to_owned());
        }
        parameters.join(", ")
    }

    pub(super) fn returns_luau(&self) -> String {
        let returns: Vec<_> = self.returns.iter().map(Value::luau).collect();
        match returns.as_slice() {
            [one] => one.clone(),
            several => format!("({})", several.join(", ")),
        }
    }

    /// As people read it: `robot.move(left, right [, seconds])`.
    pub fn call(&self) -> String {
        let mut text = format!("{}(", self.path);
        let least = self.least();
        for (at, value) in self.parameters.iter().enumerate() {
            let comma = if at > 0 { ", " } else { "" };
            let _ = match at < least {
                true => write!(text, "{comma}{}", value.name),
                false => write!(text, " [{comma}{}]", value.name),
            };
        }
        if self.rest.is_some() {
            text += if self.parameters.is_empty() {
                "..."
            } else {
                ", ..."
            };
        }
        text.replace("( [", "([") + ")"
    }
}

/// One entry in full, for the terminal: a function, constant, object, field, event or set of names.
pub fn full(path: &str) -> Option<String> {
    if let Some(function) = super::function(path) {
        return Some(of_function(function));
    }
    if let Some(constant) = super::constants().find(|one| one.path == path) {
        return Some(of_constant(constant));
    }
    if let Some(object) = super::object(path) {
        return Some(of_object(object));
    }
    if let Some((owner, field)) = path.split_once('.')
        && let Some(object) = super::object(owner)
        && let Some(field) = object.fields.iter().find(|one| one.name == field)
    {
        return Some(format!("{path}: {}\n\n{}\n", field.luau(), field.words()));
    }
    if let Some(event) = super::event(path) {
        return Some(of_event(event));
    }
    let choice = super::choices().find(|choice| choice.name == path)?;
    Some(format!("{path}: one of {}\n", (choice.names)().join(", ")))
}

fn of_function(function: &Function) -> String {
    let mut text = format!("{}\n\n{}\n", function.signature(), function.doc);
    if function.waits {
        text += "It may wait; a cancelled task ends there.\n";
    }
    section(&mut text, "takes", function.parameters);
    if let Some(rest) = function.rest {
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
    let methods: Vec<_> = object.methods().collect();
    if !methods.is_empty() {
        text += "\nmethods\n";
    }
    for method in methods {
        let _ = writeln!(text, "  {}\n      {}", method.signature(), method.doc);
    }
    text
}

fn of_event(event: &Event) -> String {
    let name = event.name;
    let payload = match event.payload {
        Some(object) => format!("handlers get a {object}"),
        None => "handlers get an empty table".to_owned(),
    };
    format!(
        "event {name}\n\n{} {}.\n\nexample\n  robot.on(\"{name}\", function(event)\n  \tprint(\"{name}\", event)\n  end)\n",
        event.doc,
        capital(&payload)
    )
}

fn capital(text: &str) -> String {
    let mut letters = text.chars();
    let first = letters.next().map(|letter| letter.to_ascii_uppercase());
    first.into_iter().chain(letters).collect()
}

fn section(text: &mut String, title: &str, values: &[Value]) {
    if values.is_empty() {
        return;
    }
    let _ = writeln!(text, "\n{title}");
    let width = values.iter().map(|value| value.name.len()).max();
    let width = width.unwrap_or(0) + 1;
    for value in values {
        let optional = if value.need == Need::Required {
            ""
        } else {
            "?"
        };
        let name = format!("{}{optional}", value.name);
        let _ = writeln!(text, "  {name:width$}  {}", value.words());
    }
}

fn example(text: &mut String, example: &str) {
    *text += "\nexample\n";
    for line in example.lines() {
        let _ = writeln!(text, "  {line}");
    }
}
