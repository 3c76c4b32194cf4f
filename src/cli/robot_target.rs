//! Chooses the robot that the flags or the config name, starts a simulator if one is meant, and
//! provides the function that connects.

use super::embedded::{self, EmbeddedSim, Simulated};
use super::{ConnectionArgs, Failure, RobotChoice};
use crate::config::Config;
use crate::link::{self, Target};
use crate::pilot::Connector;
use crate::sim::World;
use crate::wire::Login;

/// The robot that is meant, with the world of a simulated one.
pub(super) enum ChosenRobot {
    Robot(Target),
    Sim(Box<World>),
}

impl ChosenRobot {
    /// The robot of the flags, or else of the config; `None` if neither names one. The config's
    /// camera becomes that of a simulated robot.
    pub(super) fn load(
        connection: &ConnectionArgs,
        config: &mut Config,
    ) -> Result<Option<ChosenRobot>, Failure> {
        let from_config = || config.robot.clone().map(RobotChoice::Robot);
        let Some(choice) = connection.robot().or_else(from_config) else {
            return Ok(None);
        };
        let chosen = ChosenRobot::from_choice(choice)?;
        if let ChosenRobot::Sim(world) = &chosen {
            config.camera = world.camera.calibrated();
        }
        Ok(Some(chosen))
    }

    pub(super) fn from_choice(choice: RobotChoice) -> Result<ChosenRobot, Failure> {
        Ok(match choice {
            RobotChoice::Robot(target) => ChosenRobot::Robot(target),
            RobotChoice::Sim(world) => ChosenRobot::Sim(embedded::load(world.as_deref())?.into()),
        })
    }

    /// # Errors
    /// There is none.
    pub(super) fn required(chosen: Option<ChosenRobot>) -> Result<ChosenRobot, Failure> {
        chosen.ok_or_else(|| {
            Failure::usage("which robot? neither --robot nor --sim was given").help(
                "--sim uses a simulated robot; --robot HOST[:PORT] uses yours (`spykee discover` \
                 finds it)",
            )
        })
    }

    pub(super) fn is_simulated(&self) -> bool {
        matches!(self, ChosenRobot::Sim(_))
    }

    /// Its address. A simulated robot is started with these options, and accepts this login.
    pub(super) fn start(
        self,
        login: &Login,
        seed: u64,
        kind: Simulated,
    ) -> Result<(Target, Option<EmbeddedSim>), Failure> {
        match self {
            ChosenRobot::Robot(target) => Ok((target, None)),
            ChosenRobot::Sim(world) => {
                let sim = EmbeddedSim::start(*world, login, seed, kind)?;
                let address = sim.address();
                let target = Target {
                    host: address.ip().to_string(),
                    port: address.port(),
                };
                Ok((target, Some(sim)))
            }
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
