//! Completion of names: all names of the API and the words of the language.

use rustyline::completion::Completer;
use rustyline::highlight::Highlighter;
use rustyline::hint::Hinter;
use rustyline::validate::Validator;
use rustyline::{Context, Helper};

use crate::api;

/// Keywords and common functions of the language.
const WORDS: [&str; 24] = [
    "and", "break", "continue", "do", "else", "elseif", "end", "false", "for", "function", "if",
    "in", "ipairs", "local", "nil", "not", "or", "pairs", "print", "repeat", "return", "then",
    "true", "while",
];

/// Completes names up to the cursor.
pub(super) struct Names(Vec<String>);

impl Names {
    pub(super) fn new() -> Names {
        let api = api::names().map(|(path, ..)| path);
        let words = WORDS.iter().map(|&word| word.to_owned());
        let mut names: Vec<String> = api.chain(words).collect();
        names.sort();
        names.dedup();
        Names(names)
    }

    /// Returns the start of the word before the cursor and its possible completions.
    fn candidates(&self, line: &str, cursor: usize) -> (usize, Vec<String>) {
        let before = line.get(..cursor).unwrap_or(line);
        let part = |c: char| c.is_alphanumeric() || matches!(c, '_' | '.');
        let start = before.trim_end_matches(part).len();
        let word = &before[start..];
        if word.is_empty() {
            return (start, Vec::new());
        }
        let fits = self.0.iter().filter(|name| name.starts_with(word));
        (start, fits.cloned().collect())
    }
}

impl Completer for Names {
    type Candidate = String;

    fn complete(
        &self,
        line: &str,
        cursor: usize,
        _: &Context<'_>,
    ) -> rustyline::Result<(usize, Vec<String>)> {
        Ok(self.candidates(line, cursor))
    }
}

impl Hinter for Names {
    type Hint = String;
}
impl Highlighter for Names {}
impl Validator for Names {}
impl Helper for Names {}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn names_of_the_api_are_completed_at_the_cursor() {
        let names = Names::new();
        let (start, found) = names.candidates("if robot.forw", 13);
        assert_eq!((start, found), (3, vec!["robot.forward".to_owned()]));
        let (_, found) = names.candidates("robot.", 6);
        assert!(found.contains(&"robot.move".to_owned()), "{found:?}");
        assert_eq!(names.candidates("", 0), (0, vec![]));
    }

    proptest! {
        #[test]
        fn no_line_causes_a_panic(line in ".{0,40}", cursor in 0..200_usize) {
            let (start, _) = Names::new().candidates(&line, cursor);
            prop_assert!(start <= line.len());
        }
    }
}
