//! Outages around a service that runs for weeks: a full disk, a clock that is set back, a robot
//! that is gone for a night.

use std::path::{Path, PathBuf};
use std::process::Command as Process;

use rustix::process::Signal;
use spykee::wire::{Command, Led};

use crate::rig::{QUIET_WORLD, Rig, WAIT_LIMIT, run_spykee};

const BASE: &str = "time_zone: UTC\nservice: { user: root }\n";

async fn wait_until(mut what: impl FnMut() -> bool) {
    let looks = async {
        while !what() {
            tokio::time::sleep(std::time::Duration::from_millis(20)).await;
        }
    };
    tokio::time::timeout(WAIT_LIMIT, looks)
        .await
        .expect("waited too long");
}

/// A separate file system, unmounted with the test.
struct Disk(PathBuf);

impl Disk {
    /// `None` if this system does not permit a mount.
    fn mount(at: &Path, mebibytes: u64) -> Option<Disk> {
        std::fs::create_dir(at).unwrap();
        let size = format!("size={mebibytes}m");
        let mount = ["-t", "tmpfs", "-o", &size, "tmpfs", at.to_str().unwrap()];
        let done = Process::new("mount").args(mount).output();
        let done = done.is_ok_and(|output| output.status.success());
        done.then(|| Disk(at.to_owned()))
    }
}

impl Drop for Disk {
    fn drop(&mut self) {
        let _ = Process::new("umount").arg("--lazy").arg(&self.0).status();
    }
}

fn kinds(rig: &Rig, kind: &str) -> i64 {
    let path = rig.folder().join("disk/data/.journal/journal.db");
    let flags = rusqlite::OpenFlags::SQLITE_OPEN_READ_WRITE;
    let Ok(connection) = rusqlite::Connection::open_with_flags(path, flags) else {
        return 0;
    };
    let count = "SELECT count(*) FROM event WHERE kind = ?";
    connection
        .query_row(count, [kind], |row| row.get(0))
        .unwrap_or(0)
}

#[tokio::test(flavor = "multi_thread")]
async fn a_full_disk_does_not_affect_driving_and_the_journal_resumes_when_there_is_room() {
    let rig = Rig::quiet().await;
    let Some(disk) = Disk::mount(&rig.folder().join("disk"), 40) else {
        return println!("no disk can be mounted here: a full one was not tried");
    };
    let ticks = "local n = 0 while true do n += 1 journal.add('tick', {n = n})
        robot.led('left', n % 2 == 1) task.wait(0.1) end";
    rig.file("ticks.lua", ticks);
    rig.file(
        "spykee.yaml",
        &format!("{BASE}data: disk/data\nbehaviours: [{{ file: ticks.lua }}]\n"),
    );
    let mut run = rig.spykee(&["serve", "--config", "spykee.yaml", "--robot", &rig.address]);
    wait_until(|| kinds(&rig, "entry") > 0).await;
    let filler = disk.0.join("filler");
    std::fs::write(&filler, vec![7; 30 << 20]).unwrap();
    run.says("the journal cannot be written: the disk has less than")
        .await;
    let mut at = rig.sim.heard_count();
    for on in [true, false, true, false, true, false] {
        let light = move |command: &Command| *command == Command::Led { led: Led::Left, on };
        at = rig.heard(at, light).await + 1;
    }
    let stuck = kinds(&rig, "entry");
    std::fs::remove_file(&filler).unwrap();
    wait_until(|| kinds(&rig, "entry") > stuck + 5).await;
    run.signal(Signal::TERM);
    assert_eq!(run.code().await, Some(0), "{}", run.text());
}

