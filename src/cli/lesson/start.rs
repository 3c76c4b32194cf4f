//! `spykee lesson start`: creates a folder with a lesson's task and a script to start from.

use std::fs;
use std::path::PathBuf;

use super::catalogue::Lesson;
use super::{Exit, Failure, LessonParser, print};

#[derive(Debug, Clone, clap::Args)]
pub(super) struct StartArgs {
    /// Number or name of the lesson
    #[arg(value_name = "LESSON", value_parser = LessonParser, hide_possible_values = true)]
    lesson: &'static Lesson,

    /// Folder to create [default: named after the lesson, such as lesson-03-moving]
    #[arg(value_name = "DIR")]
    folder: Option<PathBuf>,
}

/// Creates the folder. Does not change an existing one.
///
/// # Errors
/// The folder exists or cannot be created.
pub(super) fn run(args: &StartArgs) -> Result<Exit, Failure> {
    let lesson = args.lesson;
    let own = || PathBuf::from(format!("lesson-{}", lesson.folder));
    let folder = args.folder.clone().unwrap_or_else(own);
    let shown = folder.display();
    let cannot = |error| Failure::io(format_args!("create {shown}"), error);
    if let Some(parent) = folder.parent() {
        fs::create_dir_all(parent).map_err(cannot)?;
    }
    fs::create_dir(&folder).map_err(|error| match error.kind() {
        std::io::ErrorKind::AlreadyExists => Failure::usage(format_args!("{shown} already exists"))
            .help(format!(
                "nothing was changed; continue in it, or use another folder: spykee lesson start {} \
                 DIR",
                lesson.number
            )),
        _ => cannot(error),
    })?;
    let file = lesson.file();
    for (name, text) in [("README.md", lesson.readme), (&file, lesson.starter)] {
        fs::write(folder.join(name), text).map_err(cannot)?;
    }
    let (number, title, world) = (lesson.number, lesson.title(), lesson.world);
    print(&format!(
        "Lesson {number}, {title}, is in {shown}: read README.md, then edit {file}.\n\n\
         next:\n  cd {shown}\n  spykee run {file} --sim {world} --trace run.png\n  spykee lesson check {file}\n"
    ))?;
    Ok(Exit::Done)
}
