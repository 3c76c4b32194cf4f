//! Draws what was seen onto pictures for people.

pub(crate) mod annotate;
mod font;
