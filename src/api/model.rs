//! The types that describe the API.

#[derive(Debug, Clone, Copy)]
pub struct Function {
    /// The name as scripts write it, such as `robot.move`; for a method, such as `Frame:save`.
    pub path: &'static str,
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
    /// A complete example that can be run. Examples of a Frame's methods expect a variable `frame`.
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
    /// `true` or `false`.
    Boolean(bool),
    Number(f64),
    /// `{low, high}`.
    Range(f64, f64),
}

#[derive(Debug, Clone, Copy)]
pub enum Type {
    Any,
    /// `true` or `false`.
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
    /// An object or a table of this kind.
    Object(&'static Object),
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

/// A field of a namespace.
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

/// A kind of table or object.
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
    /// The table that handlers get; `None` if it is an empty table.
    pub payload: Option<&'static Object>,
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

    /// The parameter lists that a call may use: the full list and, if an optional parameter comes
    /// before a required one, the list without such optional parameters.
    pub fn forms(&self) -> Vec<Vec<&'static Value>> {
        let all: Vec<&Value> = self.parameters.iter().collect();
        let (head, tail) = all.split_at(self.required_len());
        let mut short: Vec<&Value> = head.to_vec();
        short.retain(|value| value.requirement == Requirement::Required);
        if short.len() == head.len() {
            return vec![all];
        }
        short.extend(tail);
        vec![all, short]
    }

    /// The number of parameters up to and including the last required one.
    pub fn required_len(&self) -> usize {
        let needed = |value: &Value| value.requirement == Requirement::Required;
        let last = self.parameters.iter().rposition(needed);
        last.map_or(0, |at| at + 1)
    }
}

impl Object {
    pub fn members(&self) -> Vec<&'static str> {
        let fields = self.fields.iter().map(|field| field.name);
        fields
            .chain(self.methods.iter().map(Function::key))
            .collect()
    }

    pub fn method(&self, key: &str) -> Option<&'static Function> {
        self.methods.iter().find(|method| method.key() == key)
    }
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
    /// The word for it in messages: `light`, `the function`, `seconds`.
    pub fn label(&self) -> &'static str {
        match self.kind {
            Type::Choice(choice) => choice.what,
            kind if kind.is_function() => "the function",
            Type::Options(_) => "the options",
            _ => self.name,
        }
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

/// A number's bounds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Bounds {
    /// From the first number to the second, both included.
    Between(f64, f64),
    /// Above the first number, up to and including the second.
    Above(f64, f64),
}

/// How long a call may wait, in seconds: up to thirty days.
pub(super) const SECONDS: Bounds = Bounds::Between(0.0, 30.0 * 86_400.0);

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
