//! The discovery payload that describes the agent's entities to Home Assistant: one device, by
//! device-based discovery.
//! <https://www.home-assistant.io/integrations/mqtt/#device-discovery-payload>

use serde_json::{Value, json};

use super::topics::{Presence, Topics};
use crate::robot::RobotInfo;

/// The event types of the event entity. Battery and watchdog are in the state, and a patrol saves two
/// thousand pictures a day.
pub(super) const EVENTS: [&str; 15] = [
    "link_up",
    "link_down",
    "safety",
    "dock",
    "undock",
    "started",
    "ended",
    "given_up",
    "start_missed",
    "standstill",
    "stop_engaged",
    "stop_reset",
    "timetable_changed",
    "entry",
    "notify",
];

/// `page` is the address of the page, if other computers can open it.
pub(super) fn discovery(
    topics: &Topics,
    robot: &RobotInfo,
    behaviours: &[String],
    page: Option<&str>,
) -> Value {
    let online = Presence::Online.name();
    let mut device = json!({
        "identifiers": [format!("spykee_{}", topics.id)],
        "name": robot.name,
        "manufacturer": "Meccano",
        "model": "Spykee",
        "serial_number": robot.uid,
        "sw_version": robot.firmware,
    });
    if let Some(page) = page {
        device["configuration_url"] = page.into();
    }
    json!({
        "device": device,
        "origin": { "name": "spykee", "sw_version": env!("CARGO_PKG_VERSION") },
        "availability": [{
            "topic": topics.named("connection"),
            "value_template": format!("{{{{ 'online' if value == '{online}' else 'offline' }}}}"),
        }],
        "qos": 1,
        "components": components(topics, behaviours),
    })
}

/// An entity: its platform, its key and its name, with what only it has.
type Entity = (&'static str, &'static str, Value, Value);

fn components(topics: &Topics, behaviours: &[String]) -> Value {
    let mut entities = robot(topics);
    entities.extend(sensors(topics));
    entities.extend(timetable(topics));
    entities.extend(buttons(topics));
    if !behaviours.is_empty() {
        let select = json!({
            "state_topic": topics.named("state"),
            "value_template": "{{ value_json.behaviour }}",
            "command_topic": topics.named("behaviour/set"),
            "options": behaviours,
            // The broker keeps the choice, also while no run is active.
            "retain": true,
            "icon": "mdi:script-text-play-outline",
        });
        entities.push(("select", "behaviour", "Behaviour".into(), select));
    }
    let id = &topics.id;
    let object = id.to_lowercase().replace('-', "_");
    let complete = |(platform, key, name, mut entity): Entity| {
        entity["platform"] = platform.into();
        entity["name"] = name;
        entity["unique_id"] = format!("spykee_{id}_{key}").into();
        entity["default_entity_id"] = format!("{platform}.{object}_{key}").into();
        (key.to_owned(), entity)
    };
    Value::Object(entities.into_iter().map(complete).collect())
}

fn robot(topics: &Topics) -> Vec<Entity> {
    let vacuum = json!({
        "state_topic": topics.named("state"),
        "command_topic": topics.named("command"),
        "supported_features": ["start", "stop", "return_home", "locate"],
    });
    let camera = json!({ "topic": topics.named("picture") });
    let alarm = json!({ "image_topic": topics.named("alarm"), "content_type": "image/jpeg" });
    let event = json!({ "state_topic": topics.named("event"), "event_types": EVENTS });
    vec![
        ("vacuum", "robot", Value::Null, vacuum),
        ("camera", "camera", "Camera".into(), camera),
        ("image", "alarm", "Last alarm".into(), alarm),
        ("event", "event", "Last event".into(), event),
    ]
}

