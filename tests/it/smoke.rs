//! A short one of each long run; `scripts/nightly` plays them at full length.

use std::f64::consts::PI;
use std::path::Path;
use std::time::Duration;

use spykee::safety::{Limits, Rescue};
use spykee::script;
use spykee::sim::{Firmware, Point, Pose};
use spykee::simulation::{self, Recorder, Simulation};
use tokio::time::timeout;

use crate::long_runs::explore::explore;
use crate::long_runs::rescue::{Battery, Name, Place, Row, Start, Strategy, heading, play_all};
use crate::long_runs::soak::{self, Ledger, soak};
use crate::long_runs::stops::breaks::{self, End, Outage};
use crate::long_runs::stops::queue::{self, Driver, Stopper, Trial};
use crate::long_runs::{behaviour, month, two_rooms};
use crate::rig::{in_a_process_of_its_own, sized};

#[test]
fn hours_with_faults_keep_every_promise() {
    in_a_process_of_its_own("smoke::hours_with_faults");
}

#[test]
#[ignore = "the test above runs it"]
fn hours_with_faults() {
    let other = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/firmware/all_other.yaml");
    let other = Firmware::load(&other).unwrap();
    let mut total = Ledger::default();
    let lasts = Duration::from_secs(60 * sized(30, 60));
    let robots = [(1, Firmware::default()), (4, other)];
    for (seed, firmware) in robots.into_iter().take(sized(1, 2)) {
        let folder = tempfile::tempdir().unwrap();
        let ledger = soak(lasts, seed, &firmware, folder.path(), &mut |_, _| {});
        println!("seed {seed}: {}", ledger.summary());
        total.add(&format!("seed {seed}"), ledger);
    }
    assert!(total.proves(&soak::CORE), "\n{total}");
}

/// Places beside the station from which the soak's world hides its beacon, on both sides, each with
/// a heading.
const BLIND: [(f64, f64, f64); 2] = [(0.35, 4.0, -1.15), (0.4, 0.9, 0.5)];

/// Starts there with a low battery and an idle behaviour; returns whether the robot charges within
/// ten minutes, and how often the watchdog did `does`.
fn comes_home_from((x, y, heading): (f64, f64, f64), limits: &Limits, does: &str) -> (bool, usize) {
    let (recorder, events) = Recorder::keeping();
    let options = simulation::Options {
        events: Some(recorder),
        limits: limits.clone(),
        ..simulation::Options::default()
    };
    let idle = behaviour("task.wait(3600)", script::Options::new("idle", "idle.lua"));
    let home = simulation::run(two_rooms(), options, async |simulation: &Simulation| {
        simulation.sim().place(Pose { x, y, heading });
        simulation.sim().set_battery(19.0);
        let run = simulation.start(vec![idle], None);
        let home = simulation.sim().wait_state(|state| state.charging);
        let home = timeout(Duration::from_secs(600), home).await.is_ok();
        run.stop();
        home && run.outcome().await.is_ok()
    });
    let events = events.lock();
    let done = events.iter().filter(|event| event.text.contains(does));
    (home.unwrap(), done.count())
}

#[test]
fn a_low_robot_beside_its_station_comes_home_although_it_cannot_find_it_from_there() {
    let blind = Limits {
        rescue: Rescue::Off,
        ..Limits::default()
    };
    for place in BLIND.into_iter().take(sized(1, 2)) {
        for (limits, does) in [
            (&blind, "makes short blind move"),
            (&Limits::default(), "a rescue behaviour may drive"),
        ] {
            let (home, times) = comes_home_from(place, limits, does);
            assert!(home && times > 0, "from {place:?}: {does} {times} times");
        }
    }
}

#[test]
fn the_history_of_a_service_with_faults_matches_the_simulators_record() {
    in_a_process_of_its_own("smoke::days_of_a_service_with_faults");
}

#[test]
#[ignore = "the test above runs it"]
fn days_of_a_service_with_faults() {
    let folder = tempfile::tempdir().unwrap();
    let mut ledger = month::serve(1, 1, folder.path(), &mut |day, size, bytes| {
        println!("{day} d: {size}, {bytes} bytes of data");
    });
    println!("{}\n{ledger}", ledger.summary());
    assert!(ledger.proves(&month::CORE), "\n{ledger}");
}

/// Few enough for a test that runs often; they do not measure the success rate, and only check that
/// the rescue works at all.
#[test]
fn low_robots_in_the_next_room_come_home_without_help_from_their_behaviour() {
    let place = Place::new(Name::LivingRoom, 1, "exact", Battery::HalfHour);
    let starts = place.starts(sized(3, 6), 1);
    expect_home(place, &starts, sized(2, 3));
}

