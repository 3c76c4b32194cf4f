//! Reads the robot's password from a file or from the environment, and removes it from the
//! environment, where every process of the same user and every child could read it.

use std::ffi::{OsStr, OsString};
use std::io::{Read as _, Write as _};
use std::os::fd::{AsRawFd as _, OwnedFd};
use std::os::unix::ffi::{OsStrExt as _, OsStringExt};
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::Command;

use parking_lot::Mutex;
use rustix::fs::{FileType, Mode, OFlags, fstat};
use rustix::io::{FdFlags, fcntl_setfd, ioctl_fionbio};

use super::Failure;
use crate::config::{PASSWORD_PIPE_VARIABLE, PASSWORD_VARIABLE};
use crate::files;
use crate::service::{PASSWORD_CREDENTIAL, credential_name};

/// Maximum size of a password file, bytes.
const MAX_FILE_LEN: u64 = 4096;

/// The password taken from the environment.
static PASSWORD: Mutex<Option<Vec<u8>>> = Mutex::new(None);

/// Removes the password from the environment. The kernel shows a process's initial environment for
/// its whole life, so the program restarts itself without the variable and passes the password
/// through a pipe. Must be called before anything else. If the restart fails, the variable stays.
pub(super) fn remove_from_environment() {
    if let Some(pipe_number) = std::env::var_os(PASSWORD_PIPE_VARIABLE) {
        if let Some(password) = read_pipe(&pipe_number) {
            store(password);
        }
        return;
    }
    if let Some(password) = std::env::var_os(PASSWORD_VARIABLE) {
        store(password.as_bytes().to_owned());
        if let Ok(pipe) = password_pipe(password.as_bytes()) {
            reexec(&pipe);
        }
    }
}

fn store(password: Vec<u8>) {
    *PASSWORD.lock() = Some(password);
}

/// The reading end of a pipe that holds the password; it stays open across `exec`.
fn password_pipe(password: &[u8]) -> std::io::Result<OwnedFd> {
    let (reader, mut writer) = std::io::pipe()?;
    fcntl_setfd(&reader, FdFlags::empty())?;
    // Fail instead of blocking if it does not fit: no password is that long.
    ioctl_fionbio(&writer, true)?;
    writer.write_all(password)?;
    Ok(reader.into())
}

/// Replaces this process by a new instance of the program. Returns only on failure.
fn reexec(pipe: &OwnedFd) {
    let mut args = std::env::args_os();
    let name = args.next().unwrap_or_else(|| OsString::from("spykee"));
    let args: Vec<OsString> = args.collect();
    // The second path also works if the file has been replaced meanwhile, but looks odd in process
    // lists.
    let files = [std::env::current_exe().ok(), Some("/proc/self/exe".into())];
    for file in files.into_iter().flatten() {
        let _ = Command::new(file)
            .arg0(&name)
            .args(&args)
            .env_remove(PASSWORD_VARIABLE)
            .env(PASSWORD_PIPE_VARIABLE, pipe.as_raw_fd().to_string())
            .exec();
    }
}

/// Reads the password from the pipe and empties it, so that the secret does not stay in it.
fn read_pipe(number: &OsStr) -> Option<Vec<u8>> {
    let number: u32 = number.to_str()?.parse().ok()?;
    let flags = OFlags::RDONLY | OFlags::NONBLOCK | OFlags::CLOEXEC;
    let path = format!("/proc/self/fd/{number}");
    let pipe = rustix::fs::open(path, flags, Mode::empty()).ok()?;
    if FileType::from_raw_mode(fstat(&pipe).ok()?.st_mode) != FileType::Fifo {
        return None;
    }
    let mut password = Vec::new();
    std::fs::File::from(pipe).read_to_end(&mut password).ok()?;
    Some(password)
}

pub(super) fn from_environment() -> Result<Option<String>, Failure> {
    let given = PASSWORD.lock().clone();
    let given = given.or_else(|| std::env::var_os(PASSWORD_VARIABLE).map(OsStringExt::into_vec));
    let text = given.map(String::from_utf8).transpose();
    text.map_err(|_| Failure::usage(format_args!("{PASSWORD_VARIABLE} is not UTF-8")))
}

/// The file of this credential, if systemd passes it to this service.
fn credential(name: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("CREDENTIALS_DIRECTORY")?;
    Some(Path::new(&folder).join(name)).filter(|path| path.exists())
}

/// The password from systemd: the credential `password` of a service's unit, if any.
pub(super) fn from_credential() -> Result<Option<String>, Failure> {
    credential(PASSWORD_CREDENTIAL)
        .map(|path| from_file(&path))
        .transpose()
}

/// The first line of a short regular file.
fn from_file(path: &Path) -> Result<String, Failure> {
    let text = files::read(path, MAX_FILE_LEN).map_err(|error| unreadable(path, &error))?;
    first_line(path, text)
}

/// The first line of a file that the command line or the environment names. It may also be a pipe,
/// since the person who starts this program has chosen it.
pub(super) fn from_chosen_file(path: &Path) -> Result<String, Failure> {
    warn_if_shared(path);
    let mut text = Vec::new();
    let read =
        std::fs::File::open(path).and_then(|file| file.take(MAX_FILE_LEN).read_to_end(&mut text));
    read.map_err(|error| unreadable(path, &error))?;
    first_line(path, text)
}

