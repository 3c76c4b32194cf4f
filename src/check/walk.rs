//! Walks a tree and reports what cannot work: names that do not exist, calls with wrong arguments,
//! loops that never wait. What depends on more than the file shows is left to the run.

mod calls;

use std::collections::BTreeSet;

use super::CheckContext;
use super::diagnostic::{Diagnostic, Severity, SourceText, in_quotes};
use super::kinds::{Kinds, ValueKind, of_type, parameters};
use super::lexer::Span;
use super::passing;
use super::tree::{Block, Entry, Expr, ExprKind, LocalId, Statement, StatementKind, Tree};
use crate::api::{self, Function};
use crate::yaml::suggestion;

pub(super) struct Walk<'a> {
    pub(super) kinds: Kinds<'a>,
    pub(super) context: &'a CheckContext,
    source: SourceText<'a>,
    diagnostics: Vec<Diagnostic>,
    /// Number of errors and of warnings beyond the maximum, which are only counted.
    more_errors: usize,
    more_warnings: usize,
}

/// Maximum number of diagnostics per file.
const MAX_DIAGNOSTICS: usize = 200;

pub(super) fn walk<'a>(
    tree: &'a Tree,
    source: SourceText<'a>,
    context: &'a CheckContext,
) -> Vec<Diagnostic> {
    walked(tree, source, context).0
}

/// Same as [`walk`], but also returns what is then known about the names.
pub(super) fn walked<'a>(
    tree: &'a Tree,
    source: SourceText<'a>,
    context: &'a CheckContext,
) -> (Vec<Diagnostic>, Kinds<'a>) {
    let mut walk = Walk {
        kinds: Kinds::new(tree, &context.paths),
        context,
        source,
        diagnostics: Vec::new(),
        more_errors: 0,
        more_warnings: 0,
    };
    walk.block(&tree.block);
    let summary = walk.summary();
    let mut diagnostics = walk.diagnostics;
    diagnostics.sort_by_key(|diagnostic| (diagnostic.line, diagnostic.column));
    diagnostics.dedup();
    diagnostics.extend(summary);
    (diagnostics, walk.kinds)
}

/// Names of variables that are meant to count.
const COUNTERS: [&str; 7] = ["_", "i", "j", "k", "n", "index", "number"];

impl<'a> Walk<'a> {
    /// `help` says what to do; empty if that is clear from the message.
    fn error(&mut self, span: Span, message: impl Into<String>, help: impl Into<String>) {
        if self.is_full() {
            self.more_errors += 1;
        } else {
            self.diagnostics
                .push(self.source.error(span, message).help(help));
        }
    }

    fn warning(&mut self, span: Span, message: impl Into<String>, help: impl Into<String>) {
        if self.is_full() {
            self.more_warnings += 1;
        } else {
            let warning = Diagnostic::new(self.source, span, Severity::Warning, message);
            self.diagnostics.push(warning.help(help));
        }
    }

    /// Returns one diagnostic that stands for all that were only counted.
    fn summary(&self) -> Option<Diagnostic> {
        let count = self.more_errors + self.more_warnings;
        if count == 0 {
            return None;
        }
        let severity = if self.more_errors > 0 {
            Severity::Error
        } else {
            Severity::Warning
        };
        let end = self.source.text.trim_end().len();
        let span = Span { start: end, end };
        let message = format!("and {count} more mistakes in this file");
        let summary = Diagnostic::new(self.source, span, severity, message);
        Some(summary.help("correct the first ones first"))
    }

    fn is_full(&self) -> bool {
        self.diagnostics.len() >= MAX_DIAGNOSTICS
    }

