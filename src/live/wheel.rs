//! Driving by hand: a seat in front of the pilot, above all behaviours, for one person at a time.
//!
//! The viewer that has the wheel has the tracks, which rest until he says otherwise. A setpoint lives 0.3 s;
//! then they rest again. The seat shows life from the task that judges this, so that if the task is
//! stuck or gone, the watchdog stops the robot: by the seat's end at once, by its silence in 0.25 s.

use std::time::Duration;

use tokio::sync::watch;
use tokio::time::{Instant, MissedTickBehavior, interval};
use tracing::info;

use crate::agent::SeatError;
use crate::clock::until;
use crate::control::Run;
use crate::robot::{Event, Setpoint};

/// How long a setpoint lives.
pub(super) const LIFE: Duration = Duration::from_millis(300);
/// How often the seat sends a sign of life; the watchdog stops the tracks after 0.25 s without one.
const BEAT: Duration = Duration::from_millis(50);

/// How long STOP waits before it takes the tracks again.
const AGAIN: Duration = Duration::from_millis(200);

/// A setpoint and when it came.
pub(super) type Wish = (Setpoint, Instant);

/// Drives as its viewer asks until it stops asking. Leaving the seat stops the robot, or lets the
/// next in line go on.
pub(super) async fn drive(run: Run, name: String, mut wishes: watch::Receiver<Wish>) {
    info!("{name} drives by hand");
    if let Err(error) = steer(&run, &name, &mut wishes).await {
        info!("{name} cannot drive any more: {error}");
    } else {
        info!("{name} drives no more");
    }
}

async fn steer(run: &Run, name: &str, wishes: &mut watch::Receiver<Wish>) -> Result<(), SeatError> {
    let mut seat = run.seat(name).await?;
    seat.drive(Setpoint::STOP).await?;
    let mut beat = interval(BEAT);
    beat.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut ends = None;
    loop {
        tokio::select! {
            biased;
            () = until(ends) => {
                ends = None;
                seat.drive(Setpoint::STOP).await?;
            }
            changed = wishes.changed() => {
                if changed.is_err() {
                    return Ok(());
                }
                let (setpoint, came) = *wishes.borrow_and_update();
                let dies = came + LIFE;
                // Of one that has waited too long nothing is left.
                let alive = !setpoint.is_stop() && dies > Instant::now();
                ends = alive.then_some(dies);
                seat.drive(if alive { setpoint } else { Setpoint::STOP }).await?;
            }
            _ = beat.tick() => seat.alive().await?,
            told = seat.told() => drop(told?),
        }
    }
}

/// STOP's own seat: behaviours below it have not the tracks, and are told so, until it is dropped.
pub(super) async fn hold(run: Run, mut held: watch::Receiver<bool>) {
    let holding = async {
        let mut seat = run.seat("STOP").await?;
        let mut beat = interval(BEAT);
        beat.set_missed_tick_behavior(MissedTickBehavior::Delay);
        // When the tracks are to be taken (again): they cannot be had on the station or without a link.
        let mut take = Some(Instant::now());
        loop {
            tokio::select! {
                () = until_free(&mut held) => return Ok::<(), SeatError>(()),
                () = until(take) => {
                    take = None;
                    seat.drive(Setpoint::STOP).await?;
                }
                _ = beat.tick() => seat.alive().await?,
                told = seat.told() => {
                    if let Event::MotionEnded { .. } = told? {
                        take = Some(Instant::now() + AGAIN);
                    }
                }
            }
        }
    };
    if let Err(error) = holding.await {
        info!("STOP: {error}");
    }
}

/// Also if no viewer is left who could let go of it here.
async fn until_free(held: &mut watch::Receiver<bool>) {
    let _ = held.wait_for(|held| !held).await;
}
