//! Drops the privileges of a service that was started as root.

use std::ffi::CString;
use std::io;
use std::os::unix::fs::{DirBuilderExt as _, chown};
use std::path::Path;

use nix::unistd::{Gid, Uid, User, initgroups, setgid, setuid};

use super::Failure;

/// If started as root, permanently switches to this user; `root` itself keeps the privileges. Does
/// nothing if not started as root. Creates the data folder for the user if it is missing.
pub(super) fn drop_root(user: Option<&str>, data: &Path) -> Result<(), Failure> {
    if !Uid::effective().is_root() {
        return Ok(());
    }
    let Some(name) = user else {
        let failure =
            Failure::usage("a service must not run as root, and the config names no user");
        return Err(failure.help(
            "name one in the config, `service: { user: NAME }`; `user: root` stays root; \
             `spykee service install` creates a unit with its own user",
        ));
    };
    if name == "root" {
        tracing::warn!("the service continues as root, as the config requests");
        return Ok(());
    }
    let found = User::from_name(name).ok().flatten();
    let user = found.ok_or_else(|| {
        let failure = Failure::usage(format_args!("this computer has no user `{name}`"));
        failure.help("name an existing user in the config, `service: { user: ... }`")
    })?;
    create_folder(data, &user).map_err(|error| {
        let data = data.display();
        Failure::io(format_args!("create {data} for `{name}`"), error)
    })?;
    become_user(&user).map_err(|why| Failure::io(format_args!("continue as `{name}`"), why))?;
    tracing::info!("started as root, now running as {name}");
    Ok(())
}

/// Creates the folder for this user. Does not change an existing one.
fn create_folder(data: &Path, user: &User) -> io::Result<()> {
    if data.exists() {
        return Ok(());
    }
    std::fs::DirBuilder::new()
        .recursive(true)
        .mode(0o700)
        .create(data)?;
    chown(data, Some(user.uid.as_raw()), Some(user.gid.as_raw()))
}

fn become_user(user: &User) -> io::Result<()> {
    let name = CString::new(user.name.as_str())?;
    initgroups(&name, user.gid)?;
    setgid(user.gid)?;
    setuid(user.uid)?;
    if Uid::effective() != user.uid
        || Gid::effective() != user.gid
        || setuid(Uid::from_raw(0)).is_ok()
    {
        let kept = "the process still has root's privileges";
        return Err(io::Error::other(kept));
    }
    Ok(())
}
