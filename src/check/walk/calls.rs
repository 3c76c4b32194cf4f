//! Checks calls, operators and their operands.

use super::super::kinds::ValueKind;
use super::super::lexer::Span;
use super::super::tree::{Entry, Expr, ExprKind};
use super::super::{passing, required};
use super::Walk;
use crate::api::{self, Bounds, EventName, Function, Type, Value};
use crate::script::{PICTURE_NAMES, picture_name};
use crate::vision::Colour;
use crate::wire::Stream;

/// A little over two turns: a larger number is probably not meant in radians.
const MAX_RADIANS: f64 = 13.0;
/// Longer than a room: a larger number is probably not meant in metres.
const MAX_METRES: f64 = 20.0;
/// Several times as fast as a Spykee: a larger number is probably not meant in metres per second.
const MAX_SPEED: f64 = 2.0;

impl<'a> Walk<'a> {
    pub(super) fn called(&mut self, call: &'a Expr, callee: &'a Expr, arguments: &'a [Expr]) {
        self.expr(callee);
        let kind = self.kinds.kind_of(callee);
        if let ValueKind::Native(function) = kind {
            self.handler(function, arguments);
        }
        self.exprs(arguments);
        match kind {
            ValueKind::Native(function) => self.call(function, arguments, call.span),
            ValueKind::Namespace(name) => {
                let message = format!("{name} is not a function");
                let help = format!("call its functions as {name}.NAME()");
                self.error(callee.span, message, help);
            }
            ValueKind::Nothing
            | ValueKind::Number(_)
            | ValueKind::Boolean
            | ValueKind::Text(_)
            | ValueKind::List(_) => {
                let what = kind.describe().unwrap_or_default();
                let words = self.source_text(callee.span);
                let message = format!("'{words}' is {what}, not a function");
                self.error(callee.span, message, "");
            }
            _ => self.library(callee, arguments),
        }
    }

    /// Unknown standard functions, and methods called with a dot.
    fn library(&mut self, callee: &'a Expr, arguments: &'a [Expr]) {
        let ExprKind::Field(object, name, at) = &callee.kind else {
            return;
        };
        match self.kinds.kind_of(object) {
            ValueKind::Namespace(owner)
                if owner != "_G" && !self.is_ours(owner) && !self.has(owner, name) =>
            {
                self.unknown_field(owner, name, *at);
            }
            kind if self.has_method(kind, name) => {
                let again = arguments.first().map(|first| self.kinds.kind_of(first));
                let again = again.unwrap_or(ValueKind::Nothing);
                if !self.has_method(again, name) && !matches!(again, ValueKind::Unknown) {
                    let object = self.source_text(object.span);
                    let message =
                        format!("{name} must be called with a colon: {object}:{name}(...)");
                    self.error(*at, message, "");
                }
            }
            _ => {}
        }
    }

    fn has_method(&self, kind: ValueKind<'a>, name: &str) -> bool {
        match kind {
            ValueKind::Object(of) => of.method(name).is_some(),
            ValueKind::Text(_) => self.has("string", name),
            _ => false,
        }
    }

