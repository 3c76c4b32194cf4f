//! Walks a tree and says what cannot work: names that do not exist, calls that do not fit, loops
//! that never wait. Whatever depends on more than the file tells is left to the run.

use super::super::api::definition::{self, Function, Type};
use super::super::nearest::suggestion;
use super::Surroundings;
use super::calls::Site;
use super::finding::{Finding, Severity};
use super::foreign;
use super::kinds::{Kind, Kinds, of_type};
use super::lexer::Span;
use super::loops;
use super::parameters;
use super::tree::{Block, Body, Expr, ExprKind, LocalId, Statement, StatementKind, Tree};

pub(super) struct Walk<'a> {
    pub(super) kinds: Kinds<'a>,
    pub(super) surroundings: &'a Surroundings,
    /// File and source.
    text: (&'a str, &'a str),
    findings: Vec<Finding>,
}

/// All that is wrong in a tree, in the order of the text.
pub(super) fn walk<'a>(
    tree: &'a Tree,
    text: (&'a str, &'a str),
    surroundings: &'a Surroundings,
) -> Vec<Finding> {
    walked(tree, text, surroundings).0
}

/// The same, with what is known of the names afterwards.
pub(super) fn walked<'a>(
    tree: &'a Tree,
    text: (&'a str, &'a str),
    surroundings: &'a Surroundings,
) -> (Vec<Finding>, Kinds<'a>) {
    let mut walk = Walk {
        kinds: Kinds::new(tree, &surroundings.paths),
        surroundings,
        text,
        findings: Vec::new(),
    };
    walk.block(&tree.block);
    let mut findings = walk.findings;
    findings.sort_by_key(|finding| (finding.line, finding.column));
    findings.dedup();
    (findings, walk.kinds)
}

impl<'a> Walk<'a> {
    pub(super) fn error(&mut self, span: Span, message: impl Into<String>) -> &mut Finding {
        self.note(span, Severity::Error, message)
    }

    fn warning(&mut self, span: Span, message: impl Into<String>) -> &mut Finding {
        self.note(span, Severity::Warning, message)
    }

    fn note(&mut self, span: Span, severity: Severity, message: impl Into<String>) -> &mut Finding {
        let finding = Finding::new(self.text, span, severity, message);
        self.findings.push(finding);
        let last = self.findings.len() - 1;
        &mut self.findings[last]
    }

