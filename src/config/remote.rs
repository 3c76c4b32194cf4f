//! The `remote:` section: a service on another computer.

use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The service on another computer that `spykee status`, `behaviour` and `robot` use; the command
/// line can name another.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Remote {
    /// The address of its JSON API, such as `http://10.0.0.7:7788`.
    pub url: Option<String>,
    /// A file with a token of that service in its first line.
    pub token_file: Option<PathBuf>,
}
