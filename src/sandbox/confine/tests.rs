use super::*;
use rustix::process::{getppid, test_kill_process};
use std::fs;
use std::net::{TcpListener, TcpStream, UdpSocket};
use std::os::unix::net::{UnixDatagram, UnixListener, UnixStream};
use std::os::unix::process::CommandExt;
use std::process::Command;

/// Set in the process that confines itself; the value is its folder.
const INSIDE: &str = "SPYKEE_TEST_CONFINED_TO";
const DONE: &str = "everything was tried";

fn refused<T>(what: &str, attempt: io::Result<T>) {
    let error = attempt
        .err()
        .unwrap_or_else(|| panic!("{what} was possible"));
    assert_eq!(
        error.kind(),
        io::ErrorKind::PermissionDenied,
        "{what}: {error}"
    );
}

/// File accesses that must be refused.
fn try_files(folder: &Path) {
    let parent = folder.parent().unwrap();
    refused("reading a file", fs::read("/etc/passwd"));
    refused("reading itself", fs::read("/proc/self/exe"));
    refused("reading its environment", fs::read("/proc/self/environ"));
    refused(
        "reading its agent's environment",
        fs::read(format!("/proc/{}/environ", getppid().unwrap())),
    );
    refused("listing a folder", fs::read_dir("/"));
    refused("listing the folder above", fs::read_dir(parent));
    refused("a new file", fs::write(parent.join("other"), "x"));
    refused(
        "changing a neighbour",
        fs::write(parent.join("neighbour"), "x"),
    );
    refused(
        "removing a neighbour",
        fs::remove_file(parent.join("neighbour")),
    );
    fs::write(folder.join("mine"), "x").unwrap();
    let moved = fs::rename(folder.join("mine"), parent.join("mine"));
    assert!(moved.is_err(), "moving a file out was possible");
    let linked = std::os::unix::fs::symlink("/etc/passwd", folder.join("link"));
    refused("a link to elsewhere", linked);
}

fn try_calls(folder: &Path) {
    refused("a UDP socket", UdpSocket::bind("127.0.0.1:0"));
    refused("a TCP server", TcpListener::bind("127.0.0.1:0"));
    refused("a TCP client", TcpStream::connect("127.0.0.1:9"));
    refused("a local server", UnixListener::bind(folder.join("socket")));
    refused(
        "a local client",
        UnixStream::connect("/run/dbus/system_bus_socket"),
    );
    refused("a local datagram", UnixDatagram::unbound());
    refused(
        "another program",
        Err::<(), _>(Command::new("/bin/true").exec()),
    );
    refused("a process", Command::new("/bin/true").spawn());
    refused(
        "a signal",
        test_kill_process(getppid().unwrap()).map_err(Into::into),
    );
    let open = std::os::unix::fs::PermissionsExt::from_mode(0o777);
    refused(
        "other permissions",
        fs::set_permissions(folder.parent().unwrap(), open),
    );
}

/// Operations that must still work.
fn live(folder: &Path) {
    let unfinished = folder.join("picture.part");
    let picture = folder.join("picture.jpg");
    fs::create_dir_all(folder).unwrap();
    fs::write(&unfinished, vec![7; 100_000]).unwrap();
    fs::rename(&unfinished, &picture).unwrap();
    assert_eq!(fs::read(&picture).unwrap().len(), 100_000);
    let mode =
        std::os::unix::fs::PermissionsExt::mode(&fs::metadata(&picture).unwrap().permissions());
    assert_eq!(mode & 0o077, 0, "others can read it: {mode:o}");
    assert!(fs::read_dir(folder).unwrap().count() > 0);
    fs::remove_file(picture).unwrap();
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .unwrap();
    let waited = std::thread::spawn(move || {
        let pause = std::time::Duration::from_millis(1);
        runtime.block_on(async { tokio::time::sleep(pause).await });
    });
    waited.join().unwrap();
    eprintln!("{DONE}");
}

fn inside(folder: &Path) {
    let policy = SandboxPolicy {
        write: vec![folder.to_owned()],
        ..SandboxPolicy::default()
    };
    let supported = Restrictions::supported();
    let parent = getppid().unwrap();
    let elsewhere = confine(u32::MAX, &policy);
    assert!(
        elsewhere.is_err(),
        "confined although the parent is another one"
    );
    let restrictions = confine(parent.as_raw_nonzero().get().unsigned_abs(), &policy).unwrap();
    assert_eq!(restrictions, supported);
    let rights = rustix::thread::capabilities(None);
    assert!(rights.is_err() || rights.is_ok_and(|rights| rights.permitted.is_empty()));
    if restrictions.files {
        try_files(folder);
    }
    if restrictions.calls {
        try_calls(folder);
    }
    live(folder);
}

#[test]
fn a_policy_survives_the_round_trip_over_a_command_line() {
    let paths = |names: &[&str]| names.iter().map(PathBuf::from).collect::<Vec<_>>();
    let policy = SandboxPolicy {
        read: paths(&["a b", "--", ""]),
        write: paths(&["/c"]),
        cpu_seconds: 7,
    };
    let back = SandboxPolicy::of_arguments(policy.arguments().into_iter());
    assert_eq!(back, Some((std::process::id(), policy)));
    for wrong in [&["1", "2"][..], &["x", "0", "0"], &["1", "0", "2", "only"]] {
        let arguments = wrong.iter().map(OsString::from);
        assert_eq!(SandboxPolicy::of_arguments(arguments), None, "{wrong:?}");
    }
}

#[test]
fn a_confined_process_reaches_its_own_folder_and_nothing_else() {
    if let Some(folder) = std::env::var_os(INSIDE) {
        return inside(Path::new(&folder));
    }
    let outside = Restrictions::supported();
    if outside
        != (Restrictions {
            files: true,
            calls: true,
        })
    {
        eprintln!(
            "this kernel does not support all restrictions, the others are checked: {outside:?}"
        );
    }
    let parent = tempfile::tempdir().unwrap();
    let folder = parent.path().join("own");
    fs::create_dir(&folder).unwrap();
    fs::write(parent.path().join("neighbour"), "untouched").unwrap();
    let test = concat!(
        module_path!(),
        "::a_confined_process_reaches_its_own_folder_and_nothing_else"
    );
    let (_, test) = test.split_once("::").unwrap();
    let output = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", test, "--nocapture"])
        .env(INSIDE, &folder)
        .output()
        .unwrap();
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && stderr.contains(DONE), "{stderr}");
    assert_eq!(
        fs::read(parent.path().join("neighbour")).unwrap(),
        b"untouched"
    );
}
