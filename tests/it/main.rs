//! Integration tests, one binary.

mod cli;
mod floors;
mod link;
mod vision;
