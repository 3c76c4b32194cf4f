//! A few robots far from home with a low battery; `scripts/rescue` plays as many as one likes.

#[path = "../rescue/mod.rs"]
#[allow(dead_code)]
mod low;

use low::{Name, Place, Row, Strategy, heading, play_all};

/// Few enough for an everyday test.
const STARTS: usize = 6;
/// So few tell little of the share: this says that the rescue works at all.
const HOME: usize = 3;

#[test]
fn low_robots_in_the_next_room_come_home_without_help_of_their_behaviour() {
    let place = Place::named(Name::LivingRoom);
    let starts = place.starts(STARTS, 1);
    let played = play_all(&place, Strategy::Builtin, &starts, 2, &|_| ());
    let lines: Vec<String> = played.iter().map(ToString::to_string).collect();
    let row = Row::of(Name::LivingRoom, Strategy::Builtin, &played);
    let table = format!("{}\n{row}\n{}", heading(), lines.join("\n"));
    assert!(row.home >= HOME, "{table}");
}
