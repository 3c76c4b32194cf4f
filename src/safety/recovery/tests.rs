use super::*;

const SECOND: Duration = Duration::from_secs(1);
const WHO: BehaviourId = BehaviourId(7);
const STANDING: RecoveryOptions = RecoveryOptions {
    rescuer: None,
    leg: false,
};
const BLIND: RecoveryOptions = RecoveryOptions {
    leg: true,
    ..STANDING
};
const SEEING: RecoveryOptions = RecoveryOptions {
    rescuer: Some(WHO),
    ..BLIND
};

/// The first search began a while ago.
fn searching() -> (Recovery, Instant) {
    let now = Instant::now();
    let mut recovery = Recovery::new(&Limits::default(), now);
    assert_eq!(recovery.poll(true, now), Some(RecoveryStep::Search));
    assert_eq!(recovery.next_deadline(now), None);
    (recovery, now + 60 * SECOND)
}

#[test]
fn a_leg_begins_at_once_and_a_search_follows_it() {
    let (mut recovery, now) = searching();
    let next = recovery.failed(DockEnd::BaseNotFound, BLIND, now);
    assert_eq!((next, recovery.legs()), (AfterFailure::Leg, 1));
    assert!(recovery.setpoint(now + SECOND).is_some());
    let due = recovery.next_deadline(now).unwrap();
    assert_eq!(due, now + 2 * SECOND);
    assert_eq!(recovery.next_deadline(due), Some(due), "at once");
    assert_eq!(recovery.poll(true, now + SECOND), None);
    assert_eq!(recovery.poll(true, due), Some(RecoveryStep::Search));
    assert_eq!(recovery.setpoint(due), None);
    recovery.failed(DockEnd::BaseNotFound, BLIND, due);
    assert_eq!(recovery.legs(), 2);
    recovery.end(due);
    assert_eq!(
        recovery.poll(true, due + SECOND),
        Some(RecoveryStep::Search)
    );
    let due = due + SECOND;
    assert_eq!(recovery.poll(true, due), None, "not twice in a second");
}

#[test]
fn a_search_that_ended_without_a_report_is_followed_by_another() {
    let (mut recovery, now) = searching();
    assert_eq!(recovery.poll(true, now), Some(RecoveryStep::Search));
    assert_eq!(recovery.poll(true, now), None, "not twice in a second");
    assert_eq!(recovery.next_deadline(now), Some(now + SECOND));
}

#[test]
fn a_rescuer_drives_before_a_blind_leg() {
    let (mut recovery, now) = searching();
    let next = recovery.failed(DockEnd::BaseNotFound, SEEING, now);
    assert_eq!((next, recovery.borrower()), (AfterFailure::Loan, Some(WHO)));
    recovery.note_motion(true, now + SECOND);
    let due = now + 8 * SECOND;
    assert_eq!(recovery.next_deadline(now), Some(due));
    assert_eq!(recovery.poll(true, due), Some(RecoveryStep::Search));
    assert_eq!(recovery.borrower(), None);
}

#[test]
fn an_unused_loan_is_followed_by_a_leg_where_one_is_allowed() {
    for (may_drive, next) in [(true, RecoveryStep::Leg), (false, RecoveryStep::Search)] {
        let (mut recovery, now) = searching();
        recovery.failed(DockEnd::BaseNotFound, SEEING, now);
        let due = now + Loan::FIRST;
        assert_eq!(recovery.poll(may_drive, due), Some(next));
    }
}

#[test]
fn only_base_not_found_leads_to_a_leg() {
    let (mut recovery, now) = searching();
    let next = recovery.failed(DockEnd::Timeout, BLIND, now);
    assert_eq!(next, AfterFailure::Pause(20 * SECOND));
    let next = recovery.failed(DockEnd::NotCharging, SEEING, now);
    assert_eq!(next, AfterFailure::Search);
    assert_eq!(recovery.poll(true, now), Some(RecoveryStep::Search));
}

#[test]
fn all_pauses_are_the_same() {
    let (mut recovery, mut now) = searching();
    for _ in 0..4 {
        let next = recovery.failed(DockEnd::BaseNotFound, STANDING, now);
        assert_eq!(next, AfterFailure::Pause(20 * SECOND));
        let due = recovery.next_deadline(now).unwrap();
        assert_eq!(due, now + 20 * SECOND);
        assert_eq!(recovery.poll(true, due), Some(RecoveryStep::Search));
        now = due + 60 * SECOND;
    }
    assert!(recovery.is_alarming());
}

#[test]
fn a_leg_that_is_no_longer_allowed_ends() {
    let (mut recovery, now) = searching();
    recovery.failed(DockEnd::BaseNotFound, BLIND, now);
    assert_eq!(
        recovery.poll(false, now + SECOND),
        Some(RecoveryStep::Search)
    );
}

#[test]
fn an_interruption_ends_everything_but_a_pause() {
    let (mut recovery, now) = searching();
    recovery.failed(DockEnd::BaseNotFound, BLIND, now);
    recovery.interrupt(now);
    assert_eq!(recovery.next_deadline(now), Some(now + SECOND));
    assert_eq!(
        recovery.poll(true, now + SECOND),
        Some(RecoveryStep::Search)
    );
    recovery.failed(DockEnd::Timeout, STANDING, now + SECOND);
    let due = recovery.next_deadline(now);
    recovery.interrupt(now + 2 * SECOND);
    assert_eq!(recovery.next_deadline(now), due);
    recovery.search_at_once(now + 3 * SECOND);
    assert_eq!(
        recovery.poll(true, now + 3 * SECOND),
        Some(RecoveryStep::Search)
    );
}

#[test]
fn ending_a_loan_changes_nothing_in_a_pause_or_a_search() {
    let (mut recovery, now) = searching();
    recovery.end(now);
    assert_eq!(recovery.next_deadline(now), None);
    recovery.failed(DockEnd::BaseNotFound, STANDING, now);
    recovery.end(now);
    assert_eq!(recovery.next_deadline(now), Some(now + 20 * SECOND));
    recovery.search_at_once(now);
    recovery.poll(true, now);
    recovery.failed(DockEnd::BaseNotFound, BLIND, now + SECOND);
    recovery.end(now + 2 * SECOND);
    assert_eq!(
        recovery.poll(true, now + 2 * SECOND),
        Some(RecoveryStep::Search)
    );
}
