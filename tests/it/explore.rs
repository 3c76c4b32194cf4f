//! The watchdog, explored breadth first to a bound; `scripts/explore` goes deeper.

use spykee::safety::{Limits, Rescue};

#[path = "../explore/mod.rs"]
mod explorer;

/// Enough to see every pair of events in every order, and most threes.
const MOST_STATES: usize = 20_000;

#[test]
fn whatever_happens_in_whatever_order_a_low_robot_is_sent_home() {
    let bare = Limits {
        rescue: Rescue::Off,
        recovery_legs: 0,
        ..Limits::default()
    };
    for limits in [Limits::default(), bare] {
        let found = explorer::explore(&limits, 4, MOST_STATES);
        println!("{} states to a depth of {}", found.states, found.depth);
        assert_eq!(found.broken, [] as [String; 0]);
        assert!(found.states > 1000, "{}", found.states);
    }
}
