//! The modules that a script requires by names that are written out.

use serde::{Deserialize, Serialize};

use super::finding::{Finding, Severity};
use super::lexer::Span;
use super::parser;
use super::tree::{Expr, ExprKind};
use crate::script::{ModuleName, Target, read_text, resolve};

/// One of a script's own modules, and where it is required first.
#[derive(Debug, Serialize, Deserialize)]
pub struct Required {
    /// Which, as seen from the behaviour's folder.
    pub name: ModuleName,
    at: Span,
}

impl Required {
    /// That it cannot be had, told where it is required.
    pub fn refused(&self, (source, chunk): (&[u8], &str), why: &str) -> Option<Finding> {
        let text = std::str::from_utf8(source).ok()?;
        Some(Finding::new((chunk, text), self.at, Severity::Error, why))
    }
}

/// The modules that a file requires; `folder` is where it is, as seen from the behaviour's folder.
/// None of a file that cannot be read.
pub fn required(source: &[u8], folder: &str) -> Vec<Required> {
    let mut found: Vec<Required> = Vec::new();
    let text = read_text(source, "").ok();
    let Some(tree) = text.and_then(|text| parser::parse(text).ok()) else {
        return found;
    };
    tree.each_expr(&mut |expr| {
        let Some((path, at)) = path(expr) else { return };
        if let Ok(Target::File(name)) = resolve(folder, path)
            && !found.iter().any(|one| one.name == name)
        {
            found.push(Required { name, at });
        }
    });
    found
}

/// Of `require("./lib/pid")`.
fn path(expr: &Expr) -> Option<(&str, Span)> {
    let ExprKind::Call(callee, arguments) = &expr.kind else {
        return None;
    };
    let [argument] = arguments.as_slice() else {
        return None;
    };
    match (&callee.kind, &argument.kind) {
        (ExprKind::Global(name), ExprKind::Text(path)) if name == "require" => {
            Some((path, argument.span))
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(source: &str, folder: &str) -> Vec<String> {
        let found = required(source.as_bytes(), folder);
        found.into_iter().map(|one| one.name.into()).collect()
    }

    #[test]
    fn modules_are_named_from_the_behaviours_folder_and_each_once() {
        let source =
            "local a = require('./a')\nif a then print(require('../b.lua'), require('./a')) end";
        assert_eq!(names(source, "lib"), ["lib/a", "b"]);
        let others =
            "require('@spykee/pid') require('/etc/passwd') require('./' .. x) require('../../x')";
        assert_eq!(names(others, "lib"), [""; 0]);
        assert_eq!(names("require(", ""), [""; 0]);
    }
}
