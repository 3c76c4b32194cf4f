//! Explains a failed run in plain words: which expression was nil, why that may be, and the source
//! line with a caret. The VM reports the line and the failed operation; the syntax tree shows the
//! expressions on that line.

mod failures;
mod reasons;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;

use super::diagnostic::{Diagnostic, Severity};
use super::kinds::Kinds;
use super::lexer::Span;
use super::tree::{Block, Expr, ExprKind, LocalId, Statement, StatementKind, Tree};
use super::{CheckContext, parser, walk};

/// What failed, and where.
struct Explanation {
    at: Span,
    message: String,
    help: String,
}

/// Explains an error such as `a.lua:3: attempt to index nil with 'cx'` in plain words, with the
/// source line. `None` if it is not in this file or needs no explanation.
pub fn explain(text: &str, chunk: &str, source: &str) -> Option<String> {
    let diagnostic = explanation(text, chunk, source)?;
    let line = diagnostic.line;
    let message = &diagnostic.message;
    Some(format!(
        "{chunk}:{line}: {message}\n{}",
        diagnostic.excerpt()
    ))
}

/// Same as [`explain`], in parts.
pub fn explanation(text: &str, chunk: &str, source: &str) -> Option<Diagnostic> {
    let rest = text.strip_prefix(chunk)?.strip_prefix(':')?;
    let (line, words) = rest.split_once(": ")?;
    let number: usize = line.parse().ok()?;
    let whole = line_span(source, number)?;
    let tree = parser::parse(source).ok();
    let explanation = tree.as_ref().and_then(|tree| {
        let context = CheckContext::defined();
        let site = ErrorSite::new(tree, source, number, &context);
        site.explanation(words)
    });
    let explanation = explanation.or_else(|| general(words, whole));
    if explanation.is_none()
        && ["error(", "assert("]
            .iter()
            .any(|call| whole.of(source).contains(call))
    {
        // An error that the script raised itself needs no explanation.
        return None;
    }
    let explanation = explanation.unwrap_or(Explanation {
        at: whole,
        message: words.to_owned(),
        help: String::new(),
    });
    // The caret must be on the line that the VM reports.
    let at = if explanation.at.start >= whole.start && explanation.at.start <= whole.end {
        explanation.at
    } else {
        whole
    };
    let diagnostic = Diagnostic::new((chunk, source), at, Severity::Error, explanation.message);
    Some(diagnostic.help(explanation.help))
}

/// Returns the span of a line, without its indentation.
fn line_span(source: &str, number: usize) -> Option<Span> {
    let start: usize = source
        .split_inclusive('\n')
        .take(number.checked_sub(1)?)
        .map(str::len)
        .sum();
    let line = source.get(start..)?.lines().next()?;
    let indent = line.len() - line.trim_start().len();
    Some(Span {
        start: start + indent,
        end: start + line.trim_end().len().max(indent),
    })
}

/// Explains an error without a syntax tree.
fn general(words: &str, at: Span) -> Option<Explanation> {
    let explanation = |message: &str, help: &str| {
        Some(Explanation {
            at,
            message: message.to_owned(),
            help: help.to_owned(),
        })
    };
    if words.contains("stack overflow") {
        return explanation(
            "a function calls itself endlessly",
            "let it end at some point, or use a loop: while true do ... task.wait(0.1) end",
        );
    }
    if words.contains("attempt to call a") || words.contains("attempt to call missing") {
        return explanation(
            "the value called here is not a function",
            "check the spelling of its name",
        );
    }
    if words.contains("attempt to yield across") {
        return explanation(
            words,
            "a function for table.sort or gsub, or a metamethod, cannot wait",
        );
    }
    if words.contains("readonly table") {
        return explanation(
            "this table is read-only and cannot be changed",
            "keep your own values in a local variable",
        );
    }
    let similar = [
        (
            "attempt to index",
            "a field is read from a value that has no fields, perhaps nil",
        ),
        (
            "attempt to perform arithmetic",
            "one of the two values is not a number, perhaps nil",
        ),
        (
            "attempt to compare",
            "only numbers can be compared with numbers; one of the two values is something else, perhaps nil",
        ),
        (
            "attempt to concatenate",
            "one of the two values is not a string, perhaps nil",
        ),
        (
            "attempt to get length",
            "only lists and strings have a length",
        ),
        (
            "attempt to iterate",
            "the value after `in` is not a list, perhaps nil",
        ),
        ("invalid 'for'", "a `for` counts with numbers only"),
    ];
    let found = similar.iter().find(|(part, _)| words.contains(part));
    found.and_then(|(_, message)| explanation(message, "print the values to see which one it is"))
}

