//! A failed run in words for people: which expression was nil, why it may be, and the line with a
//! caret. The VM tells the line and what it could not do; the tree tells what stands there.

use std::collections::BTreeMap;

use super::finding::{Finding, Severity};
use super::kinds::{Kind, Kinds};
use super::lexer::Span;
use super::tree::{Block, Expr, ExprKind, LocalId, Statement, StatementKind, Tree, each_in_expr};
use super::{Surroundings, parser, walk};
use crate::script::api::definition::{self, Need, Type};

/// What could not be done, and where.
struct Remark {
    at: Span,
    message: String,
    help: String,
}

/// The text of an error, such as `a.lua:3: attempt to index nil with 'cx'`, in words, with the
/// source line; `None` if it is not of this file.
pub(in super::super) fn explain(text: &str, chunk: &str, source: &str) -> Option<String> {
    let rest = text.strip_prefix(chunk)?.strip_prefix(':')?;
    let (line, words) = rest.split_once(": ")?;
    let number: usize = line.parse().ok()?;
    let whole = line_span(source, number)?;
    let tree = parser::parse(source).ok();
    let remark = tree.as_ref().and_then(|tree| {
        let surroundings = Surroundings::defined();
        let scene = Scene::new(tree, source, number, &surroundings);
        scene.remark(words)
    });
    let remark = remark.or_else(|| general(words, whole));
    if remark.is_none()
        && ["error(", "assert("]
            .iter()
            .any(|call| whole.of(source).contains(call))
    {
        // The script's own words need no explanation.
        return None;
    }
    let remark = remark.unwrap_or(Remark {
        at: whole,
        message: words.to_owned(),
        help: String::new(),
    });
    // The caret stands on the line that the VM tells, whatever stands around it.
    let at = match remark.at.start >= whole.start && remark.at.start <= whole.end {
        true => remark.at,
        false => whole,
    };
    let finding = Finding::new((chunk, source), at, Severity::Error, "").help(remark.help);
    Some(format!(
        "{chunk}:{line}: {}\n{}",
        remark.message,
        finding.excerpt()
    ))
}

/// A line without its indentation.
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

/// What needs no tree.
fn general(words: &str, at: Span) -> Option<Remark> {
    let said = |message: &str, help: &str| {
        Some(Remark {
            at,
            message: message.to_owned(),
            help: help.to_owned(),
        })
    };
    if words.contains("stack overflow") {
        return said(
            "a function calls itself again and again, without end",
            "let it stop at some point, or use a loop: while true do ... task.wait(0.1) end",
        );
    }
    if words.contains("attempt to call a") || words.contains("attempt to call missing") {
        return said(
            "what is called here is no function",
            "check the spelling of its name",
        );
    }
    if words.contains("attempt to yield across") {
        return said(
            words,
            "nothing can wait inside a table.sort or gsub function or a metamethod",
        );
    }
    if words.contains("readonly table") {
        return said(
            "this is a readonly table, which cannot be changed",
            "keep your own values in a local variable",
        );
    }
    let kin = [
        (
            "attempt to index",
            "a field is read of what has none, perhaps of nil",
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
            "one of the two values is no text, perhaps nil",
        ),
        (
            "attempt to get length",
            "only lists and texts have a length",
        ),
        (
            "attempt to iterate",
            "what stands behind `in` is no list, perhaps nil",
        ),
        ("invalid 'for'", "a `for` counts with numbers only"),
    ];
    let found = kin.iter().find(|(piece, _)| words.contains(piece));
    found.and_then(|(_, message)| said(message, "print the values to see which it is"))
}

struct Scene<'a> {
    source: &'a str,
    /// All that begins or ends on the line, in the order of the text.
    exprs: Vec<&'a Expr>,
    statements: Vec<&'a Statement>,
    kinds: Kinds<'a>,
    /// What local variables begin as: the value, and which of its results.
    begins: BTreeMap<LocalId, (&'a Expr, usize)>,
}

