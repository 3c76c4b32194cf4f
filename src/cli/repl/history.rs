//! The file that keeps typed lines from one session to the next; only its user can read it.

use std::fs::{DirBuilder, OpenOptions};
use std::io;
use std::os::unix::fs::{DirBuilderExt as _, OpenOptionsExt as _};
use std::path::{Path, PathBuf};

/// `$XDG_STATE_HOME/spykee/history`, or in `~/.local/state`; `None` without a home.
pub(super) fn path() -> Option<PathBuf> {
    let folder = |name| {
        let path = PathBuf::from(std::env::var_os(name)?);
        path.is_absolute().then_some(path)
    };
    let state = folder("XDG_STATE_HOME")
        .or_else(|| folder("HOME").map(|home| home.join(".local").join("state")))?;
    Some(state.join("spykee").join("history"))
}

/// Creates the file and its folder, readable only by this user.
pub(super) fn prepare(path: &Path) -> io::Result<()> {
    if let Some(folder) = path.parent() {
        DirBuilder::new()
            .recursive(true)
            .mode(0o700)
            .create(folder)?;
    }
    let mut private = OpenOptions::new();
    private.create(true).append(true).mode(0o600);
    private.open(path).map(|_| ())
}
