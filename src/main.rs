//! The `spykee` command.
fn main() {}
