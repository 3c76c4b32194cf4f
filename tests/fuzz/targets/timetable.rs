//! Arbitrary lines as the values of a timetable: pattern, zone, quiet hours, length, date. A valid
//! value is the same when written and parsed again; the computed starts lie in the future, in
//! order, and are no more than requested.
#![no_main]

use std::fmt::{Debug, Display};
use std::str::FromStr;

use libfuzzer_sys::fuzz_target;
use spykee::clock::{Date, Span, Zone};
use spykee::timetable::{Hold, Pattern, Quiet, Rule, Timetable, predict_starts};

/// Number of starts to compute.
const STARTS: usize = 6;

fuzz_target!(|text: &str| {
    let mut lines = text.split('\n');
    let mut line = || lines.next().unwrap_or_default();
    let pattern = line();
let zone = line();
let quiet = line();
    let lasts = line();
let date = line();
    let zone = again::<Zone>(zone).unwrap_or_else(Zone::utc);
    let quiet = again::<Quiet>(quiet);
    let lasts = again::<Span>(lasts);
    let date: Date = date.parse().or("2026-03-29 01:30".parse()).expect("the fallback is a valid date");
    let Some(pattern) = again::<Pattern>(pattern) else {
        return;
    };
    let begin = date.at(&zone);
    let mut at = begin;
    for _ in 0..STARTS {
        let Some(next) = pattern.next_after(at, &zone) else {
            break;
        };
        assert!(next > at, "{pattern}: {next} is not after {at}");
        at = next;
    }
    let rule = |run: &str| Rule {
        run: run.to_owned(),
        at: pattern.clone(),
        lasts,
    };
    let table = Timetable {
        rules: vec![rule("patrol"), rule("stranger"), rule("patrol")],
        zone,
        quiet,
        catch_up: Span::minutes(10),
    };
    let found = predict_starts(&table, &Hold::default(), &["patrol".to_owned()], begin, STARTS);
    assert!(found.len() <= STARTS, "{} starts", found.len());
    assert!(found.iter().all(|one| one.at > begin), "{found:?}");
    assert!(found.windows(2).all(|pair| pair[0].at <= pair[1].at), "{found:?}");
    assert!(found.iter().all(|one| one.happens() <= (one.run == "patrol")), "{found:?}");
});

/// Parses a text; checks that a valid value is the same when written and parsed again, and that an
/// error has a message of reasonable length.
fn again<T: FromStr<Err: Display> + Display + Debug + PartialEq>(text: &str) -> Option<T> {
    match text.parse::<T>().map_err(|error| error.to_string()) {
        Ok(value) => {
            let written = value.to_string();
            let read = written.parse::<T>().ok();
            assert_eq!(read.as_ref(), Some(&value), "{text:?} is written {written:?}");
            read
        }
        Err(why) => {
            assert!(!why.is_empty() && why.len() <= 2 * text.len() + 300, "{why}");
            None
        }
    }
}
