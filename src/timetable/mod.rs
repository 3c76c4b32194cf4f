//! When behaviours start and for how long, and the quiet hours. Pure: facts and the time of day go
//! in, starts and ends come out.
//!
//! Times of day are local, in the time zone of the config. When the clock is put forward, a start
//! within the skipped hour happens right after the change; when it is put back, a time that comes
//! twice counts once, the first time. A pattern without hours (`*/15 * * * *`) counts intervals: it
//! continues through both changes.

mod act;
mod error;
mod outlook;
mod pattern;
mod planner;
mod quiet;
mod record;
mod rule;
mod view;

pub use act::{Act, Notice};
pub use error::TimetableError;
pub use outlook::{Outlook, Reason, outlook};
pub use pattern::Pattern;
pub use planner::{Facts, Planner};
pub use quiet::Quiet;
pub use record::{Record, UnderWay};
pub use rule::{Rule, Timetable};
pub use view::View;
