use super::watcher::pause_until_next_check;
use super::*;

#[test]
fn a_slice_without_cpu_time_is_over_late_and_in_a_simulation_later() {
    let limit = Duration::from_millis(100);
    let is_over = |wall: u64, processor: u64, wall_factor| {
        let [wall, processor] = [wall, processor].map(Duration::from_millis);
        is_too_long(wall, processor, limit, wall_factor)
    };
    for wall_factor in [WALL_FACTOR, SIMULATED_WALL_FACTOR] {
        assert!(is_over(100, 50, wall_factor));
        assert!(!is_over(499, 49, wall_factor));
    }
    assert!(is_over(500, 0, WALL_FACTOR));
    assert!(!is_over(9_999, 49, SIMULATED_WALL_FACTOR));
    assert!(is_over(10_000, 0, SIMULATED_WALL_FACTOR));
}

#[test]
fn checks_without_an_answer_are_counted_until_the_vm_answers() {
    let slot = Slot::default();
    slot.script().push_str("stuck.lua");
    let checks = |count: u64, from: u64| (from..from + count).for_each(|now| slot.check(now));
    checks(100, 1);
    assert_eq!(slot.unanswered.load(Ordering::Relaxed), 0, "nothing runs");
    slot.check_at.store(150, Ordering::Release);
    checks(50, 100);
    assert_eq!(
        slot.unanswered.load(Ordering::Relaxed),
        0,
        "within its budget"
    );
    checks(20, 150);
    assert_eq!(slot.unanswered.load(Ordering::Relaxed), 20);
    // The VM has answered and may go on for a while.
    slot.check_at.store(180, Ordering::Release);
    slot.flag.store(WITHIN_BUDGET, Ordering::Release);
    checks(10, 170);
    assert_eq!(slot.unanswered.load(Ordering::Relaxed), 0);
}

#[test]
fn a_stuck_slice_is_reported_with_its_file() {
    let (sender, reports) = std::sync::mpsc::channel();
    when_stuck(Duration::from_millis(100), move |file| {
        let _ = sender.send((file.to_owned(), running()));
    });
    begin(Duration::from_millis(1), "stuck.lua");
    let (file, running) = reports.recv_timeout(Duration::from_secs(60)).unwrap();
    let _ = end();
    assert_eq!(file, "stuck.lua");
    assert!(running.contains(&file), "{running:?}");
}

#[test]
fn a_thread_of_simulations_uses_the_larger_factor() {
    assert_eq!(WALL_TIME_FACTOR.get(), WALL_FACTOR);
    set_simulated_wall_factor();
    assert_eq!(WALL_TIME_FACTOR.get(), SIMULATED_WALL_FACTOR);
}

#[test]
fn the_watcher_pauses_while_no_slice_can_reach_its_limit() {
    let [limit, now] = [100, 5000].map(|millis| millis * 1_000_000);
    let pause = |checks: &[u64], smallest| {
        let checks = checks.iter().map(|millis| millis * 1_000_000);
        pause_until_next_check(checks, smallest, now).as_millis()
    };
    assert_eq!(pause(&[0, 0], limit), 100, "none is running");
    assert_eq!(pause(&[0, 5040], limit), 40);
    assert_eq!(pause(&[5900, 5600], limit), 100, "another may begin");
    for reached in [5003, 5000, 4000] {
        assert_eq!(pause(&[reached], limit), 10);
    }
    assert!(pause(&[0], u64::MAX) > 1_000_000, "there was none yet");
}
