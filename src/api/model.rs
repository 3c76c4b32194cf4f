//! The types that describe the API.

use std::fmt::Write as _;

#[derive(Debug, Clone, Copy)]
pub struct Function {
    /// The name as scripts write it, such as `robot.move`; for a method, such as `Frame:save`.
    pub path: &'static str,
    /// The title of its page in the book; empty if that is the page of its namespace or object.
    pub group: &'static str,
    /// The parameters in order, without a method's object.
    pub parameters: &'static [Value],
    /// A description of the further arguments; `None` if it takes none.
    pub rest: Option<&'static str>,
    pub returns: &'static [Value],
    /// Whether the calling task may wait.
    pub waits: bool,
    /// Whether it has no side effect, so that a call whose result is not used is pointless.
    pub pure: bool,
    /// A short description in whole sentences.
    pub doc: &'static str,
    /// A complete example that can be run; that of a `sim` call is for the function of a scenario.
    pub example: &'static str,
}

/// A parameter, an option, a result or a field.
#[derive(Debug, Clone, Copy)]
pub struct Value {
    pub name: &'static str,
    pub kind: Type,
    /// Its unit; empty without one.
    pub unit: &'static str,
    /// Whether it may be left out, or may be nil.
    pub requirement: Requirement,
    /// Its meaning in a few words; empty if the name says enough.
    pub doc: &'static str,
}

/// Whether a value may be left out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Requirement {
    /// It must be given; a result is never nil.
    Required,
    /// It may be left out; a result may be nil.
    Optional,
    /// It may be left out, and then has this value.
    Default(Literal),
}

/// A constant value, as scripts write it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Literal {
    Boolean(bool),
    Number(f64),
    /// `{low, high}`.
    Range(f64, f64),
}

#[derive(Debug, Clone, Copy)]
pub enum Type {
    Any,
    Boolean,
    /// A number, within bounds if there are any.
    Number(Option<Bounds>),
    Whole(Option<Bounds>),
    /// Text, with its largest length in bytes if there is a limit.
    Text(Option<usize>),
    /// A function, with its type in Luau's notation.
    Function(&'static str),
    Buffer,
    Choice(&'static Choice),
    Colours,
    /// A part of a frame.
    Roi,
    /// `{low, high}`.
    Range,
    /// A table of the script's, with any keys.
    Fields,
    /// An object or a table of the kind with this name.
    Object(&'static str),
    List(&'static Type),
    OneOrMore(&'static Type),
    /// The payload of the event that the first argument names.
    Payload,
    /// A function that takes the payload of the event that the first argument names.
    Handler,
    /// A table of tables, each with these keys and no others.
    Named(&'static [Value]),
    /// A table with these keys and no others.
    Options(&'static [Value]),
}

#[derive(Debug)]
pub struct Choice {
    pub name: &'static str,
    /// The word for one of them in messages.
    pub what: &'static str,
    pub names: fn() -> Vec<&'static str>,
}

#[derive(Debug, Clone, Copy)]
pub struct Constant {
    /// The name as scripts write it.
    pub path: &'static str,
    pub kind: Type,
    /// A short description in whole sentences.
    pub doc: &'static str,
    /// A complete example that can be run.
    pub example: &'static str,
}

#[derive(Debug, Clone, Copy)]
pub struct Object {
    pub name: &'static str,
    /// A short description in whole sentences.
    pub doc: &'static str,
    pub fields: &'static [Value],
    pub methods: &'static [Function],
    /// Whether reading an unknown name is an error. Otherwise such a read returns nil, as in a
    /// plain table.
    pub strict: bool,
}

#[derive(Debug, Clone, Copy)]
pub struct Event {
    pub name: &'static str,
    /// The name of the table that handlers get; `None` if it is an empty table.
    pub payload: Option<&'static str>,
    /// A sentence that says when the event occurs.
    pub doc: &'static str,
}

#[derive(Debug, Clone, Copy)]
pub struct Namespace {
    /// The name as scripts write it; empty for functions without a namespace.
    pub name: &'static str,
    pub about: &'static str,
    pub availability: Availability,
    pub functions: &'static [Function],
    /// Its fields that are not functions.
    pub constants: &'static [Constant],
    /// For a module, an example of its use; otherwise empty.
    pub example: &'static str,
}

/// The scripts that can use a namespace.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Availability {
    Everywhere,
    Behaviour,
    /// Only scenarios: `*_test.lua`.
    Scenario,
    /// Only scripts that call `require("@spykee/NAME")`.
    Module,
}

impl Function {
    /// The last part of its path.
    pub fn key(&self) -> &'static str {
        self.path.rsplit(['.', ':']).next().unwrap_or(self.path)
    }

    /// The namespace or object before its last part; empty for a global.
    pub fn owner(&self) -> &'static str {
        let end = self.path.find(['.', ':']).unwrap_or(0);
        &self.path[..end]
    }

    /// Whether it is a method, which is called with a colon.
    pub fn is_method(&self) -> bool {
        self.path.contains(':')
    }

    /// Whether its first argument names an event that determines the type of its handler or result.
    pub fn takes_an_event(&self) -> bool {
        let mut values = self.parameters.iter().chain(self.returns);
        values.any(|value| matches!(value.kind, Type::Handler | Type::Payload))
    }

    /// The parameters of a call with this many arguments: see [`Function::forms`].
    pub fn form(&self, arguments: usize) -> Vec<&'static Value> {
        let mut forms = self.forms();
        let short = forms.len() > 1 && forms[1].len() == arguments;
        forms.swap_remove(usize::from(short))
    }

    /// The parameter lists that a call may use: the full list and, if an optional parameter comes
    /// before a required one, the list without such optional parameters.
    pub fn forms(&self) -> Vec<Vec<&'static Value>> {
        let all: Vec<&Value> = self.parameters.iter().collect();
        let (head, tail) = all.split_at(self.required_len());
        let mut short: Vec<&Value> = head.to_vec();
        short.retain(|value| value.is_required());
        if short.len() == head.len() {
            return vec![all];
        }
        short.extend(tail);
        vec![all, short]
    }

    /// The number of parameters up to and including the last required one.
    pub fn required_len(&self) -> usize {
        let last = self.parameters.iter().rposition(Value::is_required);
        last.map_or(0, |at| at + 1)
    }

    /// Its signature, such as `robot.led(name: Light, on: boolean): ()`.
    pub fn signature(&self) -> String {
        let parameters = self.declared_parameters();
        format!("{}({parameters}): {}", self.path, self.returns_luau())
    }

    /// Its type in Luau's notation, without a method's object.
    pub fn luau_type(&self) -> String {
        format!(
            "({}) -> {}",
            self.parameters_luau("...any"),
            self.returns_luau()
        )
    }

    pub(super) fn declared_parameters(&self) -> String {
        self.parameters_luau("...: any")
    }

    /// `rest` is how further arguments are written: a type has no colon there, a declaration has one.
    fn parameters_luau(&self, rest: &str) -> String {
        let mut parameters: Vec<_> = self.parameters.iter().map(Value::named).collect();
        if self.rest.is_some() {
            parameters.push(rest.to_owned());
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
            let _ = if value.is_required() {
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
    pub fn members(&self) -> Vec<&'static str> {
        let fields = self.fields.iter().map(|field| field.name);
        fields
            .chain(self.methods.iter().map(Function::key))
            .collect()
    }

    pub fn field(&self, name: &str) -> Option<&'static Value> {
        self.fields.iter().find(|field| field.name == name)
    }

    pub fn method(&self, key: &str) -> Option<&'static Function> {
        self.methods.iter().find(|method| method.key() == key)
    }
}

/// The name of an object with an article, such as `a Frame` or `an Info`.
pub fn with_article(name: &str) -> String {
    let vowel = name.starts_with(['A', 'E', 'I', 'O', 'U']) && name != "Usage";
    let article = if vowel { "an" } else { "a" };
    format!("{article} {name}")
}

impl Namespace {
    pub fn function(&self, key: &str) -> Option<&'static Function> {
        self.functions.iter().find(|function| function.key() == key)
    }

    /// The names of its functions and other fields.
    pub fn members(&self) -> Vec<&'static str> {
        let constants = self.constants.iter().map(|one| {
            let key = one.path.rsplit('.').next();
            key.unwrap_or(one.path)
        });
        let functions = self.functions.iter().map(Function::key);
        functions.chain(constants).collect()
    }
}

