//! One explanation for each kind of failure that the VM reports.

use super::super::kinds::ValueKind;
use super::super::passing;
use super::super::tree::{Expr, ExprKind, StatementKind};
use super::a;
use super::{ErrorSite, Explanation};
use crate::api::{self, Function, Value};

impl<'a> ErrorSite<'a> {
    pub(super) fn index(&self, what: &str, key: &str) -> Option<Explanation> {
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
        Some(Explanation {
            at: object.span,
            message,
            help,
        })
    }

    pub(super) fn missing_method(&self, name: &str) -> Option<Explanation> {
        let mut exprs = self.exprs.iter();
        exprs.find_map(|expr| match &expr.kind {
            ExprKind::Method(object, method, at, _) if method == name => Some(Explanation {
                at: *at,
                message: format!("`{}` has no function `{name}`", self.text(object)),
                help: "check its spelling".to_owned(),
            }),
            _ => None,
        })
    }

    pub(super) fn call(&self, what: &str) -> Option<Explanation> {
        let mut exprs = self.exprs.iter();
        let callee = exprs.find_map(|expr| match &expr.kind {
            ExprKind::Call(callee, _) => self.may_be(callee, what).then_some(&**callee),
            _ => None,
        })?;
        let help = match (&callee.kind, what) {
            (ExprKind::Field(_, name, _), "nil") => format!("there is no function called `{name}` there; check its spelling"),
            (_, "nil") => "there is no function of that name here; check its spelling, and that it is defined above this line".to_owned(),
            _ => "only functions can be called".to_owned(),
        };
        let message = format!("{}, so it cannot be called", self.is(callee, what));
        Some(Explanation {
            at: callee.span,
            message,
            help,
        })
    }

    pub(super) fn arithmetic(&self, operation: &str, types: &str) -> Option<Explanation> {
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
        let mut explanation = self.operand(side, what, "so it cannot be used in arithmetic");
        if operator == "+" && what == "string" {
            explanation.help = "to join strings, write .. instead of +".to_owned();
        }
        Some(explanation)
    }

    pub(super) fn compare(&self, words: &str) -> Option<Explanation> {
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

    pub(super) fn operand(&self, side: &Expr, what: &str, so: &str) -> Explanation {
        Explanation {
            at: side.span,
            message: format!("{}, {so}", self.is(side, what)),
            help: self.why(side, what),
        }
    }

    /// Finds an operation on this line and returns its operand of the wrong type.
    pub(super) fn sides<'b>(
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

    pub(super) fn join(&self, left: &str, right: &str) -> Option<Explanation> {
        let joins = |what: &str| matches!(what, "string" | "number");
        let what = if joins(left) { right } else { left };
        let leaves = self.joined(what);
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
            return Some(Explanation {
                at: side.span,
                message: format!(
                    "one of {} is nil, so it cannot be joined to a string",
                    names.join(", ")
                ),
                help: "tostring(value) converts any value to a string".to_owned(),
            });
        }
        let mut explanation = self.operand(side, what, "so it cannot be joined to a string");
        if what != "nil" {
            explanation.help = format!("tostring({}) converts it to a string", self.text(side));
        }
        Some(explanation)
    }

    pub(super) fn length(&self, what: &str) -> Option<Explanation> {
        let side = self.exprs.iter().find_map(|expr| match &expr.kind {
            ExprKind::Unary(operator, operand) if operator == "#" && self.may_be(operand, what) => {
                Some(&**operand)
            }
            _ => None,
        })?;
        Some(self.operand(side, what, "so it has no length"))
    }

    pub(super) fn iterate(&self, what: &str) -> Option<Explanation> {
        let list = self
            .statements
            .iter()
            .find_map(|statement| match &statement.kind {
                StatementKind::Each(_, values, _) => values.first(),
                _ => None,
            })?;
        let mut explanation = self.operand(list, what, "so a loop cannot go through it");
        if what == "number" {
            explanation.help = format!("to count, write for i = 1, {} do", self.text(list));
        }
        Some(explanation)
    }

    /// `initial value must be a number`, in the VM's words.
    pub(super) fn count(&self, words: &str) -> Option<Explanation> {
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
        let mut explanation = self.operand(value, what, "");
        explanation.message = format!(
            "a `for` {which} with a number, but {}",
            self.is(value, what)
        );
        Some(explanation)
    }

    /// `invalid argument #1 to 'floor' (number expected, got nil)`.
    pub(super) fn library_argument(&self, words: &str) -> Option<Explanation> {
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
        Some(Explanation {
            at: argument.map_or(callee, |argument| argument.span),
            message,
            help,
        })
    }

    /// `robot.move: left must be ...`: the caret goes below the argument.
    pub(super) fn api(&self, words: &str) -> Option<Explanation> {
        let (path, rest) = words.split_once(": ")?;
        let function = api::function(path)?;
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
                passing::help(self.source, argument, Some(whole.span), wants_result)
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
        Some(Explanation {
            at: argument.map_or(whole.span, |argument| argument.span),
            message: words.to_owned(),
            help,
        })
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
