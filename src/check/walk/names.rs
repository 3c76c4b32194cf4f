//! Checks names and fields for existence.

use super::super::foreign;
use super::super::kinds::{ValueKind, parameters};
use super::super::lexer::Span;
use super::super::tree::Expr;
use super::Walk;
use crate::api;

impl<'a> Walk<'a> {
    pub(super) fn global(&mut self, name: &'a str, span: Span) {
        let paths = &self.context.paths;
        if paths.contains(name) || self.kinds.globals.contains(name) || self.context.open_globals {
            return;
        }
        let (message, help) = self.unknown_name(name, span);
        self.error(span, message).help = help;
    }

    pub(super) fn unknown_name(&self, name: &str, span: Span) -> (String, Option<String>) {
        if self.is_full() {
            return (String::new(), None);
        }
        let tree = self.kinds.tree;
        let elsewhere = tree.locals.iter().find(|local| local.name == name);
        if let Some(local) = elsewhere {
            let line = self.text.1[..local.span.start].matches('\n').count() + 1;
            let message = format!("'{name}' is not known here");
            let help = if local.span.start > span.start {
                format!("it is defined further down, in line {line}; move that above this line")
            } else {
                format!(
                    "the '{name}' of line {line} is known only inside its own block; declare it before that block"
                )
            };
            return (message, Some(help));
        }
        if let Some(meant) = foreign::meant(name) {
            return (format!("unknown name '{name}'"), Some(meant.to_owned()));
        }
        if let Some(elsewhere) = api::elsewhere(name, self.context.paths.contains(api::SCENARIO)) {
            return (format!("unknown name '{name}'"), Some(elsewhere));
        }
        let globals = self.context.paths.iter().map(String::as_str);
        let globals = globals.filter(|path| !path.contains('.'));
        let own = tree.locals.iter().map(|local| local.name.as_str());
        let set = self.kinds.globals.iter().copied();
        let near = self.near(name, globals.chain(own).chain(set));
        let help = if near.is_empty() {
            foreign::belongs_to(name, &self.context.paths)
        } else {
            None
        };
        (format!("unknown name '{name}'{near}"), help)
    }

    pub(super) fn field(&mut self, object: &'a Expr, name: &str, at: Span) {
        match self.kinds.kind_of(object) {
            ValueKind::Namespace(owner) if self.is_ours(owner) && !self.has(owner, name) => {
                self.unknown_field(owner, name, at);
            }
            ValueKind::Module(module) if module.function(name).is_none() => {
                self.unknown_field(module.name, name, at);
            }
            ValueKind::Params(table) => {
                let known = parameters(table).unwrap_or_default();
                if !known.contains(&name) {
                    let near = self.near(name, known.iter().copied());
                    let message = format!("params.{name} does not exist{near}");
                    self.error(at, message).help = Some(format!("declared: {}", known.join(", ")));
                }
            }
            ValueKind::Object(of) => self.member(of, name, at),
            ValueKind::List(_) if !self.kinds.fields.contains(name) => {
                let list = self.source_text(object.span);
                let message =
                    format!("this is a list: its entries have '{name}', the list itself does not");
                self.error(at, message).help = Some(format!(
                    "take one of its entries: {list}[1].{name}; the list may be empty, so test it first"
                ));
            }
            ValueKind::Native(function) => {
                let message = format!("{} is a function: it has no '{name}'", function.path);
                self.error(at, message).help = Some(format!("call it: {}", function.call()));
            }
            _ => {}
        }
    }

    pub(super) fn has(&self, owner: &str, name: &str) -> bool {
        let paths = &self.context.paths;
        paths.contains(&format!("{owner}.{name}"))
    }

    /// Whether this is a namespace of the API. These are strict; unknown fields of Luau's own are
    /// nil.
    pub(super) fn is_ours(&self, owner: &str) -> bool {
        !owner.is_empty() && api::namespace(owner).is_some()
    }

    pub(super) fn unknown_field(&mut self, owner: &str, name: &str, at: Span) {
        let inside = format!("{owner}.");
        let paths = self.context.paths.iter();
        let known: Vec<_> = match api::module(owner) {
            Some(module) => module.members(),
            None => paths
                .filter_map(|path| path.strip_prefix(&inside))
                .collect(),
        };
        let near = self.near(name, known);
        let help = if near.is_empty() {
            let members =
                |module: &api::Namespace| format!("it has {}", module.members().join(", "));
            foreign::belongs_to(name, &self.context.paths)
                .or_else(|| foreign::meant(name).map(str::to_owned))
                .or_else(|| api::module(owner).map(members))
        } else {
            None
        };
        self.error(at, format!("{owner}.{name} does not exist{near}"))
            .help = help;
    }

    pub(super) fn member(&mut self, object: &'static api::Object, name: &str, at: Span) {
        let known = object.members();
        let own = !object.strict && self.kinds.fields.contains(name);
        if known.contains(&name) || own {
            return;
        }
        let near = self.near(name, known.iter().copied());
        let message = format!("{} has no '{name}'{near}", object.with_article());
        self.error(at, message).help = Some(format!("it has {}", known.join(", ")));
    }

    pub(super) fn item(&mut self, list: &'a Expr, index: &'a Expr, span: Span) {
        if let (ValueKind::List(_), ValueKind::Number(Some(0.0))) =
            (self.kinds.kind_of(list), self.kinds.kind_of(index))
        {
            self.error(span, "lists begin at 1: there is nothing at 0")
                .help = Some(format!("the first is {}[1]", self.source_text(list.span)));
        }
    }
}
