//! Detects loops that can neither wait nor end.

use super::kinds::{Kinds, ValueKind};
use super::tree::{Block, Expr, ExprKind, Statement, StatementKind, each_in_expr};
use crate::api::Function;

/// Maximum depth to which calls of the script's own functions are followed.
const DEEPEST: u32 = 8;

pub(super) fn always_true(condition: &Expr) -> bool {
    matches!(
        condition.bare().kind,
        ExprKind::Boolean(true) | ExprKind::Number(_) | ExprKind::Text(_)
    )
}

/// Whether anything in a loop's block may wait or leave the loop.
pub(super) fn may_pause(kinds: &Kinds<'_>, block: &Block) -> bool {
    block.iter().any(|statement| pauses(kinds, statement, 0))
}

fn pauses(kinds: &Kinds<'_>, statement: &Statement, depth: u32) -> bool {
    if matches!(
        statement.kind,
        StatementKind::Leave | StatementKind::Return(_)
    ) && depth == 0
    {
        return true;
    }
    if matches!(
        statement.kind,
        StatementKind::Function(..) | StatementKind::LocalFunction(..)
    ) {
        return false;
    }
    let mut found = false;
    for expr in statement.exprs() {
        let mut visit = |part: &Expr| found |= call_pauses(kinds, part, depth);
        each_in_expr_outside_functions(expr, &mut visit);
    }
    let inner = || {
        statement
            .blocks()
            .into_iter()
            .flatten()
            .any(|inner| pauses(kinds, inner, depth))
    };
    found || inner()
}

fn each_in_expr_outside_functions(expr: &Expr, visit: &mut dyn FnMut(&Expr)) {
    if matches!(expr.kind, ExprKind::Function(_)) {
        return;
    }
    visit(expr);
    for part in expr.parts() {
        each_in_expr_outside_functions(part, visit);
    }
}

fn call_pauses(kinds: &Kinds<'_>, expr: &Expr, depth: u32) -> bool {
    match &expr.kind {
        ExprKind::Call(callee, arguments) => match kinds.kind_of(callee) {
            ValueKind::Native(function) => native_pauses(function, arguments),
            ValueKind::Function(Some(body)) if depth < DEEPEST => body
                .block
                .iter()
                .any(|statement| pauses(kinds, statement, depth + 1)),
            _ => !is_quick(kinds, callee),
        },
        ExprKind::Method(object, name, ..) => match kinds.method(kinds.kind_of(object), name) {
            Some(function) => function.waits,
            None => true,
        },
        _ => false,
    }
}

fn native_pauses(function: &Function, arguments: &[Expr]) -> bool {
    match function.path {
        "robot.move" | "robot.drive" => match arguments.last() {
            Some(last) => arguments.len() > 2 || is_call(last),
            None => true,
        },
        "script.stop" => true,
        _ => function.waits,
    }
}

fn is_call(expr: &Expr) -> bool {
    let mut found = false;
    each_in_expr(expr, &mut |part| {
        found |= matches!(
            part.kind,
            ExprKind::Call(..) | ExprKind::Method(..) | ExprKind::Varargs
        );
    });
    found
}

/// Whether this is a standard function that never waits, raises no error and calls no script
/// function.
fn is_quick(kinds: &Kinds<'_>, callee: &Expr) -> bool {
    match &callee.kind {
        ExprKind::Global(name) => {
            let quick = [
                "type", "tostring", "tonumber", "ipairs", "pairs", "next", "rawlen", "select",
            ];
            quick.contains(&name.as_str()) && !kinds.globals.contains(name.as_str())
        }
        ExprKind::Field(object, ..) => match kinds.kind_of(object) {
            ValueKind::Namespace(owner) => {
                matches!(owner, "math" | "bit32" | "utf8" | "buffer" | "vector")
            }
            _ => false,
        },
        _ => false,
    }
}