    /// Checks calls whose arguments depend on the script's environment.
    fn special(&mut self, function: &'static Function, arguments: &'a [Expr]) {
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
            self.error(argument.span, wrong, "");
        }
    }

    /// Warns of numbers that are probably not meant in the parameter's unit.
    fn units(&mut self, function: &'static Function, arguments: &'a [Expr]) {
        let place = if function.path == "robot.move" { 2 } else { 0 };
        let Some(first) = arguments.get(place) else {
            return;
        };
        let text = first.span.of(self.source.text);
        let degrees = text.strip_prefix("math.rad(");
        if let ("easy.left" | "easy.right", Some(degrees)) = (function.path, degrees) {
            let path = function.path;
            let message = format!("{path} takes degrees, not radians");
            return self.warning(first.span, message, format!("write {path}({degrees}"));
        }
        let ValueKind::Number(Some(number)) = self.kinds.kind_of(first) else {
            return;
        };
        let minutes = number / 60.0;
        let (message, help) = match function.path {
            "robot.drive" if number.abs() > MAX_SPEED => (
                format!("robot.drive takes metres per second: no robot drives {number} m/s"),
                "for the power of the tracks in percent, write robot.move(left, right)".to_owned(),
            ),
            path @ ("task.wait" | "easy.wait") if number >= 500.0 && number % 500.0 == 0.0 => (
                format!("{path} takes seconds: {number} are {minutes:.0} minutes"),
                format!("for milliseconds, write {path}({})", number / 1000.0),
            ),
            "robot.move" if number >= 500.0 && number % 100.0 == 0.0 => (
                format!("robot.move takes seconds: {number} are {minutes:.0} minutes"),
                format!("for milliseconds, write {}", number / 1000.0),
            ),
            "easy.forward" | "easy.back" if number == 0.0 => {
                let Some(help) = self.decimal_comma(arguments) else {
                    return;
                };
                (format!("{} for 0 seconds", function.path), help)
            }
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
        self.warning(first.span, message, help);
    }

    /// The first parameter of an inline handler: an event's payload, or an object of the API.
    fn handler(&mut self, function: &'static Function, arguments: &'a [Expr]) {
        for (row, argument) in function.form(arguments.len()).iter().zip(arguments) {
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
        let words = self.source_text(object.span);
        let kind = self.kinds.kind_of(object);
        match kind {
            ValueKind::Namespace(owner) if self.is_ours(owner) => {
                self.function_with_colon(owner, name, at, self.has(owner, name));
            }
            ValueKind::Module(module) => {
                let exists = module.function(name).is_some();
                self.function_with_colon(module.name, name, at, exists);
            }
            ValueKind::Object(of) => match of.method(name) {
                Some(function) => self.call(function, arguments, call.span),
                None if of.field(name).is_some() => {
                    let message = format!("'{name}' is data, not a function: write {words}.{name}");
                    self.error(at, message, "");
                }
                None => self.member(of, name, at),
            },
            ValueKind::List(_) | ValueKind::Nothing => {
                let what = kind.describe().unwrap_or_default();
                let message = format!("'{words}' is {what}: it has no function '{name}'");
                self.error(at, message, "");
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
        self.error(at, message, format!("write {path}(...)"));
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
            let help = "tonumber(text) converts a string to a number";
            self.error(left.span.to(right.span), message, help);
        }
    }

    /// Reports a value that the operator cannot be applied to; returns whether it is one.
    fn wrong_operand(&mut self, operator: &str, side: &'a Expr) -> bool {
        let kind = self.kinds.kind_of(side);
        let words = self.source_text(side.span);
        let help = match kind {
            ValueKind::Object(object) => object.fields.first().map_or_else(String::new, |field| {
                format!("read one of its fields, such as {words}.{}", field.name)
            }),
            ValueKind::List(_) => format!("#{words} is the number of its entries"),
            ValueKind::Native(function) => format!("call it: {}", function.call()),
            ValueKind::Function(_) => format!("call it: {words}()"),
            ValueKind::Boolean if operator == ".." => {
                format!("tostring({words}) converts it to a string")
            }
            ValueKind::Boolean | ValueKind::Nothing => String::new(),
            _ => return false,
        };
        let does = match operator {
            ".." => "cannot be joined to a string",
            "<" | ">" | "<=" | ">=" => "cannot be compared with < or >",
            _ => "cannot be used in arithmetic",
        };
        let what = kind.describe().unwrap_or_default();
        let message = if words == what {
            format!("{what} {does}")
        } else {
            format!("`{words}` is {what}: it {does}")
        };
        self.error(side.span, message, help);
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
            let negated = self.source_text(left.span);
            let negated = negated.trim_start_matches("not").trim();
            let help = format!("write {negated} ~= {}", self.source_text(right.span));
            let message = "`not` applies only to the left side here, so this compares true or \
                           false with something else";
            self.warning(left.span.to(right.span), message, help);
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
        self.warning(text.span, message, format!("known: {}", names.join(", ")));
    }
}

/// Returns the kind of the first parameter in a signature such as `(sim: Sim) -> ()`.
fn first_parameter<'a>(luau: &str) -> ValueKind<'a> {
    let inside = luau.strip_prefix('(').unwrap_or_default();
    let first = inside.split([',', ')']).next().unwrap_or_default();
    let name = first.split_once(": ").map_or("", |(_, name)| name);
    api::object(name).map_or(ValueKind::Unknown, ValueKind::Object)
}

/// An argument or an option, with the row that says what it must be.
#[derive(Clone, Copy)]
struct Passed<'a> {
    call: &'static str,
    value: &'static Value,
    argument: &'a Expr,
    /// The whole call; `None` for an option.
    whole: Option<Span>,
}

impl<'a> Walk<'a> {
    fn call(&mut self, function: &'static Function, arguments: &'a [Expr], span: Span) {
        let call = function.path;
        let most = function.parameters.len();
        let is_open = arguments.last().is_some_and(Expr::is_open);
        if let Some(extra) = arguments.get(most)
            && function.rest.is_none()
            && !(most + 1 == arguments.len() && is_open)
        {
            let got = arguments.len();
            let message = format!("{call}: takes {}, got {got}", counted(most));
            let help = self
                .decimal_comma(arguments)
                .unwrap_or_else(|| function.call());
            self.error(extra.span, message, help);
        }
        let parameters = function.form(arguments.len());
        let is_short = parameters.len() < most;
        for (value, argument) in parameters.into_iter().zip(arguments) {
            let whole = Some(span);
            self.argument(Passed {
                call,
                value,
                argument,
                whole,
            });
        }
        self.stream(function, arguments, span);
        if arguments.len() < function.required_len() && !is_open && !is_short {
            let missing = &function.parameters[arguments.len()];
            let label = missing.label();
            let message = format!("{call}: {label} is missing{}", must_be(missing));
            self.error(span, message, function.call());
        }
        self.special(function, arguments);
    }

    /// The help for `0,5`: two numbers without a blank between them.
    fn decimal_comma(&self, arguments: &'a [Expr]) -> Option<String> {
        let [.., whole, part] = arguments else {
            return None;
        };
        let text = self.source_text(whole.span.to(part.span));
        let is_digit = |c: char| c.is_ascii_digit();
        let (whole, part) = text.split_once(',')?;
        let is_number = whole.chars().all(is_digit) && part.chars().all(is_digit);
        is_number.then(|| format!("decimals come after a point: {whole}.{part}"))
    }

    /// Only a warning: the script may handle a stream that the config keeps off.
    fn stream(&mut self, function: &'static Function, arguments: &'a [Expr], span: Span) {
        let text = match arguments.first().map(|one| self.kinds.kind_of(one)) {
            Some(ValueKind::Text(text)) => text,
            _ => None,
        };
        let on = arguments.get(1).map(|one| &one.bare().kind);
        let switched_off = matches!(on, Some(ExprKind::Boolean(false)));
        let wanted = match function.path {
            "robot.frame" | "robot.wait_frame" => Some(Stream::Video),
            "robot.stream" if !switched_off => text.and_then(Stream::from_name),
            _ if function.takes_an_event() => text
                .and_then(EventName::from_name)
                .and_then(EventName::stream),
            _ => None,
        };
        let streams = self.context.streams;
        if let Some(Err(why)) = wanted.map(|stream| streams.allow(stream)) {
            self.warning(span, format!("{}: {why}", function.path), "");
        }
    }

    fn argument(&mut self, passed: Passed<'a>) {
        let Passed {
            value, argument, ..
        } = passed;
        if value.kind.is_function()
            && let Some(path) = self.answered_by(argument)
        {
            return self.wrong(passed, "a function", &format!("the result of {path}"));
        }
        match self.kinds.kind_of(argument) {
            ValueKind::Nothing => {
                let required = value.is_required();
                if required && !matches!(value.kind, Type::Any) {
                    self.wrong(passed, &value.kind.describe(), "nothing");
                }
            }
            kind => self.fits(passed, kind),
        }
    }

    /// Reports an argument that is not what its row says.
    fn wrong(&mut self, passed: Passed<'a>, wanted: &str, got: &str) {
        let Passed {
            call,
            value,
            argument,
            whole,
        } = passed;
        let help = if value.kind.is_function() {
            passing::help(self.source.text, argument, whole, value.kind.wants_result())
        } else {
            None
        };
        let message = format!("{call}: {} must be {wanted}, got {got}", value.label());
        self.error(argument.span, message, help.unwrap_or_default());
    }

    fn answered_by(&self, argument: &'a Expr) -> Option<&'static str> {
        let ValueKind::Native(function) = self.kinds.callee(argument.bare()) else {
            return None;
        };
        let first = function.returns.first()?;
        let open = matches!(first.kind, Type::Any | Type::Function(_) | Type::Payload);
        (!open).then_some(function.path)
    }

    fn fits(&mut self, passed: Passed<'a>, kind: ValueKind<'a>) {
        let Passed { call, argument, .. } = passed;
        match (&passed.value.kind, kind) {
            (Type::Number(bounds) | Type::Whole(bounds), ValueKind::Number(Some(number))) => {
                self.number(passed, *bounds, number);
            }
            (Type::Choice(choice), ValueKind::Text(Some(text))) => {
                let names = (choice.names)();
                self.known(call, choice.what, text, &names, argument.span);
            }
            (Type::Colours, kind) => self.colour(passed, kind),
            (Type::Options(keys), ValueKind::Table(table)) => self.options(call, keys, table),
            (Type::Named(keys), ValueKind::Table(table)) => {
                for entry in table.entries() {
                    if let (Entry::Named(..), ValueKind::Table(one)) =
                        (entry, self.kinds.kind_of(entry.value()))
                    {
                        self.options(call, keys, one);
                    }
                }
            }
            (wanted, kind) if may_be(wanted, kind) => {}
            (_, kind) => self.wrong_kind(passed, kind),
        }
    }

    fn number(&mut self, passed: Passed<'a>, bounds: Option<Bounds>, number: f64) {
        let is_whole = matches!(passed.value.kind, Type::Whole(_));
        let wanted = match bounds {
            Some(bounds) if !bounds.contains(number) => bounds.describe(),
            _ if is_whole && number.fract() != 0.0 => "a whole number".to_owned(),
            _ => return,
        };
        self.wrong(passed, &wanted, &number.to_string());
    }

    fn wrong_kind(&mut self, passed: Passed<'a>, kind: ValueKind<'a>) {
        let got = match passed.argument.bare().kind {
            ExprKind::Boolean(on) => Some(on.to_string()),
            _ => kind.describe(),
        };
        if let Some(got) = got {
            self.wrong(passed, &passed.value.kind.describe(), &got);
        }
    }

    fn known(&mut self, call: &str, what: &str, name: &str, known: &[&str], span: Span) {
        if known.contains(&name) {
            return;
        }
        let near = self.near(name, known.iter().copied());
        let name = crate::script::printable(name, 40);
        let message = format!("{call}: unknown {what} '{name}'{near}");
        self.error(span, message, format!("known: {}", known.join(", ")));
    }

    fn colour(&mut self, passed: Passed<'a>, kind: ValueKind<'a>) {
        match kind {
            ValueKind::Text(Some(text)) => {
                let own = self.context.colours.iter().map(String::as_str);
                let known: Vec<&str> = own.chain(Colour::NAMES).collect();
                self.known(passed.call, "colour", text, &known, passed.argument.span);
            }
            ValueKind::Table(table) => {
                for entry in table.entries() {
                    let Entry::Item(argument) = entry else {
                        continue;
                    };
                    let kind = self.kinds.kind_of(argument);
                    if !matches!(kind, ValueKind::Table(_) | ValueKind::Nothing) {
                        self.colour(Passed { argument, ..passed }, kind);
                    }
                }
            }
            ValueKind::Object(object) if object.name == "Colour" => {}
            ValueKind::Number(_)
            | ValueKind::Boolean
            | ValueKind::Function(_)
            | ValueKind::Native(_)
            | ValueKind::Object(_) => self.wrong_kind(passed, kind),
            _ => {}
        }
    }

    fn options(&mut self, call: &'static str, keys: &'static [Value], table: &'a Expr) {
        let names: Vec<&str> = keys.iter().map(|key| key.name).collect();
        let mut given = Vec::new();
        let mut certain = true;
        for entry in table.entries() {
            let (name, span) = match entry {
                Entry::Named(name, span, _) => (name.as_str(), *span),
                Entry::Item(item) => {
                    let first = names.first().copied().unwrap_or("name");
                    let message =
                        format!("{call}: an option needs its name, such as {{{first} = ...}}");
                    self.error(item.span, message, "");
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
                Some(value) => self.argument(Passed {
                    call,
                    value,
                    argument: entry.value(),
                    whole: None,
                }),
                None => self.known(call, "option", name, &names, span),
            }
        }
        let missing = keys
            .iter()
            .find(|key| key.is_required() && !given.contains(&key.name));
        if let Some(missing) = missing
            && certain
        {
            let message = format!("{call}: {} is missing{}", missing.name, must_be(missing));
            self.error(table.span, message, "");
        }
    }
}

/// Whether a value of this kind may be what a row wants.
fn may_be(wanted: &Type, kind: ValueKind<'_>) -> bool {
    use ValueKind as K;
    match (wanted, kind) {
        (_, K::Unknown) | (Type::Any | Type::Payload, _) => true,
        (Type::Object(wanted), K::Object(object)) if object.name == *wanted => true,
        (Type::Object(wanted), K::Table(_) | K::Object(_)) => {
            !api::object(wanted).is_some_and(|object| object.strict)
        }
        (wanted, K::Function(_) | K::Native(_)) => wanted.is_function(),
        (Type::Number(_) | Type::Whole(_), K::Number(_))
        | (Type::Boolean, K::Boolean)
        | (Type::Text(_) | Type::Choice(_), K::Text(_))
        | (Type::Options(_) | Type::Buffer, K::Object(_))
        | (Type::Options(_), K::List(_))
        | (Type::List(_), K::Table(_) | K::List(_)) => true,
        (
            Type::Roi | Type::Range | Type::Fields | Type::OneOrMore(_),
            K::Table(_) | K::Object(_) | K::List(_),
        ) => true,
        _ => false,
    }
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
