//! Determines what kind of value an expression has, as far as the file itself shows. What is not
//! certain is [`ValueKind::Unknown`] and never leads to a diagnostic.

use std::collections::{BTreeMap, BTreeSet};

use super::tree::{
    Block, Body, Entry, Expr, ExprKind, LocalId, Node, Statement, StatementKind, Tree, each_node,
};
use crate::api::{self, Choice, Function, Namespace, Object, Type};

#[derive(Debug, Clone, Copy)]
pub(super) enum ValueKind<'a> {
    Unknown,
    /// nil, or the result of a function that returns nothing.
    Nothing,
    Boolean,
    Number(Option<f64>),
    Text(Option<&'a str>),
    /// A table constructor in this file.
    Table(&'a Expr),
    Function(Option<&'a Body>),
    Native(&'static Function),
    Namespace(&'a str),
    /// The result of `require("@spykee/...")`.
    Module(&'static Namespace),
    Object(&'static Object),
    /// The result of `params.declare`, with the table constructor passed to it.
    Params(&'a Expr),
    List(&'static Type),
}

impl ValueKind<'_> {
    /// Describes the kind for messages; `None` if it is unknown.
    pub(super) fn describe(&self) -> Option<String> {
        Some(match self {
            ValueKind::Unknown => return None,
            ValueKind::Nothing => "nil".to_owned(),
            ValueKind::Boolean => "true or false".to_owned(),
            ValueKind::Number(Some(number)) => number.to_string(),
            ValueKind::Number(None) => "a number".to_owned(),
            ValueKind::Text(Some(text)) => format!("'{}'", crate::script::printable(text, 40)),
            ValueKind::Text(None) => "a string".to_owned(),
            ValueKind::Table(_) | ValueKind::Params(_) => "a table".to_owned(),
            ValueKind::Function(_) | ValueKind::Native(_) => "a function".to_owned(),
            ValueKind::Namespace(name) => format!("all of {name}"),
            ValueKind::Module(module) => format!("the module {}", module.name),
            ValueKind::Object(object) => api::with_article(object.name),
            ValueKind::List(_) => "a list".to_owned(),
        })
    }
}

pub(super) struct Kinds<'a> {
    pub(super) tree: &'a Tree,
    /// Every path (such as `robot.move`) that exists in a live VM.
    pub(super) paths: &'a BTreeSet<String>,
    pub(super) globals: BTreeSet<&'a str>,
    /// Fields that the script sets on any table.
    pub(super) fields: BTreeSet<&'a str>,
    pub(super) locals: BTreeMap<LocalId, ValueKind<'a>>,
    /// Local variables that hold one of a fixed set of names.
    choices: BTreeMap<LocalId, &'static Choice>,
}

impl<'a> Kinds<'a> {
    pub(super) fn new(tree: &'a Tree, paths: &'a BTreeSet<String>) -> Kinds<'a> {
        let mut kinds = Kinds {
            tree,
            paths,
            globals: BTreeSet::new(),
            fields: BTreeSet::new(),
            locals: BTreeMap::new(),
            choices: BTreeMap::new(),
        };
        each_node(&tree.block, &mut |node| match node {
            Node::Statement(statement) => kinds.note_names(statement),
            Node::Expr(expr) => {
                let names = expr.entries().iter().filter_map(Entry::name);
                kinds.fields.extend(names);
            }
        });
        kinds
    }

    fn note_names(&mut self, statement: &'a Statement) {
        let targets: Vec<&Expr> = match &statement.kind {
            StatementKind::Assign(targets, _) => targets.iter().collect(),
            StatementKind::Function(target, _) => vec![target],
            // A compound assignment changes an existing value.
            StatementKind::Compound(target, ..) => match target.kind {
                ExprKind::Field(..) => vec![target],
                _ => Vec::new(),
            },
            _ => Vec::new(),
        };
        for target in targets {
            match &target.kind {
                ExprKind::Global(name) => {
                    self.globals.insert(name);
                }
                ExprKind::Field(object, name, _) => {
                    self.fields.insert(name);
                    if matches!(&object.kind, ExprKind::Global(name) if name == "_G") {
                        self.globals.insert(name);
                    }
                }
                _ => {}
            }
        }
    }

    /// Records the kind of a local variable, unless it is reassigned later.
    pub(super) fn bind(&mut self, id: LocalId, kind: ValueKind<'a>) {
        if !self.tree.locals[id.0].changes {
            self.locals.insert(id, kind);
        }
    }

    /// Whether a global name is a namespace of the VM that the script has not replaced.
    pub(super) fn namespace(&self, name: &str) -> bool {
        let inside = format!("{name}.");
        let from = self.paths.range(inside.clone()..).next();
        !self.globals.contains(name) && from.is_some_and(|path| path.starts_with(&inside))
    }

    pub(super) fn kind_of(&self, expr: &'a Expr) -> ValueKind<'a> {
        match &expr.kind {
            ExprKind::Nil => ValueKind::Nothing,
            ExprKind::Boolean(_) => ValueKind::Boolean,
            ExprKind::Number(number) => ValueKind::Number(Some(*number)),
            ExprKind::Text(text) => ValueKind::Text((!text.contains('\\')).then_some(text)),
            ExprKind::Pieces(_) => ValueKind::Text(None),
            ExprKind::Function(body) => ValueKind::Function(Some(body)),
            ExprKind::Table(_) => ValueKind::Table(expr),
            ExprKind::Inner(inner) => self.kind_of(inner),
            ExprKind::Local(id) => self.locals.get(id).copied().unwrap_or(ValueKind::Unknown),
            ExprKind::Global(name) if self.globals.contains(name.as_str()) => ValueKind::Unknown,
            ExprKind::Global(name) if self.namespace(name) && name == "sim" => {
                api::object("Sim").map_or(ValueKind::Unknown, ValueKind::Object)
            }
            ExprKind::Global(name) if self.namespace(name) && name != "_G" => {
                ValueKind::Namespace(name)
            }
            ExprKind::Global(name) => {
                api::function(name).map_or(ValueKind::Unknown, ValueKind::Native)
            }
            ExprKind::Field(object, name, _) => self.field(self.kind_of(object), name),
            ExprKind::Item(list, index) => match (self.kind_of(list), self.kind_of(index)) {
                (ValueKind::List(of), ValueKind::Number(_)) => of_type(*of),
                _ => ValueKind::Unknown,
            },
            ExprKind::Call(..) | ExprKind::Method(..) => self.result(expr, 0),
            ExprKind::Unary(operator, operand) => self.unary(operator, self.kind_of(operand)),
            ExprKind::Binary(operator, left, right) => self.binary(operator, left, right),
            ExprKind::Varargs | ExprKind::Choose(_) => ValueKind::Unknown,
        }
    }

    fn field(&self, owner: ValueKind<'a>, name: &str) -> ValueKind<'a> {
        match owner {
            ValueKind::Namespace(namespace) => {
                let path = format!("{namespace}.{name}");
                if let Some(constant) = api::constants().find(|one| one.path == path) {
                    return of_type(constant.kind);
                }
                api::function(&path).map_or(ValueKind::Unknown, ValueKind::Native)
            }
            ValueKind::Module(module) => module
                .function(name)
                .map_or(ValueKind::Unknown, ValueKind::Native),
            ValueKind::Params(table) => {
                let about = value_of(table, name).map(Expr::bare);
                let default = about.and_then(|about| value_of(about, "default"));
                default.map_or(ValueKind::Unknown, |default| {
                    self.kind_of(default).of_any_value()
                })
            }
            ValueKind::Object(object) if object.strict || !self.fields.contains(name) => {
                let field = object.field(name);
                field.map_or(ValueKind::Unknown, |field| of_type(field.kind))
            }
            _ => ValueKind::Unknown,
        }
    }

    /// Returns the kind of a call's result with this index, from 0.
    pub(super) fn result(&self, call: &'a Expr, number: usize) -> ValueKind<'a> {
        let (ExprKind::Call(_, arguments) | ExprKind::Method(.., arguments)) = &call.kind else {
            return ValueKind::Unknown;
        };
        let function = match self.callee(call) {
            ValueKind::Native(function) => function,
            ValueKind::Function(Some(body)) if !returns(&body.block) => return ValueKind::Nothing,
            _ => return ValueKind::Unknown,
        };
        match function.returns.get(number).map(|value| value.kind) {
            Some(Type::Payload) => self.payload(arguments),
            _ if function.path == "require" => self.module(arguments),
            _ if function.path == "params.declare" => self.params(arguments),
            // These calls may return no result at all, which passed on would be a missing argument.
            Some(_) if number == 0 && matches!(function.path, "robot.move" | "robot.drive") => {
                ValueKind::Unknown
            }
            Some(kind) => of_type(kind),
            None if function.returns.is_empty() && function.rest.is_none() => ValueKind::Nothing,
            None => ValueKind::Unknown,
        }
    }

    fn params(&self, arguments: &'a [Expr]) -> ValueKind<'a> {
        let Some(ValueKind::Table(table)) = arguments.first().map(|one| self.kind_of(one)) else {
            return ValueKind::Unknown;
        };
        let names = parameters(table);
        names.map_or(ValueKind::Unknown, |_| ValueKind::Params(table))
    }

    pub(super) fn bind_choice(&mut self, id: LocalId, call: &'a Expr, number: usize) {
        let ValueKind::Native(function) = self.callee(call) else {
            return;
        };
        if let Some(Type::Choice(choice)) = function.returns.get(number).map(|one| one.kind)
            && !self.tree.locals[id.0].changes
        {
            self.choices.insert(id, choice);
        }
    }

    /// Returns the set of names of which an expression is one.
    pub(super) fn choice(&self, expr: &'a Expr) -> Option<&'static Choice> {
        match &expr.bare().kind {
            ExprKind::Local(id) => self.choices.get(id).copied(),
            ExprKind::Field(object, name, _) => {
                let ValueKind::Object(object) = self.kind_of(object) else {
                    return None;
                };
                match object.field(name)?.kind {
                    Type::Choice(choice) => Some(choice),
                    _ => None,
                }
            }
            _ => None,
        }
    }

    /// Returns the built-in module that a call of `require` loads.
    fn module(&self, arguments: &'a [Expr]) -> ValueKind<'a> {
        let name = match arguments.first().map(|path| self.kind_of(path)) {
            Some(ValueKind::Text(Some(path))) => path.strip_prefix("@spykee/"),
            _ => None,
        };
        let module = name.and_then(api::module);
        module.map_or(ValueKind::Unknown, ValueKind::Module)
    }

    /// Returns the kind of the payload of the event that the first argument names.
    pub(super) fn payload(&self, arguments: &'a [Expr]) -> ValueKind<'a> {
        let Some(ValueKind::Text(Some(name))) = arguments.first().map(|one| self.kind_of(one))
        else {
            return ValueKind::Unknown;
        };
        let payload = api::event(name).and_then(|event| event.payload);
        payload
            .and_then(api::object)
            .map_or(ValueKind::Unknown, ValueKind::Object)
    }

    /// Returns what a call calls; a method of the API is a [`ValueKind::Native`], too.
    pub(super) fn callee(&self, call: &'a Expr) -> ValueKind<'a> {
        match &call.kind {
            ExprKind::Call(callee, _) => self.kind_of(callee),
            ExprKind::Method(object, name, ..) => match self.kind_of(object) {
                ValueKind::Object(object) => object
                    .method(name)
                    .map_or(ValueKind::Unknown, ValueKind::Native),
                _ => ValueKind::Unknown,
            },
            _ => ValueKind::Unknown,
        }
    }

    fn unary(&self, operator: &str, operand: ValueKind<'a>) -> ValueKind<'a> {
        match (operator, operand) {
            ("not", _) => ValueKind::Boolean,
            ("-", ValueKind::Number(number)) => ValueKind::Number(number.map(|number| -number)),
            ("#", _) => ValueKind::Number(None),
            _ => ValueKind::Unknown,
        }
    }

    fn binary(&self, operator: &str, left: &'a Expr, right: &'a Expr) -> ValueKind<'a> {
        match operator {
            "==" | "~=" | "<" | ">" | "<=" | ">=" => ValueKind::Boolean,
            ".." => match (self.kind_of(left), self.kind_of(right)) {
                (ValueKind::Unknown, _) | (_, ValueKind::Unknown) => ValueKind::Unknown,
                _ => ValueKind::Text(None),
            },
            "and" | "or" => ValueKind::Unknown,
            _ => match (self.kind_of(left), self.kind_of(right)) {
                (ValueKind::Number(a), ValueKind::Number(b)) => {
                    ValueKind::Number(a.zip(b).and_then(|(a, b)| computed(operator, a, b)))
                }
                _ => ValueKind::Unknown,
            },
        }
    }
}

impl ValueKind<'_> {
    fn of_any_value(self) -> Self {
        match self {
            ValueKind::Number(_) => ValueKind::Number(None),
            ValueKind::Text(_) => ValueKind::Text(None),
            ValueKind::Boolean => ValueKind::Boolean,
            _ => ValueKind::Unknown,
        }
    }
}

/// Returns the keys of a table constructor, if all its entries have the form `name = value`.
pub(super) fn parameters(table: &Expr) -> Option<Vec<&str>> {
    table.entries().iter().map(Entry::name).collect()
}

fn value_of<'a>(table: &'a Expr, key: &str) -> Option<&'a Expr> {
    let mut entries = table.entries().iter();
    entries
        .find(|entry| entry.name() == Some(key))
        .map(Entry::value)
}

fn computed(operator: &str, a: f64, b: f64) -> Option<f64> {
    let value = match operator {
        "+" => a + b,
        "-" => a - b,
        "*" => a * b,
        "/" => a / b,
        _ => return None,
    };
    Some(value).filter(|value| value.is_finite())
}

pub(super) fn of_type<'a>(kind: Type) -> ValueKind<'a> {
    match kind {
        Type::Boolean => ValueKind::Boolean,
        Type::Number(_) | Type::Whole(_) => ValueKind::Number(None),
        Type::Text(_) | Type::Choice(_) => ValueKind::Text(None),
        Type::Object(name) => api::object(name).map_or(ValueKind::Unknown, ValueKind::Object),
        Type::List(of) => ValueKind::List(of),
        _ => ValueKind::Unknown,
    }
}

/// Whether a function's block returns any value; functions nested in it do not count.
pub(super) fn returns(block: &Block) -> bool {
    block.iter().any(|statement| match &statement.kind {
        StatementKind::Return(values) => !values.is_empty(),
        StatementKind::Function(..) | StatementKind::LocalFunction(..) => false,
        _ => statement.blocks().into_iter().any(returns),
    })
}
