//! Checks given parameter values against the script's declaration, if that consists of constants.

use std::collections::BTreeMap;

use super::kinds::{Kinds, ValueKind};
use super::tree::{Entry, Expr, ExprKind};
use crate::script::{Declaration, GivenParam, ParamValue, param_values};

/// Returns what is wrong with the given values; `None` also if the declaration cannot be evaluated
/// without running the script.
pub(super) fn refused(
    kinds: &Kinds<'_>,
    table: &Expr,
    given: &BTreeMap<String, GivenParam>,
) -> Option<String> {
    let ExprKind::Table(entries) = &table.kind else {
        return None;
    };
    let mut declared = BTreeMap::new();
    for entry in entries {
        let Entry::Named(name, _, about) = entry else {
            return None;
        };
        let declaration = declaration(kinds, about)?;
        if let Err(wrong) = declaration.check() {
            return Some(format!("params.declare: {name}: {wrong}"));
        }
        declared.insert(name.clone(), declaration);
    }
    param_values(&declared, given)
        .err()
        .map(|error| error.to_string())
}

fn declaration(kinds: &Kinds<'_>, about: &Expr) -> Option<Declaration> {
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
    Some(Declaration {
        default: constant(kinds, values.get("default")?)?,
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
