//! Arbitrary text as a config: the result is a config with numbers valid for the safety rules, or
//! an error that names the file.
#![no_main]

use libfuzzer_sys::fuzz_target;
use spykee::config::Config;
use spykee::safety::Watchdog;
use tokio::time::Instant;

fuzz_target!(|text: &str| {
    match Config::parse(text, "fuzz.yaml") {
        Ok(config) => {
            config.watchdog.check().expect("the parser has checked it");
            let _ = Watchdog::new(config.watchdog, Instant::now());
        }
        Err(error) => {
            let words = error.to_string();
            assert!(words.starts_with("fuzz.yaml: "), "{words}");
        }
    }
});
