//! Integration tests, one binary.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod cli;
mod floors;
mod link;
