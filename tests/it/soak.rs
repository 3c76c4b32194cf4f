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
