//! Global names that exist only in another kind of file, or once a module is loaded.

use super::{function, module, namespace};

/// The function that only files with scenarios have.
pub const SCENARIO: &str = "scenario";

/// Says where a global name exists that a file does not have: in a module that must be loaded first,
/// or in another kind of file. `None` if the API has no such name.
pub fn elsewhere(name: &str, in_scenario: bool) -> Option<String> {
    if module(name).is_some() {
        return Some(format!(
            "if you mean the module, load it first: local {name} = require(\"@spykee/{name}\")"
        ));
    }
    if in_scenario && namespace(name).is_some() {
        return Some(format!(
            "only behaviours have {name}; a scenario uses sim, such as sim:run(FILE)"
        ));
    }
    (!in_scenario && function(name).is_some()).then(|| {
        format!("{name} exists only in files with scenarios, whose names end in _test.lua")
    })
}