fn sensors(topics: &Topics) -> Vec<Entity> {
    let state = topics.named("state");
    let sensor = |class: &str, template: &str| {
        json!({
            "device_class": class,
            "state_topic": state,
            "value_template": template,
            "entity_category": "diagnostic",
        })
    };
    let mut battery = sensor("battery", "{{ value_json.battery }}");
    battery["unit_of_measurement"] = "%".into();
    battery["state_class"] = "measurement".into();
    let charging = "{{ 'ON' if value_json.charging else 'OFF' }}";
    let charging = sensor("battery_charging", charging);
    let mut problem = sensor("problem", "{{ 'ON' if value_json.problem else 'OFF' }}");
    problem["json_attributes_topic"] = state.clone().into();
    problem["json_attributes_template"] =
        "{{ {'reason': value_json.reason, 'link': value_json.link, 'watchdog': value_json.watchdog} | tojson }}"
            .into();
    vec![
        ("sensor", "battery", "Battery".into(), battery),
        ("binary_sensor", "charging", "Charging".into(), charging),
        ("binary_sensor", "problem", "Problem".into(), problem),
    ]
}

fn timetable(topics: &Topics) -> Vec<Entity> {
    let state = topics.named("state");
    let command = topics.named("command");
    let next = json!({
        "device_class": "timestamp",
        "state_topic": state,
        "value_template": "{{ value_json.next }}",
        "entity_category": "diagnostic",
        "json_attributes_topic": state,
        "json_attributes_template": "{{ {'behaviour': value_json.next_behaviour} | tojson }}",
    });
    let skip = json!({
        "state_topic": state,
        "value_template": "{{ 'skip' if value_json.next_skipped else 'unskip' }}",
        "command_topic": command,
        "payload_on": "skip",
        "payload_off": "unskip",
        "icon": "mdi:debug-step-over",
    });
    let pause = json!({
        "state_topic": state,
        "value_template": "{{ value_json.paused or '' }}",
        "command_topic": command,
        "command_template": "pause {{ value }}",
        "max": 40,
        "icon": "mdi:calendar-remove",
    });
    vec![
        ("sensor", "next", "Next start".into(), next),
        ("switch", "skip", "Leave out the next start".into(), skip),
        ("text", "pause", "Timetable paused until".into(), pause),
    ]
}

fn buttons(topics: &Topics) -> Vec<Entity> {
    [
        ("dock", "Dock", "mdi:home-import-outline"),
        ("undock", "Undock", "mdi:home-export-outline"),
        ("stop", "Stop", "mdi:stop"),
        ("reset_stop", "Release STOP", "mdi:lock-open-variant"),
        ("snapshot", "Take a picture", "mdi:camera"),
        ("resume", "Resume the timetable", "mdi:calendar-check"),
    ]
    .map(|(payload, name, icon)| {
        let button = json!({
            "command_topic": topics.named("command"),
            "payload_press": payload,
            "icon": icon,
        });
        ("button", payload, name.into(), button)
    })
    .into()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The exact payload for Home Assistant: a change here is visible to every user of the
    /// integration.
    const GOLDEN: &str = include_str!("discovery/golden.json");

    fn robot() -> RobotInfo {
        RobotInfo {
            uid: "SPYKEE0001".to_owned(),
            name: "Rover".to_owned(),
            firmware: "1.0.22".to_owned(),
            address: "10.0.0.2:9000".to_owned(),
            simulated: false,
        }
    }

    #[test]
    fn the_discovery_payload_is_exactly_the_golden_one() {
        let topics = Topics::new("SPYKEE0001");
        let behaviours = ["patrol".to_owned(), "guard".to_owned()];
        let page = Some("http://192.168.1.7:7788/");
        let mut payload = discovery(&topics, &robot(), &behaviours, page);
        // Changes with each release.
        payload["origin"]["sw_version"] = "0".into();
        let golden: Value = serde_json::from_str(GOLDEN).unwrap();
        let text = serde_json::to_string_pretty(&payload).unwrap();
        assert_eq!(payload, golden, "{text}");
        assert_eq!(topics.discovery(), "homeassistant/device/SPYKEE0001/config");
    }

    #[test]
    fn without_behaviours_there_is_no_select_entity() {
        let topics = Topics::new("SPYKEE0001");
        let payload = discovery(&topics, &robot(), &[], None);
        assert_eq!(payload["device"]["configuration_url"], Value::Null);
        assert_eq!(payload["components"]["behaviour"], Value::Null);
        assert!(payload["components"]["robot"].is_object());
    }
}
