//! Checks calls, operators and their operands.

use super::super::diagnostic::Diagnostic;
use super::super::kinds::ValueKind;
use super::super::lexer::Span;
use super::super::tree::{Entry, Expr, ExprKind};
use super::super::{passing, required};
use super::Walk;
use crate::api::{self, Bounds, Choice, EventName, Function, Requirement, Type, Value};
use crate::script::{PICTURE_NAMES, picture_name};
use crate::wire::Stream;

/// A little over two turns: a larger number is probably not meant in radians.
const MAX_RADIANS: f64 = 13.0;
/// Longer than a room: a larger number is probably not meant in metres.
const MAX_METRES: f64 = 20.0;

impl<'a> Walk<'a> {
    pub(super) fn called(&mut self, call: &'a Expr, callee: &'a Expr, arguments: &'a [Expr]) {
        self.expr(callee);
        let kind = self.kinds.kind_of(callee);
        if let ValueKind::Native(function) = kind {
            self.handler(function, arguments);
        }
        self.exprs(arguments);
        match kind {
            ValueKind::Native(function) => {
                self.call(CallSite {
                    function,
                    arguments,
                    span: call.span,
                });
                self.special(function, arguments);
            }
            ValueKind::Namespace(name) => {
                self.error(callee.span, format!("{name} is not a function"))
                    .help = Some(format!("call its functions as {name}.NAME()"));
            }
            ValueKind::Nothing
            | ValueKind::Number(_)
            | ValueKind::Boolean
            | ValueKind::Text(_)
            | ValueKind::List(_) => {
                let what = kind.describe().unwrap_or_default();
                let message = format!(
                    "'{}' is {what}, not a function",
                    self.source_text(callee.span)
                );
                self.error(callee.span, message);
            }
            _ => self.library(callee, arguments),
        }
    }

    /// Unknown standard functions, and methods called with a dot.
    pub(super) fn library(&mut self, callee: &'a Expr, arguments: &'a [Expr]) {
        let ExprKind::Field(object, name, at) = &callee.kind else {
            return;
        };
        match self.kinds.kind_of(object) {
            ValueKind::Namespace(owner)
                if owner != "_G" && !self.is_ours(owner) && !self.has(owner, name) =>
            {
                self.unknown_field(owner, name, *at);
            }
            ValueKind::Object(of) if of.method(name).is_some() => {
                let again = arguments.first().map(|first| self.kinds.kind_of(first));
                if !matches!(again, Some(ValueKind::Object(_) | ValueKind::Unknown)) {
                    let object = self.source_text(object.span);
                    let message =
                        format!("{name} must be called with a colon: {object}:{name}(...)");
                    self.error(*at, message);
                }
            }
            _ => {}
        }
    }

    /// Checks calls whose arguments depend on the script's environment.
    pub(super) fn special(&mut self, function: &'static Function, arguments: &'a [Expr]) {
        self.units(function, arguments);
        let [.., argument] = arguments else { return };
        let wrong = match (function.path, self.kinds.kind_of(argument)) {
            ("require", ValueKind::Text(Some(path))) => self.context.missing_module(path),
            ("params.declare", ValueKind::Table(table)) => {
                required::refused(&self.kinds, table, &self.context.params)
            }
            ("Frame:save", ValueKind::Text(Some(name))) if picture_name(name).is_none() => {
                Some(format!("Frame:save: {PICTURE_NAMES}"))
            }
            ("store.set", ValueKind::Function(_) | ValueKind::Native(_))
                if arguments.len() == 2 =>
            {
                Some("store.set: a function cannot be stored".to_owned())
            }
            _ => None,
        };
        if let Some(wrong) = wrong {
            self.error(argument.span, wrong);
        }
    }

    /// Warns of numbers that are probably not meant in the parameter's unit.
    fn units(&mut self, function: &'static Function, arguments: &'a [Expr]) {
        let Some(first) = arguments.first() else {
            return;
        };
        let ValueKind::Number(Some(number)) = self.kinds.kind_of(first) else {
            return;
        };
        let (message, help) = match function.path {
            "robot.turn" if number.abs() > MAX_RADIANS => {
                let turns = number.abs() / std::f64::consts::TAU;
                (
                    format!("robot.turn takes radians: {number} are {turns:.0} turns"),
                    format!("for degrees, write robot.turn(math.rad({number}))"),
                )
            }
            "robot.forward" if number.abs() > MAX_METRES => (
                format!("robot.forward takes metres: {number} metres are a long way"),
                "to drive for a time, write robot.move(40, 40, seconds)".to_owned(),
            ),
            _ => return,
        };
        self.warning(first.span, message).help = Some(help);
    }

