//! Types and signatures as text: in Luau's notation, and in words.

use std::fmt::Write as _;

use super::model::{Function, Object, Requirement, Type, Value};

impl Type {
    /// The type in Luau's notation.
    pub fn luau(&self) -> String {
        match self {
            Type::Any => "any".to_owned(),
            Type::Boolean => "boolean".to_owned(),
            Type::Number(_) | Type::Whole(_) => "number".to_owned(),
            Type::Text(_) => "string".to_owned(),
            Type::Function(luau) => format!("({luau})"),
            Type::Buffer => "buffer".to_owned(),
            Type::Choice(choice) => choice.name.to_owned(),
            Type::Colours => "Colours".to_owned(),
            Type::Roi => "Roi".to_owned(),
            Type::Range => "{ number }".to_owned(),
            Type::Fields => "{ [string]: any }".to_owned(),
            Type::Object(object) => object.name.to_owned(),
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

    /// The accepted values in words: `a number between 0 and 100`, `one of ...`.
    pub fn describe(&self) -> String {
        match self {
            Type::Any => "anything".to_owned(),
            Type::Boolean => "true or false".to_owned(),
            Type::Number(None) => "a number".to_owned(),
            Type::Number(Some(bounds)) => format!("a number {}", bounds.describe()),
            Type::Whole(None) => "a whole number".to_owned(),
            Type::Whole(Some(bounds)) => format!("a whole number {}", bounds.describe()),
            Type::Text(None) => "a string".to_owned(),
            Type::Text(Some(most)) => format!("a string of at most {most} bytes"),
            Type::Function(_) | Type::Handler => "a function".to_owned(),
            Type::Buffer => "a buffer".to_owned(),
            Type::Choice(choice) => format!("one of {}", (choice.names)().join(", ")),
            Type::Colours => "a colour or a list of colours".to_owned(),
            Type::Roi => "a table {x, y, w, h}".to_owned(),
            Type::Range => "two numbers {low, high}".to_owned(),
            Type::Fields => "a table of named values".to_owned(),
            Type::Object(object) => object.with_article(),
            Type::List(of) => format!("a list, each {}", of.describe()),
            Type::OneOrMore(of) => format!("{}, or a list of them", of.describe()),
            Type::Payload => "the event's payload".to_owned(),
            Type::Named(_) => "a table of tables".to_owned(),
            Type::Options(_) => "a table".to_owned(),
        }
    }
}

impl Value {
    /// Its type in Luau's notation, with a `?` if it may be nil.
    pub fn luau(&self) -> String {
        match (self.requirement, &self.kind) {
            (Requirement::Required, kind) => kind.luau(),
            (_, Type::Any | Type::Payload) => "any".to_owned(),
            (_, kind @ Type::Function(_)) => format!("({})?", kind.luau()),
            (_, kind) => format!("{}?", kind.luau()),
        }
    }

    /// Its name and type in Luau's notation.
    pub(super) fn named(&self) -> String {
        format!("{}: {}", self.name, self.luau())
    }

    /// Its full description in one line, such as `a number between -100 and 100, in %: power`.
    pub fn describe(&self) -> String {
        if matches!(self.kind, Type::Any) && !self.doc.is_empty() {
            return self.doc.to_owned();
        }
        let mut words = self.kind.describe();
        if !self.unit.is_empty() {
            let _ = write!(words, ", in {}", self.unit);
        }
        if let Requirement::Default(usual) = self.requirement {
            let _ = write!(words, ", default {usual}");
        }
        if !self.doc.is_empty() {
            let _ = write!(words, ": {}", self.doc);
        }
        words
    }
}

impl Function {
    /// Its signature, such as `robot.led(name: Light, on: boolean): ()`.
    pub fn signature(&self) -> String {
        format!("{}{}", self.path, self.luau_type(": "))
    }

    /// Its parameters and results in Luau's notation, without a method's object.
    pub fn luau_type(&self, arrow: &str) -> String {
        format!("({}){arrow}{}", self.parameters_luau(), self.returns_luau())
    }

    pub(super) fn parameters_luau(&self) -> String {
        let mut parameters: Vec<_> = self.parameters.iter().map(Value::named).collect();
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

    /// The call as the documentation shows it: `robot.move(left, right [, seconds])`.
    pub fn call(&self) -> String {
        let mut text = format!("{}(", self.path);
        for (at, value) in self.parameters.iter().enumerate() {
            let comma = if at > 0 { ", " } else { "" };
            let _ = if value.requirement == Requirement::Required {
                write!(text, "{comma}{}", value.name)
            } else {
                write!(text, " [{comma}{}]", value.name)
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

impl Object {
    /// Its name with an article, such as `a Frame` or `an Info`.
    pub fn with_article(&self) -> String {
        let vowel = self.name.starts_with(['A', 'E', 'I', 'O', 'U']) && self.name != "Usage";
        let article = if vowel { "an" } else { "a" };
        format!("{article} {}", self.name)
    }
}
