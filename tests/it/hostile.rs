//! Attacks on the agent, one script each, in `tests/hostile/`. All scripts of a kind run one after
//! the other in one agent, beside a well-behaved behaviour; new files are picked up automatically.
//!
//! The first comment of a script names the attack. `-- expect:` lists the permitted endings by
//! their reasons; `-- expect: refused: WORDS` marks a file that must not even be loaded;
//! `-- expect where times do not count: REASON` is a further permitted ending on an emulated
//! machine. Before the first line of the script, the harness makes it wait for its turn, drive, and
//! set the volume. This is the mark from which all times are measured.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::time::Duration;

use rustix::process::Pid;
use serde_json::Value;
use spykee::wire::{Command, EngineReport, Led, Report};
use tokio::time::{Instant, sleep, timeout};

use crate::rig::{
    Rig, Run, STOPPED_FOR_SILENCE, Stopwatch, WAIT_LIMIT, longest_stall, moves, run_spykee,
};

/// From the mark, which is set before an attack begins, to the stop of the tracks. On a busy
/// machine, hosts are scheduled after everything else.
const STOPPED_WITHIN: Duration = Duration::from_secs(2);
/// From the end of a behaviour to the end of its process.
const GONE_WITHIN: Duration = Duration::from_secs(1);
/// The longest permitted silence of the well-behaved behaviour, whose beat is 50 ms; this machine
/// may be busy.
const LONGEST_GAP: Duration = Duration::from_secs(1);
/// The beat of the well-behaved behaviour.
const BEAT: Duration = Duration::from_millis(50);
/// The share of its beats that it must keep, percent.
const BEATS_KEPT: u128 = 95;
/// The permitted growth of the agent's memory, over all attacks of a kind.
const GROWTH_KIB: i64 = 4 * 1024;
/// The ENGINE code that starts the first attack; the protocol does not use it.
const FIRST_TURN: u8 = 100;

/// Whether times are checked: not on an emulated machine (`scripts/check-arm`), where everything
/// takes many times as long.
fn times_count() -> bool {
    std::env::var_os("SPYKEE_TEST_TIMES").is_none_or(|times| times != "emulated")
}

/// The time limit: the usual one, or minutes where times are not checked.
fn at_most(usual: Duration) -> Duration {
    match times_count() {
        true => usual,
        false => Duration::from_secs(180),
    }
}

/// Beats until the robot reports that a sound has ended.
const BYSTANDER: &str = "
    local on = false
    local beat = task.every(0.05, function()
        on = not on
        robot.led('right', on)
    end)
    robot.wait_for('sound_finished')
    beat:cancel()";

/// On an emulated machine a well-behaved script needs more time than the usual limit permits. On a
/// busy one, so does a script that is to meet the limit of its memory.
const SLOW: &str = "limits: { callback_budget_ms: 1000 }";

/// One script of the folder.
struct Attack {
    name: String,
    source: Vec<u8>,
    expected: String,
    /// A further permitted ending where times are not checked.
    expected_when_slow: String,
}

impl Attack {
    fn read(path: &Path) -> Attack {
        let source = std::fs::read(path).unwrap();
        let text = String::from_utf8_lossy(&source);
        let after = |prefix| text.lines().find_map(|line| line.strip_prefix(prefix));
        let expected = after("-- expect: ");
        let expected = expected.unwrap_or_else(|| panic!("{} has no `-- expect:`", path.display()));
        let expected = expected.trim().to_owned();
        let expected_when_slow = after("-- expect where times do not count: ");
        let expected_when_slow = expected_when_slow.unwrap_or_default().trim().to_owned();
        let name = path.file_stem().unwrap().to_str().unwrap().to_owned();
        Attack {
            name,
            source,
            expected,
            expected_when_slow,
        }
    }

    /// Whether the first permitted ending is this one.
    fn is(&self, ending: &str) -> bool {
        self.expected.split([' ', ':']).next() == Some(ending)
    }

    /// On a slow machine, the time limit may end a script before any other limit does. A stall of the
    /// machine may change the order of things.
    fn may_end(&self, reason: &str, stalled: bool) -> bool {
        let slow = !times_count();
        let otherwise = (slow || stalled) && reason == self.expected_when_slow;
        let over_time = slow && reason == "cpu";
        otherwise || over_time || self.expected.split(' ').any(|expected| expected == reason)
    }

    /// The script, preceded by code that waits for its turn.
    fn armed(&self, turn: u8) -> String {
        let code = FIRST_TURN + turn;
        let source = std::str::from_utf8(&self.source).unwrap();
        format!(
            "repeat until robot.wait_for('engine').code == {code} \
             robot.move(50, 50) robot.volume({turn}) task.wait(0.05)\n{source}"
        )
    }
}

