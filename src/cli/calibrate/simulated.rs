//! Measurements in the simulator: true positions and times instead of a tape measure and a clock.

use std::f64::consts::{PI, TAU};
use std::time::Duration;

use super::measure::{Measured, Plan};
use super::{ready, step};
use crate::cli::driver::Driver;
use crate::cli::{Exit, Failure};
use crate::safety::WatchdogState;
use crate::sim::{Handle, State};

/// Milliseconds of the steps.
const SHORT: u64 = 1000;
const LONG: u64 = 1800;
const TURN: u64 = 1500;
/// Time until the tracks have reached their speed.
const RAMP: Duration = Duration::from_millis(500);
/// Time until they have stopped again.
const REST: Duration = Duration::from_millis(500);
/// Timeout for leaving the station.
const LEAVING: Duration = Duration::from_secs(20);

/// Drives back and forth, short and long, and turns each way: the robot ends where it began.
pub(super) async fn round(driver: &mut Driver, sim: &Handle) -> Result<Measured, Failure> {
    if driver.status().safety == WatchdogState::Docked && !driver.status().low {
        driver.undock(LEAVING).await?;
    }
    ready(driver.status())?;
    let mut speeds = Vec::new();
    for (direction, millis) in [(-1.0, SHORT), (1.0, SHORT), (-1.0, LONG), (1.0, LONG)] {
        let seen = watch(driver, sim, Plan::straight(direction, millis)).await?;
        speeds.push(rate(&seen, |a, b| a.pose.point().distance(b.pose.point()))?);
    }
    let mut turnings = Vec::new();
    for direction in [1.0, -1.0] {
        let seen = watch(driver, sim, Plan::turn(direction, TURN)).await?;
        turnings.push(rate(&seen, |a, b| turned(a, b).abs())?);
    }
    let mean = |all: &[f64]| all.iter().sum::<f64>() / all.len() as f64;
    Ok(Measured {
        speed: mean(&speeds),
        turning: mean(&turnings),
    })
}

/// Drives a step and returns the states while the tracks are at full speed.
async fn watch(driver: &mut Driver, sim: &Handle, plan: Plan) -> Result<Vec<State>, Failure> {
    let before = sim.state().collisions;
    let mut seen = Vec::<State>::new();
    let driving = step(driver, plan);
    tokio::pin!(driving);
    let mut last = sim.state().time;
    loop {
        tokio::select! {
            biased;
            ended = &mut driving => {
                ended?;
                break;
            }
            state = sim.wait_state(|state| state.time > last) => {
                last = state.time;
                seen.push(state);
            }
        }
    }
    tokio::time::sleep(REST).await;
    if sim.state().collisions > before {
        let failure = Failure::new(Exit::Failed, "the simulated robot ran into something");
        return Err(failure.help("choose a world with a metre free around the robot"));
    }
    seen.retain(|state| state.commanded.left != 0);
    let begin = seen.first().map_or(last, |state| state.time) + RAMP;
    seen.retain(|state| state.time >= begin);
    Ok(seen)
}

/// Mean rate of change from the first to the last state.
fn rate(seen: &[State], between: impl Fn(&State, &State) -> f64) -> Result<f64, Failure> {
    let way: f64 = seen
        .windows(2)
        .map(|pair| between(&pair[0], &pair[1]))
        .sum();
    let time = match seen {
        [first, .., last] => (last.time - first.time).as_secs_f64(),
        _ => 0.0,
    };
    // A shorter span means that this computer was suspended or overloaded.
    if time < 0.2 {
        let failure = Failure::new(Exit::Failed, "too few states from the simulator");
        return Err(failure.help("is this computer overloaded? Try again"));
    }
    Ok(way / time)
}

/// Radians turned from one state to the next, at most half a turn.
fn turned(before: &State, after: &State) -> f64 {
    (after.pose.heading - before.pose.heading + PI).rem_euclid(TAU) - PI
}
