//! A test rig for scripts: it advances the time, collects the output, and delivers the robot's
//! answers.

mod events;
mod examples;
mod frames;
mod hostile;
mod language;
mod life;
mod modules;
mod motion;
mod params;
mod sounds_and_lights;
mod stdlib;
mod store;
mod tasks;
mod vision;

use std::time::Duration;

use tokio::time::Instant;

use super::{
    Evaluated, Explain, FromHost, Level, LogLine, ModuleFile, ModuleName, NoModule, Options,
    Script, ScriptExit,
};
use crate::robot::{DeclaredParam, EndReason, Event, HostReport, Intent, MotionEnd, RobotInfo};

/// A script and its output.
struct Rig {
    script: Script,
    now: Instant,
    intents: Vec<Intent>,
    log: Vec<LogLine>,
    /// Modules that the script has requested.
    modules: Vec<ModuleName>,
    /// The results of typed lines.
    answers: Vec<Evaluated>,
    /// Remarks: output that does not concern the robot.
    reports: Vec<HostReport>,
    /// The parameters as last sent.
    params: Vec<DeclaredParam>,
}

impl Rig {
    /// Loads a script and runs it until all tasks wait. Budgets are generous, so that a stalled
    /// machine does not end the script.
    fn new(source: &str) -> Rig {
        Rig::with(source, |options| {
            options.limits.callback_budget_ms = 2_000;
        })
    }

    fn with(source: &str, adjust: impl FnOnce(&mut Options)) -> Rig {
        let mut rig = Rig::loaded(source, adjust);
        rig.run();
        rig
    }

    fn loaded(source: &str, adjust: impl FnOnce(&mut Options)) -> Rig {
        let mut options = Options::new("test", "test.lua");
        adjust(&mut options);
        let now = Instant::now();
        Rig {
            script: Script::load(source.as_bytes(), options, now).unwrap(),
            now,
            intents: Vec::new(),
            log: Vec::new(),
            modules: Vec::new(),
            answers: Vec::new(),
            reports: Vec::new(),
            params: Vec::new(),
        }
    }

    /// Runs what is ready at this time.
    fn run(&mut self) {
        loop {
            self.script.run_ready(self.now);
            self.collect();
            if !self.script.is_ready() {
                break;
            }
        }
    }

    fn collect(&mut self) {
        for output in self.script.take_output() {
            match output {
                FromHost::Intent(intent) => self.intents.push(intent),
                FromHost::Log(line) => self.log.push(line),
                FromHost::Module(name) => self.modules.push(name),
                FromHost::Evaluated(answer) => self.answers.push(answer),
                FromHost::HostReport(report) => self.reports.push(report),
                FromHost::Params(params) => self.params = params,
                other => panic!("not a script's: {other:?}"),
            }
        }
    }

    /// Advances the time, with a stop at every deadline on the way.
    fn pass(&mut self, seconds: f64) {
        let end = self.now + Duration::from_secs_f64(seconds);
        while let Some(at) = self.script.next_deadline().filter(|at| *at <= end) {
            self.now = self.now.max(at);
            self.run();
        }
        self.now = end;
        self.run();
    }

    /// Delivers the requested modules from these files, until no more are requested.
    fn serve(&mut self, files: &[(&str, &str)]) {
        while !self.modules.is_empty() {
            let name = self.modules.remove(0);
            let known = files.iter().find(|(file, _)| {
                let stem = file.trim_end_matches(".luau").trim_end_matches(".lua");
                stem == name.as_str()
            });
            let file = known.map(|(file, source)| ModuleFile {
                file: (*file).to_owned(),
                source: source.as_bytes().to_vec(),
            });
            let file =
                file.ok_or_else(|| NoModule(format!("module '{}' was not found", name.as_str())));
            self.script.deliver_module(&name, file, self.now);
            self.run();
        }
    }

    fn deliver(&mut self, event: Event) {
        self.script.deliver(event, self.now);
        self.run();
    }

    /// The texts of the log lines above debug level.
    fn texts(&self) -> Vec<&str> {
        let lines = self.log.iter().filter(|line| line.level != Level::Debug);
        lines.map(|line| line.text.as_str()).collect()
    }

    fn logged(&self, level: Level) -> Vec<&str> {
        let of_level = self.log.iter().filter(|line| line.level == level);
        of_level.map(|line| line.text.as_str()).collect()
    }

    fn take_intents(&mut self) -> Vec<Intent> {
        std::mem::take(&mut self.intents)
    }

    fn exit(&self) -> ScriptExit {
        self.script.ended().expect("the script has ended")
    }

    #[track_caller]
    fn assert_ended(&self, reason: EndReason, words: &str) {
        let exit = self.exit();
        let message = exit.message.clone().unwrap_or_default();
        assert_eq!(exit.reason, reason, "{message}");
        assert!(message.contains(words), "{message:?} lacks {words:?}");
    }
}

/// Runs a script to its end; returns what it printed.
fn printed(source: &str) -> String {
    let rig = Rig::new(source);
    assert_eq!(rig.exit().message, None);
    rig.texts().join("\n")
}

/// The message with which a script fails.
#[track_caller]
fn failure(source: &str) -> String {
    let exit = Rig::new(source).exit();
    assert_eq!(exit.reason, EndReason::Error, "{exit:?}");
    exit.message.unwrap_or_default()
}

/// The explained message with which a script fails on a robot whose camera sees a plain picture.
pub(crate) fn failure_with(source: &str, explain: Explain) -> String {
    let mut rig = Rig::loaded(source, |options| {
        options.limits.callback_budget_ms = 2_000;
    });
    rig.script.explain_with(explain);
    rig.run();
    rig.deliver(connected(false));
    vision::show(&mut rig, 1, &vision::picture(&[]));
    rig.pass(2.0);
    rig.exit().message.unwrap_or_default()
}

/// Pairs of a text and what comes of it, one a line: `TEXT => WORDS`.
pub(crate) fn cases(lines: &str) -> impl Iterator<Item = (&str, &str)> {
    let lines = lines.lines().map(str::trim);
    lines.map(|line| line.split_once(" => ").expect("a pair"))
}

fn connected(docked: bool) -> Event {
    let info = RobotInfo {
        uid: "SPYKEE0001".to_owned(),
        name: "Spykee".to_owned(),
        firmware: "1.0.22".to_owned(),
        address: "172.17.6.1:9000".to_owned(),
        simulated: true,
    };
    Event::Connected { info, docked }
}

fn motion_ended(intent: &Intent, end: MotionEnd) -> Event {
    match intent {
        Intent::Move { motion, .. } => Event::MotionEnded {
            motion: *motion,
            end,
        },
        other => panic!("not a motion: {other:?}"),
    }
}