struct ErrorSite<'a> {
    source: &'a str,
    /// The expressions that overlap the line, in the order of the text.
    exprs: Vec<&'a Expr>,
    statements: Vec<&'a Statement>,
    kinds: Kinds<'a>,
    /// The initial values of local variables: the expression, and the index of its result.
    begins: BTreeMap<LocalId, (&'a Expr, usize)>,
}

impl<'a> ErrorSite<'a> {
    fn new(
        tree: &'a Tree,
        source: &'a str,
        line: usize,
        context: &'a CheckContext,
    ) -> ErrorSite<'a> {
        let (_, kinds) = walk::walked(tree, ("", source), context);
        let mut site = ErrorSite {
            source,
            exprs: Vec::new(),
            statements: Vec::new(),
            kinds,
            begins: BTreeMap::new(),
        };
        let starts: Vec<usize> = source.match_indices('\n').map(|(at, _)| at).collect();
        let line_of = |at: usize| starts.partition_point(|start| *start < at) + 1;
        let on_line =
            |span: Span| line_of(span.start) <= line && line <= line_of(span.end.saturating_sub(1));
        each_statement(&tree.block, &mut |statement| {
            if on_line(statement.span) {
                site.statements.push(statement);
            }
            if let StatementKind::Local(ids, values) = &statement.kind {
                for (at, id) in ids.iter().enumerate() {
                    let last = values.len().saturating_sub(1);
                    if let Some(value) = values.get(at.min(last)) {
                        site.begins.insert(*id, (value, at.saturating_sub(last)));
                    }
                }
            }
        });
        tree.each_expr(&mut |expr| {
            if on_line(expr.span) {
                site.exprs.push(expr);
            }
        });
        site
    }

    fn text(&self, expr: &Expr) -> String {
        let text = expr.span.of(self.source);
        let short = crate::script::printable(text.lines().next().unwrap_or_default(), 60);
        short.trim().to_owned()
    }

    fn explanation(&self, words: &str) -> Option<Explanation> {
        if let Some(rest) = words.strip_prefix("attempt to index ") {
            let (what, with) = rest.split_once(" with ")?;
            return self.index(what, with.trim_matches('\''));
        }
        if let Some(rest) = words.strip_prefix("attempt to call missing method '") {
            return self.missing_method(rest.split('\'').next()?);
        }
        if let Some(rest) = words.strip_prefix("attempt to call a ") {
            return self.call(rest.split(' ').next()?);
        }
        if let Some(rest) = words.strip_prefix("attempt to perform arithmetic (") {
            let (operation, rest) = rest.split_once(") on ")?;
            return self.arithmetic(operation, rest);
        }
        if let Some(rest) = words.strip_prefix("attempt to compare ") {
            return self.compare(rest);
        }
        if let Some(rest) = words.strip_prefix("attempt to concatenate ") {
            let (left, right) = rest.split_once(" with ")?;
            return self.join(left, right);
        }
        if let Some(rest) = words.strip_prefix("attempt to get length of a ") {
            return self.length(rest.split(' ').next()?);
        }
        if let Some(rest) = words.strip_prefix("attempt to iterate over a ") {
            return self.iterate(rest.split(' ').next()?);
        }
        if let Some(rest) = words.strip_prefix("invalid 'for' ") {
            return self.count(rest);
        }
        if words.starts_with("invalid argument #") || words.starts_with("missing argument #") {
            return self.library_argument(words);
        }
        self.api(words)
    }
}

/// Visits every statement, outer ones first, including those in functions.
fn each_statement<'a>(block: &'a Block, visit: &mut dyn FnMut(&'a Statement)) {
    for statement in block {
        visit(statement);
        for inner in statement.blocks() {
            each_statement(inner, visit);
        }
        for expr in statement.exprs() {
            let mut bodies = Vec::new();
            outer_functions(expr, &mut bodies);
            for body in bodies {
                each_statement(body, visit);
            }
        }
    }
}

/// Collects the blocks of the functions in an expression, without functions nested in them.
fn outer_functions<'a>(expr: &'a Expr, bodies: &mut Vec<&'a Block>) {
    if let ExprKind::Function(body) = &expr.kind {
        return bodies.push(&body.block);
    }
    for part in expr.parts() {
        outer_functions(part, bodies);
    }
}
