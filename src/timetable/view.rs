//! The view of the timetable for display.

use jiff::Timestamp;
use tokio::sync::watch;

/// The next start and the quiet hours. Both are unset in a run without a timetable.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct View {
    /// The next start of the timetable: its time and its behaviour.
    pub next: Option<(Timestamp, String)>,
    /// Whether it is a quiet hour.
    pub quiet: bool,
}

impl View {
    /// Creates the channel through which a service publishes its view.
    pub fn channel() -> (watch::Sender<View>, watch::Receiver<View>) {
        watch::channel(View::default())
    }
}
