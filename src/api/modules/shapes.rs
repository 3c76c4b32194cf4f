//! What the rows of several modules are made with.

use crate::api::make::{boolean, strict};
use crate::api::terms::{Availability, Function, Namespace, Object, Value};

pub(super) const OK: &[Value] = &[boolean("ok", "whether it worked")];

pub(super) const fn module(
    name: &'static str,
    about: &'static str,
    functions: &'static [Function],
    example: &'static str,
) -> Namespace {
    Namespace {
        name,
        about,
        availability: Availability::Module,
        functions,
        constants: &[],
        example,
    }
}

/// An object that scripts may keep values of their own in.
pub(super) const fn open(
    name: &'static str,
    doc: &'static str,
    fields: &'static [Value],
    methods: &'static [Function],
) -> Object {
    Object {
        strict: false,
        ..strict(name, doc, fields, methods)
    }
}