/// Shifts the clock for one program, by the number of seconds in a file, which may change at any
/// time.
const SHIFT: &str = r#"
#define _GNU_SOURCE
#include <dlfcn.h>
#include <fcntl.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <time.h>
static volatile int64_t *shift;
__attribute__((constructor)) static void begin(void) {
    const char *path = getenv("CLOCK_SHIFT");
    int file = path ? open(path, O_RDONLY | O_CLOEXEC) : -1;
    void *page = file < 0 ? MAP_FAILED : mmap(0, 8, PROT_READ, MAP_SHARED, file, 0);
    if (page != MAP_FAILED) shift = page;
}
int clock_gettime(clockid_t clock, struct timespec *now) {
    static int (*real)(clockid_t, struct timespec *);
    if (!real) real = (int (*)(clockid_t, struct timespec *))dlsym(RTLD_NEXT, "clock_gettime");
    int done = real(clock, now);
    if (!done && clock == CLOCK_REALTIME && shift) now->tv_sec += *shift;
    return done;
}
"#;

/// `None` if no C compiler is installed.
fn shifted_clock(rig: &Rig) -> Option<(PathBuf, PathBuf)> {
    let source = rig.file("shift.c", SHIFT);
    let library = rig.folder().join("shift.so");
    let seconds = rig.folder().join("seconds");
    std::fs::write(&seconds, 0_i64.to_ne_bytes()).unwrap();
    let mut compile = Process::new("cc");
    compile
        .args(["-shared", "-fPIC", "-O1", "-o"])
        .arg(&library)
        .arg(source);
    let made = compile.output().is_ok_and(|output| output.status.success());
    made.then_some((library, seconds))
}

