//! Passes a notification to a program of the owner: the text on its standard input, the rest as
//! arguments and in its environment. When it ends, the timeout has passed or this agent ends, its
//! whole process group is killed.

use std::io::Write as _;
use std::os::unix::process::CommandExt as _;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use rustix::process::{Pid, Signal, kill_process_group};
use tokio_util::sync::CancellationToken;

use super::options::Target;
use super::template::{Slot, fill};
use super::{Delivery, Notice};

const POLL_INTERVAL: Duration = Duration::from_millis(25);

const EVENT: &str = "SPYKEE_EVENT";
/// Not `SPYKEE_ROBOT`, which is a setting: a `spykee` that the program calls would take the name for
/// the robot's address.
const ROBOT_NAME: &str = "SPYKEE_ROBOT_NAME";
const TIME: &str = "SPYKEE_TIME";
const PICTURE: &str = "SPYKEE_PICTURE";
pub const PROGRAM_VARIABLES: [&str; 4] = [EVENT, ROBOT_NAME, TIME, PICTURE];

/// Runs the program to its end, at most for this long and until `abort` is cancelled.
pub(super) fn send(
    target: &Target,
    notice: &Notice,
    picture: Option<&Path>,
    limit: Duration,
    abort: &CancellationToken,
) -> Delivery {
    let words: Vec<String> = target
        .command
        .iter()
        .map(|word| fill(word, notice, "", Slot::Plain).replace('\0', ""))
        .collect();
    let Some((program, arguments)) = words.split_first() else {
        return Delivery::Refused("it names no program".to_owned());
    };
    let mut command = Command::new(program);
    command
        .args(arguments)
        .env(EVENT, notice.rule.name())
        .env(ROBOT_NAME, notice.robot.replace('\0', ""))
        .env(TIME, &notice.time)
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .process_group(0);
    if let Some(picture) = picture {
        command.env(PICTURE, picture);
    }
    match command.spawn() {
        Ok(child) => wait_for_exit(child, notice, limit, abort),
        Err(error) => Delivery::Later(format!("{program} cannot be started: {error}")),
    }
}

fn wait_for_exit(
    mut child: Child,
    notice: &Notice,
    limit: Duration,
    abort: &CancellationToken,
) -> Delivery {
    if let Some(mut input) = child.stdin.take() {
        // Shorter than a pipe's buffer: never blocks, even if the command does not read it.
        let _ = input.write_all(notice.text.as_bytes());
    }
    let mut left = limit;
    let ended = loop {
        match child.try_wait() {
            Ok(Some(status)) if status.success() => break Delivery::Done,
            Ok(Some(status)) => break Delivery::Later(format!("it ended with {status}")),
            Ok(None) if left.is_zero() => {
                break Delivery::Later(format!("it took more than {} s", limit.as_secs_f64()));
            }
            Ok(None) if abort.is_cancelled() => {
                break Delivery::Later("it was killed, because spykee ends".to_owned());
            }
            Ok(None) => {
                std::thread::sleep(POLL_INTERVAL.min(left));
                left = left.saturating_sub(POLL_INTERVAL);
            }
            Err(error) => break Delivery::Later(error.to_string()),
        }
    };
    // Also kills what it has left running: the group exists as long as any of its processes.
    let _ = kill_process_group(Pid::from_child(&child), Signal::KILL);
    let _ = child.wait();
    ended
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::notify::Rule;

    fn run(words: &[&str], seconds: f64) -> Delivery {
        let target = Target {
            command: words.iter().map(|word| (*word).to_owned()).collect(),
            ..Target::default()
        };
        let notice = Notice {
            rule: Rule::Low,
            text: "a text; rm -rf *".to_owned(),
            robot: "Rover".to_owned(),
            at: 0,
            time: String::new(),
            picture: None,
        };
        let picture = Path::new("/data/1.jpg");
        let limit = Duration::from_secs_f64(seconds);
        send(
            &target,
            &notice,
            Some(picture),
            limit,
            &CancellationToken::new(),
        )
    }

    #[test]
    fn it_gets_text_arguments_and_environment_without_a_shell() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("output");
        let script = "{ cat; echo \"|$1|$SPYKEE_EVENT|$SPYKEE_ROBOT_NAME|$SPYKEE_PICTURE\"
                      echo \"address: $SPYKEE_ROBOT\"; } > \"$0\"";
        let words = ["sh", "-c", script, path.to_str().unwrap(), "{text} {robot}"];
        assert_eq!(run(&words, 10.0), Delivery::Done);
        let output = std::fs::read_to_string(path).unwrap();
        let setting = std::env::var("SPYKEE_ROBOT").unwrap_or_default();
        let expected = format!(
            "a text; rm -rf *|a text; rm -rf * Rover|low|Rover|/data/1.jpg\naddress: {setting}\n"
        );
        assert_eq!(output, expected);
    }

    #[test]
    fn a_program_that_hangs_is_killed_with_its_descendants() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("pid");
        let script = "sleep 600 & echo $! > \"$0\"; wait";
        let delivery = run(&["sh", "-c", script, path.to_str().unwrap()], 0.5);
        assert!(
            matches!(&delivery, Delivery::Later(why) if why.contains("more than")),
            "{delivery:?}"
        );
        let pid: i32 = std::fs::read_to_string(path)
            .unwrap()
            .trim()
            .parse()
            .unwrap();
        let state = || {
            let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
            stat.rsplit(") ")
                .next()
                .and_then(|rest| rest.chars().next())
        };
        let gone = || matches!(state(), None | Some('Z' | 'X'));
        for _ in 0..1000 {
            if gone() {
                return;
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        panic!("it is still running: {:?}", state());
    }

    #[test]
    fn a_program_that_fails_or_is_missing_is_retried() {
        assert!(matches!(run(&["false"], 10.0), Delivery::Later(_)));
        let delivery = run(&["/no/such/program"], 10.0);
        assert!(
            matches!(&delivery, Delivery::Later(why) if why.contains("cannot be started")),
            "{delivery:?}"
        );
    }
}
