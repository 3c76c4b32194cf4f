//! Explains a failed run in plain words. The VM reports the line and the failed operation; the
//! syntax tree shows the expressions on that line, and why one of them may be nil.

use std::collections::BTreeMap;

use super::diagnostic::{Diagnostic, SourceText};
use super::kinds::{Kinds, ValueKind};
use super::lexer::Span;
use super::tree::{Expr, ExprKind, LocalId, Node, Statement, StatementKind, Tree, each_node};
use super::{CheckContext, parser, passing, syntax, walk};
use crate::api::{self, Function, Value};
use crate::script::compile_error;

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
    let source = SourceText {
        file: chunk,
        text: source,
    };
    let tree = parser::parse(source.text).ok();
    if tree.is_none() && compile_error(source.text, chunk).is_some() {
        return Some(syntax::diagnostic(source, text));
    }
    let explained = tree.as_ref().and_then(|tree| {
        let context = CheckContext::defined();
        ErrorSite::new(tree, source, number, &context).explanation(words)
    });
    let explained = explained.or_else(|| general(words, source, whole));
    let line = whole.of(source.text);
    let raised = ["error(", "assert("].iter().any(|call| line.contains(call));
    match explained {
        // An error that the script raised itself needs no explanation.
        None if raised => None,
        None => Some(source.error(whole, words)),
        Some(diagnostic) if diagnostic.line as usize == number => Some(diagnostic),
        // The caret must be on the line that the VM reports.
        Some(Diagnostic { message, help, .. }) => Some(Diagnostic {
            help,
            ..source.error(whole, message)
        }),
    }
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
fn general(words: &str, source: SourceText<'_>, at: Span) -> Option<Diagnostic> {
    if words.contains("attempt to yield across") {
        let help = "a function for table.sort or gsub, or a metamethod, cannot wait";
        return Some(source.error(at, words).help(help));
    }
    let unknown = words.strip_prefix("unknown name '");
    if let Some(name) = unknown.and_then(|rest| rest.strip_suffix('\'')) {
        let behind = at.of(source.text).rsplit_once(name);
        let text = behind.and_then(|(_, behind)| walk::text_without_quotes(name, behind));
        let help = walk::meant(name).or(text).unwrap_or_default();
        return Some(source.error(at, words).help(help));
    }
    let found = GENERAL.iter().find(|(part, ..)| words.contains(part));
    found.map(|(_, message, help)| source.error(at, *message).help(*help))
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
    source: SourceText<'a>,
    exprs: Vec<&'a Expr>,
    statements: Vec<&'a Statement>,
    kinds: Kinds<'a>,
    /// The initial values of local variables: the expression, and the index of its result.
    begins: BTreeMap<LocalId, (&'a Expr, usize)>,
}

impl<'a> ErrorSite<'a> {
    fn new(
        tree: &'a Tree,
        source: SourceText<'a>,
        line: usize,
        context: &'a CheckContext,
    ) -> ErrorSite<'a> {
        let (_, kinds) = walk::walked(tree, source, context);
        let mut site = ErrorSite {
            source,
            exprs: Vec::new(),
            statements: Vec::new(),
            kinds,
            begins: BTreeMap::new(),
        };
        let starts: Vec<usize> = source.text.match_indices('\n').map(|(at, _)| at).collect();
        let line_of = |at: usize| starts.partition_point(|start| *start < at) + 1;
        let on_line =
            |span: Span| line_of(span.start) <= line && line <= line_of(span.end.saturating_sub(1));
        each_node(&tree.block, &mut |node| match node {
            Node::Expr(expr) if on_line(expr.span) => site.exprs.push(expr),
            Node::Expr(_) => {}
            Node::Statement(statement) => {
                if on_line(statement.span) {
                    site.statements.push(statement);
                }
                if let StatementKind::Local(ids, values) = &statement.kind {
                    site.note_begin(ids, values);
                }
            }
        });
        site
    }

    fn note_begin(&mut self, ids: &'a [LocalId], values: &'a [Expr]) {
        let last = values.len().saturating_sub(1);
        for (at, id) in ids.iter().enumerate() {
            if let Some(value) = values.get(at.min(last)) {
                self.begins.insert(*id, (value, at.saturating_sub(last)));
            }
        }
    }

    fn error(&self, span: Span, message: impl Into<String>) -> Diagnostic {
        self.source.error(span, message)
    }

    fn text(&self, expr: &Expr) -> String {
        let text = expr.span.of(self.source.text);
        let short = crate::script::printable(text.lines().next().unwrap_or_default(), 60);
        short.trim().to_owned()
    }

    /// The first of the line's expressions for which this returns something.
    fn expr<T>(&self, of: impl Fn(&'a Expr) -> Option<T>) -> Option<T> {
        self.exprs.iter().copied().find_map(of)
    }

    fn statement<T>(&self, of: impl Fn(&'a StatementKind) -> Option<T>) -> Option<T> {
        let mut statements = self.statements.iter();
        statements.find_map(|statement| of(&statement.kind))
    }

    fn explanation(&self, words: &str) -> Option<Diagnostic> {
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
        if words == "table" {
            let (call, _) = self.call_of("error")?;
            let error = self.error(call.span, "the error is a table, which says nothing here");
            return Some(error.help("write error(\"what has happened\")"));
        }
        self.api(words)
    }
}

impl<'a> ErrorSite<'a> {
    /// Whether an expression can have this Luau type.
    fn may_be(&self, expr: &'a Expr, what: &str) -> bool {
        let kind = self.kinds.kind_of(expr);
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

    fn is(&self, expr: &Expr, what: &str) -> String {
        match expr.bare().kind {
            ExprKind::Nil => "this is nil".to_owned(),
            _ => format!("`{}` is {} here", self.text(expr), a(what)),
        }
    }

    /// Says why the value may be nil, and what to do.
    fn why(&self, expr: &'a Expr, what: &str) -> String {
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
            ExprKind::Field(object, field, _) => match self.kinds.kind_of(object) {
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
    fn reason(&self, value: &'a Expr, number: usize) -> String {
        match &value.bare().kind {
            ExprKind::Item(list, _) => match self.kinds.kind_of(list) {
                ValueKind::List(_) => format!("{} found none; ", self.called(list)),
                _ => String::new(),
            },
            ExprKind::Call(..) | ExprKind::Method(..) => {
                let Some(function) = self.native(value) else {
                    return String::new();
                };
                match function.returns.get(number) {
                    Some(result) if !result.is_required() && !result.doc.is_empty() => {
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

    fn called(&self, list: &'a Expr) -> String {
        let list = match &list.bare().kind {
            ExprKind::Local(id) => self.begins.get(id).map_or(list, |(value, _)| value),
            _ => list,
        };
        self.native(list)
            .map_or_else(|| "it".to_owned(), |function| function.key().to_owned())
    }

    fn native(&self, call: &'a Expr) -> Option<&'static Function> {
        match self.kinds.callee(call.bare()) {
            ValueKind::Native(function) => Some(function),
            _ => None,
        }
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
        _ => true,
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

impl<'a> ErrorSite<'a> {
    fn index(&self, what: &str, key: &str) -> Option<Diagnostic> {
        let read = |expr: &&'a Expr| match &expr.kind {
            ExprKind::Field(object, name, _) | ExprKind::Method(object, name, ..)
                if name == key =>
            {
                Some(&**object)
            }
            ExprKind::Item(object, _) if matches!(key, "number" | "string" | "nil" | "boolean") => {
                Some(&**object)
            }
            ExprKind::Item(object, index) => match self.kinds.kind_of(index) {
                ValueKind::Text(Some(text)) if text != key => None,
                _ => Some(&**object),
            },
            _ => None,
        };
        let mut found = self
            .exprs
            .iter()
            .filter_map(|expr| read(expr).map(|object| (*expr, object)));
        let (whole, object) = found.find(|(_, object)| self.may_be(object, what))?;
        let name = self.text(object);
        let message = match whole.kind {
            ExprKind::Item(..) => {
                format!("{}, so nothing can be read from it", self.is(object, what))
            }
            ExprKind::Method(..) => format!(
                "{}, so `{name}:{key}()` cannot be called",
                self.is(object, what)
            ),
            _ => format!(
                "{}, so `{name}.{key}` cannot be read",
                self.is(object, what)
            ),
        };
        let help = self.why(object, what);
        Some(self.error(object.span, message).help(help))
    }

    fn missing_method(&self, name: &str) -> Option<Diagnostic> {
        self.expr(|expr| match &expr.kind {
            ExprKind::Method(object, method, at, _) if method == name => {
                let message = format!("`{}` has no function `{name}`", self.text(object));
                Some(self.error(*at, message).help("check its spelling"))
            }
            _ => None,
        })
    }

    fn call(&self, what: &str) -> Option<Diagnostic> {
        let callee = self.expr(|expr| match &expr.kind {
            ExprKind::Call(callee, _) if self.may_be(callee, what) => Some(&**callee),
            _ => None,
        })?;
        let help = match (&callee.kind, what) {
            (ExprKind::Field(_, name, _), "nil") => {
                format!("there is no function called `{name}` there; check its spelling")
            }
            (_, "nil") => {
                "there is no function of that name here; check its spelling, and that it is \
                           defined above this line"
                    .to_owned()
            }
            _ => "only functions can be called".to_owned(),
        };
        let message = format!("{}, so it cannot be called", self.is(callee, what));
        Some(self.error(callee.span, message).help(help))
    }

    fn arithmetic(&self, operation: &str, types: &str) -> Option<Diagnostic> {
        let operator = match operation {
            "add" => "+",
            "sub" | "unm" => "-",
            "mul" => "*",
            "div" => "/",
            "idiv" => "//",
            "mod" => "%",
            "pow" => "^",
            _ => return None,
        };
        let (left, right) = types.split_once(" and ").unwrap_or((types, types));
        let (side, what) = self.sides(operator, left, right, |what| what != "number")?;
        let explanation = self.operand(side, what, "so it cannot be used in arithmetic");
        if operator == "+" && what == "string" {
            return Some(explanation.help("to join strings, write .. instead of +"));
        }
        Some(explanation)
    }

    fn compare(&self, words: &str) -> Option<Diagnostic> {
        let mut parts = words.split(' ');
        let left = parts.next()?;
        let operator = parts.next()?;
        let right = parts.next()?;
        let turned = if operator == "<" { ">" } else { ">=" };
        let other = if left == "number" || left == "string" {
            right
        } else {
            left
        };
        let wrong = |what: &str| what == other;
        let found = self
            .sides(operator, left, right, wrong)
            .or_else(|| self.sides(turned, right, left, wrong));
        let (side, what) = found?;
        Some(self.operand(side, what, "so it cannot be compared with < or >"))
    }

    fn operand(&self, side: &'a Expr, what: &str, so: &str) -> Diagnostic {
        self.error(side.span, format!("{}, {so}", self.is(side, what)))
            .help(self.why(side, what))
    }

    /// Finds an operation on this line and returns its operand of the wrong type.
    fn sides<'b>(
        &self,
        operator: &str,
        left: &'b str,
        right: &'b str,
        wrong: impl Fn(&str) -> bool,
    ) -> Option<(&'a Expr, &'b str)> {
        let of_exprs = self.exprs.iter().filter_map(|expr| match &expr.kind {
            ExprKind::Binary(one, a, b) if one == operator => Some((&**a, &**b)),
            ExprKind::Unary(one, a) if one == operator => Some((&**a, &**a)),
            _ => None,
        });
        let of_statements = self
            .statements
            .iter()
            .filter_map(|statement| match &statement.kind {
                StatementKind::Compound(a, one, b) if one == operator => Some((a, b)),
                _ => None,
            });
        let mut pairs = of_exprs.chain(of_statements);
        pairs.find_map(|(a, b)| {
            if wrong(left) && self.may_be(a, left) && (wrong(right) || self.may_be(b, right)) {
                return Some((a, left));
            }
            (wrong(right) && self.may_be(b, right) && self.may_be(a, left)).then_some((b, right))
        })
    }

    /// The parts of the line's `..` that may be what the message says.
    fn joined(&self, what: &str) -> Vec<&'a Expr> {
        let mut leaves = Vec::new();
        for expr in &self.exprs {
            if let ExprKind::Binary(operator, a, b) = &expr.kind
                && operator == ".."
            {
                let ends = [&**a, &**b].into_iter();
                leaves.extend(ends.filter(
                    |one| !matches!(&one.kind, ExprKind::Binary(operator, ..) if operator == ".."),
                ));
            }
        }
        leaves.retain(|leaf| {
            self.may_be(leaf, what)
                && !matches!(
                    self.kinds.kind_of(leaf),
                    ValueKind::Text(_) | ValueKind::Number(_)
                )
        });
        leaves.sort_by_key(|leaf| leaf.span.start);
        leaves
    }

    fn join(&self, left: &str, right: &str) -> Option<Diagnostic> {
        let joins = |what: &str| matches!(what, "string" | "number");
        let what = if joins(left) { right } else { left };
        let leaves = self.joined(what);
        let statement = self.statement(|kind| match kind {
            StatementKind::Compound(a, operator, b) if operator == ".." => {
                Some(if joins(left) { b } else { a })
            }
            _ => None,
        });
        let side = leaves.first().copied().or(statement)?;
        if leaves.len() > 1 && what == "nil" {
            let names: Vec<_> = leaves
                .iter()
                .map(|leaf| format!("`{}`", self.text(leaf)))
                .collect();
            let message = format!(
                "one of {} is nil, so it cannot be joined to a string",
                names.join(", ")
            );
            let help = "tostring(value) converts any value to a string";
            return Some(self.error(side.span, message).help(help));
        }
        let explanation = self.operand(side, what, "so it cannot be joined to a string");
        if what == "nil" {
            return Some(explanation);
        }
        Some(explanation.help(format!(
            "tostring({}) converts it to a string",
            self.text(side)
        )))
    }

    fn length(&self, what: &str) -> Option<Diagnostic> {
        let side = self.expr(|expr| match &expr.kind {
            ExprKind::Unary(operator, operand) if operator == "#" && self.may_be(operand, what) => {
                Some(&**operand)
            }
            _ => None,
        })?;
        Some(self.operand(side, what, "so it has no length"))
    }

    fn iterate(&self, what: &str) -> Option<Diagnostic> {
        let list = self.statement(|kind| match kind {
            StatementKind::Each(_, values, _) => values.first(),
            _ => None,
        })?;
        let explanation = self.operand(list, what, "so a loop cannot go through it");
        if what != "number" {
            return Some(explanation);
        }
        Some(explanation.help(format!("to count, write for i = 1, {} do", self.text(list))))
    }

    /// `initial value must be a number`, in the VM's words.
    fn count(&self, words: &str) -> Option<Diagnostic> {
        let values = self.statement(|kind| match kind {
            StatementKind::Count(_, values, _) => Some(values),
            _ => None,
        })?;
        let (at, which) = match words {
            words if words.starts_with("initial") => (0, "begins"),
            words if words.starts_with("limit") => (1, "ends"),
            _ => (2, "steps"),
        };
        let value = values.get(at)?;
        let what = words
            .split("got ")
            .nth(1)
            .unwrap_or("nil")
            .trim_end_matches(')');
        let is = self.is(value, what);
        let message = format!("a `for` {which} with a number, but {is}");
        Some(self.error(value.span, message).help(self.why(value, what)))
    }

    /// `invalid argument #1 to 'floor' (number expected, got nil)`.
    fn library_argument(&self, words: &str) -> Option<Diagnostic> {
        let (_, rest) = words.split_once('#')?;
        let (number, rest) = rest.split_once(" to '")?;
        let (name, rest) = rest.split_once('\'')?;
        let detail = rest.trim().trim_start_matches('(').trim_end_matches(')');
        let (whole, arguments) = self.call_of(name)?;
        let (callee, is_method) = match &whole.kind {
            ExprKind::Method(_, _, at, _) => (*at, true),
            ExprKind::Call(callee, _) => (callee.span, false),
            _ => return None,
        };
        let number: usize = number.parse().ok()?;
        let number = number - usize::from(is_method && number > 1);
        let (wanted, got) = detail.split_once(" expected").unwrap_or((detail, ""));
        let got = got.split("got ").nth(1).unwrap_or("nothing");
        let path = callee.of(self.source.text);
        if detail.starts_with("max must be") {
            let order = "the lower limit comes first, and must not be above the upper one";
            return Some(self.error(callee, format!("{path}: {order}")));
        }
        let argument = arguments.get(number.saturating_sub(1));
        let message = match argument {
            Some(argument) => format!(
                "{path}: `{}` must be a {wanted}, but it is {}",
                self.text(argument),
                a(got)
            ),
            None => format!("{path}: argument {number} is missing; it must be a {wanted}"),
        };
        let help = argument.map_or_else(String::new, |argument| self.why(argument, got));
        let at = argument.map_or(callee, |argument| argument.span);
        Some(self.error(at, message).help(help))
    }

    /// The first call on the line of a function or method whose name ends so, and its arguments.
    fn call_of(&self, name: &str) -> Option<(&'a Expr, &'a [Expr])> {
        self.expr(|expr| match &expr.kind {
            ExprKind::Call(callee, arguments) => {
                let path = callee.span.of(self.source.text);
                if path.rsplit(['.', ':']).next() == Some(name) {
                    Some((expr, arguments.as_slice()))
                } else {
                    None
                }
            }
            ExprKind::Method(_, method, _, arguments) if method == name => {
                Some((expr, arguments.as_slice()))
            }
            _ => None,
        })
    }

    /// `robot.move: left must be ...`: the caret goes below the argument.
    fn api(&self, words: &str) -> Option<Diagnostic> {
        let (path, rest) = words.split_once(": ")?;
        let function = api::function(path)?;
        let key = function.key();
        let (whole, arguments) = self.call_of(key)?;
        let named = function.parameters.iter().position(|parameter| {
            let what = format!("{} ", parameter.label());
            let rest = rest.strip_prefix("unknown ").unwrap_or(rest);
            rest.starts_with(&what)
        });
        let counted = function_argument(function, rest);
        let argument = named.or(counted).and_then(|at| arguments.get(at));
        let kind = named.and_then(|at| function.parameters.get(at));
        let kind = kind.map(|parameter| parameter.kind);
        let wants_function = kind.is_some_and(|kind| kind.is_function());
        let wants_result = counted.is_some() || kind.is_some_and(|kind| kind.wants_result());
        let passed = match argument {
            Some(argument) if wants_function || counted.is_some() => {
                passing::help(self.source.text, argument, Some(whole.span), wants_result)
            }
            _ => None,
        };
        let help = passed.unwrap_or_else(|| match argument {
            Some(argument) if rest.ends_with("got nothing") || rest.contains("is missing") => {
                self.why(argument, "nil")
            }
            _ if rest.contains("is missing") => format!("it is called as {}", function.call()),
            _ => String::new(),
        });
        let at = argument.map_or(whole.span, |argument| argument.span);
        Some(self.error(at, words).help(help))
    }
}

/// Returns the index of the argument that is no function, if the error names it by its number or as
/// a node of a behaviour tree.
fn function_argument(function: &Function, words: &str) -> Option<usize> {
    let mut parameters = function.parameters.iter();
    let is_function = |parameter: &Value| parameter.kind.is_function();
    if words.starts_with("the condition: a node must be a function") {
        return parameters.position(is_function);
    }
    if words.starts_with("a node must be a function") {
        return parameters.rposition(is_function);
    }
    let (number, _) = words
        .strip_prefix("argument ")?
        .split_once(" must be a function")?;
    number.parse::<usize>().ok()?.checked_sub(1)
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
