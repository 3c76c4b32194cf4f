//! How worlds, faults and firmware are read from YAML: numbers with their ranges, and errors with line,
//! column and the probable name.

pub(crate) mod document;
pub(crate) mod locate;
pub(crate) mod number;