    fn words(&self, span: Span) -> String {
        super::super::failure::printable(span.of(self.text.1), 60)
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
                self.kinds.bind(*id, Kind::Function(Some(body)));
                self.body(body);
            }
            S::Function(target, body) => {
                self.target(target);
                self.body(body);
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
            S::While(condition, block) => {
                self.expr(condition);
                self.endless(statement, condition, block);
                self.block(block);
            }
            S::Count(id, values, block) => {
                self.exprs(values);
                self.kinds.bind(*id, Kind::Number(None));
                self.block(block);
            }
            S::Each(ids, values, block) => {
                self.exprs(values);
                self.each(ids, values);
                self.block(block);
            }
            S::If(arms, otherwise) => {
                for (condition, block) in arms {
                    self.expr(condition);
                    self.block(block);
                }
                otherwise.iter().for_each(|block| self.block(block));
            }
            S::Repeat(block, condition) => {
                self.block(block);
                self.expr(condition);
            }
            S::Return(values) => self.exprs(values),
            S::Do(block) => self.block(block),
            S::Leave | S::Type => {}
        }
    }

    fn declare(&mut self, ids: &'a [LocalId], values: &'a [Expr]) {
        for (at, id) in ids.iter().enumerate() {
            self.hides(*id);
            let kind = match (values.get(at), values.last()) {
                (Some(value), _) if at + 1 < values.len() => self.kinds.of(value),
                (_, Some(last))
                    if matches!(last.kind, ExprKind::Call(..) | ExprKind::Method(..)) =>
                {
                    self.kinds.result(last, at + 1 - values.len().min(at + 1))
                }
                (Some(value), _) => self.kinds.of(value),
                (None, Some(last)) if matches!(last.kind, ExprKind::Varargs) => Kind::Unknown,
                (None, _) => Kind::Nothing,
            };
            // A table written out here may be filled later.
            let kind = match kind {
                Kind::Table(_) => Kind::Unknown,
                kind => kind,
            };
            self.kinds.bind(*id, kind);
        }
    }

    /// A local name that hides a namespace makes its calls unreachable.
    fn hides(&mut self, id: LocalId) {
        let tree = self.kinds.tree;
        let local = &tree.locals[id.0];
        let ours = definition::functions().any(|one| one.owner() == local.name && !one.is_method());
        // `local params = params.declare{...}` is how it is meant.
        let usual = local.name == "params";
        if ours && !usual && self.kinds.namespace(&local.name) {
            let message = format!(
                "this variable hides {0}: from here on {0}.* cannot be called",
                local.name
            );
            self.warning(local.span, message).help = Some("give it another name".to_owned());
        }
    }

    fn each(&mut self, ids: &'a [LocalId], values: &'a [Expr]) {
        let [one] = values else { return };
        let list = match &one.kind {
            ExprKind::Call(callee, arguments) if matches!(&callee.kind, ExprKind::Global(name) if name == "ipairs" || name == "pairs") => {
                arguments
                    .first()
                    .map_or(Kind::Unknown, |list| self.kinds.of(list))
            }
            _ => self.kinds.of(one),
        };
        if let (Kind::List(of), [index, item, ..]) = (list, ids) {
            self.kinds.bind(*index, Kind::Number(None));
            self.kinds.bind(*item, of_type(of));
        }
    }

    fn target(&mut self, target: &'a Expr) {
        match &target.kind {
            ExprKind::Global(_) | ExprKind::Local(_) => {}
            ExprKind::Field(object, name, _) => {
                self.expr(object);
                if let Kind::Namespace(owner) = self.kinds.of(object) {
                    let message = format!("{owner}.{name} cannot be set");
                    self.error(target.span, message).help =
                        Some("keep your own values in a local variable".to_owned());
                }
            }
            _ => self.exprs(target.parts()),
        }
    }

    fn unused(&mut self, call: &'a Expr) {
        let function = match &call.kind {
            ExprKind::Call(callee, _) => match self.kinds.of(callee) {
                Kind::Native(function) => function,
                _ => return,
            },
            ExprKind::Method(object, name, ..) => {
                match self.kinds.method(self.kinds.of(object), name) {
                    Some(function) => function,
                    None => return,
                }
            }
            _ => return,
        };
        if function.only_answers() {
            let message = format!(
                "{} only answers, and nobody looks at the answer",
                function.path
            );
            let result = function
                .returns
                .first()
                .map_or("answer", |value| value.name);
            self.warning(call.span, message).help = Some(format!(
                "keep it: local {result} = {}",
                self.words(call.span)
            ));
        }
    }

    fn endless(&mut self, statement: &'a Statement, condition: &'a Expr, block: &'a Block) {
        if loops::always_true(condition) && !loops::may_pause(&self.kinds, block) {
            let line_end = Span {
                start: statement.span.start,
                end: condition.span.end,
            };
            let message = "this loop never waits: the script would be ended after 0.1 s";
            self.warning(line_end, message).help = Some("put task.wait(0.1) into it".to_owned());
        }
    }

    // Expressions ------------------------------------------------------------------------------

    fn exprs(&mut self, exprs: impl IntoIterator<Item = &'a Expr>) {
        for expr in exprs {
            self.expr(expr);
        }
    }

    fn body(&mut self, body: &'a Body) {
        self.block(&body.block);
    }

    fn expr(&mut self, expr: &'a Expr) {
        match &expr.kind {
            ExprKind::Global(name) => return self.global(name, expr.span),
            ExprKind::Function(body) => return self.body(body),
            ExprKind::Call(callee, arguments) => return self.called(expr, callee, arguments),
            ExprKind::Method(object, name, at, arguments) => {
                return self.method(expr, object, (name, *at), arguments);
            }
            ExprKind::Field(object, name, at) => {
                self.expr(object);
                return self.field(object, name, *at);
            }
            ExprKind::Item(list, index) => self.item(list, index, expr.span),
            ExprKind::Binary(operator, left, right) => self.operands(operator, left, right),
            _ => {}
        }
        self.exprs(expr.parts());
    }

    fn global(&mut self, name: &'a str, span: Span) {
        let paths = &self.surroundings.paths;
        if paths.contains(name)
            || self.kinds.globals.contains(name)
            || self.surroundings.open_globals
        {
            return;
        }
        let (message, help) = self.unknown_name(name, span);
        self.error(span, message).help = help;
    }

    fn unknown_name(&self, name: &str, span: Span) -> (String, Option<String>) {
        let tree = self.kinds.tree;
        let elsewhere = tree.locals.iter().find(|local| local.name == name);
        if let Some(local) = elsewhere {
            let line = self.text.1[..local.span.start].matches('\n').count() + 1;
            let message = format!("'{name}' is not known here");
            let help = match local.span.start > span.start {
                true => {
                    format!("it is made further down, in line {line}; move that above this line")
                }
                false => format!(
                    "the '{name}' of line {line} is known only inside of its own block; declare it before that block"
                ),
            };
            return (message, Some(help));
        }
        if let Some(meant) = foreign::meant(name) {
            return (format!("unknown name '{name}'"), Some(meant.to_owned()));
        }
        let globals = self.surroundings.paths.iter().map(String::as_str);
        let globals = globals.filter(|path| !path.contains('.'));
        let own = tree.locals.iter().map(|local| local.name.as_str());
        let set = self.kinds.globals.iter().copied();
        let near = suggestion(name, globals.chain(own).chain(set));
        let help = match near.is_empty() {
            true => foreign::belongs_to(name),
            false => None,
        };
        (format!("unknown name '{name}'{near}"), help)
    }

    fn field(&mut self, object: &'a Expr, name: &str, at: Span) {
        match self.kinds.of(object) {
            Kind::Namespace(owner) if self.is_ours(owner) && !self.has(owner, name) => {
                self.unknown_field(owner, name, at);
            }
            Kind::Object(of) => self.member(of, name, at),
            Kind::List(_) if !self.kinds.fields.contains(name) => {
                let list = self.words(object.span);
                let message =
                    format!("this is a list: it has no '{name}', only the things in it have");
                self.error(at, message).help = Some(format!(
                    "take one of it: {list}[1].{name}; there may be none, so test it first"
                ));
            }
            Kind::Native(function) => {
                let message = format!("{} is a function: it has no '{name}'", function.path);
                self.error(at, message).help = Some(format!("call it: {}", function.call()));
            }
            _ => {}
        }
    }

    fn has(&self, owner: &str, name: &str) -> bool {
        let paths = &self.surroundings.paths;
        paths.contains(&format!("{owner}.{name}"))
    }

    /// Namespaces of our own are strict; those of the language give nil.
    fn is_ours(&self, owner: &str) -> bool {
        definition::functions().any(|one| one.owner() == owner && !one.is_method())
    }

    fn unknown_field(&mut self, owner: &str, name: &str, at: Span) {
        let inside = format!("{owner}.");
        let paths = self.surroundings.paths.iter();
        let known: Vec<_> = paths
            .filter_map(|path| path.strip_prefix(&inside))
            .collect();
        let near = suggestion(name, known);
        let help = match near.is_empty() {
            true => foreign::belongs_to(name),
            false => None,
        };
        self.error(at, format!("{owner}.{name} does not exist{near}"))
            .help = help;
    }

    fn member(&mut self, object: &'static definition::Object, name: &str, at: Span) {
        let known = definition::members(object);
        let own = !object.strict && self.kinds.fields.contains(name);
        if known.contains(&name) || own {
            return;
        }
        let near = suggestion(name, known.iter().copied());
        let message = format!("{} has no '{name}'{near}", article(object.name));
        self.error(at, message).help = Some(format!("it has {}", known.join(", ")));
    }

    fn item(&mut self, list: &'a Expr, index: &'a Expr, span: Span) {
        if let (Kind::List(_), Kind::Number(Some(0.0))) =
            (self.kinds.of(list), self.kinds.of(index))
        {
            self.error(span, "lists begin at 1: there is nothing at 0")
                .help = Some(format!("the first is {}[1]", self.words(list.span)));
        }
    }

    fn called(&mut self, call: &'a Expr, callee: &'a Expr, arguments: &'a [Expr]) {
        self.expr(callee);
        let kind = self.kinds.of(callee);
        if let Kind::Native(function) = kind {
            self.handler(function, arguments);
        }
        self.exprs(arguments);
        match kind {
            Kind::Native(function) => {
                self.call(Site {
                    function,
                    arguments,
                    span: call.span,
                });
                self.special(function, arguments);
            }
            Kind::Namespace(name) => {
                self.error(callee.span, format!("{name} is no function"))
                    .help = Some(format!("its functions are called as {name}.NAME()"));
            }
            Kind::Nothing | Kind::Number(_) | Kind::Boolean | Kind::Text(_) | Kind::List(_) => {
                let what = kind.words().unwrap_or_default();
                let message = format!("'{}' is {what}, not a function", self.words(callee.span));
                self.error(callee.span, message);
            }
            _ => self.library(callee, arguments),
        }
    }

    /// Calls of what is no native: functions of the language that do not exist, and methods called
    /// with a dot.
    fn library(&mut self, callee: &'a Expr, arguments: &'a [Expr]) {
        let ExprKind::Field(object, name, at) = &callee.kind else {
            return;
        };
        match self.kinds.of(object) {
            Kind::Namespace(owner)
                if owner != "_G" && !self.is_ours(owner) && !self.has(owner, name) =>
            {
                self.unknown_field(owner, name, *at);
            }
            Kind::Object(of) if of.methods().any(|method| method.key() == name) => {
                let again = arguments.first().map(|first| self.kinds.of(first));
                if !matches!(again, Some(Kind::Object(_) | Kind::Unknown)) {
                    let object = self.words(object.span);
                    let message = format!("{name} is called with a colon: {object}:{name}(...)");
                    self.error(*at, message);
                }
            }
            _ => {}
        }
    }

    /// Calls whose arguments depend on what is around the script.
    fn special(&mut self, function: &'static Function, arguments: &'a [Expr]) {
        let [argument] = arguments else { return };
        let wrong = match (function.path, self.kinds.of(argument)) {
            ("require", Kind::Text(Some(path))) => self.surroundings.missing_module(path),
            ("params.declare", Kind::Table(table)) => {
                parameters::refused(&self.kinds, table, &self.surroundings.params)
            }
            _ => None,
        };
        if let Some(wrong) = wrong {
            self.error(argument.span, wrong);
        }
    }

    /// What a handler's parameter is follows from the event's name.
    fn handler(&mut self, function: &'static Function, arguments: &'a [Expr]) {
        let at = function
            .parameters
            .iter()
            .position(|one| matches!(one.kind, Type::Handler));
        let handler = at.and_then(|at| arguments.get(at));
        if let Some(ExprKind::Function(body)) = handler.map(|handler| &handler.kind)
            && let Some(first) = body.parameters.first()
        {
            let payload = self.kinds.payload(arguments);
            self.kinds.bind(*first, payload);
        }
    }

    fn method(
        &mut self,
        call: &'a Expr,
        object: &'a Expr,
        (name, at): (&'a str, Span),
        arguments: &'a [Expr],
    ) {
        self.expr(object);
        self.exprs(arguments);
        match self.kinds.of(object) {
            Kind::Namespace(owner) if self.is_ours(owner) => {
                let path = format!("{owner}.{name}");
                if self.surroundings.paths.contains(&path) {
                    let message = format!("{path} is called with a dot, not with a colon");
                    self.error(at, message).help = Some(format!("write {path}(...)"));
                } else {
                    self.unknown_field(owner, name, at);
                }
            }
            Kind::Object(of) => match of.methods().find(|method| method.key() == name) {
                Some(function) => self.call(Site {
                    function,
                    arguments,
                    span: call.span,
                }),
                None if of.fields.iter().any(|field| field.name == name) => {
                    let words = self.words(object.span);
                    let message = format!("'{name}' is data, not a function: write {words}.{name}");
                    self.error(at, message);
                }
                None => self.member(of, name, at),
            },
            Kind::List(_) | Kind::Nothing => {
                let what = self.kinds.of(object).words().unwrap_or_default();
                let message = format!(
                    "'{}' is {what}: it has no function '{name}'",
                    self.words(object.span)
                );
                self.error(at, message);
            }
            _ => {}
        }
    }

    /// Arithmetic, order and joining of what is neither number nor text.
    fn operands(&mut self, operator: &str, left: &'a Expr, right: &'a Expr) {
        let compares = matches!(operator, "<" | ">" | "<=" | ">=");
        let counts = matches!(operator, "+" | "-" | "*" | "/" | "//" | "%" | "^");
        if operator == "=="
            && matches!(left.kind, ExprKind::Unary(ref not, _) if not == "not")
            && !matches!(self.kinds.of(right), Kind::Boolean | Kind::Unknown)
        {
            let help = format!(
                "write {} ~= {}",
                self.words(left.span).trim_start_matches("not").trim(),
                self.words(right.span)
            );
            let message = "`not` belongs to the left side alone here, so this compares true or false with something else";
            self.warning(left.span.to(right.span), message).help = Some(help);
        }
        if !(compares || counts || operator == "..") {
            return;
        }
        for side in [left, right] {
            let kind = self.kinds.of(side);
            let wrong = match kind {
                Kind::Object(_)
                | Kind::List(_)
                | Kind::Nothing
                | Kind::Native(_)
                | Kind::Function(_) => true,
                Kind::Boolean => operator != "==",
                _ => false,
            };
            let what = self.got_words(side, kind);
            if wrong && let Some(what) = what {
                let does = match operator {
                    ".." => "cannot be joined to a text",
                    _ if compares => "cannot be compared with < or >",
                    _ => "cannot be counted with",
                };
                let words = self.words(side.span);
                let message = match words == what {
                    true => format!("{what} {does}"),
                    false => format!("`{words}` is {what}: it {does}"),
                };
                let help = self.what_to_read(side, kind, operator);
                self.error(side.span, message).help = help;
                return;
            }
        }
        if let (true, Kind::Number(_), Kind::Text(_)) | (true, Kind::Text(_), Kind::Number(_)) =
            (compares, self.kinds.of(left), self.kinds.of(right))
        {
            self.error(
                left.span.to(right.span),
                "a number cannot be compared with a text",
            )
            .help = Some("tonumber(text) makes a number of a text".to_owned());
        }
    }

    fn got_words(&self, side: &Expr, kind: Kind<'a>) -> Option<String> {
        match side.bare().kind {
            ExprKind::Nil => Some("nil".to_owned()),
            _ => kind.words(),
        }
    }

    fn what_to_read(&self, side: &Expr, kind: Kind<'a>, operator: &str) -> Option<String> {
        let words = self.words(side.span);
        match kind {
            Kind::Object(object) => {
                let field = object.fields.first()?.name;
                Some(format!("read one of its fields, such as {words}.{field}"))
            }
            Kind::List(_) => Some(format!("#{words} is how many are in it")),
            Kind::Native(function) => Some(format!("call it: {}", function.call())),
            Kind::Function(_) => Some(format!("call it: {words}()")),
            Kind::Boolean if operator == ".." => {
                Some(format!("tostring({words}) makes a text of it"))
            }
            _ => None,
        }
    }
}

fn article(name: &str) -> String {
    match name.starts_with(['A', 'E', 'I', 'O', 'U']) && !name.starts_with("Us") {
        true => format!("an {name}"),
        false => format!("a {name}"),
    }
}
