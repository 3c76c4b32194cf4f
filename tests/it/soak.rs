//! An hour alone with everything going wrong; `scripts/soak` runs as many as one likes.

#[path = "../soak/mod.rs"]
mod weeks;

#[test]
fn an_hour_alone_with_faults_keeps_every_promise() {
    let folder = tempfile::tempdir().unwrap();
    let ledger = weeks::soak(1, 1, folder.path(), &mut |_, _| {});
    assert!(ledger.is_kept(), "\n{ledger}");
    for words in [
        "the first command of every connection is a stop",
        "low and off the station: no script moves the robot",
        "patrol and guard never fail",
    ] {
        assert!(ledger.tested(words) > 0, "never put to the test: {words}\n{ledger}");
    }
}