/// The first line of a file that the config names, if it names one, or of the copy that systemd passes
/// to this service. It must be a short regular file;
/// for a config that was found in the current folder (`found_config`), not named, see
/// [`from_found_file`].
pub(super) fn from_optional_file(
    path: Option<&Path>,
    found_config: Option<&Path>,
) -> Result<Option<String>, Failure> {
    let Some(path) = path else {
        return Ok(None);
    };
    if let Some(config) = found_config {
        return from_found_file(path, config).map(Some);
    }
    if let Some(copy) = credential(&credential_name(path)) {
        return from_file(&copy).map(Some);
    }
    warn_if_shared(path);
    from_file(path).map(Some)
}

/// The first line of a file named by a config that was found in the current folder, not named: such
/// a config may have come from anywhere. So the file must be in the config's folder or below, and
/// readable only by this user; otherwise its first line could be sent to any robot that the config
/// names.
fn from_found_file(path: &Path, config: &Path) -> Result<String, Failure> {
    let folder = match config.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    let whole = |path: &Path| {
        path.canonicalize()
            .map_err(|error| unreadable(path, &error))
    };
    let folder = whole(folder)?;
    let file = whole(path)?;
    if !file.starts_with(&folder) {
        let what = format_args!(
            "the config {} was found in the current folder, not named, but its password file {} is \
             not in its folder",
            config.display(),
            path.display()
        );
        return Err(refuse_found(config, what));
    }
    let text = files::read_private(&file, MAX_FILE_LEN)
        .map_err(|error| refuse_found(config, unreadable(path, &error).what))?;
    first_line(path, text)
}

fn warn_if_shared(path: &Path) {
    if files::is_shared(path) {
        let path = path.display();
        tracing::warn!("other users can read the password file {path}: chmod 600 {path}");
    }
}

/// Refuses what a config asks for that was found in the current folder: it may have come from
/// anywhere.
pub(super) fn refuse_found(config: &Path, what: impl std::fmt::Display) -> Failure {
    let config = config.display();
    Failure::usage(what).help(format!(
        "name the config, --config {config}, if you trust it"
    ))
}

fn unreadable(path: &Path, error: &dyn std::fmt::Display) -> Failure {
    let path = path.display();
    Failure::usage(format_args!("cannot read {path}: {error}"))
        .help("its first line must be the password or the token")
}

fn first_line(path: &Path, text: Vec<u8>) -> Result<String, Failure> {
    let text = String::from_utf8(text).map_err(|_| unreadable(path, &"it is not UTF-8"))?;
    match text.lines().next().unwrap_or_default() {
        "" => {
            let shown = path.display();
            let failure = Failure::usage(format_args!("the first line of {shown} is empty"));
            Err(failure.help("it must be the password or the token"))
        }
        line => Ok(line.to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;
    use std::os::unix::fs::{PermissionsExt as _, symlink};

    fn write(path: &PathBuf, mode: u32) {
        fs::write(path, "hunter2\nrest").unwrap();
        fs::set_permissions(path, fs::Permissions::from_mode(mode)).unwrap();
    }

    #[test]
    fn a_found_config_may_only_name_private_files_in_its_folder() {
        let root = tempfile::tempdir().unwrap();
        let path = |name: &str| root.path().join(name);
        fs::create_dir_all(path("here/below")).unwrap();
        let config = path("here/spykee.yaml");
        let read = |name: &str| from_found_file(&path(name), &config);
        write(&path("here/below/password"), 0o600);
        write(&path("here/open"), 0o644);
        write(&path("private"), 0o600);
        symlink(path("private"), path("here/link")).unwrap();
        fs::write(path("here/long"), "x".repeat(5000)).unwrap();
        fs::set_permissions(path("here/long"), fs::Permissions::from_mode(0o600)).unwrap();
        assert_eq!(read("here/below/password").unwrap(), "hunter2");
        for name in [
            "private",
            "here/../private",
            "here/link",
            "here/open",
            "here/long",
            "here/none",
        ] {
            let failure = read(name).unwrap_err().report();
            assert!(!failure.contains("hunter2"), "{failure}");
        }
        assert!(
            read("private")
                .unwrap_err()
                .report()
                .contains("not in its folder")
        );
        assert!(
            read("here/open")
                .unwrap_err()
                .report()
                .contains("other users can read it")
        );
    }

    #[test]
    fn a_chosen_file_may_be_anywhere_and_one_of_a_named_config_must_be_regular() {
        let root = tempfile::tempdir().unwrap();
        let path = root.path().join("password");
        write(&path, 0o644);
        assert_eq!(from_chosen_file(&path).unwrap(), "hunter2");
        let of_config = |path| from_optional_file(Some(path), None);
        assert_eq!(of_config(&path).unwrap().as_deref(), Some("hunter2"));
        assert!(of_config(Path::new("/dev/zero")).is_err());
        fs::write(&path, "\n").unwrap();
        assert!(of_config(&path).unwrap_err().report().contains("empty"));
    }

    #[test]
    fn only_a_pipe_is_read_and_only_once() {
        let pipe = password_pipe(b"hunter2").unwrap();
        let number = OsString::from(pipe.as_raw_fd().to_string());
        assert_eq!(read_pipe(&number).as_deref(), Some(&b"hunter2"[..]));
        assert_eq!(read_pipe(&number).as_deref(), Some(&b""[..]));
        let file = tempfile::tempfile().unwrap();
        assert_eq!(read_pipe(OsStr::new(&file.as_raw_fd().to_string())), None);
        for wrong in ["", "-1", "../../etc/passwd", "999999"] {
            assert_eq!(read_pipe(OsStr::new(wrong)), None, "{wrong}");
        }
    }
}
