//! The `remote:` section: a service on another computer that the tools ask.

use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Where `spykee status`, `behaviour` and `robot` ask, unless the command line says something else.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Remote {
    /// The address of its JSON API, such as `http://10.0.0.7:7788`.
    pub url: Option<String>,
    /// The file whose first line is a token of that service.
    pub token_file: Option<PathBuf>,
}
