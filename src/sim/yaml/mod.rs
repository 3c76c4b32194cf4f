//! Reads worlds, faults and firmware settings from YAML: numbers with range checks, and errors with
//! line, column and a suggestion for misspelt names.

pub(crate) mod document;
pub(crate) mod locate;
pub(crate) mod number;
