//! Chooses the robot that the flags or the config name, starts a simulator if one is meant, and
//! provides the function that connects.

use super::embedded::{EmbeddedSim, Simulated};
use super::{ConnectionArgs, Failure, RobotChoice};
use crate::config::Config;
use crate::link::{self, Target};
use crate::pilot::Connector;
use crate::vision::Camera;
use crate::wire::Login;

pub(super) fn robot_choice(
    connection: &ConnectionArgs,
    config: &Config,
) -> Result<RobotChoice, Failure> {
    let from_config = || config.robot.clone().map(RobotChoice::Robot);
    connection.robot().or_else(from_config).ok_or_else(|| {
        Failure::usage("which robot? neither --robot nor --sim was given").help(
            "--sim uses a simulated robot; --robot HOST[:PORT] uses yours (`spykee discover` finds \
             it)",
        )
    })
}

/// The camera of the robot that is meant: the config's, or that of the world of a simulated robot.
pub(super) fn camera(connection: &ConnectionArgs, config: &Config) -> Result<Camera, Failure> {
    match robot_choice(connection, config) {
        Ok(RobotChoice::Sim(world)) => {
            let world = super::embedded::load(world.as_deref())?;
            Ok(world.camera.calibrated())
        }
        _ => Ok(config.camera),
    }
}

pub(super) fn resolve_or_simulate(
    place: RobotChoice,
    login: &Login,
    seed: u64,
) -> Result<(Target, Option<EmbeddedSim>), Failure> {
    resolve_or_simulate_with(place, login, seed, Simulated::default())
}

/// Like [`resolve_or_simulate`], with these options for a simulated robot.
pub(super) fn resolve_or_simulate_with(
    place: RobotChoice,
    login: &Login,
    seed: u64,
    kind: Simulated,
) -> Result<(Target, Option<EmbeddedSim>), Failure> {
    match place {
        RobotChoice::Robot(target) => Ok((target, None)),
        RobotChoice::Sim(world) => {
            let sim = EmbeddedSim::start(world.as_deref(), login, seed, kind)?;
            let address = sim.address();
            let target = Target {
                host: address.ip().to_string(),
                port: address.port(),
            };
            Ok((target, Some(sim)))
        }
    }
}

pub(super) fn connector(target: Target, login: Login) -> Connector {
    Box::new(move |supervision| {
        let target = target.clone();
        let login = login.clone();
        let options = link::Options::default();
        Box::pin(async move { link::connect(&target, &login, supervision, &options).await })
    })
}
