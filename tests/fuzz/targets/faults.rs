//! Arbitrary text as a list of faults: the result is a list, or an error that names a place in the
//! text.
#![no_main]

use libfuzzer_sys::fuzz_target;
use spykee::sim::{DocumentError, Fault};

fuzz_target!(|text: &str| {
    match Fault::list_from_yaml(text, "fuzz.yaml") {
        Ok(faults) => assert!(faults.len() <= 200, "{} faults", faults.len()),
        Err(DocumentError::Invalid {
            line,
            column,
            message,
            ..
        }) => {
            assert!(line >= 1 && column >= 1 && !message.is_empty());
            let breaks = ['\n', '\r', '\u{85}', '\u{2028}', '\u{2029}']; // all line breaks of YAML
            let lines = text.matches(breaks).count() + 1;
            assert!(line <= lines + 1, "line {line} of {text:?}");
        }
        Err(other) => panic!("{other}"),
    }
});
