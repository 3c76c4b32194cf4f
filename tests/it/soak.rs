//! An hour alone with everything going wrong; `scripts/soak` runs as many as one likes.

#[path = "../soak/mod.rs"]
mod weeks;

#[test]
fn an_hour_alone_with_faults_keeps_every_promise() {
    let folder = tempfile::tempdir().unwrap();
    let ledger = weeks::soak(1, 1, folder.path(), &mut |_, _| {});
    assert!(ledger.is_kept(), "\n{ledger}");
    let untested = ledger.untested(&weeks::CORE);
    assert!(
        untested.is_empty(),
        "never put to the test: {untested:?}\n{ledger}"
    );
}

/// Where the soak's world hides the station's beacon: to the left, to the right, in a corner.
const BLIND: [(f64, f64); 3] = [(0.35, 4.0), (0.4, 0.9), (0.2, 4.8)];

#[test]
fn a_robot_beside_its_station_that_cannot_find_it_from_there_comes_home_all_the_same() {
    for (place, heading) in BLIND.into_iter().zip([-1.15, 0.5, 2.0]) {
        let end = weeks::comes_home_from(place, heading);
        assert!(end.is_ok(), "from {place:?}: {end:?}");
    }
}
