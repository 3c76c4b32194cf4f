//! A robot that is not there at the time of a start.

use std::time::{Duration, SystemTime, UNIX_EPOCH};

use rustix::process::Signal;
use spykee::sim::{Options, World};
use tokio::time::timeout;

use super::{DRIVES, config, ends_well};
use crate::rig::{QUIET_WORLD, Rig, WAIT_LIMIT};

#[tokio::test(flavor = "multi_thread")]
async fn a_start_waits_for_the_robot_also_if_the_service_restarts_meanwhile() {
    let home = Rig::quiet().await;
    let listener = std::net::TcpListener::bind("127.0.7.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    drop(listener);
    home.file("drive.lua", DRIVES);
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap();
    let minute = now.as_secs() / 60 - 1;
    let at = format!("{} {} * * *", minute % 60, minute / 60 % 24);
    let schedule = format!("schedule:\n- {{ run: drive, at: '{at}', for: 1h }}\n");
    config(
        &home,
        "",
        &format!("behaviours:\n- file: drive.lua\n{schedule}"),
    );
    let robot = address.to_string();
    let args = ["serve", "--config", "spykee.yaml", "--robot", &robot];
    let mut run = home.spykee(&args);
    let record = home.folder().join("spykee-data/schedule.json");
    let kept = async {
        while !std::fs::read_to_string(&record).is_ok_and(|text| text.contains("drive")) {
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
    };
    let kept = timeout(WAIT_LIMIT, kept).await;
    kept.unwrap_or_else(|_| panic!("not recorded:\n{}", run.text()));
    run.signal(Signal::KILL);
    run.status().await;
    let options = Options {
        listen: address,
        ..Options::default()
    };
    let late = Rig::with(World::from_yaml(QUIET_WORLD, "test").unwrap(), options).await;
    let mut next = home.spykee(&args);
    next.says("starts by the timetable").await;
    late.heard_motion(0).await;
    ends_well(&mut next).await;
}
