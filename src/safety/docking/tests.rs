use super::*;

const SECOND: Duration = Duration::from_secs(1);

fn plan(retries: u32) -> DockPlan {
    DockPlan {
        timeout: 10 * SECOND,
        retries,
        charge_timeout: 5 * SECOND,
    }
}

fn reversing(retries: u32) -> DockLimits {
    DockLimits {
        plan: plan(retries),
        retry: Retry::Reverse(SECOND),
    }
}

fn once() -> DockLimits {
    DockLimits {
        plan: plan(0),
        retry: Retry::Never,
    }
}

fn started(approach: DockLimits) -> (Docking, Instant) {
    let now = Instant::now();
    let (docking, actions) = Docking::start(approach, false, now);
    assert_eq!(actions, [DockAction::Find]);
    (docking, now)
}

#[test]
fn docked_means_charging() {
    let (mut docking, now) = started(reversing(0));
    assert_eq!(docking.engine(EngineReport::Docked, now + SECOND), []);
    assert_eq!(docking.outcome(), None);
    assert_eq!(docking.charging(now + 2 * SECOND), []);
    let outcome = DockOutcome {
        end: DockEnd::Done,
        attempts: 1,
        took: 2 * SECOND,
    };
    assert_eq!(docking.outcome(), Some(outcome));
}

#[test]
fn a_search_that_fails_is_tried_again_from_another_place() {
    let (mut docking, now) = started(reversing(1));
    assert_eq!(
        docking.engine(EngineReport::BaseNotFound, now),
        [DockAction::Reverse]
    );
    assert_eq!(docking.poll(now + SECOND / 2), []);
    assert_eq!(docking.poll(now + SECOND), [DockAction::Find]);
    assert_eq!(
        docking.engine(EngineReport::BaseNotFound, now + SECOND),
        [DockAction::Halt]
    );
    let outcome = docking.outcome().unwrap();
    assert_eq!((outcome.end, outcome.attempts), (DockEnd::BaseNotFound, 2));
}

#[test]
fn a_search_that_takes_too_long_is_cancelled_first() {
    let (mut docking, now) = started(once());
    let actions = docking.poll(now + 10 * SECOND);
    assert_eq!(actions, [DockAction::Cancel, DockAction::Halt]);
    assert_eq!(docking.outcome().unwrap().end, DockEnd::Timeout);
    let (mut docking, now) = started(reversing(1));
    let actions = docking.poll(now + 10 * SECOND);
    assert_eq!(actions, [DockAction::Cancel, DockAction::Reverse]);
    assert_eq!(docking.poll(now + 11 * SECOND), [DockAction::Find]);
}

#[test]
fn without_charging_a_behaviour_tries_again_and_a_low_robot_stays() {
    let (mut docking, now) = started(reversing(1));
    docking.engine(EngineReport::Docked, now);
    assert_eq!(docking.poll(now + 5 * SECOND), [DockAction::Undock]);
    assert_eq!(
        docking.engine(EngineReport::Undocked, now + 6 * SECOND),
        [DockAction::Find]
    );

    let (mut docking, now) = started(once());
    docking.engine(EngineReport::Docked, now);
    assert_eq!(docking.poll(now + 5 * SECOND), []);
    assert_eq!(docking.outcome().unwrap().end, DockEnd::NotCharging);
}

#[test]
fn a_docking_without_charging_in_any_attempt_ends_as_not_charging() {
    let (mut docking, now) = started(reversing(1));
    for actions in [vec![DockAction::Undock], vec![]] {
        docking.engine(EngineReport::Docked, now);
        assert_eq!(docking.poll(now + 5 * SECOND), actions);
        docking.engine(EngineReport::Undocked, now);
    }
    let outcome = docking.outcome().unwrap();
    assert_eq!((outcome.end, outcome.attempts), (DockEnd::NotCharging, 2));
}

#[test]
fn an_undocking_before_charging_is_a_failed_attempt() {
    let (mut docking, now) = started(reversing(1));
    docking.engine(EngineReport::Docked, now);
    let actions = docking.engine(EngineReport::Undocked, now + SECOND);
    assert_eq!(actions, [DockAction::Reverse]);
}

#[test]
fn lost_contact_leads_to_a_search_or_to_the_end() {
    let (mut docking, now) = started(once());
    assert!(docking.is_searching());
    assert_eq!(docking.lost_contact(Doubt::Contact, now), []);
    docking.engine(EngineReport::Docked, now);
    assert!(!docking.is_searching());
    assert_eq!(
        docking.lost_contact(Doubt::Leaving, now),
        [DockAction::Find]
    );
    docking.engine(EngineReport::Docked, now);
    assert_eq!(docking.lost_contact(Doubt::Contact, now), []);
    assert_eq!(docking.outcome().unwrap().end, DockEnd::NotCharging);
}

#[test]
fn cancelling_ends_the_search_or_the_reversing() {
    let (mut docking, now) = started(reversing(1));
    assert_eq!(
        docking.cancel(DockEnd::Cancelled, now),
        [DockAction::Cancel]
    );
    assert_eq!(docking.outcome().unwrap().end, DockEnd::Cancelled);

    let (mut docking, now) = started(reversing(1));
    docking.engine(EngineReport::BaseNotFound, now);
    assert_eq!(docking.cancel(DockEnd::Safety, now), [DockAction::Halt]);
    assert_eq!(docking.poll(now + 60 * SECOND), []);
}

#[test]
fn on_the_station_no_search_begins() {
    let now = Instant::now();
    let (mut docking, actions) = Docking::start(reversing(2), true, now);
    assert_eq!(actions, []);
    assert_eq!(docking.poll(now + 5 * SECOND), []);
    assert_eq!(docking.outcome().unwrap().end, DockEnd::NotCharging);
}
