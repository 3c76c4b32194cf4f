//! Any text as a list of faults: it is one, or an error that names a place of the text.
#![no_main]

use libfuzzer_sys::fuzz_target;
use spykee::sim::{Fault, FaultsError};

fuzz_target!(|text: &str| {
    match Fault::list_from_yaml(text, "fuzz.yaml") {
        Ok(faults) => assert!(faults.len() <= 200, "{} faults", faults.len()),
        Err(FaultsError::Invalid {
            line,
            column,
            message,
            ..
        }) => {
            assert!(line >= 1 && column >= 1 && !message.is_empty());
            assert!(line <= text.lines().count() + 1, "line {line} of {text:?}");
        }
        Err(other) => panic!("{other}"),
    }
});
