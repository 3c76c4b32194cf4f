//! The feedback to a learner: short sentences that the script's output cannot forge.

use std::fmt::Write as _;
use std::path::Path;

use serde_json::{Value, json};

use super::catalogue::Lesson;
use super::check::{Mark, Marks};
use crate::sanitize;
use crate::scenario::{Cause, Failure};

/// Maximum number of lines shown of an error.
const MAX_LINES: usize = 16;

pub(super) struct Feedback<'a> {
    pub(super) lesson: &'static Lesson,
    /// Whether `--lesson` named the lesson: the next command needs it, too.
    pub(super) is_chosen: bool,
    /// A sentence that says that the script names another lesson.
    pub(super) other_lesson: Option<String>,
    pub(super) file: &'a Path,
    pub(super) marks: &'a Marks,
    pub(super) hint: Option<u8>,
}

impl Feedback<'_> {
    pub(super) fn text(&self) -> String {
        let lesson = self.lesson;
        let marks = self.marks;
        let file = sanitize::text(&self.file.display().to_string(), false).replace('\n', " ");
        let mut text = format!("Lesson {}, {}: {file}\n\n", lesson.number, lesson.title());
        if let Some(other) = &self.other_lesson {
            text += &format!("{other} Is it the right script?\n\n");
        }
        if !marks.cannot_run {
            marks.marks.iter().for_each(|mark| write(mark, &mut text));
            text.push('\n');
        }
        text += &self.script_mistakes();
        text += &format!("{} of {} points.", marks.points(), marks.max_points());
        text += &self.next_step(&file);
        if let Some(hint) = self.hint.and_then(|number| lesson.hint(number)) {
            text += &format!("\nHint: {hint}\n");
            if let Some(next @ 2..=3) = self.hint.map(|number| number + 1) {
                text += &format!("\nThe next hint: {} --hint {next}\n", self.command(&file));
            }
        }
        text
    }

    /// The mistakes in the script itself, with each line marked as a quotation.
    fn script_mistakes(&self) -> String {
        let marks = self.marks;
        let mut text = String::new();
        if let Some(words) = marks.script_error() {
            text += &format!("The script stopped with an error:\n\n{}\n", quoted(words));
        }
        if !marks.diagnostics.is_empty() {
            let found: Vec<String> = marks.diagnostics.iter().map(ToString::to_string).collect();
            text += if marks.cannot_run {
                "The script cannot run yet:\n\n"
            } else {
                "Look at this too:\n\n"
            };
            text += &format!("{}\n", quoted(&found.join("\n\n")));
        }
        text
    }

    fn next_step(&self, file: &str) -> String {
        let marks = self.marks;
        let number = self.lesson.number;
        match (marks.is_full(), number < Lesson::all().len()) {
            (true, true) => format!(" Well done! Next: spykee lesson start {}\n", number + 1),
            (true, false) => " Well done! That was the last lesson.\n".to_owned(),
            // No hint is offered if the script has mistakes to fix or a hint is already shown.
            (false, _)
                if marks.cannot_run || marks.script_error().is_some() || self.hint.is_some() =>
            {
                "\n".to_owned()
            }
            (false, _) => format!(" A hint: {} --hint 1\n", self.command(file)),
        }
    }

    fn command(&self, file: &str) -> String {
        let number = self.lesson.number;
        if self.is_chosen {
            return format!("spykee lesson check {file} --lesson {number}");
        }
        format!("spykee lesson check {file}")
    }

    /// What is missing, in one sentence.
    pub(super) fn sentence(&self) -> String {
        let marks = self.marks;
        if let (true, Some(found)) = (marks.cannot_run, marks.diagnostics.first()) {
            format!("Line {}: {}", found.line, found.message)
        } else if let Some(error) = marks.script_error().and_then(|error| error.lines().next()) {
            error.to_owned()
        } else {
            let missing = marks.marks.iter().find_map(Mark::failure).map(sentence);
            missing.unwrap_or_else(|| "Well done!".to_owned())
        }
    }

    pub(super) fn json(&self) -> Value {
        let lesson = self.lesson;
        let marks = self.marks;
        let scenario = |mark: &Mark| {
            json!({
                "name": mark.name, "points": mark.points(), "max_points": mark.max_points,
                "passed": mark.passed(), "tries": mark.seeds, "failed_seeds": mark.failed_seeds(),
                "message": mark.failure().map(sentence),
            })
        };
        json!({
            "lesson": lesson.number, "title": lesson.title(), "other_lesson": self.other_lesson,
            "file": self.file.display().to_string(),
            "points": marks.points(), "max_points": marks.max_points(), "passed": marks.is_full(),
            "mistakes": marks.diagnostics, "error": marks.script_error(),
            "scenarios": marks.marks.iter().map(scenario).collect::<Vec<Value>>(),
        })
    }
}

/// The feedback as the results.json of a Gradescope autograder.
pub(super) fn gradescope(feedback: &Feedback<'_>) -> Value {
    let marks = feedback.marks;
    let test = |mark: &Mark| {
        json!({
            "name": mark.name, "score": mark.points(), "max_score": mark.max_points,
            "status": if mark.passed() { "passed" } else { "failed" },
            "output": match (marks.cannot_run, mark.failure()) {
                (true, _) => "The script cannot run yet; see above.".to_owned(),
                (false, None) => "Well done!".to_owned(),
                (false, Some(failure)) => format!("{}{}", sentence(failure), tries(mark)),
            },
        })
    };
    let lesson = feedback.lesson;
    let title = format!("Lesson {}, {}", lesson.number, lesson.title());
    let other = feedback.other_lesson.as_ref();
    let other = other.map_or_else(String::new, |other| format!("{other}\n\n"));
    let output = format!("{title}\n\n{other}{}", feedback.script_mistakes());
    json!({
        "score": marks.points(), "output": output.trim_end(),
        "tests": marks.marks.iter().map(test).collect::<Vec<Value>>(),
    })
}

fn write(mark: &Mark, text: &mut String) {
    let word = if mark.passed() { "ok" } else { "not yet" };
    let points = mark.points();
    let max_points = mark.max_points;
    // Writing into a string does not fail.
    let _ = writeln!(text, "  {word:7}  {points} of {max_points}  {}", mark.name);
    if let Some(failure) = mark.failure() {
        let _ = writeln!(text, "           {}{}", sentence(failure), tries(mark));
    }
}

/// A sentence that says what is missing.
pub(super) fn sentence(failure: &Failure) -> String {
    match &failure.cause {
        Cause::Behaviour(_) => "The script stopped with an error.".to_owned(),
        Cause::Expectation | Cause::Scenario => {
            sanitize::text(&failure.message, false).replace('\n', " ")
        }
    }
}

/// Says how many tries passed, if any did.
fn tries(mark: &Mark) -> String {
    match mark.passes() {
        0 => String::new(),
        passes => format!(" (It worked in {passes} of {} tries.)", mark.seeds),
    }
}

/// Quotes text: marks each line, so that it cannot pass for our own output.
fn quoted(words: &str) -> String {
    let words = sanitize::text(words.trim_end(), false);
    let mut lines = words.lines();
    let shown = lines.by_ref().take(MAX_LINES);
    let mut text: String = shown.map(|line| format!("  | {line}\n")).collect();
    if lines.next().is_some() {
        text += "  | ...\n";
    }
    text
}
