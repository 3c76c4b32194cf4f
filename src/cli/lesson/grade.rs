//! `spykee lesson grade`: checks the scripts of a class, each as `spykee lesson check` does.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::catalogue::Lesson;
use super::check::{Marks, TryArgs, marks_of, read};
use super::class::{Pair, handed_in, pairs};
use super::feedback::sentence;
use super::{Console, Exit, Failure, aligned, or_dash, parse_lesson, print};
use crate::cli::class;
use crate::sanitize::csv_cell;

#[derive(Debug, Clone, clap::Args)]
pub(in crate::cli) struct GradeArgs {
    /// Folder with a folder or a script for each learner, named after the learner
    #[arg(value_name = "DIR")]
    folder: PathBuf,

    /// Lesson to check the scripts against
    #[arg(long, value_name = "LESSON", value_parser = parse_lesson)]
    lesson: &'static Lesson,

    /// File with the names of the class, one per line; a name without a script counts as not handed
    /// in
    #[arg(long, value_name = "FILE")]
    names: Option<PathBuf>,

    /// Print CSV for spreadsheets
    #[arg(long, conflicts_with = "json")]
    csv: bool,

    /// Print a JSON object
    #[arg(long)]
    json: bool,

    #[command(flatten)]
    tries: TryArgs,
}

#[derive(Default)]
struct Graded {
    name: String,
    file: Option<PathBuf>,
    /// The script's text, if it can be read.
    text: Option<String>,
    points: u32,
    max_points: u32,
    /// Sentences that say what is missing; empty if nothing is.
    missing: Vec<String>,
}

struct Class {
    lesson: &'static Lesson,
    max_points: u32,
    learners: Vec<Graded>,
    alike: Vec<Pair>,
    /// Files in the folder that are no scripts.
    others: Vec<String>,
}

pub(super) fn run(args: &GradeArgs, console: &Console) -> Result<Exit, Failure> {
    let folder = &args.folder;
    let lesson = args.lesson;
    let cannot = |error| {
        Failure::unreadable(folder, error)
            .help("give the folder that has a folder or a script for each learner")
    };
    let list = args.names.as_deref().map_or(Ok(Vec::new()), class::names)?;
    let found = handed_in(folder, lesson, &list).map_err(cannot)?;
    if found.learners.is_empty() {
        let why = format!("there is no script in {}", folder.display());
        return Err(Failure::usage(why).help("it needs a folder or a script for each learner"));
    }
    let mut graded = Vec::new();
    for (name, script) in found.learners {
        graded.push(Graded {
            name,
            ..grade(script, args, console)?
        });
    }
    let texts: Vec<Option<String>> = graded.iter_mut().map(|one| one.text.take()).collect();
    let class = Class {
        lesson,
        max_points: graded.iter().map(|one| one.max_points).max().unwrap_or(0),
        learners: graded,
        alike: pairs(&texts, lesson.starter),
        others: found.others,
    };
    print(&if args.json {
        format!("{:#}\n", class.json())
    } else if args.csv {
        class.csv()
    } else {
        class.text()
    })
}

fn grade(
    script: Result<PathBuf, String>,
    args: &GradeArgs,
    console: &Console,
) -> Result<Graded, Failure> {
    let mut graded = Graded::default();
    let read = script.and_then(|file| {
        let source = read(&file).map_err(|why| why.what);
        graded.file = Some(file);
        source
    });
    let (source, file) = match (read, &graded.file) {
        (Ok(source), Some(file)) => (source, file.clone()),
        (read, _) => {
            graded.missing.extend(read.err());
            return Ok(graded);
        }
    };
    let own = tempfile::tempdir().map_err(|error| Failure::io("create a folder", error))?;
    let played = played_file(&file, &source, args, own.path())
        .map_err(|error| Failure::io(format_args!("copy {}", file.display()), error))?;
    let marks = marks_of(args.lesson, &played, &source, &args.tries, console)?;
    graded.points = marks.points();
    graded.max_points = marks.max_points();
    let text = String::from_utf8_lossy(&source).into_owned();
    graded.missing.extend(args.lesson.other_than_named(&text));
    // An error names the file that was handed in, not the copy that was played.
    let shown = file.display().to_string();
    let copy = played.display().to_string();
    let sentences = missing(&marks).into_iter();
    graded
        .missing
        .extend(sentences.map(|words| words.replace(&copy, &shown)));
    graded.text = Some(text);
    Ok(graded)
}

