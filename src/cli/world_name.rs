//! Parses the name of a world on the command line.

use std::ffi::OsStr;
use std::path::PathBuf;

use clap::builder::{PathBufValueParser, PossibleValue, TypedValueParser};

use crate::sim::World;

/// Parses the name of a built-in world or of a file; shells complete the names.
#[derive(Debug, Clone)]
pub(super) struct WorldParser;

impl TypedValueParser for WorldParser {
    type Value = PathBuf;

    fn parse_ref(
        &self,
        command: &clap::Command,
        arg: Option<&clap::Arg>,
        value: &OsStr,
    ) -> Result<PathBuf, clap::Error> {
        PathBufValueParser::new().parse_ref(command, arg, value)
    }

    fn possible_values(&self) -> Option<Box<dyn Iterator<Item = PossibleValue> + '_>> {
        Some(Box::new(World::builtin_names().map(PossibleValue::new)))
    }
}
