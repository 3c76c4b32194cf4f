//! What the watchdog may do to bring a robot home.

use std::path::PathBuf;
use std::sync::LazyLock;

use spykee::safety::{Limits, Rescue};
use spykee::script::RESCUE;

/// The built-in rescue behaviour, going back the way it came, in a file.
static RETRACE: LazyLock<PathBuf> = LazyLock::new(|| {
    let source = RESCUE.replacen("RETRACES = false", "RETRACES = true", 1);
    assert_ne!(source, RESCUE);
    let file = tempfile::Builder::new().suffix(".lua").tempfile().unwrap();
    let (_, path) = file.keep().unwrap();
    std::fs::write(&path, source).unwrap();
    path
});

/// See [`Strategy::limits`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Strategy {
    /// It stands and searches.
    None,
    /// It drives short legs blindly between its searches.
    Legs,
    /// What every robot gets that is not told otherwise.
    Builtin,
    /// The built-in behaviour, but it goes back the way it came.
    Retrace,
}

impl Strategy {
    /// For robots that were put where they are: nobody knows how they came there.
    pub const PUT: [Strategy; 3] = [Strategy::None, Strategy::Legs, Strategy::Builtin];
    /// For robots that have driven there.
    pub const DRIVEN: [Strategy; 3] = [Strategy::Legs, Strategy::Builtin, Strategy::Retrace];

    pub fn text(self) -> &'static str {
        match self {
            Strategy::None => "none",
            Strategy::Legs => "legs",
            Strategy::Builtin => "builtin",
            Strategy::Retrace => "retrace",
        }
    }

    /// The one place that says how a strategy is configured.
    pub fn limits(self) -> Limits {
        match self {
            Strategy::None => Limits {
                recovery_legs: 0,
                rescue: Rescue::Off,
                ..Limits::default()
            },
            Strategy::Legs => Limits {
                rescue: Rescue::Off,
                ..Limits::default()
            },
            Strategy::Builtin => Limits::default(),
            Strategy::Retrace => Limits {
                rescue: Rescue::File(RETRACE.clone()),
                ..Limits::default()
            },
        }
    }
}
