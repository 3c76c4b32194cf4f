//! The real robots, as the server knows them: passes on what the queue decides, and what the robots'
//! agents report. An agent that has ended is started again.

use std::io;
use std::path::PathBuf;
use std::time::Duration;

use serde_json::{Value, json};
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;

use super::children::{Child, LOG, RobotSetup};
use super::learner::RunPlan;
use super::queue::{Facts, Queue, TurnError};
use super::robot::{Order, RobotNews, Start};

/// The pause before an agent that has ended is started again.
const AGAIN: Duration = Duration::from_secs(5);

#[derive(Debug, Default)]
pub(super) struct Robots {
    pub(super) queue: Queue,
    robots: Vec<RealRobot>,
}

#[derive(Debug)]
struct RealRobot {
    setup: RobotSetup,
    child: Option<Child>,
    /// When its agent was last started.
    started: Option<Instant>,
    /// The number of the newest order.
    ordered: u64,
    /// Why the script of this turn failed.
    error: Option<String>,
}

impl Robots {
    pub(super) fn new(setups: Vec<RobotSetup>) -> Robots {
        let queue = Queue::new(setups.iter().map(|setup| setup.name.clone()));
        let robot = |setup| RealRobot {
            setup,
            child: None,
            started: None,
            ordered: 0,
            error: None,
        };
        Robots {
            queue,
            robots: setups.into_iter().map(robot).collect(),
        }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.robots.is_empty()
    }

    /// Starts the agents that do not run.
    pub(super) fn launch(
        &mut self,
        now: Instant,
        start: impl Fn(usize, &RobotSetup) -> io::Result<Child>,
    ) {
        for (index, robot) in self.robots.iter_mut().enumerate() {
            let due = robot.started.is_none_or(|at| now - at >= AGAIN);
            if robot.child.is_some() || !due {
                continue;
            }
            robot.started = Some(now);
            robot.ordered = 0;
            robot.child = start(index, &robot.setup)
                .map_err(|error| tracing::warn!("robot {}: {error}", robot.setup.name))
                .ok();
        }
    }

    /// Notes what an agent reports; `None`: it has ended, and its guardian stops the robot.
    pub(super) fn hear(&mut self, index: usize, news: Option<RobotNews>) {
        let robot = &mut self.robots[index];
        let gone = Facts {
            stands: true,
            ..Facts::default()
        };
        let facts = match news {
            None => {
                let setup = &robot.setup;
                let log = setup.data.join(LOG);
                let log = log.display();
                tracing::warn!(
                    "robot {}: its agent has ended; its log is {log}",
                    setup.name
                );
                robot.child = None;
                gone
            }
            Some(news) => {
                robot.error = news.error;
                let stands = news.facts.stands && news.done == robot.ordered;
                Facts {
                    stands,
                    ..news.facts
                }
            }
        };
        self.queue.note(index, facts);
    }

    /// Ends and begins turns, and tells robots to stand.
    pub(super) fn poll(&mut self, now: Instant, here: impl Fn(&str) -> bool) {
        for index in self.queue.poll(now, here) {
            self.order(index, None);
        }
    }

    /// Starts a learner's script on the robot whose turn it is; one that runs is ended first.
    pub(super) fn start(
        &mut self,
        learner: &str,
        plan: RunPlan,
        now: Instant,
    ) -> Result<(), TurnError> {
        let index = self.queue.start(learner)?;
        let start = Start {
            driver: learner.to_owned(),
            plan,
            lasts: self.queue.robots[index].left(now),
        };
        self.order(index, Some(start));
        Ok(())
    }

    /// Ends a learner's script on the robot; the turn goes on.
    pub(super) fn halt(&mut self, learner: &str) -> Result<(), TurnError> {
        let index = self.queue.halt(learner)?;
        self.order(index, None);
        Ok(())
    }

    fn order(&mut self, index: usize, start: Option<Start>) {
        let robot = &mut self.robots[index];
        robot.ordered += 1;
        let turn = self.queue.robots[index].turn.as_ref();
        let order = Order {
            number: robot.ordered,
            turn: turn.map(|turn| turn.number),
            start,
        };
        let Some(child) = &mut robot.child else {
            return;
        };
        if let Err(error) = child.tell(&order) {
            let name = &robot.setup.name;
            tracing::warn!("robot {name}: its agent does not listen, and is ended: {error}");
            child.kill();
        }
    }

    /// Where viewers reach a robot.
    pub(super) fn socket(&self, index: usize) -> Option<PathBuf> {
        Some(self.robots[index].child.as_ref()?.socket())
    }

    /// The robots whose agents have not heard the teacher's STOP yet.
    pub(super) fn to_stop(&self) -> impl Iterator<Item = PathBuf> {
        let waits = |index: &usize| self.queue.robots[*index].stop_waits;
        let waiting = (0..self.robots.len()).filter(waits);
        waiting.filter_map(|index| self.socket(index))
    }

    /// Where a learner reaches the robot whose turn it is, and the end of the turn.
    pub(super) fn of_driver(&self, learner: &str) -> Option<(PathBuf, CancellationToken)> {
        let index = self.queue.robot_of(learner)?;
        let turn = self.queue.robots[index].turn.as_ref()?;
        Some((self.socket(index)?, turn.over.clone()))
    }

    /// What a learner's page shows.
    pub(super) fn seen_by(&self, learner: &str, now: Instant) -> Value {
        let mut view = self.queue.seen_by(learner, now);
        if let Some(index) = self.queue.robot_of(learner) {
            view["turn"]["error"] = json!(self.robots[index].error);
        }
        view
    }
}
