//! Explains a failed run in plain words. The VM reports the line and the failed operation; the
//! syntax tree shows the expressions on that line, and why one of them may be nil.

mod failures;

use std::collections::BTreeMap;

use super::diagnostic::{Diagnostic, Severity, SourceText};
use super::kinds::{Kinds, ValueKind};
use super::lexer::Span;
use super::tree::{Block, Expr, ExprKind, LocalId, Statement, StatementKind, Tree, each_in_expr};
use super::{CheckContext, parser, walk};
use crate::api::{self, Requirement};

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
    let text = SourceText {
        file: chunk,
        text: source,
    };
    let diagnostic = Diagnostic::new(text, at, Severity::Error, explanation.message);
    Some(diagnostic.help(explanation.help))
}

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
    if words.contains("attempt to yield across") {
        return Some(Explanation {
            at,
            message: words.to_owned(),
            help: "a function for table.sort or gsub, or a metamethod, cannot wait".to_owned(),
        });
    }
    let found = GENERAL.iter().find(|(part, ..)| words.contains(part));
    found.map(|(_, message, help)| Explanation {
        at,
        message: (*message).to_owned(),
        help: (*help).to_owned(),
    })
}

const NO_FUNCTION: &str = "the value called here is not a function";
const SPELLING: &str = "check the spelling of its name";
const PRINT: &str = "print the values to see which one it is";

/// A part of the VM's message, what it means, and what to do.
const GENERAL: [(&str, &str, &str); 11] = [
    (
        "stack overflow",
        "a function calls itself endlessly",
        "let it end at some point, or use a loop: while true do ... task.wait(0.1) end",
    ),
    ("attempt to call a", NO_FUNCTION, SPELLING),
    ("attempt to call missing", NO_FUNCTION, SPELLING),
    (
        "readonly table",
        "this table is read-only and cannot be changed",
        "keep your own values in a local variable",
    ),
    (
        "attempt to index",
        "a field is read from a value that has no fields, perhaps nil",
        PRINT,
    ),
    (
        "attempt to perform arithmetic",
        "one of the two values is not a number, perhaps nil",
        PRINT,
    ),
    (
        "attempt to compare",
        "only numbers can be compared with numbers; one of the two values is something else, perhaps nil",
        PRINT,
    ),
    (
        "attempt to concatenate",
        "one of the two values is not a string, perhaps nil",
        PRINT,
    ),
    (
        "attempt to get length",
        "only lists and strings have a length",
        PRINT,
    ),
    (
        "attempt to iterate",
        "the value after `in` is not a list, perhaps nil",
        PRINT,
    ),
    ("invalid 'for'", "a `for` counts with numbers only", PRINT),
];

struct ErrorSite<'a> {
    source: &'a str,
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
        let text = SourceText {
            file: "",
            text: source,
        };
        let (_, kinds) = walk::walked(tree, text, context);
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

fn outer_functions<'a>(expr: &'a Expr, bodies: &mut Vec<&'a Block>) {
    if let ExprKind::Function(body) = &expr.kind {
        return bodies.push(&body.block);
    }
    for part in expr.parts() {
        outer_functions(part, bodies);
    }
}

impl<'a> ErrorSite<'a> {
    /// Whether an expression can have this Luau type.
    fn may_be(&self, expr: &Expr, what: &str) -> bool {
        let kind = self.kind(expr);
        match what {
            "nil" => may_be_nil(kind, expr.bare()),
            "number" => matches!(kind, ValueKind::Number(_) | ValueKind::Unknown),
            "string" => matches!(kind, ValueKind::Text(_) | ValueKind::Unknown),
            "boolean" => matches!(kind, ValueKind::Boolean | ValueKind::Unknown),
            "table" => matches!(
                kind,
                ValueKind::Table(_)
                    | ValueKind::Object(_)
                    | ValueKind::List(_)
                    | ValueKind::Unknown
                    | ValueKind::Namespace(_)
                    | ValueKind::Module(_)
                    | ValueKind::Params(_)
            ),
            "function" => matches!(
                kind,
                ValueKind::Function(_) | ValueKind::Native(_) | ValueKind::Unknown
            ),
            _ => matches!(kind, ValueKind::Unknown | ValueKind::Object(_)),
        }
    }