    /// The first parameter of an inline handler: an event's payload, or an object of the API.
    pub(super) fn handler(&mut self, function: &'static Function, arguments: &'a [Expr]) {
        let mut forms = function.forms();
        let short = forms.len() > 1 && forms[1].len() == arguments.len();
        let rows = forms.swap_remove(usize::from(short));
        for (row, argument) in rows.iter().zip(arguments) {
            let ExprKind::Function(body) = &argument.kind else {
                continue;
            };
            let kind = match row.kind {
                Type::Handler => self.kinds.payload(arguments),
                Type::Function(luau) => first_parameter(luau),
                _ => ValueKind::Unknown,
            };
            if let Some(first) = body.parameters.first() {
                self.kinds.bind(*first, kind);
            }
        }
    }

    pub(super) fn method(&mut self, call: &'a Expr) {
        let ExprKind::Method(object, name, at, arguments) = &call.kind else {
            return;
        };
        let name = name.as_str();
        let at = *at;
        self.expr(object);
        self.exprs(arguments);
        match self.kinds.kind_of(object) {
            ValueKind::Namespace(owner) if self.is_ours(owner) => {
                let exists = self.context.paths.contains(&format!("{owner}.{name}"));
                self.function_with_colon(owner, name, at, exists);
            }
            ValueKind::Module(module) => {
                let exists = module.function(name).is_some();
                self.function_with_colon(module.name, name, at, exists);
            }
            ValueKind::Object(of) => match of.method(name) {
                Some(function) => {
                    self.call(CallSite {
                        function,
                        arguments,
                        span: call.span,
                    });
                    self.special(function, arguments);
                }
                None if of.fields.iter().any(|field| field.name == name) => {
                    let words = self.source_text(object.span);
                    let message = format!("'{name}' is data, not a function: write {words}.{name}");
                    self.error(at, message);
                }
                None => self.member(of, name, at),
            },
            ValueKind::List(_) | ValueKind::Nothing => {
                let what = self.kinds.kind_of(object).describe().unwrap_or_default();
                let message = format!(
                    "'{}' is {what}: it has no function '{name}'",
                    self.source_text(object.span)
                );
                self.error(at, message);
            }
            _ => {}
        }
    }

    fn function_with_colon(&mut self, owner: &'a str, name: &'a str, at: Span, exists: bool) {
        if !exists {
            return self.unknown_field(owner, name, at);
        }
        let path = format!("{owner}.{name}");
        let message = format!("{path} must be called with a dot, not with a colon");
        self.error(at, message).help = Some(format!("write {path}(...)"));
    }

    /// Values that are neither numbers nor strings.
    pub(super) fn operands(&mut self, operator: &str, left: &'a Expr, right: &'a Expr) {
        let compares = matches!(operator, "<" | ">" | "<=" | ">=");
        let counts = matches!(operator, "+" | "-" | "*" | "/" | "//" | "%" | "^");
        if operator == "==" {
            self.compared_with_not(left, right);
        }
        if matches!(operator, "==" | "~=") {
            self.one_of_names(left, right);
            self.one_of_names(right, left);
        }
        if !(compares || counts || operator == "..") {
            return;
        }
        if self.wrong_operand(operator, left) || self.wrong_operand(operator, right) {
            return;
        }
        let kinds = [left, right].map(|side| self.kinds.kind_of(side));
        if compares
            && let [ValueKind::Number(_), ValueKind::Text(_)]
            | [ValueKind::Text(_), ValueKind::Number(_)] = kinds
        {
            let message = "a number cannot be compared with a string";
            self.error(left.span.to(right.span), message).help =
                Some("tonumber(text) converts a string to a number".to_owned());
        }
    }

    /// Reports a value that the operator cannot be applied to; returns whether it is one.
    fn wrong_operand(&mut self, operator: &str, side: &'a Expr) -> bool {
        let kind = self.kinds.kind_of(side);
        let wrong = matches!(
            kind,
            ValueKind::Object(_)
                | ValueKind::List(_)
                | ValueKind::Nothing
                | ValueKind::Native(_)
                | ValueKind::Function(_)
                | ValueKind::Boolean
        );
        let Some(what) = self.got_words(side, kind) else {
            return false;
        };
        if !wrong {
            return false;
        }
        let does = match operator {
            ".." => "cannot be joined to a string",
            "<" | ">" | "<=" | ">=" => "cannot be compared with < or >",
            _ => "cannot be used in arithmetic",
        };
        let words = self.source_text(side.span);
        let message = if words == what {
            format!("{what} {does}")
        } else {
            format!("`{words}` is {what}: it {does}")
        };
        let help = self.what_to_read(side, kind, operator);
        self.error(side.span, message).help = help;
        true
    }

    /// `not a == b`, which compares `not a`.
    fn compared_with_not(&mut self, left: &'a Expr, right: &'a Expr) {
        if matches!(left.kind, ExprKind::Unary(ref not, _) if not == "not")
            && !matches!(
                self.kinds.kind_of(right),
                ValueKind::Boolean | ValueKind::Unknown
            )
        {
            let help = format!(
                "write {} ~= {}",
                self.source_text(left.span).trim_start_matches("not").trim(),
                self.source_text(right.span)
            );
            let message = "`not` applies only to the left side here, so this compares true or false with something else";
            self.warning(left.span.to(right.span), message).help = Some(help);
        }
    }

