//! Checks API calls against the API's definition: number, types and bounds of the arguments, and
//! the keys of options.

use super::super::kinds::ValueKind;
use super::super::lexer::Span;
use super::super::passing;
use super::super::tree::{Entry, Expr, ExprKind};
use super::Walk;
use crate::api::{Choice, EventName, Function, Requirement, Type, Value};
use crate::wire::Stream;

/// The call that is checked.
#[derive(Clone, Copy)]
pub(super) struct CallSite<'a> {
    pub(super) function: &'static Function,
    pub(super) arguments: &'a [Expr],
    pub(super) span: Span,
}

impl<'a> Walk<'a> {
    pub(super) fn call(&mut self, site: CallSite<'a>) {
        let CallSite {
            function,
            arguments,
            span,
        } = site;
        if arguments.len() > function.parameters.len() && function.rest.is_none() {
            let most = function.parameters.len();
            let extra = &arguments[most];
            let message = format!(
                "{}: takes {}, got {}",
                function.path,
                counted(most),
                arguments.len()
            );
            let open = most + 1 == arguments.len() && is_open(extra);
            if !open {
                self.error(extra.span, message).help = Some(function.call());
            }
        }
        let mut forms = function.forms();
        let short = forms.len() > 1 && forms[1].len() == arguments.len();
        let parameters = forms.swap_remove(usize::from(short));
        for (parameter, argument) in parameters.into_iter().zip(arguments) {
            self.argument(function.path, parameter, argument, Some(span));
        }
        self.stream(site);
        let open = arguments.last().is_some_and(is_open);
        if arguments.len() < function.required_len() && !open && !short {
            let missing = &function.parameters[arguments.len()];
            let missing_words = format!(
                "{}: {} is missing{}",
                function.path,
                missing.label(),
                must_be(missing)
            );
            self.error(span, missing_words).help = Some(function.call());
        }
    }

    /// Warns of the use of a stream that the config keeps off. Only a warning: the script may
    /// handle that case.
    fn stream(&mut self, site: CallSite<'a>) {
        let text = |index: usize| match site.arguments.get(index).map(|one| self.kinds.kind_of(one))
        {
            Some(ValueKind::Text(text)) => text,
            _ => None,
        };
        let switched_off = || {
            let on = site.arguments.get(1).map(|one| &one.bare().kind);
            matches!(on, Some(ExprKind::Boolean(false)))
        };
        let wanted = match site.function.path {
            "robot.frame" | "robot.wait_frame" => Some(Stream::Video),
            "robot.stream" if !switched_off() => text(0).and_then(Stream::from_name),
            _ if site.function.takes_an_event() => text(0)
                .and_then(EventName::from_name)
                .and_then(EventName::stream),
            _ => None,
        };
        let streams = self.context.streams;
        if let Some(Err(why)) = wanted.map(|stream| streams.allow(stream)) {
            self.warning(site.span, format!("{}: {why}", site.function.path));
        }
    }

    /// Checks one argument or option against its definition; `whole` is the call, if it is an
    /// argument.
    fn argument(
        &mut self,
        call: &str,
        value: &'static Value,
        argument: &'a Expr,
        whole: Option<Span>,
    ) {
        let kind = self.kinds.kind_of(argument);
        if value.kind.is_function()
            && let Some(path) = self.answered_by(argument)
        {
            let what = value.label();
            let message = format!("{call}: {what} must be a function, got the result of {path}");
            let help = self.passing(value, argument, whole);
            self.error(argument.span, message).help = help;
            return;
        }
        if matches!(kind, ValueKind::Nothing) {
            if value.requirement == Requirement::Required && !matches!(value.kind, Type::Any) {
                let message = format!(
                    "{call}: {} must be {}, got nothing",
                    value.label(),
                    value.kind.describe()
                );
                let help = self.passing(value, argument, whole);
                self.error(argument.span, message).help = help;
            }
            return;
        }
        self.fits(call, value, (argument, whole), kind);
    }

    /// Returns the help for an argument that must be a function and is not.
    fn passing(&self, value: &Value, argument: &Expr, whole: Option<Span>) -> Option<String> {
        if !value.kind.is_function() {
            return None;
        }
        passing::help(self.text.1, argument, whole, value.kind.wants_result())
    }

