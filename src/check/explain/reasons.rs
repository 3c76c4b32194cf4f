//! What is known about an expression: its possible types, and why it may be nil.

use super::super::kinds::ValueKind;
use super::super::tree::{Expr, ExprKind, each_in_expr};
use super::ErrorSite;
use crate::api::{self, Requirement};

impl<'a> ErrorSite<'a> {
    /// Whether an expression can have this Luau type.
    pub(super) fn may_be(&self, expr: &Expr, what: &str) -> bool {
        let kind = self.kind(expr);
        match what {
            "nil" => match (kind, &expr.bare().kind) {
                (ValueKind::Nothing, _) => true,
                (ValueKind::Unknown, _) => {
                    !matches!(expr.bare().kind, ExprKind::Function(_) | ExprKind::Table(_))
                }
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
                    ExprKind::Number(_)
                    | ExprKind::Text(_)
                    | ExprKind::Boolean(_)
                    | ExprKind::Pieces(_),
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
            },
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

    pub(super) fn kind(&self, expr: &Expr) -> ValueKind<'a> {
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

    pub(super) fn is(&self, expr: &Expr, what: &str) -> String {
        match expr.bare().kind {
            ExprKind::Nil => "this is nil".to_owned(),
            _ => format!("`{}` is {} here", self.text(expr), a(what)),
        }
    }

    /// Says why the value may be nil, and what to do.
    pub(super) fn why(&self, expr: &Expr, what: &str) -> String {
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
    pub(super) fn reason(&self, value: &Expr, number: usize) -> String {
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

    pub(super) fn called(&self, list: &Expr) -> String {
        let list = match &list.bare().kind {
            ExprKind::Local(id) => self.begins.get(id).map_or(list, |(value, _)| value),
            _ => list,
        };
        self.native(list)
            .map_or_else(|| "it".to_owned(), |function| function.key().to_owned())
    }

    pub(super) fn native(&self, call: &Expr) -> Option<&'static api::Function> {
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
    pub(super) fn kind_anywhere(&self, expr: &Expr) -> ValueKind<'a> {
        let mut found = None;
        self.kinds.tree.each_expr(&mut |part| {
            if std::ptr::eq(part, expr) {
                found = Some(part);
            }
        });
        found.map_or(ValueKind::Unknown, |expr| self.kinds.kind_of(expr))
    }
}

/// A Luau type with its article.
pub(super) fn a(what: &str) -> String {
    match what {
        "nil" | "nothing" | "no value" => "nil".to_owned(),
        "string" => "a string".to_owned(),
        "boolean" => "true or false".to_owned(),
        other => format!("a {other}"),
    }
}
