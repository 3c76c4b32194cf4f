//! `spykee` with a person at a terminal, which may also be closed.

use std::fs::File;
use std::io::{Read as _, Write as _};
use std::process::{Child, Command};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{Mode, OFlags, open};
use rustix::process::{Pid, Signal, kill_process};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{LocalModes, tcgetattr};
use tokio::time::timeout;

use crate::rig::{Rig, WAIT_LIMIT, becomes};

/// The interval at which the reader of the screen checks whether the terminal is to be closed.
const LOOK: Timespec = Timespec {
    tv_sec: 0,
    tv_nsec: 50_000_000,
};

/// A terminal and the program that was started from it.
pub struct Terminal {
    child: Child,
    keyboard: Option<File>,
    screen: Arc<Mutex<String>>,
    read: usize,
    closing: Arc<AtomicBool>,
    reader: Option<std::thread::JoinHandle<()>>,
}

impl Terminal {
    /// Starts the program as leader of the terminal's session, as in a terminal window.
    pub fn start(args: &[&str], rig: &Rig) -> Terminal {
        let flags = OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC;
        let keyboard = openpt(flags).unwrap();
        grantpt(&keyboard).unwrap();
        unlockpt(&keyboard).unwrap();
        let name = ptsname(&keyboard, Vec::new()).unwrap();
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC;
        let end = || File::from(open(&name, flags, Mode::empty()).unwrap());
        let child = Command::new("setsid")
            .args(["--ctty", env!("CARGO_BIN_EXE_spykee")])
            .args(args)
            .current_dir(rig.folder())
            .env_remove("RUST_LOG")
            .env("XDG_STATE_HOME", rig.folder())
            .env("TERM", "xterm")
            .stdin(end())
            .stdout(end())
            .stderr(end())
            .spawn()
            .unwrap();
        let keyboard = File::from(keyboard);
        let screen = Arc::new(Mutex::new(String::new()));
        let mut output = keyboard.try_clone().unwrap();
        let shown = Arc::clone(&screen);
        let closing = Arc::new(AtomicBool::new(false));
        let closes = Arc::clone(&closing);
        let reader = std::thread::spawn(move || {
            let mut bytes = [0; 4096];
            while !closes.load(Ordering::Relaxed) {
                if poll(&mut [PollFd::new(&output, PollFlags::IN)], Some(&LOOK)) == Ok(0) {
                    continue;
                }
                let Ok(count @ 1..) = output.read(&mut bytes) else {
                    return;
                };
                let text = String::from_utf8_lossy(&bytes[..count]);
                shown.lock().unwrap().push_str(&text);
            }
        });
        Terminal {
            child,
            keyboard: Some(keyboard),
            screen,
            read: 0,
            closing,
            reader: Some(reader),
        }
    }

    /// Waits until this text appears after the text of the last wait.
    pub async fn shows(&mut self, words: &str) {
        let shown = async {
            loop {
                let found = self.screen.lock().unwrap()[self.read..].find(words);
                if let Some(at) = found {
                    return at + words.len();
                }
                tokio::time::sleep(Duration::from_millis(10)).await;
            }
        };
        let end = timeout(WAIT_LIMIT, shown).await;
        self.read += end.unwrap_or_else(|_| panic!("`{words}` does not appear: {}", self.text()));
    }

    pub fn types(&mut self, line: &str) {
        self.presses(line);
        self.presses("\n");
    }

    pub fn presses(&mut self, keys: &str) {
        let mut keyboard = self.keyboard.as_ref().expect("the terminal is closed");
        keyboard.write_all(keys.as_bytes()).unwrap();
    }

    /// Whether the terminal echoes input and collects it into lines, its normal mode.
    fn is_plain(&self) -> bool {
        let modes = tcgetattr(self.keyboard.as_ref().unwrap())
            .unwrap()
            .local_modes;
        modes.contains(LocalModes::ECHO | LocalModes::ICANON)
    }