    /// Empty when the maximum of diagnostics is reached, as the search takes long.
    fn near<'n>(&self, wrong: &str, known: impl IntoIterator<Item = &'n str>) -> String {
        if self.is_full() {
            String::new()
        } else {
            suggestion(wrong, known)
        }
    }

    fn source_text(&self, span: Span) -> String {
        crate::script::printable(span.of(self.source.text), 60)
    }

    // Statements -----------------------------------------------------------------------------

    fn block(&mut self, block: &'a Block) {
        for statement in block {
            self.statement(statement);
        }
    }

    fn statement(&mut self, statement: &'a Statement) {
        use StatementKind as S;
        match &statement.kind {
            S::Local(ids, values) => {
                self.exprs(values);
                self.declare(ids, values);
            }
            S::LocalFunction(id, body) => {
                self.hides(*id);
                self.kinds.bind(*id, ValueKind::Function(Some(body)));
                self.block(&body.block);
            }
            S::Function(target, body) => {
                self.target(target);
                self.block(&body.block);
            }
            S::Assign(targets, values) => {
                targets.iter().for_each(|target| self.target(target));
                self.exprs(values);
            }
            S::Compound(target, operator, value) => {
                self.expr(target);
                self.expr(value);
                self.operands(operator, target, value);
            }
            S::Call(call) => {
                self.expr(call);
                self.unused(call);
            }
            S::Return(values) => self.exprs(values),
            S::Leave | S::Type => {}
            _ => self.blocks(statement),
        }
    }

    fn blocks(&mut self, statement: &'a Statement) {
        use StatementKind as S;
        match &statement.kind {
            S::While(condition, block) => {
                self.condition(condition);
                self.endless(statement, condition, block);
                self.block(block);
            }
            S::Count(id, values, block) => {
                self.exprs(values);
                self.kinds.bind(*id, ValueKind::Number(None));
                self.block(block);
            }
            S::Each(ids, values, block) => {
                self.exprs(values);
                self.each(ids, values);
                self.block(block);
            }
            S::If(arms, otherwise) => {
                for (condition, block) in arms {
                    self.condition(condition);
                    self.block(block);
                }
                otherwise.iter().for_each(|block| self.block(block));
            }
            S::Repeat(block, condition) => {
                self.block(block);
                self.condition(condition);
            }
            S::Do(block) => self.block(block),
            _ => {}
        }
    }

    fn declare(&mut self, ids: &'a [LocalId], values: &'a [Expr]) {
        for (at, id) in ids.iter().enumerate() {
            self.hides(*id);
            let kind = match (values.get(at), values.last()) {
                (Some(value), _) if at + 1 < values.len() => self.kinds.kind_of(value),
                (_, Some(last)) if last.is_call() => {
                    let number = at + 1 - values.len().min(at + 1);
                    self.kinds.bind_choice(*id, last, number);
                    self.kinds.result(last, number)
                }
                (Some(value), _) => self.kinds.kind_of(value),
                (None, Some(last)) if matches!(last.kind, ExprKind::Varargs) => ValueKind::Unknown,
                (None, _) => ValueKind::Nothing,
            };
            // A table may get more fields later.
            let kind = match kind {
                ValueKind::Table(_) => ValueKind::Unknown,
                kind => kind,
            };
            self.kinds.bind(*id, kind);
        }
    }

    /// Warns of a local variable that hides a namespace of the API.
    fn hides(&mut self, id: LocalId) {
        let tree = self.kinds.tree;
        let local = &tree.locals[id.0];
        let ours = !local.name.is_empty() && api::namespace(&local.name).is_some();
        // `local params = params.declare{...}` is the intended use.
        let usual = local.name == "params";
        if ours && !usual && self.kinds.namespace(&local.name) {
            let message = format!(
                "this variable hides {0}: from here on {0}.* cannot be called",
                local.name
            );
            self.warning(local.span, message, "give it another name");
        }
    }

    fn each(&mut self, ids: &'a [LocalId], values: &'a [Expr]) {
        let [one] = values else { return };
        let list = match &one.kind {
            ExprKind::Call(callee, arguments) if matches!(&callee.kind, ExprKind::Global(name) if name == "ipairs" || name == "pairs") =>
            {
                let list = arguments.first();
                list.map_or(ValueKind::Unknown, |list| self.kinds.kind_of(list))
            }
            _ => self.kinds.kind_of(one),
        };
        let ValueKind::List(of) = list else { return };
        match ids {
            [index, item, ..] => {
                self.kinds.bind(*index, ValueKind::Number(None));
                self.kinds.bind(*item, of_type(*of));
            }
            [index] => {
                let name = self.kinds.tree.locals[index.0].name.clone();
                let is_thing = matches!(of_type(*of), ValueKind::Object(_));
                if is_thing && !COUNTERS.contains(&name.as_str()) {
                    let message = format!("`{name}` is 1, 2, 3, ... here, not a thing of the list");
                    let help = format!("for the things themselves, write for _, {name} in ... do");
                    self.warning(one.span, message, help);
                }
            }
            [] => {}
        }
    }

    fn target(&mut self, target: &'a Expr) {
        match &target.kind {
            ExprKind::Global(_) | ExprKind::Local(_) => {}
            ExprKind::Field(object, name, _) => {
                self.expr(object);
                if let ValueKind::Namespace(owner) = self.kinds.kind_of(object) {
                    let message = format!("{owner}.{name} cannot be set");
                    let help = "keep your own values in a local variable";
                    self.error(target.span, message, help);
                }
            }
            _ => self.exprs(target.parts()),
        }
    }

    /// Warns of a function used as a condition without a call: it is always true.
    fn condition(&mut self, condition: &'a Expr) {
        self.expr(condition);
        let mut parts = vec![condition];
        while let Some(part) = parts.pop() {
            match &part.bare().kind {
                ExprKind::Binary(operator, left, right)
                    if operator == "and" || operator == "or" =>
                {
                    parts.extend([&**left, &**right]);
                }
                ExprKind::Unary(operator, operand) if operator == "not" => parts.push(operand),
                _ => {
                    if let ValueKind::Native(function) = self.kinds.kind_of(part) {
                        let path = function.path;
                        let message = format!("{path} is a function here, which is always true");
                        self.warning(part.span, message, format!("call it: {}", function.call()));
                    }
                }
            }
        }
    }

    fn unused(&mut self, call: &'a Expr) {
        let ValueKind::Native(function) = self.kinds.callee(call) else {
            return;
        };
        if function.pure {
            let path = function.path;
            let message = format!("{path} only returns a value, and the value is not used");
            let result = function
                .returns
                .first()
                .map_or("answer", |value| value.name);
            let words = self.source_text(call.span);
            self.warning(
                call.span,
                message,
                format!("keep it: local {result} = {words}"),
            );
        }
    }

    fn endless(&mut self, statement: &'a Statement, condition: &'a Expr, block: &'a Block) {
        if always_true(condition) && !may_pause(&self.kinds, block) {
            let line_end = Span {
                start: statement.span.start,
                end: condition.span.end,
            };
            let message = "this loop never waits: the script would be ended after 0.1 s";
            self.warning(line_end, message, "put task.wait(0.1) into it");
        }
    }

    // Expressions ------------------------------------------------------------------------------

    fn exprs(&mut self, exprs: impl IntoIterator<Item = &'a Expr>) {
        for expr in exprs {
            self.expr(expr);
        }
    }

    fn expr(&mut self, expr: &'a Expr) {
        match &expr.kind {
            ExprKind::Global(name) => return self.global(name, expr.span),
            ExprKind::Function(body) => return self.block(&body.block),
            ExprKind::Call(callee, arguments) => return self.called(expr, callee, arguments),
            ExprKind::Method(..) => return self.method(expr),
            ExprKind::Field(object, name, at) => {
                self.expr(object);
                return self.field(object, name, *at);
            }
            ExprKind::Item(list, index) => self.item(list, index, expr.span),
            ExprKind::Binary(operator, left, right) => self.operands(operator, left, right),
            ExprKind::Table(entries) => entries.iter().for_each(|entry| self.kept(entry)),
            _ => {}
        }
        self.exprs(expr.parts());
    }

    /// Warns of `enter = robot.led("left", true)`: the call has no result that the name could get.
    fn kept(&mut self, entry: &'a Entry) {
        if let Entry::Named(name, _, value) = entry
            && let ExprKind::Call(callee, _) = &value.kind
            && let ValueKind::Native(function) = self.kinds.kind_of(callee)
            && function.returns.is_empty()
        {
            let message = format!("`{name}` stays nil: {} returns nothing", function.path);
            let help = passing::help(self.source.text, value, None, false);
            self.warning(value.span, message, help.unwrap_or_default());
        }
    }

    fn global(&mut self, name: &'a str, span: Span) {
        let paths = &self.context.paths;
        if paths.contains(name) || self.kinds.globals.contains(name) || self.context.open_globals {
            return;
        }
        let (message, mut help) = self.unknown_name(name, span);
        if help.is_empty() && !message.ends_with('?') {
            let behind = &self.source.text[span.end..];
            help = text_without_quotes(name, behind).unwrap_or_default();
        }
        self.error(span, message, help);
    }

    fn unknown_name(&self, name: &str, span: Span) -> (String, String) {
        if self.is_full() {
            return (String::new(), String::new());
        }
        let tree = self.kinds.tree;
        let elsewhere = tree.locals.iter().find(|local| local.name == name);
        if let Some(local) = elsewhere {
            let line = self.source.text[..local.span.start].matches('\n').count() + 1;
            let message = format!("'{name}' is not known here");
            let help = if local.span.start > span.start {
                format!("it is defined further down, in line {line}; move that above this line")
            } else {
                format!(
                    "the '{name}' of line {line} is known only inside its own block; declare it before that block"
                )
            };
            return (message, help);
        }
        let elsewhere = || api::elsewhere(name, self.context.paths.contains(api::SCENARIO));
        if let Some(help) = meant(name).or_else(elsewhere) {
            return (format!("unknown name '{name}'"), help);
        }
        let globals = self.context.paths.iter().map(String::as_str);
        let globals = globals.filter(|path| !path.contains('.'));
        let own = tree.locals.iter().map(|local| local.name.as_str());
        let set = self.kinds.globals.iter().copied();
        let near = self.near(name, globals.chain(own).chain(set));
        let help = if near.is_empty() {
            belongs_to(name, &self.context.paths)
        } else {
            None
        };
        (
            format!("unknown name '{name}'{near}"),
            help.unwrap_or_default(),
        )
    }

    fn field(&mut self, object: &'a Expr, name: &str, at: Span) {
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
                    self.error(at, message, format!("declared: {}", known.join(", ")));
                }
            }
            ValueKind::Object(of) => self.member(of, name, at),
            ValueKind::List(_) if !self.kinds.fields.contains(name) => {
                let list = self.source_text(object.span);
                let message =
                    format!("this is a list: its entries have '{name}', the list itself does not");
                let help = format!(
                    "take one of its entries: {list}[1].{name}; the list may be empty, so test it first"
                );
                self.error(at, message, help);
            }
            ValueKind::Native(function) => {
                let message = format!("{} is a function: it has no '{name}'", function.path);
                self.error(at, message, format!("call it: {}", function.call()));
            }
            _ => {}
        }
    }

    fn has(&self, owner: &str, name: &str) -> bool {
        let paths = &self.context.paths;
        paths.contains(&format!("{owner}.{name}"))
    }

    /// These are strict; unknown fields of Luau's own are nil.
    fn is_ours(&self, owner: &str) -> bool {
        !owner.is_empty() && api::namespace(owner).is_some()
    }

    fn unknown_field(&mut self, owner: &str, name: &str, at: Span) {
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
            belongs_to(name, &self.context.paths)
                .or_else(|| meant(name))
                .or_else(|| api::module(owner).map(members))
        } else {
            None
        };
        let message = format!("{owner}.{name} does not exist{near}");
        self.error(at, message, help.unwrap_or_default());
    }

    fn member(&mut self, object: &'static api::Object, name: &str, at: Span) {
        let known = object.members();
        let own = !object.strict && self.kinds.fields.contains(name);
        if known.contains(&name) || own {
            return;
        }
        let near = self.near(name, known.iter().copied());
        let message = format!("{} has no '{name}'{near}", api::with_article(object.name));
        self.error(at, message, format!("it has {}", known.join(", ")));
    }

    fn item(&mut self, list: &'a Expr, index: &'a Expr, span: Span) {
        if let (ValueKind::List(_), ValueKind::Number(Some(0.0))) =
            (self.kinds.kind_of(list), self.kinds.kind_of(index))
        {
            let help = format!("the first is {}[1]", self.source_text(list.span));
            self.error(span, "lists begin at 1: there is nothing at 0", help);
        }
    }
}

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
    match statement.kind {
        StatementKind::Leave | StatementKind::Return(_) if depth == 0 => return true,
        StatementKind::Function(..) | StatementKind::LocalFunction(..) => return false,
        _ => {}
    }
    let mut exprs = statement.exprs().into_iter();
    let mut inner = statement.blocks().into_iter().flatten();
    exprs.any(|expr| expr.any(&|part| call_pauses(kinds, part, depth)))
        || inner.any(|statement| pauses(kinds, statement, depth))
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
        ExprKind::Method(..) => match kinds.callee(expr) {
            ValueKind::Native(function) => function.waits,
            _ => true,
        },
        _ => false,
    }
}

