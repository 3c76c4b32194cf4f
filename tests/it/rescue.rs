//! A few robots far from home with a low battery; `scripts/rescue` plays any number of them.

#[path = "../rescue/mod.rs"]
#[allow(dead_code)]
mod low;

use std::f64::consts::PI;

use low::place::Start;
use low::{Name, Place, Row, Strategy, heading, play_all};
use spykee::sim::{Point, Pose};

/// Few enough for a test that runs often.
const STARTS: usize = 6;
/// So few starts do not measure the success rate: this only checks that the rescue works at all.
const HOME: usize = 3;

#[test]
fn low_robots_in_the_next_room_come_home_without_help_from_their_behaviour() {
    let place = Place::named(Name::LivingRoom);
    let starts = place.starts(STARTS, 1);
    expect_home(&place, &starts, HOME);
}

/// Between two walls and a post; from there the floor beside the post looks free.
#[test]
fn a_low_robot_in_the_corner_behind_a_post_comes_home() {
    let place = Place::named(Name::TightSpots);
    let starts: Vec<Start> = (0..8u8)
        .map(|eighth| Start {
            pose: Pose::at(Point::new(0.33, 4.5), f64::from(eighth) * PI / 4.0),
            battery: 18.7,
            way: 2.8,
            seed: u64::from(eighth),
            drives: None,
        })
        .collect();
    expect_home(&place, &starts, 7);
}

fn expect_home(place: &Place, starts: &[Start], least: usize) {
    let played = play_all(place, Strategy::Builtin, starts, 2, &|_| ());
    let lines: Vec<String> = played.iter().map(ToString::to_string).collect();
    let row = Row::new(place.name, Strategy::Builtin, &played);
    let table = format!("{}\n{row}\n{}", heading(), lines.join("\n"));
    assert!(row.home >= least, "{table}");
}
