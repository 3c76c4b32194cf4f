//! The metrics for Prometheus, as exact lines of its text format, and checked by `promtool` where it is
//! installed.

use std::io::Write as _;
use std::process::{Command, Stdio};

use tokio::time::{sleep, timeout};

use crate::live::{get, live};
use crate::rig::{Rig, Run, WAIT_LIMIT, docked};

/// The metrics of a robot that was driven by its camera, sent home by a person, and then by the
/// watchdog.
async fn metrics() -> (Rig, Run, String) {
    let world = docked();
    let rig = Rig::new(&world, spykee::sim::Firmware::default()).await;
    let script = "print(robot.dock()) robot.undock() local power = 20
        robot.on('frame', function() power = 50 - power robot.move(power, power) end) task.wait(600)";
    rig.file("ends.lua", "print('ends')");
    let (run, at) = live(&rig, script, &["ends.lua"]).await;
    let all = async {
        loop {
            let (status, text) = get(&at, "/metrics").await;
            assert_eq!(status, 200, "{text}");
            let has = |what: &str| text.contains(what);
            if !has("spykee_frame_to_move_seconds_count 0\n") {
                // The script answers a frame with a motion.
                rig.sim.set_battery(10.0);
            }
            if has("spykee_safety_acts_total{") && has("spykee_docks_total{") && has("ends_total{")
            {
                return text;
            }
            sleep(std::time::Duration::from_millis(50)).await;
        }
    };
    let text = timeout(WAIT_LIMIT, all)
        .await
        .expect("some metrics are missing");
    (rig, run, text)
}

#[tokio::test(flavor = "multi_thread")]
async fn the_metrics_are_valid_openmetrics() {
    let (_rig, _run, text) = metrics().await;
    assert!(text.ends_with("# EOF\n"), "{text}");
    for (name, kind, sample) in [
        ("spykee_battery_percent", "gauge", ""),
        ("spykee_battery_left_seconds", "gauge", ""),
        ("spykee_robot_delay_seconds", "gauge", ""),
        ("spykee_network_delay_seconds", "gauge", ""),
        ("spykee_battery_charging", "gauge", ""),
        ("spykee_battery_low", "gauge", ""),
        ("spykee_docked", "gauge", ""),
        ("spykee_link_up", "gauge", ""),
        ("spykee_link_logins", "counter", "_total"),
        ("spykee_link_losses", "counter", "_total"),
        ("spykee_camera_frames", "counter", "_total"),
        ("spykee_camera_bytes", "counter", "_total"),
        ("spykee_frame_to_move_seconds", "histogram", "_sum"),
        ("spykee_docks", "counter", "_total{code=\""),
        ("spykee_safety_acts", "counter", "_total{action=\""),
        ("spykee_behaviour_starts", "counter", "_total"),
        ("spykee_behaviour_ends", "counter", "_total{reason=\""),
    ] {
        for begins in [
            format!("# HELP {name} "),
            format!("# TYPE {name} {kind}"),
            format!("{name}{sample}"),
        ] {
            let found = text.lines().filter(|line| line.starts_with(&begins));
            assert_ne!(found.count(), 0, "{begins}\n{text}");
        }
    }
    assert!(
        value(&text, "spykee_camera_bytes_total ") > 1000.0,
        "{text}"
    );
    // Each bucket contains the ones before it, and the last one everything.
    let buckets = text
        .lines()
        .filter(|line| line.contains("_to_move_seconds_bucket{"));
    let counts: Vec<f64> = buckets.map(|line| value(line, "}")).collect();
    assert!(counts.is_sorted() && counts.len() > 2, "{text}");
    let count = value(&text, "spykee_frame_to_move_seconds_count ");
    assert_eq!(counts.last(), Some(&count), "{text}");
    assert_eq!(
        value(&text, "_seconds_bucket{le=\"+Inf\"}"),
        count,
        "{text}"
    );
}

/// The number behind these words.
fn value(text: &str, words: &str) -> f64 {
    let (_, rest) = text.split_once(words).unwrap();
    let number = rest.lines().next().unwrap();
    number.trim().parse().unwrap()
}

/// Converts to Prometheus's older format, which `promtool` reads: there, the `HELP` and `TYPE`
/// lines of a counter also have its name with `_total`.
fn in_the_older_format(metrics: &str) -> String {
    let counters: Vec<&str> = metrics
        .lines()
        .filter_map(|line| line.strip_prefix("# TYPE ")?.strip_suffix(" counter"))
        .collect();
    let lines = metrics
        .lines()
        .filter(|line| !line.starts_with("# UNIT") && *line != "# EOF");
    let about = |line: &str| {
        let mut words = line.splitn(4, ' ');
        let (Some("#"), Some(kind), Some(name)) = (words.next(), words.next(), words.next()) else {
            return line.to_owned();
        };
        let rest = words.next().unwrap_or_default();
        match counters.contains(&name) {
            true => format!("# {kind} {name}_total {rest}"),
            false => line.to_owned(),
        }
    };
    lines.map(|line| about(line) + "\n").collect()
}

#[tokio::test(flavor = "multi_thread")]
async fn promtool_accepts_the_metrics() {
    let started = Command::new("promtool")
        .args(["check", "metrics"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn();
    let Ok(mut promtool) = started else {
        // Debian packages it only with all of Prometheus: 96 MB and a service.
        eprintln!("skipped: promtool is not installed (Debian's package prometheus)");
        return;
    };
    let (_rig, _run, metrics) = metrics().await;
    let text = in_the_older_format(&metrics);
    promtool
        .stdin
        .take()
        .unwrap()
        .write_all(text.as_bytes())
        .unwrap();
    let said = promtool.wait_with_output().unwrap();
    let words = String::from_utf8_lossy(&said.stderr) + String::from_utf8_lossy(&said.stdout);
    assert!(said.status.success() && words.is_empty(), "{words}\n{text}");
}
