//! Checks of this computer: clock, disk, kernel, terminal.

use std::io::IsTerminal;
use std::path::Path;

use jiff::Timestamp;

use super::CheckResult;
use crate::clock::is_plausible;
use crate::sandbox::Landlock;

/// Seconds from 1970 to the beginning of 2100.
const LATEST_PLAUSIBLE: i64 = 4_102_444_800;
/// Free space, MiB, below which the check warns (pictures will soon not fit), and below which it
/// fails.
const LOW_SPACE_MIB: u64 = 200;
const MIN_SPACE_MIB: u64 = 10;

pub(super) fn clock(now: Timestamp) -> CheckResult {
    if is_plausible(now) && now.as_second() < LATEST_PLAUSIBLE {
        return CheckResult::ok("clock", "the date is plausible");
    }
    CheckResult::warn(
        "clock",
        format!("the date is not plausible: {now:.0}"),
        "set the date, or the times in logs and file names will be wrong",
    )
}

/// Creates and removes an empty file in the data folder, or where the data folder would be created.
pub(super) fn disk(data: &Path) -> CheckResult {
    let shown = data.display();
    let absolute = std::path::absolute(data).unwrap_or_else(|_| data.to_owned());
    let Some(there) = absolute.ancestors().find(|folder| folder.exists()) else {
        return CheckResult::fail(
            "disk",
            format!("{shown}: no such folder"),
            "choose another `data` in the config",
        );
    };
    if let Err(error) = try_to_write(there) {
        let found = format!("cannot write into {}: {error}", there.display());
        return CheckResult::fail("disk", found, "choose another `data` in the config");
    }
    match rustix::fs::statvfs(there) {
        Ok(space) => space_result(&shown.to_string(), (space.f_bavail * space.f_frsize) >> 20),
        Err(error) => {
            CheckResult::warn("disk", format!("{shown}: {error}"), "is the disk mounted?")
        }
    }
}

fn try_to_write(folder: &Path) -> std::io::Result<()> {
    let name = format!(".spykee-doctor-{}", std::process::id());
    let path = folder.join(name);
    let mut new = std::fs::OpenOptions::new();
    new.write(true).create_new(true).open(&path)?;
    std::fs::remove_file(path)
}

fn space_result(folder: &str, mebibytes: u64) -> CheckResult {
    let found = format!("{folder} is writable, {mebibytes} MiB free");
    match mebibytes {
        ..MIN_SPACE_MIB => CheckResult::fail("disk", found, "free some space"),
        MIN_SPACE_MIB..LOW_SPACE_MIB => {
            CheckResult::warn("disk", found, "free some space: pictures need it")
        }
        _ => CheckResult::ok("disk", found),
    }
}

pub(super) fn landlock() -> CheckResult {
    let release = std::fs::read_to_string("/proc/sys/kernel/osrelease").unwrap_or_default();
    landlock_result(Landlock::of_this_kernel(), release.trim())
}

fn landlock_result(landlock: Landlock, release: &str) -> CheckResult {
    let without = "code that escapes a script's sandbox could open your files: run only scripts \
                   that you trust, or enable landlock (kernel 5.13 or newer, `lsm=landlock,...`)";
    match landlock {
        Landlock::Version(version) => {
            let network = match version {
                ..4 => "; this version cannot restrict the network, but seccomp does",
                _ => "",
            };
            let on = "a script's host can open only files in its own folder";
            CheckResult::ok("landlock", format!("version {version}: {on}{network}"))
        }
        Landlock::Off => {
            let found = format!("switched off in kernel {release}");
            CheckResult::warn("landlock", found, without)
        }
        Landlock::Missing => {
            let found = format!("not in kernel {release}");
            CheckResult::warn("landlock", found, without)
        }
    }
}

/// Checks the kernel's support for filters of system calls.
pub(super) fn seccomp(offered: bool) -> CheckResult {
    if offered {
        CheckResult::ok(
            "seccomp",
            "on: a script's host may make only a few system calls",
        )
    } else {
        CheckResult::warn(
            "seccomp",
            "this kernel or processor type does not support system call filters",
            "code that escapes a script's sandbox could open sockets: run only scripts that you \
             trust",
        )
    }
}

pub(super) fn terminal() -> CheckResult {
    let on = |yes: bool| if yes { "a terminal" } else { "a file or pipe" };
    let out = std::io::stdout();
    let err = std::io::stderr();
    let columns = rustix::termios::tcgetwinsize(&err).map_or(0, |size| size.ws_col);
    let width = match columns {
        0 => String::new(),
        columns => format!(", {columns} columns"),
    };
    let found = format!(
        "stdout is {}, stderr is {}{width}",
        on(out.is_terminal()),
        on(err.is_terminal())
    );
    let dumb = std::env::var_os("TERM").is_some_and(|term| term == "dumb");
    match (err.is_terminal(), dumb, columns) {
        (true, true, _) => CheckResult::warn("terminal", found, "TERM=dumb: no status line"),
        (true, _, 1..60) => {
            CheckResult::warn("terminal", found, "make it wider for the status line")
        }
        _ => CheckResult::ok("terminal", found),
    }
}

#[cfg(test)]
mod tests {
    use super::super::Verdict;
    use super::*;

    #[test]
    fn a_clock_that_was_never_set_gets_a_warning() {
        let verdict = |now| clock(Timestamp::from_second(now).unwrap()).verdict;
        assert_eq!(verdict(1000), Verdict::Warn);
        assert_eq!(verdict(1_800_000_000), Verdict::Ok);
        assert_eq!(verdict(LATEST_PLAUSIBLE), Verdict::Warn);
    }

    #[test]
    fn a_full_disk_fails_and_a_nearly_full_one_warns() {
        let verdict = |mebibytes| space_result("x", mebibytes).verdict;
        assert_eq!(
            (verdict(0), verdict(50), verdict(5000)),
            (Verdict::Fail, Verdict::Warn, Verdict::Ok)
        );
    }

    #[test]
    fn a_folder_that_cannot_be_written_fails() {
        assert_eq!(disk(Path::new("/proc/spykee")).verdict, Verdict::Fail);
        let folder = tempfile::tempdir().unwrap();
        let data = folder.path().join("a/b");
        assert_ne!(disk(&data).verdict, Verdict::Fail);
        assert_eq!(
            folder.path().read_dir().unwrap().count(),
            0,
            "nothing is left behind"
        );
    }

    #[test]
    fn kernel_features_decide_the_verdict() {
        let landlock = |found| landlock_result(found, "6.1");
        let version = landlock(Landlock::Version(3));
        assert_eq!(version.verdict, Verdict::Ok);
        assert!(version.found.contains("version 3") && version.found.contains("network"));
        assert!(!landlock(Landlock::Version(4)).found.contains("network"));
        assert_eq!(landlock(Landlock::Off).verdict, Verdict::Warn);
        assert_eq!(landlock(Landlock::Missing).verdict, Verdict::Warn);
        assert_eq!(seccomp(true).verdict, Verdict::Ok);
        assert_eq!(seccomp(false).verdict, Verdict::Warn);
    }
}