impl Value {
    /// Whether it must be given, or is never nil.
    pub fn is_required(&self) -> bool {
        self.requirement == Requirement::Required
    }

    /// The word for it in messages: `light`, `the function`, `seconds`.
    pub fn label(&self) -> &'static str {
        match self.kind {
            Type::Choice(choice) => choice.what,
            kind if kind.is_function() => "the function",
            Type::Options(_) => "the options",
            _ => self.name,
        }
    }

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

impl Type {
    pub fn is_function(&self) -> bool {
        matches!(self, Type::Function(_) | Type::Handler)
    }

    /// Whether this is a function whose result the caller uses.
    pub fn wants_result(&self) -> bool {
        matches!(self, Type::Function(luau) if luau.ends_with(" boolean") || luau.ends_with(" any"))
    }

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
            Type::Object(name) => with_article(name),
            Type::List(of) => format!("a list, each {}", of.describe()),
            Type::OneOrMore(of) => format!("{}, or a list of them", of.describe()),
            Type::Payload => "the event's payload".to_owned(),
            Type::Named(_) => "a table of tables".to_owned(),
            Type::Options(_) => "a table".to_owned(),
        }
    }
}

impl std::fmt::Display for Literal {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Literal::Boolean(on) => write!(f, "{on}"),
            Literal::Number(number) => write!(f, "{number}"),
            Literal::Range(low, high) => write!(f, "{{{low}, {high}}}"),
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Bounds {
    /// From the first number to the second, both included.
    Between(f64, f64),
    /// Above the first number, up to and including the second.
    Above(f64, f64),
}

impl Bounds {
    pub fn contains(self, number: f64) -> bool {
        match self {
            Bounds::Between(low, high) => (low..=high).contains(&number),
            Bounds::Above(low, high) => number > low && number <= high,
        }
    }

    /// The bounds in words, such as `between 0 and 100`, or `of at least 0` without an upper bound.
    pub fn describe(self) -> String {
        match self {
            Bounds::Between(low, f64::MAX) => format!("of at least {low}"),
            Bounds::Between(low, high) => format!("between {low} and {high}"),
            Bounds::Above(low, high) => format!("above {low} and at most {high}"),
        }
    }
}