    fn kind(&self, expr: &Expr) -> ValueKind<'a> {
        // Look up the same expression in the error site, where it has the lifetime of the tree.
        let own = self.exprs.iter().find_map(|one| {
            let mut found = None;
            each_in_expr(one, &mut |part| {
                if std::ptr::eq(part, expr) {
                    found = Some(part);
                }
            });
            found
        });
        own.map_or(ValueKind::Unknown, |expr| self.kinds.kind_of(expr))
    }

    fn is(&self, expr: &Expr, what: &str) -> String {
        match expr.bare().kind {
            ExprKind::Nil => "this is nil".to_owned(),
            _ => format!("`{}` is {} here", self.text(expr), a(what)),
        }
    }

    /// Says why the value may be nil, and what to do.
    fn why(&self, expr: &Expr, what: &str) -> String {
        if what != "nil" && what != "nothing" {
            return match what {
                "string" => format!(
                    "tonumber({}) converts a string to a number",
                    self.text(expr)
                ),
                _ => String::new(),
            };
        }
        let name = self.text(expr);
        match &expr.bare().kind {
            ExprKind::Local(id) => match self.begins.get(id) {
                Some((value, number)) => {
                    let reason = self.reason(value, *number);
                    format!("{reason}test it first: if {name} then ... end")
                }
                None if self.kinds.tree.locals[id.0].bound => {
                    format!(
                        "it is a parameter of the function; test it first: if {name} then ... end"
                    )
                }
                None => format!("{name} has no value yet"),
            },
            ExprKind::Nil => String::new(),
            ExprKind::Call(..) | ExprKind::Method(..) | ExprKind::Item(..) => {
                let reason = self.reason(expr, 0);
                format!(
                    "{reason}put it in a variable and test it first: local it = {name}, then if it then ... end"
                )
            }
            ExprKind::Field(object, field, _) => match self.kind(object) {
                ValueKind::Object(_) => format!("test it first: if {name} then ... end"),
                _ => format!(
                    "{field} of {} has no value yet; check the spelling",
                    self.text(object)
                ),
            },
            _ => format!("test it first: if {name} then ... end"),
        }
    }

    /// Says why the result of a call, or an item of a list, may be nil; empty if unknown.
    fn reason(&self, value: &Expr, number: usize) -> String {
        match &value.bare().kind {
            ExprKind::Item(list, _) => match self.kind_anywhere(list) {
                ValueKind::List(_) => format!("{} found none; ", self.called(list)),
                _ => String::new(),
            },
            ExprKind::Call(..) | ExprKind::Method(..) => {
                let Some(function) = self.native(value) else {
                    return String::new();
                };
                match function.returns.get(number) {
                    Some(result)
                        if result.requirement != Requirement::Required
                            && !result.doc.is_empty() =>
                    {
                        format!("{} returns {}; ", function.path, result.doc)
                    }
                    None if function.returns.is_empty() => {
                        format!("{} returns nothing; ", function.path)
                    }
                    _ => String::new(),
                }
            }
            _ => String::new(),
        }
    }

    fn called(&self, list: &Expr) -> String {
        let list = match &list.bare().kind {
            ExprKind::Local(id) => self.begins.get(id).map_or(list, |(value, _)| value),
            _ => list,
        };
        self.native(list)
            .map_or_else(|| "it".to_owned(), |function| function.key().to_owned())
    }

    fn native(&self, call: &Expr) -> Option<&'static api::Function> {
        match &call.bare().kind {
            ExprKind::Call(callee, _) => match self.kind_anywhere(callee) {
                ValueKind::Native(function) => Some(function),
                _ => None,
            },
            ExprKind::Method(object, name, ..) => {
                self.kinds.method(self.kind_anywhere(object), name)
            }
            _ => None,
        }
    }

    /// Same as `kind`, but also for expressions on other lines.
    fn kind_anywhere(&self, expr: &Expr) -> ValueKind<'a> {
        let mut found = None;
        self.kinds.tree.each_expr(&mut |part| {
            if std::ptr::eq(part, expr) {
                found = Some(part);
            }
        });
        found.map_or(ValueKind::Unknown, |expr| self.kinds.kind_of(expr))
    }
}

