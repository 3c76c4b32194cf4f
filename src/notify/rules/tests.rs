use super::*;
use crate::robot::{RobotInfo, WatchdogState};

const LONG: Duration = Duration::from_secs(600);

fn up() -> AgentEvent {
    AgentEvent::LinkUp {
        robot: RobotInfo {
            uid: "SPYKEE7".to_owned(),
            name: "Rover".to_owned(),
            firmware: String::new(),
            address: String::new(),
            simulated: false,
        },
        docked: false,
    }
}

fn down() -> AgentEvent {
    let reason = "closed".to_owned();
    AgentEvent::LinkDown { reason }
}

fn failed(behaviour: &str) -> AgentEvent {
    AgentEvent::Ended {
        behaviour: behaviour.to_owned(),
        reason: EndReason::Error,
        message: Some("a.lua:3: no".to_owned()),
        seconds: 1.0,
    }
}

fn low(low: bool) -> AgentEvent {
    AgentEvent::Watchdog {
        state: WatchdogState::Free,
        low,
        docked: false,
    }
}

#[test]
fn a_robot_out_of_reach_is_reported_once_and_its_return_too() {
    let mut now = Instant::now();
    let mut rules = Rules::new(LONG, now);
    assert_eq!(rules.handle_event(&up(), now), None);
    assert_eq!(rules.deadline(), None);
    rules.handle_event(&down(), now);
    now += LONG / 2;
    assert_eq!(rules.poll(now), None);
    // Another failure meanwhile changes nothing.
    rules.handle_event(&down(), now);
    now += LONG / 2;
    let notification = rules.poll(now).unwrap();
    assert_eq!(
        notification.text,
        "Rover has been out of reach for 10 min: closed"
    );
    assert_eq!((rules.poll(now + LONG), rules.deadline()), (None, None));
    assert!(
        rules
            .handle_event(&up(), now)
            .unwrap()
            .text
            .contains("in reach again")
    );
    rules.handle_event(&down(), now);
    assert_eq!(
        rules.handle_event(&up(), now),
        None,
        "a short absence is not reported"
    );
}

#[test]
fn a_robot_that_was_never_connected_is_reported_too() {
    let now = Instant::now();
    let mut rules = Rules::new(LONG, now);
    assert!(
        rules
            .poll(now + LONG)
            .unwrap()
            .text
            .contains("spykee has been")
    );
}

#[test]
fn a_low_battery_is_reported_on_change_and_each_failure_at_intervals() {
    let mut now = Instant::now();
    let mut rules = Rules::new(LONG, now);
    assert_eq!(rules.handle_event(&low(true), now).unwrap().rule, Rule::Low);
    assert_eq!(rules.handle_event(&low(true), now), None);
    assert_eq!(rules.handle_event(&low(false), now), None);
    assert!(rules.handle_event(&low(true), now).is_some());
    assert!(
        rules
            .handle_event(&failed("a"), now)
            .unwrap()
            .text
            .contains("a.lua:3")
    );
    assert_eq!(rules.handle_event(&failed("a"), now), None);
    assert!(
        rules.handle_event(&failed("b"), now).is_some(),
        "of another behaviour"
    );
    now += AGAIN;
    assert!(rules.handle_event(&failed("a"), now).is_some());
}

#[test]
fn each_rule_of_the_config_has_its_event_and_its_text() {
    let behaviour = || "patrol".to_owned();
    let entry = |kind: &str| AgentEvent::Entry {
        behaviour: behaviour(),
        kind: kind.to_owned(),
        data: serde_json::json!({ "energy": 3.5, "where": "door" }),
    };
    let alarm = AgentEvent::Safety {
        action: SafetyAction::Alarm,
        reason: "no station".to_owned(),
    };
    let given_up = AgentEvent::GivenUp {
        behaviour: behaviour(),
        message: "no".to_owned(),
    };
    let missed = AgentEvent::StartMissed {
        behaviour: behaviour(),
        reason: "no robot was connected".to_owned(),
    };
    let sent = AgentEvent::Notify {
        behaviour: behaviour(),
        text: "look".to_owned(),
        picture: Some("a.jpg".into()),
    };
    let now = Instant::now();
    for (what, rule, text) in [
        (alarm, Rule::Alarm, "the alarm sounds: no station"),
        (
            given_up,
            Rule::RunFailed,
            "patrol is given up, it failed too often: no",
        ),
        (
            missed,
            Rule::StartMissed,
            "patrol did not start: no robot was connected",
        ),
        (
            entry("moved"),
            Rule::Moved,
            "patrol: something moved (energy 3.5, where door)",
        ),
        (
            entry("noise"),
            Rule::Moved,
            "patrol: a noise (energy 3.5, where door)",
        ),
        (sent, Rule::Script, "look"),
    ] {
        let notification = Rules::new(LONG, now).handle_event(&what, now).unwrap();
        assert_eq!((notification.rule, &*notification.text), (rule, text));
        assert_eq!(notification.picture.is_some(), rule == Rule::Script);
    }
    assert_eq!(
        Rules::new(LONG, now).handle_event(&entry("lamp"), now),
        None
    );
}

#[test]
fn only_failed_dockings_are_reported() {
    let now = Instant::now();
    let dock = |end| AgentEvent::Dock {
        by: None,
        end,
        attempts: 1,
        seconds: 180.0,
    };
    for end in [
        DockEnd::Done,
        DockEnd::Cancelled,
        DockEnd::Preempted,
        DockEnd::Disconnected,
    ] {
        assert_eq!(
            Rules::new(LONG, now).handle_event(&dock(end), now),
            None,
            "{end}"
        );
    }
    let notification = Rules::new(LONG, now).handle_event(&dock(DockEnd::BaseNotFound), now);
    assert_eq!(notification.unwrap().rule, Rule::NotDocked);
}
