//! `spykee lesson`: built-in exercises, and checks of learners' scripts.

mod catalogue;
mod check;
mod class;
mod feedback;
mod grade;
mod likeness;
mod marks;
mod start;

use std::ffi::OsStr;

use clap::builder::{PossibleValue, TypedValueParser};

use super::argument::ArgumentError;
use super::table::{Side, aligned};
use super::{Console, Exit, Failure, print};
use catalogue::Lesson;

/// Learn to write behaviours with built-in exercises and checks
#[derive(Debug, Clone, clap::Args)]
pub(super) struct LessonArgs {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, Clone, clap::Subcommand)]
enum Action {
    /// List the lessons
    List,
    /// Create a folder with a lesson's task and a script to start from
    Start(start::StartArgs),
    /// Test a script against its lesson and say what is missing
    Check(check::CheckArgs),
    /// Check the scripts of a class
    Grade(grade::GradeArgs),
}

pub(super) fn run(args: &LessonArgs, console: &Console) -> Result<Exit, Failure> {
    match &args.action {
        Action::List => list(),
        Action::Start(args) => start::run(args),
        Action::Check(args) => check::run(args, console),
        Action::Grade(args) => grade::run(args, console),
    }
}

fn list() -> Result<Exit, Failure> {
    let head = [
        ("LESSON", Side::Right),
        ("TITLE", Side::Left),
        ("YOU LEARN", Side::Left),
    ];
    let rows: Vec<Vec<String>> = Lesson::all()
        .iter()
        .map(|lesson| {
            vec![
                lesson.number.to_string(),
                lesson.title().to_owned(),
                lesson.subjects().to_owned(),
            ]
        })
        .collect();
    print(&format!(
        "{}\nStart one with: spykee lesson start 1\n",
        aligned(&head, &rows)
    ))?;
    Ok(Exit::Done)
}

/// Parses a lesson's number, from 1, or its name, such as `moving` or `03-moving`. Shells complete
/// the names.
#[derive(Debug, Clone)]
struct LessonParser;

impl TypedValueParser for LessonParser {
    type Value = &'static Lesson;

    fn parse_ref(
        &self,
        command: &clap::Command,
        arg: Option<&clap::Arg>,
        value: &OsStr,
    ) -> Result<&'static Lesson, clap::Error> {
        parse_lesson.parse_ref(command, arg, value)
    }

    fn possible_values(&self) -> Option<Box<dyn Iterator<Item = PossibleValue> + '_>> {
        let names = Lesson::all().iter().map(Lesson::name);
        Some(Box::new(names.map(PossibleValue::new)))
    }
}

fn parse_lesson(text: &str) -> Result<&'static Lesson, ArgumentError> {
    Lesson::named(text).ok_or_else(|| ArgumentError::Lesson(Lesson::all().len()))
}
