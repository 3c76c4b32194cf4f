//! A service that was started as root drops its privileges.

use std::ffi::CString;
use std::os::unix::fs::{DirBuilderExt as _, chown};
use std::path::Path;

use nix::unistd::{Gid, Uid, User, initgroups, setgid, setuid};

use super::Failure;

/// Leaves root for this user, for good; `root` itself means to stay. Does nothing for others. The data
/// folder is made for the user if it is not there.
///
/// # Errors
/// No user was named, there is no such user, or the system does not let us.
pub(super) fn leave_root(user: Option<&str>, data: &Path) -> Result<(), Failure> {
    if !Uid::effective().is_root() {
        return Ok(());
    }
    let Some(name) = user else {
        let failure =
            Failure::usage("a service does not run as root, and the config names no user");
        return Err(failure.help(
            "`service: { user: NAME }` in the config names one; `user: root` means it; \
             `spykee service install` makes a unit with a user of its own",
        ));
    };
    if name == "root" {
        tracing::warn!("the service continues as root, as its config says");
        return Ok(());
    }
    let found = User::from_name(name).ok().flatten();
    let user = found.ok_or_else(|| {
        let failure = Failure::usage(format_args!("no user of this computer is called `{name}`"));
        failure.help("`service: { user: ... }` in the config names an existing user")
    })?;
    give_folder(data, &user).map_err(|error| {
        let data = data.display();
        Failure::usage(format_args!("cannot make {data} for `{name}`: {error}"))
    })?;
    become_user(&user)
        .map_err(|why| Failure::usage(format_args!("cannot continue as `{name}`: {why}")))?;
    tracing::info!("started as root, continues as {name}");
    Ok(())
}

/// An existing folder stays as it is.
fn give_folder(data: &Path, user: &User) -> std::io::Result<()> {
    if data.exists() {
        return Ok(());
    }
    std::fs::DirBuilder::new()
        .recursive(true)
        .mode(0o700)
        .create(data)?;
    chown(data, Some(user.uid.as_raw()), Some(user.gid.as_raw()))
}

/// Why a process is still root.
#[derive(Debug, thiserror::Error)]
enum StillRoot {
    #[error(transparent)]
    Name(#[from] std::ffi::NulError),
    #[error(transparent)]
    System(#[from] nix::Error),
    #[error("the system did not give up root's rights")]
    Kept,
}

fn become_user(user: &User) -> Result<(), StillRoot> {
    let name = CString::new(user.name.as_str())?;
    initgroups(&name, user.gid)?;
    setgid(user.gid)?;
    setuid(user.uid)?;
    if Uid::effective() != user.uid
        || Gid::effective() != user.gid
        || setuid(Uid::from_raw(0)).is_ok()
    {
        return Err(StillRoot::Kept);
    }
    Ok(())
}
