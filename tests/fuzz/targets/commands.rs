//! Arbitrary bytes as commands from outside: the payload of a broker's command, and the message of
//! a page over its WebSocket. It is rejected with a short message, or is the same when written and
//! parsed again; and no number from a page gives more than full power.
#![no_main]

use libfuzzer_sys::fuzz_target;
use serde_json::Value;
use spykee::live::understood;
use spykee::mqtt::BrokerCommand;
use spykee::robot::Setpoint;

/// Maximum length of a broker's command.
const LONGEST: usize = 1024;
/// Maximum length of an error message besides the quoted input.
const WORDS: usize = 300;

fuzz_target!(|bytes: &[u8]| {
    let Some((&kind, rest)) = bytes.split_first() else {
        return;
    };
    match (kind & 1, std::str::from_utf8(rest)) {
        (0, _) => broker(rest),
        (_, Ok(text)) => page(text),
        _ => {}
    }
});

fn broker(payload: &[u8]) {
    let mut command = match BrokerCommand::parse(payload) {
        Ok(read) => read,
        Err(error) => {
            let words = error.to_string();
            return assert!(words.len() <= LONGEST + WORDS, "{} bytes of {words}", words.len());
        }
    };
    assert!(payload.len() <= LONGEST, "a command of {} bytes was accepted", payload.len());
    command.id.get_or_insert_with(|| "7".to_owned());
    let said = serde_json::to_string(&command).expect("strings can be written");
    if said.len() <= LONGEST {
        assert_eq!(BrokerCommand::parse(said.as_bytes()), Ok(command), "{said}");
    }
}

fn page(text: &str) {
    let Ok(said) = understood(text) else {
        return;
    };
    assert_eq!(understood(&said).ok().as_ref(), Some(&said), "{text}");
    let message: Value = serde_json::from_str(&said).expect("it was written as JSON");
    if message["type"] == "drive" {
        let number = |key: &str| message[key].as_f64().expect("it is a number");
        let power = Setpoint::from_percent(number("left"), number("right"));
        let most = power.map_or(0, |power| {
            power.left.get().unsigned_abs().max(power.right.get().unsigned_abs())
        });
        assert!(most <= 90, "{said}");
    }
}
