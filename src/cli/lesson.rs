//! `spykee lesson`: built-in exercises, and checks of learners' scripts.

mod catalogue;
mod check;
mod class;
mod feedback;
mod grade;

use std::path::{Path, PathBuf};

use serde_json::Value;

use super::new::create_project;
use super::table::{aligned, or_dash};
use super::{Console, Exit, Failure, print};
use crate::class::Lesson as ClassLesson;
use crate::sanitize;
use catalogue::Lesson;

#[derive(Debug, Clone, clap::Subcommand)]
pub(super) enum Action {
    /// List the lessons
    List,
    /// Create a folder with a lesson's task and a script to start from
    Start {
        /// Number or name of the lesson
        #[arg(value_name = "LESSON", value_parser = parse_lesson)]
        lesson: &'static Lesson,

        /// Folder to create [default: named after the lesson, such as lesson-03-moving]
        #[arg(value_name = "DIR")]
        folder: Option<PathBuf>,
    },
    /// Test a script against its lesson and say what is missing
    Check(check::CheckArgs),
    /// Check the scripts of a class
    Grade(grade::GradeArgs),
}

pub(super) fn run(action: &Action, console: &Console) -> Result<Exit, Failure> {
    match action {
        Action::List => list(),
        Action::Start { lesson, folder } => start(lesson, folder.clone()),
        Action::Check(args) => check::run(args, console),
        Action::Grade(args) => grade::run(args, console),
    }
}

fn list() -> Result<Exit, Failure> {
    let row = |lesson: &Lesson| {
        vec![
            lesson.number.to_string(),
            lesson.title().to_owned(),
            lesson.subjects().to_owned(),
        ]
    };
    print(&format!(
        "{}\nStart one with: spykee lesson start 1\n",
        aligned(">LESSON|TITLE|YOU LEARN", Lesson::all().iter().map(row))
    ))
}

pub(super) fn of_class() -> Vec<ClassLesson> {
    let lesson = |lesson: &'static Lesson| ClassLesson {
        name: lesson.folder,
        title: lesson.title(),
        world: lesson.world,
        readme: lesson.readme,
        starter: lesson.starter,
    };
    Lesson::all().iter().map(lesson).collect()
}

/// Checks the script in this file against a lesson, as `lesson check --json` does, for a class: with the
/// `sentence` that says what is missing, and without the folder's path.
pub(super) fn judge(lesson: &str, file: &Path, console: &Console) -> Result<Value, String> {
    let lesson = Lesson::named(lesson).ok_or("there is no such lesson")?;
    let checked = check::for_class(lesson, file, console).map_err(|failure| failure.what)?;
    let folder = file
        .parent()
        .map_or_else(String::new, |folder| format!("{}/", folder.display()));
    Ok(sanitize::with_texts(checked, &|text| {
        text.replace(&folder, "")
    }))
}

pub(super) fn lesson_names() -> impl Iterator<Item = &'static str> {
    Lesson::all().iter().map(Lesson::name)
}

/// Parses a lesson's number, from 1, or its name, such as `moving` or `03-moving`.
fn parse_lesson(text: &str) -> Result<&'static Lesson, String> {
    Lesson::named(text).ok_or_else(|| {
        let last = Lesson::all().len();
        format!(
            "expected a lesson's name or a number from 1 to {last}; `spykee lesson list` shows them"
        )
    })
}

/// Creates the folder. Does not change an existing one.
fn start(lesson: &Lesson, folder: Option<PathBuf>) -> Result<Exit, Failure> {
    let number = lesson.number;
    let own = || PathBuf::from(format!("lesson-{}", lesson.folder));
    let folder = folder.unwrap_or_else(own);
    let shown = folder.display();
    if let Some(parent) = folder.parent() {
        std::fs::create_dir_all(parent)
            .map_err(|error| Failure::io(format_args!("create {shown}"), error))?;
    }
    let file = lesson.file();
    let files = [
        ("README.md".to_owned(), lesson.readme.to_owned()),
        (file.clone(), lesson.starter.to_owned()),
    ];
    let instead =
        format!("continue in it, or use another folder: spykee lesson start {number} DIR");
    create_project(&folder, &files, &instead)?;
    let title = lesson.title();
    let world = lesson.world;
    print(&format!(
        "Lesson {number}, {title}, is in {shown}: read README.md, then edit {file}.\n\n\
         next:\n  cd {shown}\n  spykee run {file} --sim {world} --trace run.png\n  spykee lesson check {file}\n"
    ))
}
