//! Two days of a service in virtual time, with troubles; `scripts/month` has thirty.

#[path = "../month/mod.rs"]
mod days;

#[test]
fn two_days_alone_with_troubles_are_in_the_history_as_they_were() {
    let folder = tempfile::tempdir().unwrap();
    let ledger = days::serve(2, 1, folder.path(), &mut |_, _, _| {});
    println!("{}", ledger.summary());
    assert!(ledger.is_kept(), "\n{ledger}");
    let untested = ledger.untested(&days::CORE);
    assert!(
        untested.is_empty(),
        "never put to the test: {untested:?}\n{ledger}"
    );
}