    /// Closes the terminal, as when its window is closed or the connection is lost.
    fn close(&mut self) {
        self.closing.store(true, Ordering::Relaxed);
        self.reader.take().unwrap().join().unwrap();
        self.keyboard = None;
    }

    fn pid(&self) -> Pid {
        Pid::from_child(&self.child)
    }

    pub fn text(&self) -> String {
        self.screen.lock().unwrap().clone()
    }

    pub async fn code(&mut self) -> Option<i32> {
        let ended = async {
            loop {
                if let Some(status) = self.child.try_wait().unwrap() {
                    return status.code();
                }
                tokio::time::sleep(Duration::from_millis(5)).await;
            }
        };
        timeout(WAIT_LIMIT, ended).await.unwrap()
    }
}

impl Drop for Terminal {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Closes the terminal while the robot drives: the robot must stop.
async fn closed(rig: &Rig, mut terminal: Terminal) {
    let moving = rig.heard_motion(0).await;
    terminal.close();
    rig.heard_stop(moving).await;
    assert_eq!(terminal.code().await, Some(130), "{}", terminal.text());
    let resting = rig.sim.wait_state(|state| !state.moving());
    timeout(WAIT_LIMIT, resting)
        .await
        .expect("the tracks do not rest");
}

#[tokio::test(flavor = "multi_thread")]
async fn closing_the_terminal_stops_the_robot_of_a_run() {
    let rig = Rig::quiet().await;
    rig.file("script.lua", "robot.move(40, 40) task.wait(600)");
    let run = ["run", "script.lua", "--robot", &rig.address];
    let terminal = Terminal::start(&run, &rig);
    closed(&rig, terminal).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn closing_the_terminal_stops_the_robot_of_a_prompt() {
    let rig = Rig::quiet().await;
    let mut terminal = Terminal::start(&["repl", "--robot", &rig.address], &rig);
    terminal.shows("spykee> ").await;
    terminal.types("robot.move(40, 40)");
    closed(&rig, terminal).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn closing_the_terminal_stops_the_robot_of_a_calibration() {
    let rig = Rig::quiet().await;
    let mut terminal = Terminal::start(&["calibrate", "--robot", &rig.address], &rig);
    terminal.shows("Enter starts it").await;
    terminal.types("");
    closed(&rig, terminal).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn ctrl_z_at_a_prompt_stops_the_tracks_and_restores_the_terminal_until_it_resumes() {
    let rig = Rig::quiet().await;
    let mut terminal = Terminal::start(&["repl", "--robot", &rig.address], &rig);
    terminal.shows("spykee> ").await;
    terminal.types("robot.move(40, 40)");
    let moving = rig.heard_motion(0).await;
    terminal.shows("spykee> ").await;
    terminal.presses("\u{1a}");
    rig.heard_stop(moving).await;
    becomes(terminal.pid(), 'T').await;
    let resting = rig.sim.wait_state(|state| !state.moving());
    timeout(WAIT_LIMIT, resting)
        .await
        .expect("the tracks do not rest");
    assert!(terminal.is_plain());
    let slept = rig.sim.heard_count();
    kill_process(terminal.pid(), Signal::CONT).unwrap();
    rig.heard_stop(slept).await;
    assert_eq!(rig.commands(slept)[0], spykee::wire::Command::STOP);
    terminal.types("6 * 7");
    terminal.shows("42").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn ctrl_c_ends_a_prompt_that_only_waits_for_a_low_robot() {
    let rig = Rig::quiet().await;
    rig.sim.hide_station(true);
    let mut terminal = Terminal::start(&["repl", "--robot", &rig.address], &rig);
    terminal.shows("spykee> ").await;
    rig.sim.set_battery(10.0);
    let dock = rig.heard_dock(0).await;
    terminal.presses("\u{4}");
    terminal
        .shows("staying until the robot is on its station")
        .await;
    terminal.presses("\u{3}");
    assert_eq!(terminal.code().await, Some(5), "{}", terminal.text());
    crate::guardian::ends_with_a_search(&rig, dock);
}
