//! What Luau's type checker is asked about a script, and what its answers mean. The checker itself is
//! another program: [`Question`] and [`Answer`] are what goes over.

use serde::{Deserialize, Serialize};

use super::super::api::definition;
use super::desugar::desugared;
use super::finding::{Finding, Severity};
use super::lexer::Span;
use super::tree::{Block, ExprKind, LocalId, Statement, StatementKind, Tree};
use super::wording::{in_words, says_nil, short};
use super::{compiles, parser, sandbox};

/// The longest that a text is looked at, in seconds.
const TEXT_LIMIT: f64 = 2.0;

/// What the checker is asked.
#[derive(Debug, Serialize)]
pub struct Question {
    definitions: String,
    texts: Vec<String>,
    seconds: f64,
}

/// What it says of one text.
#[derive(Debug, Deserialize)]
pub struct Answer {
    findings: Vec<Complaint>,
    timed_out: bool,
}

#[derive(Debug, Deserialize)]
struct Complaint {
    line: usize,
    column: usize,
    end_line: usize,
    end_column: usize,
    message: String,
}

/// How much a script wants to be told.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Mode {
    /// Only what cannot work, and what it has promised with types.
    Nonstrict,
    /// All.
    Strict,
}

/// A script whose types are to be checked.
#[derive(Debug)]
pub struct Typing<'a> {
    chunk: &'a str,
    source: &'a str,
    mode: Mode,
    text: String,
    /// Values of variables that have a type written to them.
    promised: Vec<Span>,
}

impl<'a> Typing<'a> {
    /// Of a script that can be read and wants to be checked; it says `--!nocheck` if not.
    pub fn of(source: &'a [u8], chunk: &'a str) -> Option<Typing<'a>> {
        let source = sandbox::check_source(source, chunk).ok()?;
        let mode = mode(source)?;
        compiles(source, chunk).ok()?;
        let tree = parser::parse(source).ok()?;
        Some(Typing {
            chunk,
            source,
            mode,
            text: desugared(source, &tree),
            promised: promised(source, &tree),
        })
    }

    /// What to ask.
    pub fn question(&self) -> Question {
        let strict = format!("--!strict\n{}", self.text);
        let nonstrict = || format!("--!nonstrict\n{}", self.text);
        Question {
            definitions: definition::checker(),
            texts: match self.mode {
                Mode::Strict => vec![strict],
                Mode::Nonstrict if self.promised.is_empty() => vec![nonstrict()],
                Mode::Nonstrict => vec![nonstrict(), strict],
            },
            seconds: TEXT_LIMIT,
        }
    }

    /// What the answers to that question say, without what these findings have said already of the
    /// same place.
    ///
    /// # Errors
    /// It took too long, or the answers are to another question.
    pub fn findings(&self, answers: &[Answer], said: &[Finding]) -> Result<Vec<Finding>, String> {
        if answers.iter().any(|answer| answer.timed_out) {
            return Err(format!("types take more than {TEXT_LIMIT} s to check"));
        }
        let (own, strict) = match (answers, self.mode) {
            ([own], _) => (own, None),
            ([own, strict], Mode::Nonstrict) => (own, Some(strict)),
            _ => return Err("the type checker answered something else".to_owned()),
        };
        // In a line of ours it complains of itself.
        let mut all = answers.iter().flat_map(|answer| &answer.findings);
        if let Some(failed) = all.find(|one| one.line == 0) {
            return Err(format!(
                "the type checker failed: {}",
                short(&failed.message)
            ));
        }
        let own = own.findings.iter().map(|one| (self.span(one), one));
        let broken = strict.iter().flat_map(|answer| &answer.findings);
        let broken = broken.map(|one| (self.span(one), one)).filter(|(at, _)| {
            let mut promised = self.promised.iter();
            promised.any(|value| value.start == at.start)
        });
        let mut complaints: Vec<_> = own.chain(broken).collect();
        // The clearest of several about one place comes first.
        complaints.sort_by_key(|(_, one)| !says_nil(&one.message));
        let found = complaints.into_iter();
        let mut findings: Vec<Finding> = Vec::new();
        for finding in found.filter_map(|(at, one)| self.finding(at, one)) {
            if !said
                .iter()
                .chain(&findings)
                .any(|one| overlap(one, &finding))
            {
                findings.push(finding);
            }
        }
        findings.sort_by_key(|finding| (finding.line, finding.column));
        Ok(findings)
    }

    fn finding(&self, span: Span, complaint: &Complaint) -> Option<Finding> {
        let (message, help) = in_words(&complaint.message)?;
        let finding = Finding::new((self.chunk, self.source), span, Severity::Error, message);
        Some(finding.help(help))
    }

    /// Where it is in the script: the text has one line more before it.
    fn span(&self, complaint: &Complaint) -> Span {
        let start = self.offset(complaint.line, complaint.column);
        let end = self.offset(complaint.end_line, complaint.end_column);
        Span { start, end }
    }

    fn offset(&self, line: usize, column: usize) -> usize {
        let before = line.saturating_sub(1);
        let lines = self.source.split_inclusive('\n').take(before);
        let start: usize = lines.map(str::len).sum();
        let mut at = start.saturating_add(column).min(self.source.len());
        while !self.source.is_char_boundary(at) {
            at -= 1;
        }
        at
    }
}

