//! Decides when behaviours start and how long they run, and defines the quiet hours. Pure. Times
//! are local: when the clock is put forward, a start within the skipped hour happens right after
//! the change; when it is put back, a time that occurs twice counts once. A pattern without hours
//! (`*/15 * * * *`) continues through both changes.

mod hold;
mod pattern;
mod planner;
mod rule;

pub use hold::{Hold, TimetableChange, TimetableOrder};
pub use pattern::{Pattern, TimetableError};
pub use planner::{Act, Due, Planner, PlannerInputs, Record, UnderWay};
pub use rule::{NextStart, PredictedStart, Quiet, Reason, Rule, Timetable, View, predict_starts};
