//! What the watchdog may do to bring a robot home.

use spykee::safety::{Limits, Rescue};

/// See [`Strategy::limits`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Strategy {
    /// It stands and searches.
    None,
    /// It makes short blind moves between its searches.
    BlindMoves,
    /// What every robot gets that is not told otherwise.
    Builtin,
}

impl Strategy {
    /// For robots that were put where they are: nobody knows how they came there.
    pub const PUT: [Strategy; 3] = [Strategy::None, Strategy::BlindMoves, Strategy::Builtin];
    /// For robots that have driven there.
    pub const DRIVEN: [Strategy; 2] = [Strategy::BlindMoves, Strategy::Builtin];

    pub fn text(self) -> &'static str {
        match self {
            Strategy::None => "none",
            Strategy::BlindMoves => "blind moves",
            Strategy::Builtin => "builtin",
        }
    }

    /// The one place that says how a strategy is configured.
    pub fn limits(self) -> Limits {
        match self {
            Strategy::None => Limits {
                blind_moves: false,
                rescue: Rescue::Off,
                ..Limits::default()
            },
            Strategy::BlindMoves => Limits {
                rescue: Rescue::Off,
                ..Limits::default()
            },
            Strategy::Builtin => Limits::default(),
        }
    }
}