/// Between two walls and a post; from there the floor beside the post looks free.
#[test]
fn a_low_robot_in_the_corner_behind_a_post_comes_home() {
    let place = Place::new(Name::TightSpots, 1, "exact", Battery::HalfHour);
    let starts: Vec<Start> = (0..8u8)
        .step_by(sized(4, 1))
        .map(|eighth| Start {
            pose: Pose::at(Point::new(0.33, 4.5), f64::from(eighth) * PI / 4.0),
            battery: 18.7,
            way: 2.8,
            seed: u64::from(eighth),
            drives: None,
        })
        .collect();
    expect_home(place, &starts, sized(1, 7));
}

fn expect_home(mut place: Place, starts: &[Start], least: usize) {
    // Five pictures a second are enough for the rescue behaviour to find its way.
    place.world.camera.fps = sized(5.0, place.world.camera.fps);
    let name = place.name;
    let played = play_all(&place.cases(starts), Strategy::Builtin, 2, &|_| ());
    let lines: Vec<String> = played.iter().map(ToString::to_string).collect();
    let row = Row::new(name, Strategy::Builtin, &played);
    let table = format!("{}\n{row}\n{}", heading(), lines.join("\n"));
    assert!(row.home >= least, "{table}");
}

/// Every STOP on robots of these speeds is executed in time, and nothing moves them afterwards.
fn expect_stops(speeds: &[Option<f64>], seeds: u64) {
    let drives = sized(4.0, queue::DRIVES);
    let cells = queue::play_all(speeds, &Driver::ALL, drives, seeds, 2);
    let rows: Vec<String> = cells
        .iter()
        .map(|(trial, cell)| queue::row(trial, cell))
        .collect();
    let kept = cells.iter().all(|(trial, cell)| cell.is_kept(trial.speed));
    assert!(kept, "{}\n{}", queue::heading(), rows.join("\n"));
}

#[test]
fn a_fast_robot_executes_a_stop_at_once() {
    expect_stops(&[Some(20.0), None], 1);
}

#[test]
fn a_robot_that_executes_slowly_does_the_same_with_the_same_seed() {
    let trial = Trial {
        speed: Some(5.0),
        driver: Driver::Explore,
        stopper: Stopper::Person,
        drives: sized(4.0, queue::DRIVES),
        seed: 3,
    };
    assert_eq!(queue::play(&trial), queue::play(&trial));
}

#[test]
fn a_slow_robot_executes_a_stop_soon() {
    // The second robot reports a voltage.
    let speeds = [Some(3.0), Some(8.0), Some(5.0)];
    expect_stops(&speeds[..sized(2, 3)], 2);
}

/// Runs that end in these ways while the robot is out of reach for a second leave it standing.
fn expect_stopped_after_a_break(ends: &[End]) {
    let cases = breaks::cases(ends, &[Outage::Refused, Outage::Silent], &[1], 1);
    let outcomes = breaks::play_all(&cases, 8, &|_, _| ());
    let table = breaks::Table::new(&cases, &outcomes);
    // How soon is left to the long run: this machine may stall.
    let stopped = |outcome: &breaks::Outcome| {
        matches!(
            outcome,
            breaks::Outcome::After(_) | breaks::Outcome::Late(..)
        )
    };
    assert!(outcomes.iter().all(stopped), "{table}\n{outcomes:#?}");
}

#[test]
fn a_robot_out_of_reach_is_stopped_when_it_is_back_if_its_run_goes_on() {
    expect_stopped_after_a_break(&[End::Page, End::RobotStop]);
}

#[test]
fn a_robot_out_of_reach_at_the_end_of_its_run_is_stopped_when_it_is_back() {
    expect_stopped_after_a_break(&[End::ScriptReturns, End::For, End::Interrupt, End::Killed]);
}

/// Its system has lost packets, not the connection: it refuses logins until it learns that.
#[test]
fn a_robot_that_believes_in_an_old_session_is_stopped_when_it_is_back() {
    let packets = [Outage::Packets];
    let mut cases = breaks::cases(&[End::ScriptReturns], &packets, &[12], 1);
    cases.extend(breaks::cases(&[End::Killed], &packets, &[5], 1));
    let outcomes = breaks::play_all(&cases, 8, &|_, _| ());
    let table = breaks::Table::new(&cases, &outcomes);
    for outcome in &outcomes {
        match outcome {
            // TCP's own repetition would take 7 s.
            breaks::Outcome::After(time) | breaks::Outcome::Late(time, _) => {
                assert!(*time < Duration::from_secs(5), "{table}");
            }
            breaks::Outcome::Failed(why) if why.starts_with("no network namespaces") => {
                println!("not tested: {why}");
            }
            other => panic!("{other:?}\n{table}"),
        }
    }
}

/// Breadth first: every pair of events in every order, and many triples.
#[test]
fn a_low_robot_is_sent_home_after_any_sequence_of_events() {
    let bare = Limits {
        rescue: Rescue::Off,
        blind_moves: false,
        ..Limits::default()
    };
    for limits in [Limits::default(), bare] {
        let found = explore(&limits, 4, 5_000);
        println!("{} states to a depth of {}", found.states, found.depth);
        assert_eq!(found.broken, [] as [String; 0]);
        assert!(found.states > 1000, "{}", found.states);
    }
}
