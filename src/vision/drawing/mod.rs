//! Draws what was detected onto pictures for people.

pub(crate) mod annotate;
mod font;
