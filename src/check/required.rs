//! Finds the modules that a script requires by constant names.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::diagnostic::{Diagnostic, SourceText};
use super::kinds::{Kinds, ValueKind};
use super::lexer::Span;
use super::parser;
use super::tree::{Entry, Expr, ExprKind, Node, each_node};
use crate::robot::DeclaredParam;
use crate::script::{
    GivenParam, ModuleName, ParamValue, Target, check_declaration, read_text, resolve, set_given,
};

/// One of a script's own modules, and where it is first required.
#[derive(Debug, Serialize, Deserialize)]
pub struct Required {
    /// The module's name, relative to the behaviour's folder.
    pub name: ModuleName,
    at: Span,
}

impl Required {
    /// The diagnostic that this module cannot be loaded.
    pub fn refused(&self, source: &[u8], file: &str, why: &str) -> Option<Diagnostic> {
        let text = std::str::from_utf8(source).ok()?;
        let source = SourceText { file, text };
        Some(source.error(self.at, why))
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
    each_node(&tree.block, &mut |node| {
        if let Node::Expr(expr) = node
            && let Some((path, at)) = path(expr)
            && let Ok(Target::File(name)) = resolve(folder, path)
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

/// `None` also if the declaration cannot be evaluated without running the script.
pub(super) fn refused(
    kinds: &Kinds<'_>,
    table: &Expr,
    given: &BTreeMap<String, GivenParam>,
) -> Option<String> {
    let mut declared = BTreeMap::new();
    for entry in table.entries() {
        let Entry::Named(name, _, about) = entry else {
            return None;
        };
        let declaration = declaration(kinds, name, about)?;
        if let Err(wrong) = check_declaration(&declaration) {
            return Some(format!("params.declare: {name}: {wrong}"));
        }
        declared.insert(name.clone(), declaration);
    }
    set_given(&mut declared, given).err()
}

fn declaration(kinds: &Kinds<'_>, name: &str, about: &Expr) -> Option<DeclaredParam> {
    let ExprKind::Table(entries) = &about.bare().kind else {
        return None;
    };
    let mut values = BTreeMap::new();
    for entry in entries {
        match entry {
            Entry::Named(name, _, value) => values.insert(name.as_str(), value),
            _ => return None,
        };
    }
    let number = |key| match values.get(key) {
        None => Some(None),
        Some(value) => match constant(kinds, value)? {
            ParamValue::Number(number) => Some(Some(number)),
            _ => None,
        },
    };
    let choices = match values.get("choices") {
        None => Vec::new(),
        Some(list) => texts(kinds, list)?,
    };
    Some(DeclaredParam {
        name: name.to_owned(),
        value: constant(kinds, values.get("default")?)?,
        min: number("min")?,
        max: number("max")?,
        unit: None,
        choices,
        live: false,
        doc: String::new(),
    })
}

fn texts(kinds: &Kinds<'_>, list: &Expr) -> Option<Vec<String>> {
    let ExprKind::Table(entries) = &list.bare().kind else {
        return None;
    };
    let text = |entry: &Entry| match (entry, constant(kinds, entry.value())?) {
        (Entry::Item(_), ParamValue::Text(text)) => Some(text),
        _ => None,
    };
    entries.iter().map(text).collect()
}

fn constant(kinds: &Kinds<'_>, value: &Expr) -> Option<ParamValue> {
    if let ExprKind::Boolean(value) = value.bare().kind {
        return Some(ParamValue::Boolean(value));
    }
    match kinds.kind_of(value) {
        ValueKind::Number(Some(number)) => Some(ParamValue::Number(number)),
        ValueKind::Text(Some(text)) => Some(ParamValue::Text(text.to_owned())),
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
