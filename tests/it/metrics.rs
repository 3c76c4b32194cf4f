//! Figures for Prometheus, by its own tool where that is installed.

use std::io::Write as _;
use std::process::{Command, Stdio};

use crate::live::{get, live};
use crate::rig::Rig;

/// In Prometheus's older format, which `promtool` reads: there a counter's name ends with `_total` in the
/// lines about it, too.
fn in_the_older_format(figures: &str) -> String {
    let counters: Vec<&str> = figures
        .lines()
        .filter_map(|line| line.strip_prefix("# TYPE ")?.strip_suffix(" counter"))
        .collect();
    let lines = figures
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
async fn promtool_has_nothing_to_say_against_the_figures() {
    let started = Command::new("promtool")
        .args(["check", "metrics"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn();
    let Ok(mut promtool) = started else {
        eprintln!("skipped: promtool is not installed (Debian's package prometheus)");
        return;
    };
    let rig = Rig::quiet().await;
    let (_run, at) = live(&rig, "task.wait(600)", &[]).await;
    let (_, figures) = get(&at, "/metrics").await;
    let text = in_the_older_format(&figures);
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