/// The file to play: the script in the learner's own folder, with the modules beside it, or else a copy
/// in a folder of its own. Beside it in the class's folder are the scripts of others, which it could
/// `require`; and only a file that is named `.lua` is played.
fn played_file(file: &Path, source: &[u8], args: &GradeArgs, own: &Path) -> io::Result<PathBuf> {
    let is_shared = file.parent() == Some(args.folder.as_path());
    if !is_shared && file.extension().is_some_and(|ending| ending == "lua") {
        return Ok(file.to_owned());
    }
    let copy = own.join(args.lesson.file());
    fs::write(&copy, source)?;
    Ok(copy)
}

/// The sentences that say what is missing, each once.
fn missing(marks: &Marks) -> Vec<String> {
    if marks.cannot_run {
        let first = marks.diagnostics.first();
        let why = first.map(|found| format!("line {}: {}", found.line, found.message));
        let why = why.unwrap_or_default();
        return vec![format!("The script cannot run: {why}")];
    }
    let mut sentences: Vec<String> = Vec::new();
    for mark in &marks.marks {
        let words = mark.failure().map(sentence);
        sentences.extend(words.filter(|words| !sentences.contains(words)));
    }
    if let Some(words) = marks.script_error() {
        sentences.push(words.lines().next().unwrap_or_default().to_owned());
    }
    sentences
}

impl Class {
    fn text(&self) -> String {
        let row = |one: &Graded| {
            let points = or_dash(one.file.as_ref().map(|_| one.points));
            vec![one.name.clone(), points, one.missing.join(" ")]
        };
        let number = self.lesson.number;
        let title = self.lesson.title();
        let mut text = format!("Lesson {number}, {title}: {} points\n\n", self.max_points);
        text += &aligned(
            "NAME|>POINTS|WHAT IS MISSING",
            self.learners.iter().map(row),
        );
        let absent = self.learners.iter().filter(|one| one.file.is_none());
        let absent: Vec<&str> = absent.map(|one| one.name.as_str()).collect();
        if !absent.is_empty() {
            text += &format!("\nNo script to check from: {}\n", absent.join(", "));
        }
        if !self.others.is_empty() {
            text += &format!("\nNo scripts, not read: {}\n", self.others.join(", "));
        }
        for pair in &self.alike {
            let (one, other) = self.names(pair);
            let percent = (100.0 * pair.similarity).round();
            text += &format!("\nNearly the same text ({percent} %): {one} and {other}\n");
        }
        text
    }

    fn names(&self, pair: &Pair) -> (&str, &str) {
        let name = |location: usize| self.learners[location].name.as_str();
        (name(pair.places.0), name(pair.places.1))
    }

    fn csv(&self) -> String {
        let mut text = "name,points,max_points,missing,file,same_text_as\n".to_owned();
        for (location, one) in self.learners.iter().enumerate() {
            let file = one.file.as_ref().map(|file| file.display().to_string());
            let cells = [
                one.name.clone(),
                one.points.to_string(),
                self.max_points.to_string(),
                one.missing.join(" "),
                file.unwrap_or_default(),
                self.alike_with(location).join(", "),
            ];
            text += &cells.map(|cell| csv_cell(&cell)).join(",");
            text.push('\n');
        }
        text
    }

    /// The names of the learners with nearly the same text.
    fn alike_with(&self, location: usize) -> Vec<&str> {
        let other = |pair: &Pair| match pair.places {
            (one, other) if one == location => Some(other),
            (other, one) if one == location => Some(other),
            _ => None,
        };
        let others = self.alike.iter().filter_map(other);
        others.map(|at| self.learners[at].name.as_str()).collect()
    }

    fn json(&self) -> Value {
        let learner = |one: &Graded| {
            json!({
                "name": one.name, "handed_in": one.file.is_some(),
                "file": one.file.as_ref().map(|file| file.display().to_string()),
                "points": one.points, "missing": one.missing,
            })
        };
        let pair = |pair: &Pair| {
            let (one, other) = self.names(pair);
            json!({ "names": [one, other], "similarity": (pair.similarity * 100.0).round() / 100.0 })
        };
        json!({
            "lesson": self.lesson.number, "title": self.lesson.title(), "max_points": self.max_points,
            "learners": self.learners.iter().map(learner).collect::<Vec<Value>>(),
            "same_text": self.alike.iter().map(pair).collect::<Vec<Value>>(),
            "not_read": self.others,
        })
    }
}
