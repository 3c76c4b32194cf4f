//! The words in which the API is described.

use super::super::super::arguments::Bounds;
use crate::robot::{DockEnd, MotionEnd, SafetyAction};
use crate::vision::Colour;
use crate::wire::{Sound, Stream};

/// One function or method.
#[derive(Debug, Clone, Copy)]
pub struct Function {
    /// As people write it, such as `robot.move`; methods as `Frame:save`.
    pub path: &'static str,
    /// In order; a method's object is not among them.
    pub parameters: &'static [Value],
    /// Anything more, if it takes more: what it is for.
    pub rest: Option<&'static str>,
    /// In order.
    pub returns: &'static [Value],
    /// The task that calls may wait.
    pub waits: bool,
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
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Need {
    /// No.
    Required,
    /// Yes; a result may be nil.
    Optional,
    /// Yes, and then it is this, as it is written in a script.
    Default(&'static str),
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
    /// Text.
    Text,
    /// A function, with its type in Luau's notation.
    Function(&'static str),
    /// A buffer.
    Buffer,
    /// One of a set of names.
    Choice(&'static Choice),
    /// A colour's name or a Colour.
    Colour,
    /// A colour or a list of colours.
    Colours,
    /// A part of a frame.
    Roi,
    /// `{low, high}`.
    Range,
    /// A table of one's own, with any keys.
    Fields,
    /// An object or table that [`super::objects`] describes.
    Object(&'static str),
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
    /// Reading any other name is an error; else it is a plain table, and gives nil.
    pub strict: bool,
}

/// An event.
#[derive(Debug, Clone, Copy)]
pub struct Event {
    /// Its name.
    pub name: &'static str,
    /// What handlers get; `None`: an empty table.
    pub payload: Option<&'static str>,
    /// When it happens.
    pub doc: &'static str,
}

impl Function {
    /// The last part of its path.
    pub fn key(&self) -> &'static str {
        self.path.rsplit(['.', ':']).next().unwrap_or(self.path)
    }

    /// The namespace or object that it belongs to; empty for a global.
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

    /// Whether calling it without using what it returns does nothing at all.
    pub fn only_answers(&self) -> bool {
        const ANSWERS: [&str; 12] = [
            "task.now",
            "robot.battery",
            "robot.docked",
            "robot.connected",
            "robot.info",
            "script.usage",
            "Frame:find_blobs",
            "Frame:find_line",
            "Frame:find_qrcodes",
            "Frame:brightness",
            "Frame:sharpness",
            "Frame:get_pixel",
        ];
        ANSWERS.contains(&self.path)
    }

    /// The fewest arguments that it can be called with.
    pub fn least(&self) -> usize {
        let needed = |value: &Value| value.need == Need::Required;
        self.parameters
            .iter()
            .rposition(needed)
            .map_or(0, |at| at + 1)
    }
}

impl Object {
    /// Its methods.
    pub fn methods(&self) -> impl Iterator<Item = &'static Function> + use<> {
        let name = self.name;
        super::functions().filter(move |function| function.is_method() && function.owner() == name)
    }
}

impl Value {
    const fn new(name: &'static str, kind: Type, doc: &'static str) -> Value {
        Value {
            name,
            kind,
            unit: "",
            need: Need::Required,
            doc,
        }
    }

    pub(super) const fn unit(self, unit: &'static str) -> Value {
        Value { unit, ..self }
    }

    pub(super) const fn optional(self) -> Value {
        let need = Need::Optional;
        Value { need, ..self }
    }

    pub(super) const fn default(self, literal: &'static str) -> Value {
        let need = Need::Default(literal);
        Value { need, ..self }
    }
}

pub(super) const fn value(name: &'static str, kind: Type, doc: &'static str) -> Value {
    Value::new(name, kind, doc)
}

pub(super) const fn number(name: &'static str, doc: &'static str) -> Value {
    Value::new(name, Type::Number(None), doc)
}

pub(super) const fn bounded(name: &'static str, bounds: Bounds, doc: &'static str) -> Value {
    Value::new(name, Type::Number(Some(bounds)), doc)
}

pub(super) const fn whole(name: &'static str, doc: &'static str) -> Value {
    Value::new(name, Type::Whole(None), doc)
}

/// A whole number from 0 to `most`.
pub(super) const fn count(name: &'static str, most: u32, doc: &'static str) -> Value {
    let bounds = Bounds::Between(0.0, most as f64);
    Value::new(name, Type::Whole(Some(bounds)), doc)
}

pub(super) const fn boolean(name: &'static str, doc: &'static str) -> Value {
    Value::new(name, Type::Boolean, doc)
}

pub(super) const fn text(name: &'static str, doc: &'static str) -> Value {
    Value::new(name, Type::Text, doc)
}

pub(super) const fn choice(
    name: &'static str,
    choice: &'static Choice,
    doc: &'static str,
) -> Value {
    Value::new(name, Type::Choice(choice), doc)
}

pub(super) const fn object(name: &'static str, of: &'static str, doc: &'static str) -> Value {
    Value::new(name, Type::Object(of), doc)
}

pub(super) const fn function(name: &'static str, luau: &'static str, doc: &'static str) -> Value {
    Value::new(name, Type::Function(luau), doc)
}

pub(super) const fn options(keys: &'static [Value]) -> Value {
    Value::new("options", Type::Options(keys), "").optional()
}

/// `ok` of calls that wait for an end.
pub(super) const OK: Value = boolean("ok", "whether it was done");

/// A function without anything but its sentence; the rest is set by field.
pub(super) const fn call(
    path: &'static str,
    parameters: &'static [Value],
    returns: &'static [Value],
    doc: &'static str,
    example: &'static str,
) -> Function {
    Function {
        path,
        parameters,
        rest: None,
        returns,
        waits: false,
        doc,
        example,
    }
}

impl Function {
    pub(super) const fn waiting(self) -> Function {
        Function {
            waits: true,
            ..self
        }
    }

    pub(super) const fn and(self, rest: &'static str) -> Function {
        Function {
            rest: Some(rest),
            ..self
        }
    }
}

pub(super) const LIGHT: &Choice = &Choice {
    name: "Light",
    what: "light",
    names: || vec!["flash", "left", "right", "all"],
};

pub(super) const SOUND: &Choice = &Choice {
    name: "Sound",
    what: "sound",
    names: || Sound::ALL.iter().map(|one| one.name()).collect(),
};

pub(super) const STREAM: &Choice = &Choice {
    name: "Stream",
    what: "stream",
    names: || Stream::ALL.iter().map(|one| one.name()).collect(),
};

pub(super) const EVENT: &Choice = &Choice {
    name: "EventName",
    what: "event",
    names: || super::events().map(|event| event.name).collect(),
};

pub(super) const QUEUE: &Choice = &Choice {
    name: "Queue",
    what: "queue",
    names: || vec!["latest", "all"],
};

pub(super) const COLOUR_NAME: &Choice = &Choice {
    name: "ColourName",
    what: "colour",
    names: || Colour::NAMES.to_vec(),
};

pub(super) const MOTION_CODE: &Choice = &Choice {
    name: "MotionCode",
    what: "code",
    names: || MotionEnd::ALL.iter().map(|one| one.name()).collect(),
};

pub(super) const DOCK_CODE: &Choice = &Choice {
    name: "DockCode",
    what: "code",
    names: || DockEnd::ALL.iter().map(|one| one.name()).collect(),
};

pub(super) const SAFETY_ACTION: &Choice = &Choice {
    name: "SafetyAction",
    what: "action",
    names: || SafetyAction::ALL.iter().map(|one| one.name()).collect(),
};

pub(super) const TASK_STATUS: &Choice = &Choice {
    name: "TaskStatus",
    what: "status",
    names: || vec!["running", "done", "failed", "cancelled"],
};

pub(super) const CHOICES: [&Choice; 10] = [
    LIGHT,
    SOUND,
    STREAM,
    EVENT,
    QUEUE,
    COLOUR_NAME,
    MOTION_CODE,
    DOCK_CODE,
    SAFETY_ACTION,
    TASK_STATUS,
];
