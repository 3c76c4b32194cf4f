//! When behaviours are started and for how long, and when it is to be quiet. Pure: facts and the time of
//! day go in, starts and ends come out.
//!
//! A time of day is that of the clock on the wall, in the zone of the config. Of a day on which the
//! clock is put forward, what would have begun in the hour that is left out begins when the clock has
//! been changed; on a day on which it is put back, a time that comes twice counts once, the first time.
//! A pattern that names no hours (`*/15 * * * *`) counts intervals: it goes on through both changes.

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
