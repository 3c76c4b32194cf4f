use super::*;
use crate::robot::Priority;
use proptest::prelude::*;

fn error(text: &str) -> String {
    Config::parse(text, "spykee.yaml").unwrap_err().to_string()
}

#[test]
fn an_empty_file_is_all_defaults() {
    let config = Config::parse("# nothing yet\n", "spykee.yaml").unwrap();
    assert_eq!(config.watchdog, safety::Limits::default());
    assert!(config.robot.is_none() && config.behaviours.is_empty());
}

#[test]
fn all_sections_are_read() {
    let text = "robot: 172.17.6.1\nbehaviours:\n  - file: patrol.lua\n    priority: 3\n\
                watchdog: { low: 25, host_silence: 0.5 }\n";
    let config = Config::parse(text, "spykee.yaml").unwrap();
    assert_eq!(config.robot.unwrap().to_string(), "172.17.6.1:9000");
    assert_eq!(config.behaviours[0].priority, Priority(3));
    assert_eq!(config.watchdog.low.get(), 25);
}

#[test]
fn an_unknown_key_is_refused_with_its_place() {
    let text = error("watchdog:\n  lwo: 20\n");
    assert!(
        text.contains("lwo") && text.contains("line 2 column 3"),
        "{text}"
    );
}

#[test]
fn an_unknown_key_in_the_first_line_is_refused_with_its_place() {
    let text = error("colors: {}\n");
    assert!(
        text.contains("line 1 column 1; did you mean 'colours'?"),
        "{text}"
    );
}

#[test]
fn errors_name_no_types_of_this_program() {
    for (yaml, told) in [
        ("mqtt: broker.local\n", "expected keys with values"),
        ("live: { listen: 7788 }\n", "expected IP:PORT"),
        (
            "live: { viewers: many }\n",
            "expected a whole number from 0 at",
        ),
        ("schedule:\n  - at: */5 * * * *\n", "in quotes"),
        ("robot: a\n\tuser: b\n", "not with tabs"),
        (
            "mqtt:\n  host: broker:1883\n",
            "mqtt.host: `broker:1883` is not a host: write `host: broker` and `port: 1883` at",
        ),
        (
            "remote:\n  url: 10.0.0.7:7788\n",
            "remote.url: expected http://HOST:PORT or https://HOST",
        ),
        ("live:\n\tlisten: b\n", "not with tabs"),
    ] {
        let text = error(yaml);
        assert!(text.contains(told), "{yaml}: {text}");
    }
}

#[test]
fn a_wrong_value_is_refused_with_its_place_and_range() {
    let text = error("watchdog:\n  ok: 60\n  low: 120\n");
    assert!(
        text.contains("line 3 column 8") && text.contains("from 0 to 100"),
        "{text}"
    );
}

#[test]
fn invalid_numbers_are_refused_with_their_place() {
    for wrong in [
        "calibration:\n  full_speed: 0\n",
        "calibration:\n  track_width: .nan\n",
        "camera:\n  hfov: 0\n",
        "camera:\n  distortion: [-3, 0]\n",
        "limits:\n  memory_bytes: 0\n",
        "limits:\n  frame_bytes: -1\n",
        "limits:\n  callback_budget_ms: 0.5\n",
        "limits:\n  noise_dbfs: .nan\n",
        "schedule:\n- { run: patrol, at: \"0 25 * * *\" }\n",
        "service:\n  idle_after: soon\n",
    ] {
        let text = error(wrong);
        assert!(
            text.contains("line 2 column") && text.contains("expected"),
            "{text}"
        );
    }
    let good = "limits: { memory_bytes: 16777216 }\ncamera: { hfov: 1 }\n";
    let config = Config::parse(good, "spykee.yaml").unwrap();
    assert_eq!(config.limits.memory_bytes, 16 << 20);
}

#[test]
fn a_topic_without_a_broker_is_refused() {
    let target = "notify: { targets: { house: { topic: a } } }\n";
    assert!(error(target).contains("notify.targets.house"));
    let named = format!("{target}mqtt: {{ host: broker.local }}\n");
    Config::parse(&named, "spykee.yaml").unwrap();
}

#[test]
fn levels_that_do_not_rise_are_refused() {
    assert!(error("watchdog: { low: 60 }").contains("must rise"));
}

proptest! {
    #[test]
    fn no_text_causes_a_panic(text in "[ -~\n]{0,200}") {
        let _ = Config::parse(&text, "spykee.yaml");
    }
}
