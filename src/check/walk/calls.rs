//! Checks calls, operators and their operands.

use super::super::kinds::ValueKind;
use super::super::lexer::Span;
use super::super::parameters;
use super::super::tree::{Expr, ExprKind};
use super::Walk;
use super::arguments::CallSite;
use crate::api::{self, Function, Type};
use crate::script::{PICTURE_NAMES, picture_name};

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

    /// Checks calls that are not API functions: unknown standard functions, and methods called with
    /// a dot.
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
                parameters::refused(&self.kinds, table, &self.context.params)
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

    /// Records the kind of the first parameter of an inline handler function: an event's payload,
    /// or the object that the API's definition names.
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

    pub(super) fn method(
        &mut self,
        call: &'a Expr,
        object: &'a Expr,
        (name, at): (&'a str, Span),
        arguments: &'a [Expr],
    ) {
        self.expr(object);
        self.exprs(arguments);
        match self.kinds.kind_of(object) {
            ValueKind::Namespace(owner) if self.is_ours(owner) => {
                let path = format!("{owner}.{name}");
                if self.context.paths.contains(&path) {
                    let message = format!("{path} must be called with a dot, not with a colon");
                    self.error(at, message).help = Some(format!("write {path}(...)"));
                } else {
                    self.unknown_field(owner, name, at);
                }
            }
            ValueKind::Module(module) => {
                if module.function(name).is_some() {
                    let path = format!("{}.{name}", module.name);
                    let message = format!("{path} must be called with a dot, not with a colon");
                    self.error(at, message).help = Some(format!("write {path}(...)"));
                } else {
                    self.unknown_field(module.name, name, at);
                }
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

    /// Checks arithmetic, comparison and concatenation of values that are neither numbers nor
    /// strings.
    pub(super) fn operands(&mut self, operator: &str, left: &'a Expr, right: &'a Expr) {
        let compares = matches!(operator, "<" | ">" | "<=" | ">=");
        let counts = matches!(operator, "+" | "-" | "*" | "/" | "//" | "%" | "^");
        if operator == "=="
            && matches!(left.kind, ExprKind::Unary(ref not, _) if not == "not")
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
        if matches!(operator, "==" | "~=") {
            self.one_of_names(left, right);
            self.one_of_names(right, left);
        }
        if !(compares || counts || operator == "..") {
            return;
        }
        for side in [left, right] {
            let kind = self.kinds.kind_of(side);
            let wrong = match kind {
                ValueKind::Object(_)
                | ValueKind::List(_)
                | ValueKind::Nothing
                | ValueKind::Native(_)
                | ValueKind::Function(_) => true,
                ValueKind::Boolean => operator != "==",
                _ => false,
            };
            let what = self.got_words(side, kind);
            if wrong && let Some(what) = what {
                let does = match operator {
                    ".." => "cannot be joined to a string",
                    _ if compares => "cannot be compared with < or >",
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
                return;
            }
        }
        if let (true, ValueKind::Number(_), ValueKind::Text(_))
        | (true, ValueKind::Text(_), ValueKind::Number(_)) = (
            compares,
            self.kinds.kind_of(left),
            self.kinds.kind_of(right),
        ) {
            self.error(
                left.span.to(right.span),
                "a number cannot be compared with a string",
            )
            .help = Some("tonumber(text) converts a string to a number".to_owned());
        }
    }

    /// Warns of a comparison of a value from a fixed set of names with a text that is not in the
    /// set.
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