    fn one_of_names(&mut self, named: &'a Expr, text: &'a Expr) {
        let (Some(choice), ValueKind::Text(Some(said))) =
            (self.kinds.choice(named), self.kinds.kind_of(text))
        else {
            return;
        };
        let names = (choice.names)();
        if names.contains(&said) {
            return;
        }
        let near = self.near(said, names.iter().copied());
        let words = crate::script::printable(said, 40);
        let message = format!("no {} is called '{words}'{near}", choice.what);
        self.warning(text.span, message).help = Some(format!("known: {}", names.join(", ")));
    }

    pub(super) fn got_words(&self, side: &Expr, kind: ValueKind<'a>) -> Option<String> {
        match side.bare().kind {
            ExprKind::Nil => Some("nil".to_owned()),
            _ => kind.describe(),
        }
    }

    pub(super) fn what_to_read(
        &self,
        side: &Expr,
        kind: ValueKind<'a>,
        operator: &str,
    ) -> Option<String> {
        let words = self.source_text(side.span);
        match kind {
            ValueKind::Object(object) => {
                let field = object.fields.first()?.name;
                Some(format!("read one of its fields, such as {words}.{field}"))
            }
            ValueKind::List(_) => Some(format!("#{words} is the number of its entries")),
            ValueKind::Native(function) => Some(format!("call it: {}", function.call())),
            ValueKind::Function(_) => Some(format!("call it: {words}()")),
            ValueKind::Boolean if operator == ".." => {
                Some(format!("tostring({words}) converts it to a string"))
            }
            _ => None,
        }
    }
}

/// Returns the kind of the first parameter in a signature such as `(sim: Sim) -> ()`.
fn first_parameter<'a>(luau: &str) -> ValueKind<'a> {
    let inside = luau.strip_prefix('(').unwrap_or_default();
    let first = inside.split([',', ')']).next().unwrap_or_default();
    let name = first.split_once(": ").map_or("", |(_, name)| name);
    api::object(name).map_or(ValueKind::Unknown, ValueKind::Object)
}

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

    /// Only a warning: the script may handle a stream that the config keeps off.
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

    /// `whole` is the call, if this is an argument and not an option.
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
        self.fits(call, value, argument, whole);
    }

    fn passing(&self, value: &Value, argument: &Expr, whole: Option<Span>) -> Option<String> {
        if !value.kind.is_function() {
            return None;
        }
        passing::help(self.source.text, argument, whole, value.kind.wants_result())
    }

    fn answered_by(&self, argument: &'a Expr) -> Option<&'static str> {
        let ValueKind::Native(function) = self.kinds.callee(argument.bare()) else {
            return None;
        };
        let first = function.returns.first()?;
        let open = matches!(first.kind, Type::Any | Type::Function(_) | Type::Payload);
        (!open).then_some(function.path)
    }

    fn fits(&mut self, call: &str, value: &'static Value, argument: &'a Expr, whole: Option<Span>) {
        match (&value.kind, self.kinds.kind_of(argument)) {
            (_, ValueKind::Unknown) | (Type::Any | Type::Payload, _) => {}
            (Type::Number(bounds) | Type::Whole(bounds), ValueKind::Number(number)) => {
                self.number(call, value, *bounds, argument, number);
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
            (Type::Colours, kind) => self.colour(call, value, argument, kind),
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
                let help = self.passing(value, argument, whole);
                if let Some(diagnostic) = self.must_be(call, value.label(), value, argument, kind) {
                    diagnostic.help = help;
                }
            }
        }
    }

    fn number(
        &mut self,
        call: &str,
        value: &'static Value,
        bounds: Option<Bounds>,
        argument: &'a Expr,
        number: Option<f64>,
    ) {
        let Some(number) = number else { return };
        let name = value.name;
        let wanted = match bounds.filter(|bounds| !bounds.contains(number)) {
            Some(bounds) => bounds.describe(),
            None if matches!(value.kind, Type::Whole(_)) && number.fract() != 0.0 => {
                "a whole number".to_owned()
            }
            None => return,
        };
        let message = format!("{call}: {name} must be {wanted}, got {number}");
        self.error(argument.span, message);
    }

    /// Reports a value of the wrong kind, if its kind is known.
    fn must_be(
        &mut self,
        call: &str,
        what: &str,
        value: &'static Value,
        argument: &'a Expr,
        kind: ValueKind<'a>,
    ) -> Option<&mut Diagnostic> {
        let got = self.got(argument, kind)?;
        let wanted = value.kind.describe();
        let message = format!("{call}: {what} must be {wanted}, got {got}");
        Some(self.error(argument.span, message))
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
            ValueKind::Object(object) if object.name == "Colour" => {}
            ValueKind::Number(_)
            | ValueKind::Boolean
            | ValueKind::Function(_)
            | ValueKind::Native(_)
            | ValueKind::Object(_) => {
                self.must_be(call, value.name, value, argument, kind);
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
