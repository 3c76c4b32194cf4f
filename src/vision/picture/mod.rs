//! A decoded picture: its size, its sample planes, colour spaces, spans of its rows, and
//! statistics.

pub(crate) mod image;
pub(crate) mod measure;
pub(crate) mod size;
pub(crate) mod space;
pub(crate) mod spans;
