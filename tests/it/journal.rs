//! The journal of real runs: its contents after kills, with slow disks and wrong folders, and the
//! output of `spykee history`.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use rusqlite::{Connection, OpenFlags};
use rustix::process::Signal;
use spykee::wire::{Command, Led};

use crate::rig::{QUIET_WORLD, Rig, Run, WAIT_LIMIT, assert_contains};

const CONFIG: &str = "data: data\njournal: { record: on }\nbehaviours: [{ file: one.lua }]\n";

fn start(rig: &Rig, script: &str) -> Run {
    rig.file("one.lua", script);
    rig.run_config(CONFIG)
}

fn file(rig: &Rig) -> PathBuf {
    rig.folder().join("data/.journal/journal.db")
}

/// Opens the journal, which must exist.
fn open(rig: &Rig) -> rusqlite::Result<Connection> {
    Connection::open_with_flags(file(rig), OpenFlags::SQLITE_OPEN_READ_WRITE)
}

fn number(connection: &Connection, query: &str) -> i64 {
    let number = connection.query_row(query, [], |row| row.get::<_, Option<i64>>(0));
    number.unwrap_or_default().unwrap_or(0)
}

/// Repeats a query until its result is not 0.
async fn written(rig: &Rig, query: &str) -> i64 {
    let until = Instant::now() + WAIT_LIMIT;
    while Instant::now() < until {
        if let Ok(connection) = open(rig)
            && let Ok(found) = connection.query_row(query, [], |row| row.get::<_, i64>(0))
            && found > 0
        {
            return found;
        }
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    panic!("the journal has no result for {query}");
}

async fn history(rig: &Rig, args: &[&str]) -> (Option<i32>, String) {
    let all = [&["history", "--config", "spykee.yaml"], args].concat();
    let mut run = rig.spykee(&all);
    let code = run.code().await;
    (code, run.text())
}

#[tokio::test(flavor = "multi_thread")]
async fn killed_at_any_moment_the_journal_is_whole_and_lacks_at_most_the_last_second() {
    // `scripts/kill-journal` kills a hundred runs.
    let kills: u64 =
        std::env::var("SPYKEE_TEST_JOURNAL_KILLS").map_or(12, |text| text.parse().unwrap());
    let rig = Rig::quiet().await;
    let ticks = "local n = 0 while true do n += 1 journal.add('tick', {n = n}) print('tick ' .. n) task.wait(0.02) end";
    for kill in 0..kills {
        let mut run = start(&rig, ticks);
        run.says("tick 5").await;
        // Spread over more than a second, in irregular order.
        let pause = (kill * 7919) % 1300;
        tokio::time::sleep(Duration::from_millis(pause)).await;
        run.signal(Signal::KILL);
        run.status().await;
        let said = run
            .text()
            .lines()
            .filter(|line| line.contains("tick "))
            .count() as i64;
        // A run that is killed before its first write leaves no entries, or no file at all.
        let kept = open(&rig).map_or(0, |connection| {
            let check: String = connection
                .query_row("PRAGMA integrity_check", [], |row| row.get(0))
                .unwrap();
            assert_eq!(check, "ok", "kill {kill}");
            let of = |what: &str| {
                let pid = run.pid().as_raw_nonzero();
                format!(
                    "SELECT {what} FROM event WHERE kind = 'entry'
                     AND session = (SELECT max(id) FROM session WHERE pid = {pid})"
                )
            };
            let kept = number(&connection, &of("max(json_extract(data, '$.data.n'))"));
            let whole = number(&connection, &of("count(*)"));
            assert_eq!(kept, whole, "kill {kill}: an entry in between is missing");
            kept
        });
        // Fifty ticks take at least a second.
        assert!(said - kept <= 50, "kill {kill}: {kept} of {said}");
    }
    let cut_off = "SELECT count(*) FROM session WHERE ended IS NULL";
    let cut_off = number(&open(&rig).unwrap(), cut_off);
    assert!(cut_off >= kills as i64 / 2, "{cut_off} of {kills}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_stalled_disk_does_not_affect_driving_and_no_entry_is_lost() {
    let rig = Rig::quiet().await;
    let lights = "journal.add('before')
        for n = 1, 200 do journal.add('tick', {n = n}) robot.led('left', n % 2 == 1) task.wait(0.05) end";
    let mut run = start(&rig, lights);
    written(&rig, "SELECT count(*) FROM event WHERE kind = 'entry'").await;
    let holder = open(&rig).unwrap();
    holder.busy_timeout(WAIT_LIMIT).unwrap();
    holder.execute_batch("BEGIN EXCLUSIVE").unwrap();
    let stuck = number(&holder, "SELECT count(*) FROM event");
    let from = rig.sim.heard_since(0).len();
    let light = |on: bool| move |command: &Command| *command == Command::Led { led: Led::Left, on };
    let mut at = from;
    for number in 0..40 {
        at = rig.heard(at, light(number % 2 == 0)).await + 1;
    }
    assert_eq!(
        number(&holder, "SELECT count(*) FROM event"),
        stuck,
        "the journal was written nevertheless"
    );
    holder.execute_batch("COMMIT").unwrap();
    assert_eq!(run.code().await, Some(0), "{}", run.text());
    let ticks = "SELECT count(*) FROM event WHERE json_extract(data, '$.kind') = 'tick'";
    assert_eq!(number(&holder, ticks), 200);
}

#[tokio::test(flavor = "multi_thread")]
async fn an_unwritable_journal_is_reported_and_written_as_soon_as_possible() {
    let rig = Rig::quiet().await;
    std::fs::create_dir(rig.folder().join("data")).unwrap();
    let wall = rig.file("data/.journal", "in the way");
    let mut run = start(&rig, "journal.add('early') print('runs') task.wait(600)");
    run.says("runs").await;
    run.says("the journal cannot be written").await;
    std::fs::remove_file(wall).unwrap();
    written(&rig, "SELECT count(*) FROM event WHERE kind = 'entry'").await;
    run.signal(Signal::INT);
    run.code().await;
    let connection = open(&rig).unwrap();
    assert_eq!(
        number(
            &connection,
            "SELECT count(*) FROM session WHERE ended IS NOT NULL"
        ),
        1
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn history_shows_runs_entries_pictures_and_the_battery() {
    let rig = Rig::quiet().await;
    let script = "journal.add('moved', {energy = 3.5})
        print(robot.wait_frame(20):save('seen'))
        notify.send('hello')
        error('no')";
    let mut run = start(&rig, script);
    assert_eq!(run.code().await, Some(1), "{}", run.text());
    for (topic, words) in [
        ("all", "Spykee at 127.0.0.1"),
        ("link", "up"),
        ("runs", "one.lua:4"),
        ("entries", "energy=3.5"),
        ("pictures", "data/one/seen.jpg"),
        ("messages", "hello"),
        ("battery", "90"),
    ] {
        let (code, text) = history(&rig, &[topic]).await;
        assert_eq!(code, Some(0), "{text}");
        assert!(text.contains(words), "{topic}: {words}\n{text}");
    }
    let (_, text) = history(&rig, &["--json", "--since", "1h"]).await;
    let records: serde_json::Value = serde_json::from_str(&text).unwrap();
    let kinds: Vec<&str> = records
        .as_array()
        .unwrap()
        .iter()
        .map(|one| one["event"].as_str().unwrap())
        .collect();
    for kind in ["link_up", "started", "entry", "picture", "notify", "ended"] {
        assert!(kinds.contains(&kind), "{kind}: {kinds:?}");
    }
    let (_, text) = history(&rig, &["runs", "--csv"]).await;
    assert!(
        text.starts_with("began,ended,lasted,behaviour,by,end,what\n"),
        "{text}"
    );
    let (_, text) = history(&rig, &["--until", "2001-01-01"]).await;
    assert_contains(&text, &["the journal has no such entries"]);
}

#[tokio::test(flavor = "multi_thread")]
async fn history_shows_docks_and_alarms_with_their_reasons() {
    let firmware = spykee::sim::Firmware {
        search_limit: Duration::from_millis(300),
        ..Default::default()
    };
    let rig = Rig::new(QUIET_WORLD, firmware).await;
    rig.sim.hide_station(true);
    rig.file(
        "one.lua",
        "print(robot.dock({ retries = 0 })) print('tried') task.wait(600)",
    );
    let watchdog = "watchdog: { dock_retries: 0, blind_moves: false, rescue: off }\n";
    let mut run = rig.run_config(&format!("{CONFIG}{watchdog}"));
    run.says("tried").await;
    rig.sim.set_battery(15.0);
    run.says("action=alarm").await;
    written(&rig, "SELECT count(*) FROM event WHERE kind = 'safety' AND json_extract(data, '$.action') = 'alarm'").await;
    run.signal(Signal::INT);
    run.code().await;
    let (code, docks) = history(&rig, &["docks"]).await;
    assert_eq!(code, Some(0), "{docks}");
    assert_contains(&docks, &["base_not_found", "one"]);
    let (code, alarms) = history(&rig, &["alarms"]).await;
    assert_eq!(code, Some(0), "{alarms}");
    assert_contains(&alarms, &["alarm"]);
    let (_, json) = history(&rig, &["docks", "--json"]).await;
    let docks: serde_json::Value = serde_json::from_str(&json).unwrap();
    let script = docks
        .as_array()
        .unwrap()
        .iter()
        .find(|one| one["by"] == "one");
    assert_eq!(script.unwrap()["end"], "base_not_found", "{json}");
}

#[tokio::test(flavor = "multi_thread")]
async fn without_a_journal_history_explains_how_to_keep_one() {
    let rig = Rig::quiet().await;
    rig.file("spykee.yaml", "data: data\n");
    let (code, text) = history(&rig, &[]).await;
    assert_eq!(code, Some(2));
    assert_contains(&text, &["there is no journal in data", "record: on"]);
    let (code, text) = history(&rig, &["--since", "yesterday"]).await;
    assert_eq!(code, Some(2), "{text}");
    assert_contains(&text, &["7d"]);
}
