//! Integration tests, one binary.

mod link;