/// Every script of the folder, sorted by name.
fn scripts() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/hostile");
    let files = std::fs::read_dir(folder).unwrap();
    let files = files.map(|entry| entry.unwrap().path());
    let is_script = |path: &PathBuf| path.extension().is_some_and(|ending| ending == "lua");
    let mut files: Vec<PathBuf> = files.filter(is_script).collect();
    files.sort();
    files
}

/// The attacks whose first permitted ending is this one, sorted by name.
fn attacks(ending: &str) -> Vec<Attack> {
    let files = scripts();
    let attacks = files.iter().map(|path| Attack::read(path));
    attacks.filter(|attack| attack.is(ending)).collect()
}

/// One agent, and the attacks that it must withstand.
struct Round {
    run: Run,
    rig: Rig,
    /// Promises that were broken.
    broken: Vec<String>,
    /// Reasons with which the attacks ended.
    reasons: BTreeSet<String>,
}

impl Round {
    async fn start(attacks: &[Attack]) -> Round {
        let rig = Rig::quiet().await;
        let mut files = vec![rig.file("bystander.lua", BYSTANDER)];
        for (turn, attack) in (0..).zip(attacks) {
            files.push(rig.file(&format!("{}.lua", attack.name), &attack.armed(turn)));
        }
        let files: Vec<&str> = files.iter().map(|file| file.to_str().unwrap()).collect();
        let options = [
            "--robot",
            &rig.address,
            "--log-format",
            "json",
            "--seed",
            "7",
            // Scripts that pass the check must still be stopped by the sandbox.
            "--no-check",
        ];
        let allocates = |attack: &Attack| attack.is("memory");
        let slow: &[&str] = match times_count() && !attacks.iter().all(allocates) {
            true => &[],
            false => {
                rig.file("spykee.yaml", SLOW);
                &["--config", "spykee.yaml"]
            }
        };
        let run = rig.spykee(&[&["run"], &files[..], &options, slow].concat());
        Round {
            rig,
            run,
            broken: Vec::new(),
            reasons: BTreeSet::new(),
        }
    }

    fn promise(&mut self, kept: bool, words: impl FnOnce() -> String) {
        if !kept {
            self.broken.push(words());
        }
    }

    async fn attack(&mut self, attack: &Attack, turn: u8) {
        let name = &attack.name;
        let host = host_of(&self.run, name);
        let from = self.rig.sim.heard_count();
        let logged = self.run.text().len();
        let watch = Stopwatch::start();
        self.rig
            .sim
            .inject(Report::Engine(EngineReport::Unknown(FIRST_TURN + turn)));
        let mark = self
            .rig
            .heard(from, |command| *command == Command::Volume(turn))
            .await;
        let (reason, message) = self.ending(name).await;
        self.rig.stands_still().await;
        let stalled = watch.stalled();
        // A host may be so slow, or the machine stall, that its motion is stopped for silence before
        // it attacks, and even before the mark; it then drives on.
        let silenced = self.run.text()[logged..].contains(STOPPED_FOR_SILENCE);
        let stopped_before = silenced || !times_count() || !stalled.is_zero();
        let heard = self.rig.sim.heard_since(from);
        let last_motion = heard.iter().rposition(|heard| moves(&heard.command));
        let drove_until = match stopped_before {
            true => last_motion.unwrap_or(0),
            // A stop overtakes the mark, which waits for its pace.
            false => last_motion.map_or(0, |last| last.min(mark - from)),
        };
        let stop = heard[drove_until..]
            .iter()
            .find(|heard| heard.command == Command::STOP);
        let took = stop.map_or(Duration::MAX, |stop| {
            stop.at.saturating_sub(self.rig.at(mark).0)
        });
        let took = took.saturating_sub(stalled);
        eprintln!(
            "{name}: {reason}, tracks stopped after {} ms: {message}",
            took.as_millis()
        );
        self.promise(took <= at_most(STOPPED_WITHIN), || {
            format!("{name}: drove for {took:?}")
        });
        self.promise(attack.may_end(&reason, !stalled.is_zero()), || {
            format!("{name}: ended with {reason}: {message}")
        });
        self.promise(!message.is_empty(), || format!("{name}: no message"));
        self.reasons.insert(reason);
        let gone = gone(host).await;
        self.promise(gone, || format!("{name}: its host is still running"));
        let commands = self.rig.commands(mark);
        let is_motion = |command: &&Command| matches!(command, Command::Move { .. });
        let drives_on = match stopped_before {
            true => commands.iter().rfind(is_motion).is_some_and(moves),
            false => {
                let mut after = commands.iter().skip_while(|one| **one != Command::STOP);
                after.any(moves)
            }
        };
        self.promise(!drives_on, || format!("{name}: drove on after the stop"));
    }

