//! What comes next, for display.

use jiff::Timestamp;
use tokio::sync::watch;

/// What a service will do, and does now. A run without a timetable has nothing of both.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct View {
    /// The next start of the timetable: when, and the behaviour.
    pub next: Option<(Timestamp, String)>,
    /// It is a quiet hour.
    pub quiet: bool,
}

impl View {
    /// Where a service tells, and where that is seen.
    pub fn channel() -> (watch::Sender<View>, watch::Receiver<View>) {
        watch::channel(View::default())
    }
}
