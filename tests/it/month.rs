//! Two days of a service in virtual time, with faults; `scripts/month` plays thirty.

use crate::rig::in_a_process_of_its_own;

#[path = "../month/mod.rs"]
mod days;

#[test]
fn the_history_of_two_days_with_faults_matches_the_simulators_record() {
    in_a_process_of_its_own("month::two_days_with_faults");
}

#[test]
#[ignore = "the test above runs it"]
fn two_days_with_faults() {
    let folder = tempfile::tempdir().unwrap();
    let more = std::env::var("SPYKEE_TEST_MONTH_DAYS");
    let days = more.map_or(2, |days| days.parse().unwrap());
    let ledger = days::serve(days, 1, folder.path(), &mut |day, size, bytes| {
        println!("{day} d: {} KiB, {bytes} bytes of data", size.resident_kib);
    });
    println!("{}\n{ledger}", ledger.summary());
    assert!(ledger.is_kept(), "\n{ledger}");
    let untested = ledger.untested(&days::CORE);
    assert!(
        untested.is_empty(),
        "never put to the test: {untested:?}\n{ledger}"
    );
}