    /// The reason and message with which a behaviour ended.
    async fn ending(&self, name: &str) -> (String, String) {
        let begun = Instant::now();
        loop {
            let text = self.run.text();
            let records = text
                .lines()
                .filter_map(|line| serde_json::from_str::<Value>(line).ok());
            let field = |record: &Value, key: &str| record[key].as_str().unwrap_or("").to_owned();
            let mut ended =
                records.filter(|one| one["behaviour"] == name && !one["reason"].is_null());
            if let Some(record) = ended.next() {
                return (field(&record, "reason"), field(&record, "message"));
            }
            assert!(begun.elapsed() < WAIT_LIMIT, "{name} does not end:\n{text}");
            sleep(Duration::from_millis(5)).await;
        }
    }

    /// The number of beats of the well-behaved behaviour since `from`, and its longest silence.
    fn beats(&self, from: usize) -> (usize, Duration) {
        let is_beat = |command: &Command| {
            matches!(
                command,
                Command::Led {
                    led: Led::Right,
                    ..
                }
            )
        };
        let heard = self.rig.sim.heard_since(from);
        let beats: Vec<Duration> = heard
            .iter()
            .filter(|heard| is_beat(&heard.command))
            .map(|heard| heard.at)
            .collect();
        let gaps = beats.windows(2).map(|pair| pair[1].saturating_sub(pair[0]));
        (beats.len(), gaps.max().unwrap_or(Duration::MAX))
    }

    /// Ends the well-behaved behaviour, and with it the run.
    async fn finish(mut self) {
        let failed = ["cpu", "memory", "error"]
            .iter()
            .any(|bad| self.reasons.contains(*bad));
        let code = i32::from(failed);
        let bystander = host_of(&self.run, "bystander");
        self.rig.sim.inject(Report::SoundFinished);
        let ended = self.run.code().await;
        self.promise(ended == Some(code), || {
            format!("exit code {ended:?} and not {code}")
        });
        let gone = gone(bystander).await;
        self.promise(gone, || "a host outlived its agent".to_owned());
        assert!(
            self.broken.is_empty(),
            "{}\n\n{}",
            self.broken.join("\n"),
            self.run.text()
        );
    }
}

/// All attacks of one kind on one agent, one after the other.
async fn run_attacks(ending: &str) {
    let attacks = attacks(ending);
    let mut round = Round::start(&attacks).await;
    let is_beat = |command: &Command| matches!(command, Command::Led { .. });
    let first_beat = round.rig.sim.wait_heard(0, is_beat);
    let from = timeout(at_most(WAIT_LIMIT), first_beat).await;
    let from = from.unwrap_or_else(|_| panic!("no behaviour starts:\n{}", round.run.text()));
    let memory = resident_kib(&round.run);
    let begun = Stopwatch::start();
    for (turn, attack) in (0..).zip(&attacks) {
        round.attack(attack, turn).await;
    }
    let growth = resident_kib(&round.run) - memory;
    let took = begun.elapsed();
    let (beats, gap) = round.beats(from);
    eprintln!(
        "{} attacks in {took:?}: {beats} beats, longest gap {gap:?}, grown by {growth} KiB",
        attacks.len()
    );
    round.promise(gap <= at_most(LONGEST_GAP) + longest_stall(), || {
        format!("the well-behaved behaviour was silent for {gap:?}")
    });
    let due = took.as_millis() / BEAT.as_millis();
    let kept = beats as u128 * 100 >= due * BEATS_KEPT;
    round.promise(kept || !times_count(), || {
        format!("the well-behaved behaviour kept {beats} of {due} beats")
    });
    round.promise(growth <= GROWTH_KIB, || {
        format!("the agent grew by {growth} KiB")
    });
    round.finish().await;
}

/// The process of a behaviour, found by the folder that it may use.
fn host_of(run: &Run, name: &str) -> Pid {
    let is_its = |pid: &Pid| {
        let line = std::fs::read(format!("/proc/{}/cmdline", pid.as_raw_nonzero()));
        line.is_ok_and(|line| line.ends_with(format!("/{name}\0").as_bytes()))
    };
    let host = run.hosts().into_iter().find(is_its);
    host.unwrap_or_else(|| panic!("{name} has no host:\n{}", run.text()))
}

async fn gone(host: Pid) -> bool {
    let begun = Stopwatch::start();
    while Path::new(&format!("/proc/{}", host.as_raw_nonzero())).exists() {
        if begun.elapsed() > at_most(GONE_WITHIN) {
            return false;
        }
        sleep(Duration::from_millis(5)).await;
    }
    true
}

