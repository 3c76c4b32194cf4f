//! Short constructors for the rows of the API table, and methods that add further properties to a
//! row.

use super::model::{Bounds, Choice, Function, Literal, Object, Requirement, Type, Value};

impl Value {
    pub(super) const fn unit(self, unit: &'static str) -> Value {
        Value { unit, ..self }
    }

    /// Marks the value as optional: it may be left out, or may be nil.
    pub(super) const fn optional(self) -> Value {
        Value {
            requirement: Requirement::Optional,
            ..self
        }
    }

    pub(super) const fn required(self) -> Value {
        Value {
            requirement: Requirement::Required,
            ..self
        }
    }

    pub(super) const fn default(self, number: f64) -> Value {
        Value {
            requirement: Requirement::Default(Literal::Number(number)),
            ..self
        }
    }

    pub(super) const fn default_is(self, on: bool) -> Value {
        Value {
            requirement: Requirement::Default(Literal::Boolean(on)),
            ..self
        }
    }
}

impl Function {
    pub(super) const fn waiting(self) -> Function {
        let waits = true;
        Function { waits, ..self }
    }

    pub(super) const fn pure(self) -> Function {
        let pure = true;
        Function { pure, ..self }
    }

    /// Adds further arguments after the parameters, with their description.
    pub(super) const fn with_rest(self, rest: &'static str) -> Function {
        let rest = Some(rest);
        Function { rest, ..self }
    }
}

pub(super) const fn value(name: &'static str, kind: Type, doc: &'static str) -> Value {
    Value {
        name,
        kind,
        unit: "",
        requirement: Requirement::Required,
        doc,
    }
}

pub(super) const fn number(name: &'static str, doc: &'static str) -> Value {
    value(name, Type::Number(None), doc)
}

pub(super) const fn bounded(name: &'static str, bounds: Bounds, doc: &'static str) -> Value {
    value(name, Type::Number(Some(bounds)), doc)
}

pub(super) const fn whole(name: &'static str, doc: &'static str) -> Value {
    value(name, Type::Whole(None), doc)
}

/// A whole number from 0 to `most`.
pub(super) const fn count(name: &'static str, most: u32, doc: &'static str) -> Value {
    let bounds = Bounds::Between(0.0, most as f64);
    value(name, Type::Whole(Some(bounds)), doc)
}

pub(super) const fn boolean(name: &'static str, doc: &'static str) -> Value {
    value(name, Type::Boolean, doc)
}

pub(super) const fn text(name: &'static str, doc: &'static str) -> Value {
    value(name, Type::Text(None), doc)
}

/// A text of at most `most` bytes.
pub(super) const fn short_text(name: &'static str, most: usize, doc: &'static str) -> Value {
    value(name, Type::Text(Some(most)), doc)
}

pub(super) const fn choice(name: &'static str, of: &'static Choice, doc: &'static str) -> Value {
    value(name, Type::Choice(of), doc)
}

pub(super) const fn object(name: &'static str, of: &'static Object, doc: &'static str) -> Value {
    value(name, Type::Object(of), doc)
}

pub(super) const fn function(name: &'static str, luau: &'static str, doc: &'static str) -> Value {
    value(name, Type::Function(luau), doc)
}

pub(super) const fn options(keys: &'static [Value]) -> Value {
    value("options", Type::Options(keys), "").optional()
}

/// `{low, high}`; the default is the full range.
pub(super) const fn range(name: &'static str, full: Literal, doc: &'static str) -> Value {
    Value {
        requirement: Requirement::Default(full),
        ..value(name, Type::Range, doc)
    }
}

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
        pure: false,
        doc,
        example,
    }
}

pub(super) const fn table(
    name: &'static str,
    doc: &'static str,
    fields: &'static [Value],
) -> Object {
    Object {
        name,
        doc,
        fields,
        methods: &[],
        strict: false,
    }
}

/// An object in which scripts may store their own values.
pub(super) const fn open(
    name: &'static str,
    doc: &'static str,
    fields: &'static [Value],
    methods: &'static [Function],
) -> Object {
    Object {
        methods,
        ..table(name, doc, fields)
    }
}

/// An object for which reading an unknown name is an error.
pub(super) const fn strict(
    name: &'static str,
    doc: &'static str,
    fields: &'static [Value],
    methods: &'static [Function],
) -> Object {
    Object {
        strict: true,
        ..open(name, doc, fields, methods)
    }
}