fn overlap(one: &Finding, other: &Finding) -> bool {
    let end = |finding: &Finding| finding.column.saturating_add(finding.width);
    one.line == other.line && one.column < end(other) && other.column < end(one)
}

/// What the comments at the top ask for; nothing for `--!nocheck`.
fn mode(source: &str) -> Option<Mode> {
    let head = source.lines().map(str::trim);
    let head = head.take_while(|line| line.is_empty() || line.starts_with("--"));
    let mut asked = head.filter_map(|line| match line.strip_prefix("--!")?.trim() {
        "strict" => Some(Some(Mode::Strict)),
        "nonstrict" => Some(Some(Mode::Nonstrict)),
        "nocheck" => Some(None),
        _ => None,
    });
    asked.next().unwrap_or(Some(Mode::Nonstrict))
}

/// The values of local variables with a type.
fn promised(source: &str, tree: &Tree) -> Vec<Span> {
    let mut spans = Vec::new();
    in_block(&tree.block, &mut |one| {
        spans.extend(typed(source, tree, one))
    });
    tree.each_expr(&mut |expr| {
        if let ExprKind::Function(body) = &expr.kind {
            in_block(&body.block, &mut |one| {
                spans.extend(typed(source, tree, one))
            });
        }
    });
    spans
}

fn typed(source: &str, tree: &Tree, statement: &Statement) -> Vec<Span> {
    let StatementKind::Local(ids, values) = &statement.kind else {
        return Vec::new();
    };
    let has_type = |id: &LocalId| {
        let after = source.get(tree.locals[id.0].span.end..).unwrap_or_default();
        after.trim_start().starts_with(':')
    };
    let pairs = ids.iter().zip(values);
    let typed = pairs.filter(|(id, _)| has_type(id));
    typed.map(|(_, value)| value.span).collect()
}

/// Every statement of a block and of those in it, but for functions that are values.
fn in_block(block: &Block, visit: &mut dyn FnMut(&Statement)) {
    for statement in block {
        visit(statement);
        for inner in statement.blocks() {
            in_block(inner, visit);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn answer(line: usize, column: usize, end_column: usize, message: &str) -> Answer {
        Answer {
            findings: vec![Complaint {
                line,
                column,
                end_line: line,
                end_column,
                message: message.to_owned(),
            }],
            timed_out: false,
        }
    }

    fn nothing() -> Answer {
        Answer {
            findings: Vec::new(),
            timed_out: false,
        }
    }

    const COULD_BE_NIL: &str =
        "Expected this to be 'number', but got 'Battery?'; \nthis is because";

    #[test]
    fn a_complaint_stands_where_the_script_has_it() {
        let source = "--!strict\nlocal n: number = robot.battery()\n";
        let typing = Typing::of(source.as_bytes(), "a.lua").unwrap();
        let found = typing
            .findings(&[answer(2, 18, 33, COULD_BE_NIL)], &[])
            .unwrap();
        assert_eq!(found[0].place(), "a.lua:2:19");
        assert_eq!(found[0].message, "expected number, got Battery?");
        assert_eq!(found[0].width, 15);
    }

    #[test]
    fn without_strict_only_what_has_a_type_is_held_to_it() {
        let source = "local n: number = robot.battery()\nlocal m = robot.battery().percent\n";
        let typing = Typing::of(source.as_bytes(), "a.lua").unwrap();
        let at = |line, column| [nothing(), answer(line, column, column + 3, COULD_BE_NIL)];
        assert_eq!(typing.findings(&at(1, 18), &[]).unwrap().len(), 1);
        assert_eq!(typing.findings(&at(2, 10), &[]).unwrap().len(), 0);
    }

    #[test]
    fn what_was_said_of_a_place_already_is_not_said_again() {
        let source = "robot.move({}, 3)";
        let span = Span { start: 11, end: 13 };
        let said = Finding::new(("a.lua", source), span, Severity::Error, "a number!");
        let typing = Typing::of(source.as_bytes(), "a.lua").unwrap();
        let answers = [answer(
            1,
            11,
            13,
            "the function 'robot.move' expects to get a number",
        )];
        assert_eq!(typing.findings(&answers, &[]).unwrap().len(), 1);
        assert_eq!(typing.findings(&answers, &[said]).unwrap().len(), 0);
    }

    #[test]
    fn a_script_that_wants_no_check_or_cannot_be_read_is_not_asked_about() {
        assert!(Typing::of(b"-- of mine\n--!nocheck\nprint(1)", "a.lua").is_none());
        assert!(Typing::of(b"print(", "a.lua").is_none());
        assert!(Typing::of(b"\xff", "a.lua").is_none());
    }

    #[test]
    fn a_checker_that_takes_too_long_or_answers_something_else_is_an_error() {
        let typing = Typing::of(b"print(1)", "a.lua").unwrap();
        let late = Answer {
            timed_out: true,
            ..nothing()
        };
        assert!(typing.findings(&[late], &[]).is_err());
        assert!(typing.findings(&[], &[]).is_err());
    }

    proptest! {
        #[test]
        fn no_place_is_outside_of_the_script(
            source in "[a-zä\n ]{0,40}", line in 0..9usize, column in 0..40usize, end in 0..40usize,
        ) {
            let source = format!("--!strict\n--[[{source}]]");
            if let Some(typing) = Typing::of(source.as_bytes(), "a.lua") {
                let _ = typing.findings(&[answer(line, column, end, COULD_BE_NIL)], &[]);
            }
        }
    }
}