fn resident_kib(run: &Run) -> i64 {
    let status = std::fs::read_to_string(format!("/proc/{}/status", run.pid().as_raw_nonzero()));
    let status = status.unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
    line.unwrap()
        .trim()
        .trim_end_matches(" kB")
        .parse()
        .unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn scripts_that_never_wait_lose_the_robot_and_disturb_nothing_else() {
    run_attacks("cpu").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn scripts_that_allocate_all_memory_lose_the_robot_and_disturb_nothing_else() {
    run_attacks("memory").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn scripts_that_fail_lose_the_robot_and_disturb_nothing_else() {
    run_attacks("error").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn scripts_that_flood_and_pry_get_nothing_and_disturb_nothing_else() {
    run_attacks("done").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn files_that_are_not_scripts_are_refused_before_the_agent_connects() {
    let attacks = attacks("refused");
    assert!(!attacks.is_empty());
    for attack in attacks {
        let rig = Rig::quiet().await;
        let path = rig.folder().join("attack.lua");
        std::fs::write(&path, &attack.source).unwrap();
        let mut run = rig.spykee(&[
            "run",
            path.to_str().unwrap(),
            "--robot",
            &rig.address,
            "--no-check",
        ]);
        let code = run.code().await;
        let text = run.text();
        eprintln!("{}: {text}", attack.name);
        assert_eq!(code, Some(1), "{}: {text}", attack.name);
        let words = attack.expected.trim_start_matches("refused:").trim();
        assert!(
            text.contains("attack.lua") && text.contains(words),
            "{}: {text}",
            attack.name
        );
        assert_eq!(rig.commands(0), [], "{}", attack.name);
    }
}

#[test]
fn every_attack_has_a_known_ending() {
    let known = ["cpu", "memory", "error", "done", "refused"];
    let counted: usize = known.iter().map(|ending| attacks(ending).len()).sum();
    assert_eq!(counted, scripts().len());
    assert!(counted >= 90, "only {counted}");
}

/// The bytes of pictures in the behaviour's folder.
fn pictures(rig: &Rig) -> u64 {
    let folder = rig.folder().join("spykee-data/flood");
    let files = std::fs::read_dir(folder).into_iter().flatten();
    let sizes = files.map(|file| file.unwrap().metadata().unwrap().len());
    sizes.sum()
}

/// A service with one behaviour, which may write 24 times this much per day, and so this much at once.
fn flooded(rig: &Rig, script: &str, at_once: u64) -> Run {
    rig.file("flood.lua", script);
    let limits = format!("limits: {{ bytes_a_day: {} }}\n", 24 * at_once);
    let config = format!("{limits}service: {{ user: root }}\nbehaviours:\n- file: flood.lua\n");
    rig.file("spykee.yaml", &config);
    rig.spykee(&["serve", "--config", "spykee.yaml", "--robot", &rig.address])
}

#[tokio::test(flavor = "multi_thread")]
async fn restarts_do_not_renew_the_budget_of_the_day() {
    const AT_ONCE: u64 = 200_000;
    let rig = Rig::quiet().await;
    let script = "
        local frame = robot.wait_frame()
        local start = store.get('start', 0) + 1
        store.set('start', start)
        local number = 0
        repeat number += 1 task.wait(0.01) until not frame:save(`{start}-{number}`)
        log.info(`start {start} is over`)
        task.wait(600)";
    let mut run = flooded(&rig, script, AT_ONCE);
    run.says("start 1 is over").await;
    let once = pictures(&rig);
    assert!(once > AT_ONCE / 2, "{once}");
    for start in 2..=8 {
        let (code, text) = run_spykee(&rig, &["behaviour", "restart", "flood"]).await;
        assert_eq!(code, Some(0), "{text}");
        run.says(&format!("start {start} is over")).await;
    }
    let all = pictures(&rig);
    assert!(all < 2 * AT_ONCE, "{once} by one start, {all} by eight");
    run.signal(rustix::process::Signal::TERM);
    run.code().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_host_that_writes_more_than_it_may_is_noticed_and_ended() {
    let rig = Rig::quiet().await;
    let script = "log.info('here I am') while true do robot.move(30, 30, 0.5) end";
    let mut run = flooded(&rig, script, 200_000);
    run.says("here I am").await;
    let moving = rig.heard_motion(0).await;
    // The agent cannot know that not the host does this.
    let huge = rig.folder().join("spykee-data/flood/huge");
    std::fs::write(&huge, vec![0; 16 << 20]).unwrap();
    run.says("has written more to its folder").await;
    let mut heard = rig.commands(moving).into_iter().rev();
    let last = heard.find(|command| moves(command) || *command == Command::STOP);
    assert_eq!(last, Some(Command::STOP));
    let stopped = rig.sim.heard_count();
    let (_, text) = run_spykee(&rig, &["behaviour", "restart", "flood"]).await;
    assert!(text.contains("has written more"), "{text}");
    let moved = rig.commands(stopped).into_iter().find(moves);
    assert_eq!(moved, None, "it drives again");
    run.signal(rustix::process::Signal::TERM);
    run.code().await;
}
