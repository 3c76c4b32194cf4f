//! A decoded picture: its size, its samples in planes, colour spaces, parts of its rows, and single
//! figures of it.

pub(crate) mod image;
pub(crate) mod measure;
pub(crate) mod size;
pub(crate) mod space;
pub(crate) mod spans;