/// Sets the shift in seconds. Writes in place, because the program has the file mapped.
fn set_clock(seconds: &Path, shift: i64) {
    use std::io::Write as _;
    let file = std::fs::File::options().write(true).open(seconds);
    file.unwrap().write_all(&shift.to_ne_bytes()).unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn the_timetable_waits_until_the_clock_is_set() {
    let rig = Rig::quiet().await;
    let Some((library, seconds)) = shifted_clock(&rig) else {
        return println!("no C compiler is here: a clock that is not set was not tried");
    };
    rig.file("often.lua", "task.wait(1)");
    let rest = "behaviours: [{ file: often.lua }]\nschedule: [{ run: often, at: '* * * * *' }]\n";
    rig.file("spykee.yaml", &format!("{BASE}{rest}"));
    let environment = [
        ("LD_PRELOAD", library.to_str().unwrap()),
        ("CLOCK_SHIFT", seconds.to_str().unwrap()),
    ];
    // Like a computer whose clock has no battery, right after its start.
    set_clock(&seconds, -1_700_000_000);
    let args = ["serve", "--config", "spykee.yaml", "--robot", &rig.address];
    let mut run = rig.spykee_with(&args, &environment);
    run.says("connected").await;
    run.says("the clock is not set").await;
    assert!(!run.text().contains("starts by the timetable"));
    // It looks at least every 15 s, and then waits for the next full minute.
    set_clock(&seconds, until_second(44));
    run.says("the clock is set: the timetable begins").await;
    run.says("starts by the timetable").await;
    run.signal(Signal::TERM);
    assert_eq!(run.code().await, Some(0), "{}", run.text());
}

/// How far a clock must be set for it to show this second of a minute now.
fn until_second(second: i64) -> i64 {
    second - jiff::Timestamp::now().as_second() % 60
}

#[tokio::test(flavor = "multi_thread")]
async fn a_clock_set_back_by_a_day_is_reported_and_the_timetable_follows_it() {
    let rig = Rig::quiet().await;
    let Some((library, seconds)) = shifted_clock(&rig) else {
        return println!("no C compiler is here: a clock that is set was not tried");
    };
    rig.file("often.lua", "journal.add('here') task.wait(1)");
    let rest = "behaviours: [{ file: often.lua }]\nschedule: [{ run: often, at: '* * * * *' }]\n";
    rig.file("spykee.yaml", &format!("{BASE}{rest}"));
    let environment = [
        ("LD_PRELOAD", library.to_str().unwrap()),
        ("CLOCK_SHIFT", seconds.to_str().unwrap()),
    ];
    let args = ["serve", "--config", "spykee.yaml", "--robot", &rig.address];
    // So that the test need not wait long for the next full minute.
    set_clock(&seconds, until_second(50));
    let mut run = rig.spykee_with(&args, &environment);
    run.says("starts by the timetable").await;
    run.says("the script has finished").await;
    // It looks at least every 15 s, and then waits for the next full minute.
    set_clock(&seconds, until_second(44) - 86_400);
    run.says("the clock was set by -8").await;
    let again = async {
        while run.text().matches("starts by the timetable").count() < 2 {
            tokio::time::sleep(std::time::Duration::from_millis(50)).await;
        }
    };
    let minutes = std::time::Duration::from_secs(150);
    tokio::time::timeout(minutes, again)
        .await
        .expect("it does not start again within a minute");
    wait_until(|| run.text().matches("the script has finished").count() > 1).await;
    run.signal(Signal::TERM);
    assert_eq!(run.code().await, Some(0), "{}", run.text());
    let (code, text) = run_spykee(
        &rig,
        &["history", "entries", "--json", "--config", "spykee.yaml"],
    )
    .await;
    assert_eq!(code, Some(0), "{text}");
    let entries: serde_json::Value = serde_json::from_str(&text).unwrap();
    let times: Vec<&str> = entries
        .as_array()
        .unwrap()
        .iter()
        .map(|one| one["at"].as_str().unwrap())
        .collect();
    assert!(
        times.len() >= 2 && times[0] > times[1],
        "as they happened: {times:?}"
    );
    let (_, runs) = run_spykee(&rig, &["history", "runs", "--config", "spykee.yaml"]).await;
    assert!(
        runs.contains("0:00:01") && !runs.contains('-'.to_string().repeat(2).as_str()),
        "{runs}"
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn the_service_tries_until_an_unreachable_robot_is_back_and_the_history_shows_the_gap() {
    let options = spykee::sim::Options {
        faults: Some(Vec::new()),
        ..spykee::sim::Options::default()
    };
    let world = spykee::sim::World::from_yaml(QUIET_WORLD, "test").unwrap();
    let rig = Rig::with(world, options).await;
    rig.file("drive.lua", "while true do robot.move(30, 30, 0.5) end");
    rig.file(
        "spykee.yaml",
        &format!("{BASE}behaviours: [{{ file: drive.lua }}]\n"),
    );
    let mut run = rig.spykee(&["serve", "--config", "spykee.yaml", "--robot", &rig.address]);
    rig.heard_motion(0).await;
    // `scripts/month` plays outages of twelve hours, in virtual time.
    let gone = "faults: [{ fault: reboot, for: 8, state: lost }]";
    let faults = spykee::sim::Fault::list_from_yaml(gone, "gone").unwrap();
    faults.into_iter().for_each(|fault| rig.sim.begin(fault));
    run.says("reconnecting").await;
    let from = rig.sim.heard_count();
    let back = rig
        .heard(from, |command| matches!(command, Command::Login(_)))
        .await;
    let first = rig.heard(back + 1, |_| true).await;
    assert_eq!(
        rig.commands(first)[0],
        Command::STOP,
        "the first command is not a stop"
    );
    rig.heard_motion(back).await;
    run.signal(Signal::TERM);
    assert_eq!(run.code().await, Some(0), "{}", run.text());
    let history = ["history", "link", "--json", "--config", "spykee.yaml"];
    let (_, text) = run_spykee(&rig, &history).await;
    let records: serde_json::Value = serde_json::from_str(&text).unwrap();
    let records = records.as_array().unwrap();
    let kinds: Vec<&str> = records
        .iter()
        .map(|one| one["event"].as_str().unwrap())
        .collect();
    assert!(
        kinds.starts_with(&["link_up", "link_down", "link_up"]),
        "{kinds:?}"
    );
}
