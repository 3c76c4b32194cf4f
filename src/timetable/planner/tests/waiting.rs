//! Starts that wait for the robot, and starts that do not reach it.

use super::*;

#[test]
fn a_start_that_waits_for_the_robot_outlives_the_service() {
    let mut world = World::new(patrol(), "2026-05-04 08:59");
    world.ready = false;
    world.pass(2 * MINUTE);
    let record = world.planner.record();
    world.pass(2 * MINUTE);
    // It is not written at each poll.
    assert_eq!(world.planner.record().under_way, record.under_way);
    let mut next = World::after(patrol(), "2026-05-04 09:02", record.clone());
    next.ready = false;
    next.pass(MINUTE);
    next.ready = true;
    next.pass(60 * MINUTE);
    assert_eq!(next.starts(), ["patrol 04 09:03"]);
    assert_eq!(
        next.acts[1].0,
        when("2026-05-04 09:33"),
        "it has all its time"
    );
    assert!(next.notices().is_empty(), "{:?}", next.acts);
    let mut late = World::after(patrol(), "2026-05-04 09:11", record.clone());
    late.pass(60 * MINUTE);
    assert!(late.starts().is_empty(), "{:?}", late.acts);
    assert!(matches!(late.notices()[..], [Notice::NoRobot { .. }]));
    // The clock was put back before the start.
    let mut early = World::after(patrol(), "2026-05-04 08:50", record.clone());
    early.pass(60 * MINUTE);
    assert_eq!(early.starts(), ["patrol 04 09:00"]);
    let other = table(&[("greet", "0 10 * * *", None)], "10m");
    let mut changed = World::after(other, "2026-05-04 09:02", record);
    changed.pass(MINUTE);
    assert!(changed.acts.is_empty(), "{:?}", changed.acts);
}

#[test]
fn a_start_that_waits_for_the_robot_is_cancelled_when_a_person_stops_everything() {
    let mut world = World::new(patrol(), "2026-05-04 08:59");
    world.ready = false;
    world.pass(2 * MINUTE);
    world.planner.forget_waiting();
    world.ready = true;
    world.pass(60 * MINUTE);
    assert!(world.acts.is_empty(), "{:?}", world.acts);
    assert!(world.planner.record().under_way.is_empty());
}

#[test]
fn a_start_that_does_not_reach_the_robot_waits_for_it() {
    let mut world = World::new(patrol(), "2026-05-04 09:00");
    world.pass(5 * MINUTE);
    let record = world.planner.record();
    let new = World::new(patrol(), "2026-05-04 09:00");
    let resumed = World::after(patrol(), "2026-05-04 09:00", record);
    // A new run has all its time; a resumed one ends as planned.
    for (mut world, end) in [(new, "2026-05-04 09:35"), (resumed, "2026-05-04 09:30")] {
        world.poll();
        (world.ready, world.running) = (false, Vec::new());
        assert!(world.planner.postpone("patrol"));
        world.pass(5 * MINUTE);
        world.ready = true;
        world.pass(60 * MINUTE);
        assert_eq!(world.starts(), ["patrol 04 09:00", "patrol 04 09:05"]);
        assert_eq!(world.acts[2].0, when(end));
        assert_eq!(world.acts.len(), 3, "{:?}", world.acts);
    }
}

#[test]
fn a_start_that_does_not_reach_the_robot_in_its_time_is_over() {
    let mut planner = Planner::new(patrol(), Record::default());
    let mut inputs = PlannerInputs {
        now: when("2026-05-04 09:00"),
        at: Instant::now(),
        ready: true,
        running: &[],
    };
    assert_eq!(planner.poll(inputs).len(), 1);
    (inputs.now, inputs.at) = (inputs.now + 30 * MINUTE, inputs.at + 30 * MINUTE);
    assert!(matches!(planner.poll(inputs)[..], [Act::End { .. }]));
    assert!(!planner.postpone("patrol") && !planner.is_due());
}