impl<'a> Scene<'a> {
    fn new(
        tree: &'a Tree,
        source: &'a str,
        line: usize,
        surroundings: &'a Surroundings,
    ) -> Scene<'a> {
        let (_, kinds) = walk::walked(tree, ("", source), surroundings);
        let mut scene = Scene {
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
                scene.statements.push(statement);
            }
            if let StatementKind::Local(ids, values) = &statement.kind {
                for (at, id) in ids.iter().enumerate() {
                    let last = values.len().saturating_sub(1);
                    if let Some(value) = values.get(at.min(last)) {
                        scene.begins.insert(*id, (value, at.saturating_sub(last)));
                    }
                }
            }
        });
        tree.each_expr(&mut |expr| {
            if on_line(expr.span) {
                scene.exprs.push(expr);
            }
        });
        scene
    }

    fn text(&self, expr: &Expr) -> String {
        let text = expr.span.of(self.source);
        let short = super::super::failure::printable(text.lines().next().unwrap_or_default(), 60);
        short.trim().to_owned()
    }

    fn remark(&self, words: &str) -> Option<Remark> {
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

    fn index(&self, what: &str, key: &str) -> Option<Remark> {
        let read = |expr: &&'a Expr| match &expr.kind {
            ExprKind::Field(object, name, _) | ExprKind::Method(object, name, ..)
                if name == key =>
            {
                Some(&**object)
            }
            ExprKind::Item(object, _) if matches!(key, "number" | "string" | "nil" | "boolean") => {
                Some(&**object)
            }
            ExprKind::Item(object, index) => match self.kinds.of(index) {
                Kind::Text(Some(text)) if text != key => None,
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
                format!("{}, so nothing can be read of it", self.is(object, what))
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
        Some(Remark {
            at: object.span,
            message,
            help,
        })
    }

    fn missing_method(&self, name: &str) -> Option<Remark> {
        let mut exprs = self.exprs.iter();
        exprs.find_map(|expr| match &expr.kind {
            ExprKind::Method(object, method, at, _) if method == name => Some(Remark {
                at: *at,
                message: format!("`{}` has no function `{name}`", self.text(object)),
                help: "check its spelling".to_owned(),
            }),
            _ => None,
        })
    }

    fn call(&self, what: &str) -> Option<Remark> {
        let mut exprs = self.exprs.iter();
        let callee = exprs.find_map(|expr| match &expr.kind {
            ExprKind::Call(callee, _) => self.may_be(callee, what).then_some(&**callee),
            _ => None,
        })?;
        let help = match (&callee.kind, what) {
            (ExprKind::Field(_, name, _), "nil") => format!("there is no function of the name `{name}` there; check its spelling"),
            (_, "nil") => "there is no function of that name here; check its spelling, and that it is made above this line".to_owned(),
            _ => "only functions can be called".to_owned(),
        };
        let message = format!("{}, so it cannot be called", self.is(callee, what));
        Some(Remark {
            at: callee.span,
            message,
            help,
        })
    }

    fn arithmetic(&self, operation: &str, types: &str) -> Option<Remark> {
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
        Some(self.operand(side, what, "so it cannot be counted with"))
    }

    fn compare(&self, words: &str) -> Option<Remark> {
        let mut parts = words.split(' ');
        let (left, operator, right) = (parts.next()?, parts.next()?, parts.next()?);
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

    fn operand(&self, side: &Expr, what: &str, so: &str) -> Remark {
        Remark {
            at: side.span,
            message: format!("{}, {so}", self.is(side, what)),
            help: self.why(side, what),
        }
    }

    /// The side of an operation on this line that is not what it should be.
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

    fn join(&self, left: &str, right: &str) -> Option<Remark> {
        let joins = |what: &str| matches!(what, "string" | "number");
        let what = if joins(left) { right } else { left };
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
                && !matches!(self.kinds.of(leaf), Kind::Text(_) | Kind::Number(_))
        });
        leaves.sort_by_key(|leaf| leaf.span.start);
        let statement = self
            .statements
            .iter()
            .find_map(|statement| match &statement.kind {
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
            return Some(Remark {
                at: side.span,
                message: format!(
                    "one of {} is nil, so it cannot be joined to a text",
                    names.join(", ")
                ),
                help: "tostring(value) makes a text of any value".to_owned(),
            });
        }
        let mut remark = self.operand(side, what, "so it cannot be joined to a text");
        if what != "nil" {
            remark.help = format!("tostring({}) makes a text of it", self.text(side));
        }
        Some(remark)
    }

    fn length(&self, what: &str) -> Option<Remark> {
        let side = self.exprs.iter().find_map(|expr| match &expr.kind {
            ExprKind::Unary(operator, operand) if operator == "#" && self.may_be(operand, what) => {
                Some(&**operand)
            }
            _ => None,
        })?;
        Some(self.operand(side, what, "so it has no length"))
    }

    fn iterate(&self, what: &str) -> Option<Remark> {
        let list = self
            .statements
            .iter()
            .find_map(|statement| match &statement.kind {
                StatementKind::Each(_, values, _) => values.first(),
                _ => None,
            })?;
        let mut remark = self.operand(list, what, "so nothing can be gone through");
        if what == "number" {
            remark.help = format!("to count, write for i = 1, {} do", self.text(list));
        }
        Some(remark)
    }

    /// `initial value must be a number`, in the VM's words.
    fn count(&self, words: &str) -> Option<Remark> {
        let values = self
            .statements
            .iter()
            .find_map(|statement| match &statement.kind {
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
        let mut remark = self.operand(value, what, "");
        remark.message = format!(
            "a `for` {which} with a number, but {}",
            self.is(value, what)
        );
        Some(remark)
    }

    /// `invalid argument #1 to 'floor' (number expected, got nil)`.
    fn library_argument(&self, words: &str) -> Option<Remark> {
        let (_, rest) = words.split_once('#')?;
        let (number, rest) = rest.split_once(" to '")?;
        let (name, rest) = rest.split_once('\'')?;
        let detail = rest.trim().trim_start_matches('(').trim_end_matches(')');
        let (callee, arguments, method) = self.exprs.iter().find_map(|expr| match &expr.kind {
            ExprKind::Call(callee, arguments) => {
                let ends = callee.span.of(self.source).rsplit(['.', ':']).next() == Some(name);
                ends.then_some((callee.span, arguments, false))
            }
            ExprKind::Method(_, method, at, arguments) if method == name => {
                Some((*at, arguments, true))
            }
            _ => None,
        })?;
        let number: usize = number.parse().ok()?;
        let number = number - usize::from(method && number > 1);
        let (wanted, got) = detail.split_once(" expected").unwrap_or((detail, ""));
        let got = got.split("got ").nth(1).unwrap_or("nothing");
        let path = callee.of(self.source);
        let argument = arguments.get(number.saturating_sub(1));
        let message = match argument {
            Some(argument) => format!(
                "{path}: `{}` must be a {wanted}, but it is {}",
                self.text(argument),
                a(got)
            ),
            None => format!("{path}: argument {number} is missing; it must be a {wanted}"),
        };
        let help = argument
            .map(|argument| self.why(argument, got))
            .unwrap_or_default();
        Some(Remark {
            at: argument.map_or(callee, |argument| argument.span),
            message,
            help,
        })
    }

    /// `robot.move: left must be ...`: the caret goes below the argument.
    fn api(&self, words: &str) -> Option<Remark> {
        let (path, rest) = words.split_once(": ")?;
        let function = definition::function(path)?;
        let key = function.key();
        let (whole, arguments) = self.exprs.iter().find_map(|expr| match &expr.kind {
            ExprKind::Call(callee, arguments) => {
                let ends = callee.span.of(self.source).rsplit(['.', ':']).next() == Some(key);
                ends.then_some((*expr, arguments))
            }
            ExprKind::Method(_, name, _, arguments) if name == key => Some((*expr, arguments)),
            _ => None,
        })?;
        let named = function.parameters.iter().position(|parameter| {
            let what = match parameter.kind {
                Type::Choice(choice) => format!("unknown {} ", choice.what),
                Type::Function(_) | Type::Handler => "the function ".to_owned(),
                _ => format!("{} ", parameter.name),
            };
            rest.starts_with(&what)
        });
        let argument = named.and_then(|at| arguments.get(at));
        let help = match argument {
            Some(argument) if rest.ends_with("got nothing") || rest.contains("is missing") => {
                self.why(argument, "nil")
            }
            _ if rest.contains("is missing") => format!("it is called as {}", function.call()),
            _ => String::new(),
        };
        Some(Remark {
            at: argument.map_or(whole.span, |argument| argument.span),
            message: words.to_owned(),
            help,
        })
    }

    // What is known of an expression -------------------------------------------------------------

    /// Whether an expression can be of this type of the language.
    fn may_be(&self, expr: &Expr, what: &str) -> bool {
        let kind = self.kind(expr);
        match what {
            "nil" => match (kind, &expr.bare().kind) {
                (Kind::Nothing, _) => true,
                (Kind::Unknown, _) => {
                    !matches!(expr.bare().kind, ExprKind::Function(_) | ExprKind::Table(_))
                }
                (Kind::Namespace(_) | Kind::Native(_) | Kind::Function(_) | Kind::Table(_), _) => {
                    false
                }
                (
                    _,
                    ExprKind::Number(_)
                    | ExprKind::Text(_)
                    | ExprKind::Boolean(_)
                    | ExprKind::Pieces(_),
                ) => false,
                (_, ExprKind::Binary(operator, ..)) => matches!(operator.as_str(), "and" | "or"),
                (
                    Kind::Object(_)
                    | Kind::List(_)
                    | Kind::Number(_)
                    | Kind::Text(_)
                    | Kind::Boolean,
                    _,
                ) => true,
            },
            "number" => matches!(kind, Kind::Number(_) | Kind::Unknown),
            "string" => matches!(kind, Kind::Text(_) | Kind::Unknown),
            "boolean" => matches!(kind, Kind::Boolean | Kind::Unknown),
            "table" => matches!(
                kind,
                Kind::Table(_)
                    | Kind::Object(_)
                    | Kind::List(_)
                    | Kind::Unknown
                    | Kind::Namespace(_)
            ),
            "function" => matches!(kind, Kind::Function(_) | Kind::Native(_) | Kind::Unknown),
            _ => matches!(kind, Kind::Unknown | Kind::Object(_)),
        }
    }

    fn kind(&self, expr: &Expr) -> Kind<'a> {
        // The scene's own expressions live as long as its tree.
        let own = self.exprs.iter().find_map(|one| {
            let mut found = None;
            each_in_expr(one, &mut |part| {
                if std::ptr::eq(part, expr) {
                    found = Some(part);
                }
            });
            found
        });
        own.map_or(Kind::Unknown, |expr| self.kinds.of(expr))
    }

    fn is(&self, expr: &Expr, what: &str) -> String {
        match expr.bare().kind {
            ExprKind::Nil => "there is nil".to_owned(),
            _ => format!("`{}` is {} here", self.text(expr), a(what)),
        }
    }

    /// Why it may be nil, and what to do.
    fn why(&self, expr: &Expr, what: &str) -> String {
        if what != "nil" && what != "nothing" {
            return match what {
                "string" => format!("tonumber({}) makes a number of a text", self.text(expr)),
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
                        "it is what the function is called with; test it first: if {name} then ... end"
                    )
                }
                None => format!("nothing has been put into {name} yet"),
            },
            ExprKind::Nil => String::new(),
            ExprKind::Call(..) | ExprKind::Method(..) | ExprKind::Item(..) => {
                let reason = self.reason(expr, 0);
                format!(
                    "{reason}keep it in a variable and test it first: local it = {name}, then if it then ... end"
                )
            }
            ExprKind::Field(object, field, _) => match self.kind(object) {
                Kind::Object(_) => format!("test it first: if {name} then ... end"),
                _ => format!(
                    "nothing has been put into {field} of {} yet; check the spelling",
                    self.text(object)
                ),
            },
            _ => format!("test it first: if {name} then ... end"),
        }
    }

    /// Why the result of a call, or a thing of a list, may be nil; empty if that is not known.
    fn reason(&self, value: &Expr, number: usize) -> String {
        match &value.bare().kind {
            ExprKind::Item(list, _) => match self.kind_anywhere(list) {
                Kind::List(_) => format!("{} has found none; ", self.called(list)),
                _ => String::new(),
            },
            ExprKind::Call(..) | ExprKind::Method(..) => {
                let Some(function) = self.native(value) else {
                    return String::new();
                };
                match function.returns.get(number) {
                    Some(result) if result.need != Need::Required && !result.doc.is_empty() => {
                        format!("{} gives {}; ", function.path, result.doc)
                    }
                    None if function.returns.is_empty() => {
                        format!("{} gives nothing; ", function.path)
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

    fn native(&self, call: &Expr) -> Option<&'static definition::Function> {
        match &call.bare().kind {
            ExprKind::Call(callee, _) => match self.kind_anywhere(callee) {
                Kind::Native(function) => Some(function),
                _ => None,
            },
            ExprKind::Method(object, name, ..) => {
                self.kinds.method(self.kind_anywhere(object), name)
            }
            _ => None,
        }
    }

    /// Also of an expression of another line.
    fn kind_anywhere(&self, expr: &Expr) -> Kind<'a> {
        let mut found = None;
        self.kinds.tree.each_expr(&mut |part| {
            if std::ptr::eq(part, expr) {
                found = Some(part);
            }
        });
        found.map_or(Kind::Unknown, |expr| self.kinds.of(expr))
    }
}

/// A type of the language with its article.
fn a(what: &str) -> String {
    match what {
        "nil" | "nothing" | "no value" => "nil".to_owned(),
        "string" => "a text".to_owned(),
        "boolean" => "true or false".to_owned(),
        other => format!("a {other}"),
    }
}

/// Every statement, outer ones first, those of functions too.
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

/// The blocks of the functions in an expression, those within them left out.
fn outer_functions<'a>(expr: &'a Expr, bodies: &mut Vec<&'a Block>) {
    if let ExprKind::Function(body) = &expr.kind {
        return bodies.push(&body.block);
    }
    for part in expr.parts() {
        outer_functions(part, bodies);
    }
}
