//! Helpers that several modules use to make their rows.

use crate::api::make::boolean;
use crate::api::model::{Availability, Function, Namespace, Value};

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