/// Whether an expression of this kind may be nil, as far as the source tells.
fn may_be_nil(kind: ValueKind<'_>, expr: &Expr) -> bool {
    match (kind, &expr.kind) {
        (ValueKind::Nothing, _) => true,
        (ValueKind::Unknown, _) => !matches!(expr.kind, ExprKind::Function(_) | ExprKind::Table(_)),
        (
            ValueKind::Namespace(_)
            | ValueKind::Module(_)
            | ValueKind::Params(_)
            | ValueKind::Native(_)
            | ValueKind::Function(_)
            | ValueKind::Table(_),
            _,
        ) => false,
        (
            _,
            ExprKind::Number(_) | ExprKind::Text(_) | ExprKind::Boolean(_) | ExprKind::Pieces(_),
        ) => false,
        (_, ExprKind::Binary(operator, ..)) => matches!(operator.as_str(), "and" | "or"),
        (
            ValueKind::Object(_)
            | ValueKind::List(_)
            | ValueKind::Number(_)
            | ValueKind::Text(_)
            | ValueKind::Boolean,
            _,
        ) => true,
    }
}

/// A Luau type with its article.
fn a(what: &str) -> String {
    match what {
        "nil" | "nothing" | "no value" => "nil".to_owned(),
        "string" => "a string".to_owned(),
        "boolean" => "true or false".to_owned(),
        other => format!("a {other}"),
    }
}

#[cfg(test)]
mod tests {
    use super::explain;
    use crate::script::tests::failure_with;

    /// The message with which a broken script fails on a robot that sees nothing.
    fn failure_of(source: &str) -> String {
        failure_with(source, explain)
    }

    #[test]
    fn a_failure_shows_the_line_with_a_caret_below_what_was_nil() {
        let message = failure_of("local battery\nprint('level', battery.percent)\nbattery = 1");
        let expected = "test.lua:2: `battery` is nil here, so `battery.percent` cannot be read\n\
                        2 | print('level', battery.percent)\n  |                ^^^^^^^\n  = help: ";
        assert!(message.starts_with(expected), "{message}");
        let message = failure_of("local b = robot.wait_for('docked', 0.1)\nprint(b.x)");
        assert!(
            message
                .contains("robot.wait_for returns nil after a time-out; test it first: if b then"),
            "{message}"
        );
        let message =
            failure_of("local blobs = robot.wait_frame(5):find_blobs('red')\nprint(blobs[1].cx)");
        assert!(message.contains("find_blobs found none"), "{message}");
    }

    #[test]
    fn errors_of_the_vm_are_explained_in_plain_words() {
        for (source, words) in [
            (
                "local f\nf()",
                "test.lua:2: `f` is nil here, so it cannot be called\n2 | f()\n  | ^\n  = help: there is no function of that name here",
            ),
            (
                "print(robot.battery().percent)",
                "test.lua:1: `robot.battery()` is nil here, so `robot.battery().percent` cannot be read",
            ),
            (
                "print(1 + nil)",
                "test.lua:1: this is nil, so it cannot be used in arithmetic",
            ),
            (
                "print(1 < nil)",
                "test.lua:1: this is nil, so it cannot be compared with < or >",
            ),
            (
                "table.sort({1, 'a'})",
                "test.lua:1: only numbers can be compared with numbers",
            ),
            (
                "print('a' .. {})",
                "test.lua:1: `{}` is a table here, so it cannot be joined to a string",
            ),
        ] {
            let text = failure_of(source);
            assert!(text.contains(words), "{source}: {text:?} lacks {words:?}");
        }
    }
}
