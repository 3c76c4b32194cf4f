//! `spykee repl` with lines from a pipe, as a person would type them, with a simulated robot.

use std::process::Stdio;

use rustix::process::Signal;
use tokio::io::AsyncWriteExt as _;
use tokio::process::{Child, ChildStdin, Command as Process};
use tokio::time::timeout;

use crate::rig::{Rig, WAIT_LIMIT, assert_contains};
use spykee::wire::Command;

/// A session that reads its lines from a pipe.
struct Session {
    child: Child,
    prompt: ChildStdin,
}

impl Session {
    fn start(rig: &Rig) -> Session {
        let mut child = Process::new(env!("CARGO_BIN_EXE_spykee"))
            .args(["repl", "--robot", &rig.address, "--seed", "7"])
            .current_dir(rig.folder())
            .env_remove("RUST_LOG")
            .env("XDG_STATE_HOME", rig.folder())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .kill_on_drop(true)
            .spawn()
            .unwrap();
        let prompt = child.stdin.take().unwrap();
        Session { child, prompt }
    }

    async fn types(&mut self, text: &str) {
        self.prompt.write_all(text.as_bytes()).await.unwrap();
        self.prompt.flush().await.unwrap();
    }

    /// Closes the input and waits for the end: exit code, stdout, stderr.
    async fn ends(self) -> (Option<i32>, String, String) {
        drop(self.prompt);
        let output = timeout(WAIT_LIMIT, self.child.wait_with_output()).await;
        let output = output.expect("it does not end").unwrap();
        let text = |bytes| String::from_utf8(bytes).unwrap();
        (
            output.status.code(),
            text(output.stdout),
            text(output.stderr),
        )
    }
}

async fn typed(lines: &str) -> (Option<i32>, String, String) {
    let rig = Rig::quiet().await;
    let mut session = Session::start(&rig);
    session.types(lines).await;
    session.ends().await
}

#[tokio::test(flavor = "multi_thread")]
async fn expressions_print_their_values_and_statements_take_effect() {
    let lines = "1 + 1\n\
                 x = { 1, 2, a = { 3 }, s = 'q\\n' }\n\
                 x\n\
                 nil, 'text'\n\
                 function double(n)\n  return 2 * n\nend\n\
                 double(21)\n\
                 print('said')\n";
    let (code, out, err) = typed(lines).await;
    let shown: Vec<&str> = out.lines().collect();
    assert_eq!(code, Some(0), "{out}{err}");
    assert_eq!(shown[0], "2");
    assert!(
        shown[1].starts_with("{1, 2, ") && shown[1].contains("a = {…}"),
        "{out}"
    );
    assert!(shown[1].contains("s = \"q\\n\""), "{out}");
    assert_eq!(&shown[2..], ["nil\t\"text\"", "42", "said"], "{err}");
}

#[tokio::test(flavor = "multi_thread")]
async fn the_config_that_was_found_is_named_and_used() {
    let rig = Rig::quiet().await;
    rig.file("spykee.yaml", "streams: { video: off }\n");
    let mut session = Session::start(&rig);
    session.types("robot.stream('video', true)\n").await;
    let (code, out, err) = session.ends().await;
    assert_eq!(code, Some(1), "{out}{err}");
    assert_contains(&err, &["settings from spykee.yaml"]);
    assert!(out.contains("the config keeps video off"), "{out}{err}");
}

#[tokio::test(flavor = "multi_thread")]
async fn mistakes_are_explained_and_the_session_continues() {
    let lines = "robot.moev(1, 1)\nrobot.move(140, 0)\n1 +\n\nfor\n\n'still here'\n";
    let (code, out, err) = typed(lines).await;
    assert_eq!(code, Some(1), "{out}{err}");
    for words in ["did you mean 'move'?", "-100", "still here"] {
        assert!(out.contains(words), "{words}: {out}");
    }
    for word in ["panicked", "mlua", "traceback", "Error("] {
        assert!(
            !out.contains(word) && !err.contains(word),
            "{word}: {out}{err}"
        );
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_mistake_gets_the_help_that_check_gives_and_help_names_the_reference() {
    let lines = "x = [1]\nlen(3)\nprint(hello)\nhelp\n";
    let (code, out, err) = typed(lines).await;
    assert_eq!(code, Some(1), "{out}{err}");
    for words in [
        "help: a list is written in braces: { 1, 2, 3 }",
        "help: the length of a list or text is #list",
        "help: if this is a text, write it in quotes: \"hello\"",
        "`spykee api NAME` explains one",
    ] {
        assert!(out.contains(words), "{words}: {out}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_line_that_never_waits_ends_the_session_and_a_new_one_begins() {
    let (code, out, err) = typed("x = 1\nwhile true do end\nx\n2 + 3\n").await;
    assert_eq!(code, Some(1), "{out}{err}");
    for words in ["cpu", "a new session starts", "unknown name 'x'", "5"] {
        assert!(out.contains(words), "{words}: {out}{err}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn waiting_calls_wait_tasks_run_on_and_a_setpoint_holds_between_lines() {
    let rig = Rig::quiet().await;
    let mut session = Session::start(&rig);
    session
        .types("ok, code = robot.move(30, 30, 0.3)\ncode\n")
        .await;
    let moved = rig.heard_motion(0).await;
    let stopped = rig.heard_stop(moved).await;
    session
        .types("beats = 0 task.every(0.05, function() beats += 1 end)\nrobot.move(40, 40)\n")
        .await;
    let wanted = Command::Move {
        left: 36,
        right: 36,
    };
    let first = rig.heard(stopped, |command| *command == wanted).await;
    session.types("task.wait(0.5)\nbeats > 2\n").await;
    let again = rig.heard(first + 1, |command| *command == wanted).await;
    let (code, out, err) = session.ends().await;
    rig.heard_stop(again).await;
    assert_eq!(code, Some(0), "{out}{err}");
    assert!(
        out.contains("\"done\"") && out.contains("true"),
        "{out}{err}"
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn a_signal_ends_the_session_with_a_stop_even_while_a_line_waits() {
    let rig = Rig::quiet().await;
    let mut session = Session::start(&rig);
    session.types("robot.move(30, 30) task.wait(100)\n").await;
    let moved = rig.heard_motion(0).await;
    let pid = i32::try_from(session.child.id().unwrap()).unwrap();
    rustix::process::kill_process(rustix::process::Pid::from_raw(pid).unwrap(), Signal::TERM)
        .unwrap();
    rig.heard_stop(moved).await;
    let status = timeout(WAIT_LIMIT, session.child.wait())
        .await
        .unwrap()
        .unwrap();
    assert_eq!(status.code(), Some(130));
}

#[tokio::test(flavor = "multi_thread")]
async fn an_endless_line_is_reported_and_discarded() {
    let rig = Rig::quiet().await;
    let mut session = Session::start(&rig);
    let part = "x".repeat(1 << 20);
    for _ in 0..32 {
        session.types(&part).await;
    }
    session.types("\n40 + 2\n").await;
    let (_, said, _) = session.ends().await;
    assert_contains(&said, &["this input is too long", "42"]);
}
