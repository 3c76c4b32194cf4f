//! Decides when behaviours start and how long they run, and defines the quiet hours. Pure: takes
//! facts and the time of day, returns starts and ends.
//!
//! Times of day are local, in the time zone of the config. When the clock is put forward, a start
//! within the skipped hour happens right after the change; when it is put back, a time that occurs
//! twice counts once, the first time. A pattern that names no hours (`*/15 * * * *`) defines
//! intervals: it continues through both changes.

mod act;
mod error;
mod pattern;
mod planner;
mod prediction;
mod quiet;
mod record;
mod rule;
mod view;

pub use act::{Act, Notice};
pub use error::TimetableError;
pub use pattern::Pattern;
pub use planner::{Planner, PlannerInputs};
pub use prediction::{PredictedStart, Reason, predict_starts};
pub use quiet::Quiet;
pub use record::{Record, UnderWay};
pub use rule::{Rule, Timetable};
pub use view::View;
