//! The promises of the link with the simulator, over loopback TCP.

use super::*;
use spykee::sim::{Firmware, Handle, Server};
use tokio::task::JoinHandle;

struct Sim {
    handle: Handle,
    target: Target,
    task: JoinHandle<io::Result<()>>,
}

impl Drop for Sim {
    fn drop(&mut self) {
        self.task.abort();
    }
}

async fn sim(firmware: Firmware) -> Sim {
    let options = spykee::sim::Options {
        firmware,
        ..Default::default()
    };
    let server = Server::bind(crate::rig::exact("living_room"), options)
        .await
        .unwrap();
    Sim {
        handle: server.handle(),
        target: server.local_addr().to_string().parse().unwrap(),
        task: tokio::spawn(server.run()),
    }
}

impl Sim {
    async fn connect(&self, login: &Login) -> Result<Session, LinkError> {
        let options = Options {
            login_timeout: Duration::from_secs(5),
            dead_after: Duration::from_millis(500),
            ..Options::default()
        };
        link::connect(&self.target, login, stop(), &options).await
    }

    /// Waits until the robot has received a command, from index `from` on; returns its index.
    async fn wait_for(&self, from: usize, wanted: Command) -> usize {
        within_limit(self.handle.wait_heard(from, |command| *command == wanted)).await
    }

    /// The commands that the robot received over one connection; the first is 0.
    fn heard(&self, client: u64) -> Vec<Command> {
        let heard = self.handle.heard().into_iter();
        heard
            .filter(|heard| heard.client == client)
            .map(|heard| heard.command)
            .collect()
    }
}

#[tokio::test]
async fn every_session_begins_with_a_stop_also_after_a_lost_link() {
    let sim = sim(Firmware::default()).await;
    let login = admin();
    let mut first = sim.connect(&login).await.unwrap();
    assert_eq!(first.accepted.uid, "SPYKEE0001");
    first.writer.write(&[GO]).await.unwrap();
    sim.wait_for(0, GO).await;
    sim.handle.disconnect_all();
    while first.reader.next().await.is_ok() {}
    drop(first);
    let lost = sim.handle.heard_count();
    let _second = sim.connect(&login).await.unwrap();
    sim.wait_for(lost, Command::STOP).await;
    assert_eq!(
        sim.heard(0)[..3],
        [Command::Login(login.clone()), Command::STOP, GO]
    );
    assert_eq!(sim.heard(1), [Command::Login(login), Command::STOP]);
}

#[tokio::test]
async fn a_wrong_password_is_final() {
    let sim = sim(Firmware::default()).await;
    let error = sim
        .connect(&Login::new("admin", "nimda"))
        .await
        .unwrap_err();
    assert!(error.is_final(), "{error}");
}

#[tokio::test]
async fn the_second_user_learns_who_the_first_is_and_can_log_in_after_that_one_left() {
    let sim = sim(Firmware::default()).await;
    let first = sim.connect(&admin()).await.unwrap();
    let error = sim.connect(&admin()).await.unwrap_err();
    assert!(
        matches!(&error, LinkError::InUse { by: Some(user) } if user == "admin"),
        "{error}"
    );
    link::hang_up(first.reader, first.writer).await;
    within_limit(sim.handle.wait_state(|state| state.user.is_none())).await;
    sim.connect(&admin()).await.unwrap();
}

#[tokio::test]
async fn a_robot_that_never_sends_power_is_not_driven() {
    let firmware = Firmware {
        power_after_login: Duration::from_secs(3600),
        power_period: Duration::from_secs(3600),
        ..Firmware::default()
    };
    let sim = sim(firmware).await;
    let error = sim.connect(&admin()).await.unwrap_err();
    assert!(matches!(error, LinkError::NoPower { .. }), "{error}");
    let heard = sim.heard(0);
    assert_eq!(heard[0], Command::Login(admin()));
    assert!(
        heard[1..].iter().all(|command| *command == Command::STOP),
        "{heard:?}"
    );
}

#[tokio::test]
async fn a_dropped_session_stops_a_robot_that_would_drive_on() {
    let sim = sim(Firmware::default()).await;
    let mut session = sim.connect(&admin()).await.unwrap();
    session.writer.write(&[GO]).await.unwrap();
    let go = sim.wait_for(0, GO).await;
    drop(session);
    sim.wait_for(go, Command::STOP).await;
}

#[tokio::test]
async fn a_robot_that_stops_reading_is_a_dead_link_in_time() {
    let sim = sim(Firmware::default()).await;
    let mut session = sim.connect(&admin()).await.unwrap();
    sim.handle.mute(true);
    let long = [Command::ConfigSet("x".repeat(60_000).into())];
    let writing = async {
        loop {
            if let Err(error) = session.writer.write(&long).await {
                return error;
            }
        }
    };
    let error = within_limit(writing).await;
    assert!(matches!(error, LinkError::Dead { .. }), "{error}");
}
