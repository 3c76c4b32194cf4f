//! Explores the watchdog's states breadth first up to a limit; `scripts/explore` goes deeper.

use spykee::safety::{Limits, Rescue};

#[path = "../explore/mod.rs"]
mod explorer;

/// Enough to see every pair of events in every order, and most triples.
const MAX_STATES: usize = 20_000;

#[test]
fn a_low_robot_is_sent_home_after_any_sequence_of_events() {
    let bare = Limits {
        rescue: Rescue::Off,
        recovery_legs: false,
        ..Limits::default()
    };
    for limits in [Limits::default(), bare] {
        let found = explorer::explore(&limits, 4, MAX_STATES);
        println!("{} states to a depth of {}", found.states, found.depth);
        assert_eq!(found.broken, [] as [String; 0]);
        assert!(found.states > 1000, "{}", found.states);
    }
}
