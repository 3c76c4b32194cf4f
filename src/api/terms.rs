//! The terms in which the API is described.

use super::bounds::Bounds;

/// One function or method.
#[derive(Debug, Clone, Copy)]
pub struct Function {
    /// As people write it, such as `robot.move`; methods as `Frame:save`.
    pub path: &'static str,
    /// In order; a method's object is not among them.
    pub parameters: &'static [Value],
    /// Further arguments, if it takes any: what they are.
    pub rest: Option<&'static str>,
    /// In order.
    pub returns: &'static [Value],
    /// The calling task may wait.
    pub waits: bool,
    /// It has no effect: a call whose result is unused does nothing.
    pub pure: bool,
    /// One sentence.
    pub doc: &'static str,
    /// Lines that run as they stand; those of a Frame's methods run where `frame` is one.
    pub example: &'static str,
}

/// A parameter, an option, a result or a field.
#[derive(Debug, Clone, Copy)]
pub struct Value {
    /// Its name.
    pub name: &'static str,
    /// What it is.
    pub kind: Type,
    /// Its unit; empty without one.
    pub unit: &'static str,
    /// Whether it may be left out, or may be nil.
    pub need: Need,
    /// What it means, in a few words; may be empty where the name says all.
    pub doc: &'static str,
}

/// Whether a value may be left out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Need {
    /// No.
    Required,
    /// Yes; a result may be nil.
    Optional,
    /// Yes, and then it is this.
    Default(Literal),
}

/// A constant as it is written in a script.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Literal {
    /// `true` or `false`.
    Boolean(bool),
    /// A number.
    Number(f64),
    /// `{low, high}`.
    Range(f64, f64),
}

/// What a value is.
#[derive(Debug, Clone, Copy)]
pub enum Type {
    /// Anything.
    Any,
    /// `true` or `false`.
    Boolean,
    /// A number, within bounds if there are any.
    Number(Option<Bounds>),
    /// A whole number.
    Whole(Option<Bounds>),
    /// Text, of at most so many bytes if there is a limit.
    Text(Option<usize>),
    /// A function, with its type in Luau's notation.
    Function(&'static str),
    /// A buffer.
    Buffer,
    /// One of a set of names.
    Choice(&'static Choice),
    /// A colour or a list of colours.
    Colours,
    /// A part of a frame.
    Roi,
    /// `{low, high}`.
    Range,
    /// A table of one's own, with any keys.
    Fields,
    /// An object or a table of this kind.
    Object(&'static Object),
    /// A list of these.
    List(&'static Type),
    /// One or a list of these.
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

/// A set of names.
#[derive(Debug)]
pub struct Choice {
    /// The name of its type.
    pub name: &'static str,
    /// What messages call one of them.
    pub what: &'static str,
    /// All of them.
    pub names: fn() -> Vec<&'static str>,
}

/// A field of a namespace.
#[derive(Debug, Clone, Copy)]
pub struct Constant {
    /// As people write it.
    pub path: &'static str,
    /// What it is.
    pub kind: Type,
    /// One sentence.
    pub doc: &'static str,
    /// Lines that run as they stand.
    pub example: &'static str,
}

/// A kind of table or object.
#[derive(Debug, Clone, Copy)]
pub struct Object {
    /// Its name.
    pub name: &'static str,
    /// One sentence.
    pub doc: &'static str,
    /// Its data.
    pub fields: &'static [Value],
    /// What is called on it with a colon.
    pub methods: &'static [Function],
    /// Reading any other name is an error; else it is a plain table, and gives nil.
    pub strict: bool,
}

/// An event.
#[derive(Debug, Clone, Copy)]
pub struct Event {
    /// Its name.
    pub name: &'static str,
    /// What handlers get; `None`: an empty table.
    pub payload: Option<&'static Object>,
    /// When it happens.
    pub doc: &'static str,
}

/// A table of functions.
#[derive(Debug, Clone, Copy)]
pub struct Namespace {
    /// As scripts write it; empty for functions without one.
    pub name: &'static str,
    /// What it is for, in a few words.
    pub about: &'static str,
    /// Which scripts have it.
    pub availability: Availability,
    /// Its functions.
    pub functions: &'static [Function],
    /// Its other fields.
    pub constants: &'static [Constant],
    /// An example of the whole, for modules.
    pub example: &'static str,
}

/// Which scripts have a namespace.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Availability {
    /// All.
    Everywhere,
    /// Behaviours.
    Behaviour,
    /// Scenarios: `*_test.lua`.
    Scenario,
    /// Those that call `require("@spykee/NAME")`.
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

    /// Called with a colon.
    pub fn is_method(&self) -> bool {
        self.path.contains(':')
    }

    /// Whether its first argument names an event, on which its handler or its result depends.
    pub fn takes_an_event(&self) -> bool {
        let mut values = self.parameters.iter().chain(self.returns);
        values.any(|value| matches!(value.kind, Type::Handler | Type::Payload))
    }

    /// The parameters that calls may have: all; and, where an optional one stands before one that is
    /// not, those without the former.
    pub fn forms(&self) -> Vec<Vec<&'static Value>> {
        let all: Vec<&Value> = self.parameters.iter().collect();
        let (head, tail) = all.split_at(self.least());
        let mut short: Vec<&Value> = head.to_vec();
        short.retain(|value| value.need == Need::Required);
        if short.len() == head.len() {
            return vec![all];
        }
        short.extend(tail);
        vec![all, short]
    }

    /// The fewest arguments that it can be called with, none of them left out.
    pub fn least(&self) -> usize {
        let needed = |value: &Value| value.need == Need::Required;
        let last = self.parameters.iter().rposition(needed);
        last.map_or(0, |at| at + 1)
    }
}

impl Object {
    /// The names of its fields and methods.
    pub fn members(&self) -> Vec<&'static str> {
        let fields = self.fields.iter().map(|field| field.name);
        fields
            .chain(self.methods.iter().map(Function::key))
            .collect()
    }

    /// The method of this name.
    pub fn method(&self, key: &str) -> Option<&'static Function> {
        self.methods.iter().find(|method| method.key() == key)
    }
}

impl Namespace {
    /// The function of this name.
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
    /// What messages call it: `light`, `the function`, `seconds`.
    pub fn spoken(&self) -> &'static str {
        match self.kind {
            Type::Choice(choice) => choice.what,
            Type::Function(_) | Type::Handler => "the function",
            Type::Options(_) => "the options",
            _ => self.name,
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