fn native_pauses(function: &Function, arguments: &[Expr]) -> bool {
    match function.path {
        "robot.move" | "robot.drive" => match arguments.last() {
            Some(last) => arguments.len() > 2 || last.any(&Expr::is_open),
            None => true,
        },
        "script.stop" => true,
        _ => function.waits,
    }
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

/// The object that only scenarios get.
const SIM: &str = "Sim";

/// Names from other languages, and what to write instead.
const MEANT: [(&str, &str); 35] = [
    ("null", "it is written nil"),
    ("None", "it is written nil"),
    ("undefined", "it is written nil"),
    ("True", "it is written true, in small letters"),
    ("False", "it is written false, in small letters"),
    ("TRUE", "it is written true, in small letters"),
    ("FALSE", "it is written false, in small letters"),
    ("wait", "to wait, write task.wait(seconds)"),
    ("sleep", "to wait, write task.wait(seconds)"),
    (
        "delay",
        "to wait, write task.wait(seconds); task.delay(seconds, fn) calls a function later",
    ),
    (
        "spawn",
        "to run a function in parallel, write task.spawn(fn)",
    ),
    ("import", "load a module with require(\"./name\")"),
    ("include", "load a module with require(\"./name\")"),
    (
        "frame",
        "it is a parameter of the function: robot.on(\"frame\", function(frame) ... end)",
    ),
    (
        "on",
        "for easy.light write \"on\", in quotes; for robot.led write true",
    ),
    (
        "off",
        "for easy.light write \"off\", in quotes; for robot.led write false",
    ),
    ("elif", "it is written elseif"),
    ("elsif", "it is written elseif"),
    ("def", "functions begin with the word function"),
    ("fn", "functions begin with the word function"),
    ("func", "functions begin with the word function"),
    ("var", "variables begin with the word local"),
    ("let", "variables begin with the word local"),
    ("const", "variables begin with the word local"),
    ("console", "to write something, use print(...)"),
    ("echo", "to write something, use print(...)"),
    ("printf", "to write something, use print(...)"),
    ("len", "the length of a list or text is #list"),
    ("range", "to count, write for i = 1, 10 do"),
    ("str", "tostring(value) converts a value to a string"),
    (
        "int",
        "tonumber(text) converts a string to a number; math.floor(x) rounds down",
    ),
    ("self", "only functions declared with a colon have self"),
    (
        "this",
        "only functions declared with a colon have self; there is no this",
    ),
    (
        "os",
        "scripts have no os; clock.date() is the time of day, task.now() counts seconds",
    ),
    (
        "io",
        "scripts have no files; print, log and frame:save(name) write",
    ),
];

/// The help for an unknown name that was perhaps meant as a text: one that is passed or kept.
pub(super) fn text_without_quotes(name: &str, behind: &str) -> Option<String> {
    let behind = behind.trim_start_matches(' ');
    let is_whole = behind.starts_with([')', ',', '}', '\n']);
    is_whole.then(|| in_quotes(name))
}

pub(super) fn meant(name: &str) -> Option<String> {
    let found = MEANT.iter().find(|(foreign, _)| *foreign == name);
    found.map(|(_, meant)| (*meant).to_owned())
}

/// Says where a function of this name belongs. `known` are the paths that exist in this file.
fn belongs_to(name: &str, known: &BTreeSet<String>) -> Option<String> {
    let text = api::choices().find(|choice| (choice.names)().contains(&name));
    if let Some(choice) = text {
        return Some(format!(
            "if you mean the {}, write its name in quotes: \"{name}\"",
            choice.what
        ));
    }
    let mut functions = api::functions();
    let found = functions.find(|function| function.key() == name && known.contains(function.path));
    if let Some(found) = found {
        return Some(format!("did you mean {}?", found.path));
    }
    let mut objects =
        api::objects().filter(|object| known.contains(api::SCENARIO) || object.name != SIM);
    let owner = objects.find(|object| object.method(name).is_some())?;
    Some(format!(
        "{name} is a function of {}",
        api::with_article(owner.name)
    ))
}
