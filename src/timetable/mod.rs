//! Decides when behaviours start and how long they run, and defines the quiet hours. Pure: takes
//! facts and the time of day, returns starts and ends.
//!
//! Times of day are local, in the time zone of the config. When the clock is put forward, a start
//! within the skipped hour happens right after the change; when it is put back, a time that occurs
//! twice counts once, the first time. A pattern that names no hours (`*/15 * * * *`) defines
//! intervals: it continues through both changes.

mod pattern;
mod planner;
mod quiet;
mod rule;

pub use pattern::{Pattern, TimetableError};
pub use planner::{Act, Notice, Planner, PlannerInputs, Record, UnderWay};
pub use quiet::Quiet;
pub use rule::{PredictedStart, Reason, Rule, Timetable, View, predict_starts};
