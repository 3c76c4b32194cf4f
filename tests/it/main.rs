//! Integration tests, one binary.

mod link;
mod vision;
