//! Finds the modules that a script requires by constant names.

use serde::{Deserialize, Serialize};

use super::diagnostic::{Diagnostic, Severity};
use super::lexer::Span;
use super::parser;
use super::tree::{Expr, ExprKind};
use crate::script::{ModuleName, Target, read_text, resolve};

/// One of a script's own modules, and where it is first required.
#[derive(Debug, Serialize, Deserialize)]
pub struct Required {
    /// The module's name, relative to the behaviour's folder.
    pub name: ModuleName,
    at: Span,
}

impl Required {
    /// Creates the diagnostic that this module cannot be loaded, at the position where it is
    /// required.
    pub fn refused(&self, (source, chunk): (&[u8], &str), why: &str) -> Option<Diagnostic> {
        let text = std::str::from_utf8(source).ok()?;
        Some(Diagnostic::new(
            (chunk, text),
            self.at,
            Severity::Error,
            why,
        ))
    }
}

/// Returns the modules that a file requires. `folder` is the file's folder, relative to the
/// behaviour's folder. Empty if the file cannot be parsed.
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

/// Returns the path argument of a call such as `require("./lib/pid")`.
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
    fn modules_are_named_relative_to_the_behaviours_folder_and_only_once() {
        let source =
            "local a = require('./a')\nif a then print(require('../b.lua'), require('./a')) end";
        assert_eq!(names(source, "lib"), ["lib/a", "b"]);
        let others =
            "require('@spykee/pid') require('/etc/passwd') require('./' .. x) require('../../x')";
        assert_eq!(names(others, "lib"), [""; 0]);
        assert_eq!(names("require(", ""), [""; 0]);
    }
}
