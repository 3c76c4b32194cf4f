//! What the watchdog may do to bring a robot home.

use std::path::PathBuf;
use std::sync::LazyLock;

use spykee::safety::{Limits, Rescue};
use spykee::script::RESCUE;

/// The built-in rescue behaviour that does not go back the way it came, in a file.
static NO_WAY: LazyLock<PathBuf> = LazyLock::new(|| {
    let source = RESCUE.replacen("if loan.way_back then", "if false then", 1);
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
    /// The built-in behaviour, but it does not go back the way it came.
    NoWay,
    /// What every robot gets that is not told otherwise.
    Builtin,
}

impl Strategy {
    /// For robots that were put where they are: nobody knows how they came there.
    pub const PUT: [Strategy; 3] = [Strategy::None, Strategy::Legs, Strategy::Builtin];
    /// For robots that have driven there.
    pub const DRIVEN: [Strategy; 3] = [Strategy::Legs, Strategy::NoWay, Strategy::Builtin];

    pub fn text(self) -> &'static str {
        match self {
            Strategy::None => "none",
            Strategy::Legs => "legs",
            Strategy::NoWay => "no way",
            Strategy::Builtin => "builtin",
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
            Strategy::NoWay => Limits {
                rescue: Rescue::File(NO_WAY.clone()),
                ..Limits::default()
            },
            Strategy::Builtin => Limits::default(),
        }
    }
}
