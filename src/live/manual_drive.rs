//! Driving by hand: a client of the pilot with a priority above all behaviours, for one person at a
//! time.
//!
//! The viewer that has the drive lock controls the tracks, which stand still without a setpoint. A
//! setpoint is valid for 0.3 s. The task that enforces this also sends the client's signs of life,
//! so that the watchdog stops the robot if the task fails: at once if the client ends, after 0.25 s
//! if it is silent.

use std::time::Duration;

use tokio::sync::watch;
use tokio::time::{Instant, MissedTickBehavior, interval};
use tracing::info;

use crate::agent::PilotClientError;
use crate::clock::until;
use crate::control::Run;
use crate::robot::{Event, Setpoint};

/// How long a setpoint is valid.
pub(super) const LIFE: Duration = Duration::from_millis(300);
/// How often the client sends a sign of life; the watchdog stops the tracks after 0.25 s without
/// one.
const HEARTBEAT_INTERVAL: Duration = Duration::from_millis(50);

/// Pause before STOP takes the tracks again.
const AGAIN: Duration = Duration::from_millis(200);

/// A setpoint and the time it was received.
pub(super) type TimedSetpoint = (Setpoint, Instant);

/// Drives with the viewer's setpoints until the viewer releases the drive lock. Leaving the pilot
/// stops the robot, or lets the behaviour with the next lower priority drive.
pub(super) async fn drive(run: Run, name: String, mut setpoints: watch::Receiver<TimedSetpoint>) {
    info!("{name} drives by hand");
    if let Err(error) = steer(&run, &name, &mut setpoints).await {
        info!("{name} can no longer drive by hand: {error}");
    } else {
        info!("{name} has stopped driving by hand");
    }
}

async fn steer(
    run: &Run,
    name: &str,
    setpoints: &mut watch::Receiver<TimedSetpoint>,
) -> Result<(), PilotClientError> {
    let mut client = run.pilot_client(name).await?;
    client.drive(Setpoint::STOP).await?;
    let mut heartbeat = interval(HEARTBEAT_INTERVAL);
    heartbeat.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut ends = None;
    loop {
        tokio::select! {
            biased;
            () = until(ends) => {
                ends = None;
                client.drive(Setpoint::STOP).await?;
            }
            changed = setpoints.changed() => {
                if changed.is_err() {
                    return Ok(());
                }
                let (setpoint, came) = *setpoints.borrow_and_update();
                let dies = came + LIFE;
                // Ignore a setpoint that has already expired.
                let alive = !setpoint.is_stop() && dies > Instant::now();
                ends = if alive { Some(dies) } else { None };
                client.drive(if alive { setpoint } else { Setpoint::STOP }).await?;
            }
            _ = heartbeat.tick() => client.alive().await?,
            event = client.next_event() => drop(event?),
        }
    }
}

/// Holds the tracks with a separate client of the pilot while STOP is set: behaviours, which have a
/// lower priority, do not get the tracks and are informed of that.
pub(super) async fn hold_tracks(run: Run, mut held: watch::Receiver<bool>) {
    let holding = async {
        let mut client = run.pilot_client("STOP").await?;
        let mut heartbeat = interval(HEARTBEAT_INTERVAL);
        heartbeat.set_missed_tick_behavior(MissedTickBehavior::Delay);
        // When to take the tracks (again): this fails on the station or without a link.
        let mut take = Some(Instant::now());
        loop {
            tokio::select! {
                () = until_free(&mut held) => return Ok::<(), PilotClientError>(()),
                () = until(take) => {
                    take = None;
                    client.drive(Setpoint::STOP).await?;
                }
                _ = heartbeat.tick() => client.alive().await?,
                event = client.next_event() => {
                    if let Event::MotionEnded { .. } = event? {
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

/// Waits until STOP is released; also returns if the server has ended.
async fn until_free(held: &mut watch::Receiver<bool>) {
    let _ = held.wait_for(|held| !held).await;
}