    /// Returns the path of the API function that an argument calls, if its result is not a
    /// function.
    fn answered_by(&self, argument: &'a Expr) -> Option<&'static str> {
        let ValueKind::Native(function) = self.kinds.callee(argument.bare()) else {
            return None;
        };
        let first = function.returns.first()?;
        let open = matches!(first.kind, Type::Any | Type::Function(_) | Type::Payload);
        (!open).then_some(function.path)
    }

    fn fits(
        &mut self,
        call: &str,
        value: &'static Value,
        (argument, whole): (&'a Expr, Option<Span>),
        kind: ValueKind<'a>,
    ) {
        match (&value.kind, kind) {
            (_, ValueKind::Unknown) | (Type::Any | Type::Payload, _) => {}
            (Type::Number(bounds) | Type::Whole(bounds), ValueKind::Number(number)) => {
                let Some(number) = number else { return };
                if let Some(bounds) = bounds.filter(|bounds| !bounds.contains(number)) {
                    let words = bounds.describe();
                    let message = format!("{call}: {} must be {words}, got {number}", value.name);
                    self.error(argument.span, message);
                } else if matches!(value.kind, Type::Whole(_)) && number.fract() != 0.0 {
                    let message = format!(
                        "{call}: {} must be a whole number, got {number}",
                        value.name
                    );
                    self.error(argument.span, message);
                }
            }
            (Type::Boolean, ValueKind::Boolean)
            | (Type::Text(_), ValueKind::Text(_))
            | (
                Type::Roi | Type::Range | Type::Fields,
                ValueKind::Table(_) | ValueKind::Object(_) | ValueKind::List(_),
            ) => {}
            (kind, ValueKind::Function(_) | ValueKind::Native(_)) if kind.is_function() => {}
            (Type::Choice(choice), ValueKind::Text(text)) => {
                self.name(call, choice, text, argument.span)
            }
            (Type::Colours, _) => self.colour(call, value, argument, kind),
            (Type::Options(keys), ValueKind::Table(table)) => self.options(call, keys, table),
            (Type::Options(_), ValueKind::Object(_) | ValueKind::List(_)) => {}
            (Type::Named(keys), ValueKind::Table(table)) => {
                let ExprKind::Table(entries) = &table.kind else {
                    return;
                };
                for entry in entries {
                    if let (Entry::Named(..), ValueKind::Table(one)) =
                        (entry, self.kinds.kind_of(entry.value()))
                    {
                        self.options(call, keys, one);
                    }
                }
            }
            (Type::Object(wanted), ValueKind::Object(object)) if object.name == wanted.name => {}
            (Type::Object(wanted), ValueKind::Table(_) | ValueKind::Object(_))
                if !wanted.strict => {}
            (Type::List(_), ValueKind::Table(_) | ValueKind::List(_)) => {}
            (
                Type::OneOrMore(_),
                ValueKind::Table(_) | ValueKind::List(_) | ValueKind::Object(_),
            ) => {}
            (Type::Buffer, ValueKind::Object(_)) => {}
            (_, kind) => {
                let Some(got) = self.got(argument, kind) else {
                    return;
                };
                let what = value.label();
                let message = format!(
                    "{call}: {what} must be {}, got {got}",
                    value.kind.describe()
                );
                let help = self.passing(value, argument, whole);
                self.error(argument.span, message).help = help;
            }
        }
    }

    /// Describes the value for messages: `true` and `false` literally.
    fn got(&self, argument: &Expr, kind: ValueKind<'_>) -> Option<String> {
        match argument.bare().kind {
            ExprKind::Boolean(on) => Some(on.to_string()),
            _ => kind.describe(),
        }
    }

    fn name(&mut self, call: &str, choice: &Choice, text: Option<&str>, span: Span) {
        let names = (choice.names)();
        let Some(text) = text.filter(|text| !names.contains(text)) else {
            return;
        };
        let near = self.near(text, names.iter().copied());
        let text = crate::script::printable(text, 40);
        let message = format!("{call}: unknown {} '{text}'{near}", choice.what);
        self.error(span, message).help = Some(format!("known: {}", names.join(", ")));
    }

    fn colour(
        &mut self,
        call: &str,
        value: &'static Value,
        argument: &'a Expr,
        kind: ValueKind<'a>,
    ) {
        match kind {
            ValueKind::Text(Some(text)) => {
                let known: Vec<String> = self.context.colour_names();
                if known.iter().any(|name| name == text) {
                    return;
                }
                let near = self.near(text, known.iter().map(String::as_str));
                let text = crate::script::printable(text, 40);
                let message = format!("{call}: unknown colour '{text}'{near}");
                self.error(argument.span, message).help =
                    Some(format!("known: {}", known.join(", ")));
            }
            ValueKind::Table(table) => {
                let ExprKind::Table(entries) = &table.kind else {
                    return;
                };
                for entry in entries {
                    if let Entry::Item(item) = entry {
                        let kind = self.kinds.kind_of(item);
                        if !matches!(kind, ValueKind::Table(_) | ValueKind::Nothing) {
                            self.colour(call, value, item, kind);
                        }
                    }
                }
            }
            ValueKind::Number(_)
            | ValueKind::Boolean
            | ValueKind::Function(_)
            | ValueKind::Native(_) => {
                let Some(got) = self.got(argument, kind) else {
                    return;
                };
                let message = format!(
                    "{call}: {} must be {}, got {got}",
                    value.name,
                    value.kind.describe()
                );
                self.error(argument.span, message);
            }
            ValueKind::Object(object) if object.name != "Colour" => {
                let message = format!(
                    "{call}: {} must be {}, got {}",
                    value.name,
                    value.kind.describe(),
                    object.with_article()
                );
                self.error(argument.span, message);
            }
            _ => {}
        }
    }

    fn options(&mut self, call: &str, keys: &'static [Value], table: &'a Expr) {
        let ExprKind::Table(entries) = &table.kind else {
            return;
        };
        let mut given = Vec::new();
        let mut certain = true;
        for entry in entries {
            let (name, span) = match entry {
                Entry::Named(name, span, _) => (name.as_str(), *span),
                Entry::Item(item) => {
                    let message = format!(
                        "{call}: an option needs its name, such as {}",
                        example(keys)
                    );
                    self.error(item.span, message);
                    continue;
                }
                Entry::Keyed(key, _) => match self.kinds.kind_of(key) {
                    ValueKind::Text(Some(name)) => (name, key.span),
                    _ => {
                        certain = false;
                        continue;
                    }
                },
            };
            given.push(name);
            match keys.iter().find(|key| key.name == name) {
                Some(key) => self.argument(call, key, entry.value(), None),
                None => self.unknown_option(call, keys, name, span),
            }
        }
        let missing = keys
            .iter()
            .find(|key| key.requirement == Requirement::Required && !given.contains(&key.name));
        if let Some(missing) = missing
            && certain
        {
            let message = format!("{call}: {} is missing{}", missing.name, must_be(missing));
            self.error(table.span, message);
        }
    }

    fn unknown_option(&mut self, call: &str, keys: &[Value], name: &str, span: Span) {
        let known: Vec<_> = keys.iter().map(|key| key.name).collect();
        let near = self.near(name, known.iter().copied());
        let message = format!("{call}: unknown option '{name}'{near}");
        self.error(span, message).help = Some(format!("known: {}", known.join(", ")));
    }
}

/// Whether an expression may yield several values, or none.
fn is_open(argument: &Expr) -> bool {
    matches!(
        argument.kind,
        ExprKind::Call(..) | ExprKind::Method(..) | ExprKind::Varargs
    )
}

/// Says what a missing value must be; empty if it can be anything.
fn must_be(value: &Value) -> String {
    match value.kind {
        Type::Any => String::new(),
        _ => format!("; it must be {}", value.kind.describe()),
    }
}

fn counted(count: usize) -> String {
    match count {
        0 => "no arguments".to_owned(),
        1 => "1 argument".to_owned(),
        many => format!("{many} arguments"),
    }
}

fn example(keys: &[Value]) -> String {
    let key = keys.first().map_or("name", |key| key.name);
    format!("{{{key} = ...}}")
}
