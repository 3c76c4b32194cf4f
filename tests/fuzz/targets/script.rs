//! Arbitrary bytes as a script, and words of the language and the API in any order: the script is
//! rejected, or it runs with events and frames and is ended, without a crash and within its
//! budgets.
#![no_main]

use std::time::Duration;

use bytes::Bytes;
use libfuzzer_sys::fuzz_target;
use spykee::robot::{Battery, EndReason, Event, Frame, MotionEnd, Percent};
use spykee::robot::{DockEnd, DockOutcome, Intent, RobotInfo};
use spykee::script::{FromHost, Options, Script};
use tokio::time::Instant;

const JPEG: &[u8] = include_bytes!("../../fixtures/ball-grey.jpg");
/// Maximum number of slices for a script, because a loop of tasks could continue forever.
const SLICES: u32 = 60;
/// Maximum output of one slice: the queue of intents and the log are bounded.
const MAX_OUTPUT: usize = 4096;

/// The word for each byte, if the source is made of words.
#[rustfmt::skip]
const WORDS: &[&str] = &[
    "robot", "task", "script", "log", "vision", "math", "string", "table", "coroutine", "buffer",
    "vector", "bit32", "utf8", "os", "_G", "self", "x", "y", "f", "t", ".move", ".drive",
    ".forward", ".turn", ".stop", ".led", ".blink", ".play", ".stop_sound", ".volume", ".say",
    ".stream", ".battery", ".docked", ".info", ".dock", ".undock", ".cancel_dock", ".on", ".once",
    ".wait_for", ".frame", ".wait_frame", ".wait", ".spawn", ".delay", ".every", ".all", ".race",
    ".timeout", ".now", ".usage", ".on_stop", ".name", ".lab", ".hsv", ".tracker", ".learn",
    ".motion", ".debug", ".warn", ".error", ".wrap", ".create", ".resume", ".yield", ".close",
    ".status", ".rep", ".find", ".gsub", ".gmatch", ".match", ".format", ".split", ".pack",
    ".unpack", ".byte", ".char", ".sort", ".concat", ".insert", ".remove", ".move", ".clone",
    ".freeze", ".random", ".huge", ":cancel()", ":join(0.1)", ":off()", ":find_blobs('red')",
    ":find_line('black')", ":find_qrcodes()", ":brightness()", ":get_pixel(1, 2)", ":save('a')",
    ":update", ":best()", ":reset()", ".seq", ".age", ".width", "'frame'", "'battery'", "'docked'",
    "'noise'", "'left'", "'all'", "'alarm'", "'video'", "'red'", "'%d+'", "'(.-)%1'", "''", "0",
    "1", "-1", "0.1", "1e308", "0/0", "50", "2^53", "true", "false", "nil", "{", "}", "{}", "(",
    ")", "[", "]", ",", ";", "=", "==", "~=", "<", "..", "+", "-", "*", "/", "//", "%", "#", "not",
    "and", "or", "...", "function", "function()", "end", "return", "local", "if", "then", "else",
    "for", "in", "do", "while", "repeat", "until", "break", "continue", "pcall", "xpcall", "error",
    "assert", "print", "pairs", "ipairs", "next", "select", "type", "tostring", "tonumber",
    "setmetatable", "getmetatable", "rawget", "rawset", "__index", "__tostring", "__gc", "__call",
    "__eq", "__mode", "`{x}`", "::", "type", "\n", "for i = 1, 9 do", "while true do",
    "robot.on('frame', function(f)", "task.spawn(function()", "pcall(function()", "end)",
];

fuzz_target!(|bytes: &[u8]| {
    // The mode is the last byte: a text file, which ends with an even byte, a newline, is then used
    // unchanged as a script.
    let Some((&how, rest)) = bytes.split_last() else {
        return;
    };
    if how % 2 == 0 {
        return live(rest);
    }
    let words = rest
        .iter()
        .map(|&byte| WORDS[usize::from(byte) % WORDS.len()]);
    let source: Vec<&str> = words.collect();
    live(source.join(" ").as_bytes());
});

fn live(source: &[u8]) {
    let mut options = Options::new("fuzz", "fuzz.lua");
    options.limits.callback_budget_ms = 20;
    let mut now = Instant::now();
    let mut script = match Script::load(source, options, now) {
        Ok(script) => script,
        Err(failure) => return assert!(!failure.to_string().is_empty()),
    };
    for slice in 0..SLICES {
        script.run_ready(now);
        let answers = take_output(&mut script);
        if script.ended().is_some() {
            break;
        }
        answers
            .into_iter()
            .for_each(|event| script.deliver(event, now));
        happen(&mut script, slice, now);
        now += Duration::from_millis(30);
    }
    script.stop(EndReason::Cancelled, now);
    for _ in 0..SLICES {
        script.run_ready(now);
        take_output(&mut script);
        now += Duration::from_millis(30);
    }
    script.stop(EndReason::Cpu, now);
    assert!(script.ended().is_some(), "the script has not ended");
    assert!(!script.has_motion(), "the script still drives");
}

fn take_output(script: &mut Script) -> Vec<Event> {
    let output = script.take_output();
    assert!(output.len() <= MAX_OUTPUT, "{} outputs", output.len());
    let answers = output.into_iter().filter_map(|output| match output {
        FromHost::Intent(intent) => answer(&intent),
        _ => None,
    });
    answers.collect()
}

/// Returns the immediate answer to an intent.
fn answer(intent: &Intent) -> Option<Event> {
    match intent {
        Intent::Move {
            motion,
            duration: Some(_),
            ..
        } => Some(Event::MotionEnded {
            motion: *motion,
            end: MotionEnd::Done,
        }),
        Intent::Dock { call, .. } => Some(Event::DockEnded {
            call: *call,
            outcome: DockOutcome::without_attempt(DockEnd::BaseNotFound),
        }),
        Intent::Undock { call, .. } => Some(Event::UndockEnded {
            call: *call,
            end: DockEnd::NotDocked,
        }),
        _ => None,
    }
}

fn happen(script: &mut Script, slice: u32, now: Instant) {
    let event = match slice {
        1 => Event::Connected {
            info: RobotInfo {
                uid: "SPYKEE0001".to_owned(),
                name: "Spykee".to_owned(),
                firmware: "1.0.22".to_owned(),
                address: "127.0.0.1:9000".to_owned(),
                simulated: true,
            },
            docked: false,
        },
        2 => Event::Battery(Battery {
            percent: Some(Percent::saturating(50)),
            charging: false,
            minutes_left: None,
        }),
        3 => Event::Audio(Bytes::from_static(&[7; 321])),
        4 => Event::Docked,
        5 => Event::Undocked,
        6 => Event::Engine { code: 99 },
        _ => {
            if script.wants_frames() {
                let seq = u64::from(slice);
let jpeg = Bytes::from_static(JPEG);
                script.deliver_frame(Frame { seq, at: now, jpeg }, now);
            }
            return;
        }
    };
    script.deliver(event, now);
}
