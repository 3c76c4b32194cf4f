//! Chooses the robot that the flags or the config name, starts a simulator if one is meant, and
//! provides the function that connects.

use super::embedded::{EmbeddedSim, Simulated};
use super::{ConnectionArgs, Failure, RobotChoice};
use crate::config::Config;
use crate::link::{self, Target};
use crate::pilot::Dial;
use crate::wire::Login;

pub(super) fn place(connection: &ConnectionArgs, config: &Config) -> Result<RobotChoice, Failure> {
    let from_config = || config.robot.clone().map(RobotChoice::Robot);
    connection.place().or_else(from_config).ok_or_else(|| {
        Failure::usage("which robot? neither --robot nor --sim was given").help(
            "--sim uses a simulated robot; --robot HOST[:PORT] uses yours (`spykee discover` finds \
             it)",
        )
    })
}

pub(super) fn reach(
    place: RobotChoice,
    login: &Login,
    seed: u64,
) -> Result<(Target, Option<EmbeddedSim>), Failure> {
    reach_with(place, login, seed, Simulated::default())
}

/// Like [`reach`], with these options for a simulated robot.
pub(super) fn reach_with(
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

pub(super) fn dial(target: Target, login: Login, options: link::Options) -> Dial {
    Box::new(move |supervision| {
        let (target, login, options) = (target.clone(), login.clone(), options.clone());
        Box::pin(async move { link::connect(&target, &login, supervision, &options).await })
    })
}
