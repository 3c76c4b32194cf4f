//! A low robot that presses against something on its own way to the station: it hears the beacon through a fence
//! that it cannot pass. In virtual time.

use std::time::Duration;

use spykee::sim::World;
use spykee::simulation::{self, Simulation};
use spykee::wire::{Command, Engage};
use tokio::time::sleep;

const FENCED: &str = "
name: fenced
room: { width: 4, depth: 3 }
station: { at: [0, 1.5], heading_degrees: 0, docking: { sees_obstacles: false } }
posts: [
  { at: [1.4, 0.24], colour: red }, { at: [1.4, 0.52], colour: red }, { at: [1.4, 0.8], colour: red },
  { at: [1.4, 1.08], colour: red }, { at: [1.4, 1.36], colour: red }, { at: [1.4, 1.64], colour: red },
  { at: [1.4, 1.92], colour: red }, { at: [1.4, 2.2], colour: red }, { at: [1.4, 2.48], colour: red },
  { at: [1.4, 2.76], colour: red },
]
start: { at: [2.8, 1.5], heading_degrees: 0 }
battery: { level: 14, idle_drain_per_minute: 0.01, driving_drain_per_minute: 0.01 }
camera: { fps: 5 }
";
/// The simulated robot ends a search itself 10 s later.
const LONGEST_SEARCH: Duration = Duration::from_secs(140);
const WATCHED: Duration = Duration::from_secs(600);
/// The rescue behaviour waits for so long, and the robot may need this to get to the fence.
const PRESSED: Duration = Duration::from_secs(6);
const LONGEST: Duration = Duration::from_secs(60);
/// The first search and each fourth one after it last so long, and then until the behaviour asks again.
const FULL: Duration = Duration::from_secs(60);
const ASKED: Duration = Duration::from_secs(5);

#[test]
fn a_search_in_which_the_robot_presses_against_something_is_given_up_the_first_after_a_minute() {
    assert_gives_up_pressing(FENCED);
}

#[test]
fn a_genuine_robot_that_sways_on_tiles_while_it_presses_gives_the_search_up_too() {
    let on_tiles = FENCED.replace("depth: 3 }", "depth: 3, floor: tiles }");
    let reads_its_charge = on_tiles.replace("battery: {", "battery: { power: percent,");
    assert_gives_up_pressing(&format!("preset: genuine\n{reads_its_charge}"));
}

/// The robot drives onto its contacts again and again, and presses against the station each time.
#[test]
fn a_search_in_which_the_robot_is_at_its_station_is_not_given_up() {
    for (y, heading) in [(0.8, 200), (1.2, 160), (1.6, 190), (2.0, 90), (2.4, 0)] {
        let world = format!(
            "preset: genuine
name: contacts that never close
room: {{ width: 4, depth: 3, floor: tiles }}
station: {{ at: [0, 1.5], heading_degrees: 0, docking: {{ success: 0 }} }}
start: {{ at: [2.6, {y}], heading_degrees: {heading} }}
battery: {{ power: percent, level: 14, idle_drain_per_minute: 0.01, driving_drain_per_minute: 0.01 }}
camera: {{ fps: 5 }}
"
        );
        let (searches, given_up) = searches(&world, LONGEST_SEARCH);
        assert!(
            searches.len() == 1 && given_up.is_empty(),
            "from {y}: {searches:?}, given up: {given_up:?}"
        );
    }
}

/// Plays a world with the rescue behaviour for so long, and returns when searches began and were given up.
fn searches(world: &str, watched: Duration) -> (Vec<Duration>, Vec<Duration>) {
    let world = World::from_yaml(world, "world").unwrap();
    let options = simulation::Options::default();
    let heard = simulation::run(world, options, async |simulation: &Simulation| {
        let _run = simulation.start(vec![], None);
        sleep(watched).await;
        simulation.sim().heard()
    });
    let heard = heard.unwrap();
    let times = |wanted: Engage| {
        let wanted = Command::Engine(wanted);
        let found = heard.iter().filter(move |one| one.command == wanted);
        found.map(|one| one.at).collect::<Vec<_>>()
    };
    (times(Engage::Dock), times(Engage::CancelDock))
}

fn assert_gives_up_pressing(world: &str) {
    let (searches, given_up) = searches(world, WATCHED);
    assert!(given_up.len() >= 2, "{searches:?}, given up: {given_up:?}");
    for at in given_up {
        let number = searches.iter().rposition(|begun| *begun < at).unwrap();
        let lasted = at - searches[number];
        let expected = if number.is_multiple_of(4) {
            FULL..FULL + ASKED
        } else {
            PRESSED..LONGEST
        };
        assert!(expected.contains(&lasted), "search {number}: {lasted:?}");
    }
}
