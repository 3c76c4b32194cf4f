//! Any text as a config: it is one whose numbers the rules can work with, or an error in one place.
#![no_main]

use libfuzzer_sys::fuzz_target;
use spykee::config::Config;
use spykee::safety::Watchdog;
use tokio::time::Instant;

fuzz_target!(|text: &str| {
    match Config::parse(text, "fuzz.yaml") {
        Ok(config) => {
            config.watchdog.check().expect("it was checked");
            let _ = Watchdog::new(config.watchdog, Instant::now());
        }
        Err(error) => {
            let words = error.to_string();
            assert!(words.starts_with("fuzz.yaml: "), "{words}");
        }
    }
});
