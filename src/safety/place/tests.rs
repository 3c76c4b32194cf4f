use super::*;

const SECOND: Duration = Duration::from_secs(1);

#[test]
fn each_place_has_a_description() {
    let texts = [
        DockState::Charging,
        DockState::ContactReported,
        DockState::Left(Evidence::Login),
        DockState::Unknown,
    ];
    let texts = texts.map(|place| place.to_string());
    assert_eq!(texts[0], "on its station, charging");
    assert_eq!(texts[2], "off its station");
    assert!(texts.iter().all(|text| !text.is_empty()));
}

fn nowhere() -> (DockTracker, Instant) {
    (DockTracker::new(30 * SECOND), Instant::now())
}

fn on_contact() -> (DockTracker, Instant) {
    let (mut place, now) = nowhere();
    place.login(true, false, now);
    (place, now)
}

#[test]
fn each_report_sets_its_place() {
    let (mut place, now) = nowhere();
    assert_eq!(place.place(), DockState::Unknown);
    place.login(false, false, now);
    assert_eq!(place.place(), DockState::Left(Evidence::Login));
    place.docked(now);
    assert_eq!(place.place(), DockState::ContactReported);
    place.power(true, now);
    assert_eq!(place.place(), DockState::Charging);
    place.docked(now);
    assert_eq!(place.place(), DockState::Charging, "a late report");
    place.power(false, now);
    assert_eq!(
        place.place(),
        DockState::ContactReported,
        "full, or no current"
    );
    place.undocked(now);
    assert_eq!(place.place(), DockState::Left(Evidence::Engine));
}

#[test]
fn charging_that_ends_without_reported_contact_leaves_the_place_unknown() {
    let (mut place, now) = nowhere();
    place.login(false, false, now);
    place.power(true, now);
    place.power(false, now);
    assert_eq!(place.place(), DockState::Unknown);
}

#[test]
fn an_unconfirmed_undocking_leaves_the_place_unknown() {
    let (mut place, now) = on_contact();
    place.power(true, now);
    place.leave_station(20 * SECOND, now);
    assert_eq!(place.next_deadline(false), Some(now + 20 * SECOND));
    place.poll(false, now + 19 * SECOND);
    assert!(place.on_station() && place.is_leaving());
    assert_eq!(place.poll(false, now + 20 * SECOND), Some(Doubt::Leaving));
    assert_eq!(place.place(), DockState::Unknown);
    assert!(!place.is_leaving());
    assert_eq!(place.next_deadline(false), None);
}

#[test]
fn a_confirmation_is_awaited_for_a_minute_at_most() {
    let (mut place, now) = on_contact();
    place.leave_station(Duration::MAX, now);
    place.poll(false, now + 60 * SECOND);
    assert_eq!(place.place(), DockState::Unknown);
}

#[test]
fn charging_that_ends_after_charge_stop_is_evidence_and_the_robot_still_backs_out() {
    let (mut place, now) = on_contact();
    place.power(true, now);
    place.leave_station(20 * SECOND, now);
    place.power(false, now + SECOND);
    assert_eq!(place.place(), DockState::Left(Evidence::Power));
    assert!(place.is_leaving());
    place.poll(false, now + 20 * SECOND);
    assert_eq!(place.place(), DockState::Left(Evidence::Power));
    assert!(!place.is_leaving());
}

#[test]
fn a_report_ends_the_wait_for_a_confirmation() {
    for docked in [true, false] {
        let (mut place, now) = on_contact();
        place.leave_station(20 * SECOND, now);
        if docked {
            place.docked(now);
        } else {
            place.undocked(now);
        }
        assert!(!place.is_leaving());
        place.poll(false, now + 60 * SECOND);
        assert_eq!(place.on_station(), docked);
    }
}

#[test]
fn contact_without_charging_expires_only_while_low() {
    let (mut place, now) = on_contact();
    place.poll(false, now + 3600 * SECOND);
    assert_eq!(place.place(), DockState::ContactReported);
    let low = now + 7200 * SECOND;
    place.expect_charge(low);
    assert_eq!(place.next_deadline(true), Some(low + 30 * SECOND));
    assert_eq!(place.next_deadline(false), None);
    place.poll(true, low + 29 * SECOND);
    assert_eq!(place.place(), DockState::ContactReported);
    assert_eq!(place.poll(true, low + 30 * SECOND), Some(Doubt::Contact));
    assert_eq!(place.place(), DockState::Unknown);
}

#[test]
fn a_new_login_does_not_extend_contact_while_low() {
    let (mut place, now) = on_contact();
    for second in 1..30 {
        place.login(true, true, now + second * SECOND);
        assert_eq!(place.next_deadline(true), Some(now + 30 * SECOND));
    }
    place.login(true, true, now + 30 * SECOND);
    assert_eq!(place.place(), DockState::Unknown);
    place.docked(now + 40 * SECOND);
    assert_eq!(place.next_deadline(true), Some(now + 70 * SECOND));
}

#[test]
fn a_new_login_renews_contact_once_the_battery_was_good() {
    let (mut place, now) = on_contact();
    place.expect_charge(now);
    place.poll(true, now + 30 * SECOND);
    place.poll(false, now + 31 * SECOND);
    place.login(true, true, now + 40 * SECOND);
    assert_eq!(place.place(), DockState::ContactReported);
}

#[test]
fn expired_contact_is_not_believed_at_the_next_login_while_low() {
    let (mut place, now) = on_contact();
    assert_eq!(place.poll(true, now + 30 * SECOND), Some(Doubt::Contact));
    assert!(place.has_contact());
    place.login(true, true, now + 31 * SECOND);
    assert_eq!(place.place(), DockState::Unknown);
}

#[test]
fn contact_reported_after_its_expiry_has_new_time() {
    let (mut place, now) = on_contact();
    place.docked(now + 10 * SECOND);
    assert_eq!(place.next_deadline(true), Some(now + 30 * SECOND));
    place.docked(now + 30 * SECOND);
    assert_eq!(place.next_deadline(true), Some(now + 60 * SECOND));
}

#[test]
fn charging_that_ends_on_the_contacts_may_resume_in_time() {
    let (mut place, now) = on_contact();
    place.power(true, now);
    assert_eq!(place.next_deadline(true), None);
    place.power(false, now + 100 * SECOND);
    assert_eq!(place.next_deadline(true), Some(now + 130 * SECOND));
}

#[test]
fn an_unconfirmed_undocking_clears_contact() {
    let (mut place, now) = on_contact();
    place.leave_station(20 * SECOND, now);
    assert!(place.has_contact());
    place.poll(false, now + 20 * SECOND);
    assert!(!place.has_contact());
}

#[test]
fn after_a_suspension_an_undocking_is_in_doubt() {
    let (mut place, now) = on_contact();
    place.doubt_leaving();
    assert_eq!(place.place(), DockState::ContactReported);
    place.leave_station(20 * SECOND, now);
    place.doubt_leaving();
    assert_eq!(place.place(), DockState::Unknown);
}
