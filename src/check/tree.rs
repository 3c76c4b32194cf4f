//! The syntax tree of a script, with names resolved to local variables.

use super::lexer::Span;

/// Maximum depth of a tree: people do not nest deeper, and it bounds the recursion of tree walks.
pub(super) const MAX_DEPTH: u32 = 160;

/// A local variable, as an index into [`Tree::locals`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct LocalId(pub(super) usize);

#[derive(Debug)]
pub(crate) struct Local {
    pub(super) name: String,
    pub(super) span: Span,
    /// Whether it is assigned anywhere after its declaration.
    pub(super) changes: bool,
    /// Whether it is a function parameter or a loop variable.
    pub(super) bound: bool,
}

#[derive(Debug, Default)]
pub(crate) struct Tree {
    pub(super) block: Block,
    pub(crate) locals: Vec<Local>,
}

pub(crate) type Block = Vec<Statement>;

#[derive(Debug)]
pub(crate) struct Statement {
    pub(super) kind: StatementKind,
    pub(super) span: Span,
}

#[derive(Debug)]
pub(super) enum StatementKind {
    Local(Vec<LocalId>, Vec<Expr>),
    Assign(Vec<Expr>, Vec<Expr>),
    /// `a += b`, with the operator without its `=`.
    Compound(Expr, String, Expr),
    Call(Expr),
    Do(Block),
    While(Expr, Block),
    Repeat(Block, Expr),
    If(Vec<(Expr, Block)>, Option<Block>),
    Count(LocalId, Vec<Expr>, Block),
    Each(Vec<LocalId>, Vec<Expr>, Block),
    Function(Expr, Body),
    LocalFunction(LocalId, Body),
    Return(Vec<Expr>),
    /// `break` and `continue`.
    Leave,
    Type,
}

#[derive(Debug)]
pub(crate) struct Body {
    pub(super) parameters: Vec<LocalId>,
    pub(super) block: Block,
}

#[derive(Debug)]
pub(crate) struct Expr {
    pub(super) kind: ExprKind,
    pub(super) span: Span,
    pub(super) depth: u32,
}

#[derive(Debug)]
pub(super) enum ExprKind {
    Nil,
    Boolean(bool),
    Number(f64),
    Text(String),
    /// An interpolated string.
    Pieces(Vec<Expr>),
    Varargs,
    Function(Box<Body>),
    Local(LocalId),
    Global(String),
    Field(Box<Expr>, String, Span),
    Item(Box<Expr>, Box<Expr>),
    Call(Box<Expr>, Vec<Expr>),
    Method(Box<Expr>, String, Span, Vec<Expr>),
    Unary(String, Box<Expr>),
    Binary(String, Box<Expr>, Box<Expr>),
    Table(Vec<Entry>),
    Choose(Vec<Expr>),
    /// An expression in parentheses or with a type cast.
    Inner(Box<Expr>),
}

#[derive(Debug)]
pub(super) enum Entry {
    Item(Expr),
    Named(String, Span, Expr),
    Keyed(Expr, Expr),
}

impl Expr {
    /// Returns the expression without parentheses and type casts.
    pub(super) fn bare(&self) -> &Expr {
        let mut expr = self;
        while let ExprKind::Inner(inner) = &expr.kind {
            expr = inner;
        }
        expr
    }

    /// Whether it may yield several values, or none.
    pub(super) fn is_open(&self) -> bool {
        self.is_call() || matches!(self.kind, ExprKind::Varargs)
    }

    pub(super) fn is_call(&self) -> bool {
        matches!(self.kind, ExprKind::Call(..) | ExprKind::Method(..))
    }

    /// Whether it or a part of it passes the test; functions nested in it do not count.
    pub(super) fn any(&self, test: &dyn Fn(&Expr) -> bool) -> bool {
        test(self) || self.parts().into_iter().any(|part| part.any(test))
    }

    /// The entries of a table constructor; none for other expressions.
    pub(super) fn entries(&self) -> &[Entry] {
        match &self.kind {
            ExprKind::Table(entries) => entries,
            _ => &[],
        }
    }

    pub(super) fn parts(&self) -> Vec<&Expr> {
        match &self.kind {
            ExprKind::Pieces(all) | ExprKind::Choose(all) => all.iter().collect(),
            ExprKind::Field(one, ..) | ExprKind::Unary(_, one) | ExprKind::Inner(one) => vec![one],
            ExprKind::Item(one, two) | ExprKind::Binary(_, one, two) => vec![one, two],
            ExprKind::Call(one, all) | ExprKind::Method(one, _, _, all) => {
                std::iter::once(&**one).chain(all).collect()
            }
            ExprKind::Table(entries) => entries.iter().flat_map(Entry::parts).collect(),
            _ => Vec::new(),
        }
    }
}

impl Entry {
    /// The name, if it is written as `name = value`.
    pub(super) fn name(&self) -> Option<&str> {
        match self {
            Entry::Named(name, ..) => Some(name),
            _ => None,
        }
    }

    pub(super) fn value(&self) -> &Expr {
        match self {
            Entry::Item(value) | Entry::Named(_, _, value) | Entry::Keyed(_, value) => value,
        }
    }

    fn parts(&self) -> Vec<&Expr> {
        match self {
            Entry::Keyed(key, value) => vec![key, value],
            other => vec![other.value()],
        }
    }
}

impl Statement {
    pub(super) fn exprs(&self) -> Vec<&Expr> {
        use StatementKind as S;
        match &self.kind {
            S::Local(_, values)
            | S::Return(values)
            | S::Count(_, values, _)
            | S::Each(_, values, _) => values.iter().collect(),
            S::Assign(targets, values) => targets.iter().chain(values).collect(),
            S::Compound(target, _, value) => vec![target, value],
            S::Call(call) => vec![call],
            S::While(condition, _) | S::Repeat(_, condition) => vec![condition],
            S::If(arms, _) => arms.iter().map(|(condition, _)| condition).collect(),
            S::Function(target, _) => vec![target],
            S::Do(_) | S::LocalFunction(..) | S::Leave | S::Type => Vec::new(),
        }
    }

    /// Returns the direct inner blocks, including those of function statements.
    pub(super) fn blocks(&self) -> Vec<&Block> {
        use StatementKind as S;
        match &self.kind {
            S::Do(block)
            | S::While(_, block)
            | S::Repeat(block, _)
            | S::Count(_, _, block)
            | S::Each(_, _, block) => vec![block],
            S::If(arms, otherwise) => {
                let arms = arms.iter().map(|(_, block)| block);
                arms.chain(otherwise).collect()
            }
            S::Function(_, body) | S::LocalFunction(_, body) => vec![&body.block],
            _ => Vec::new(),
        }
    }
}

/// What a walk over a tree visits.
pub(super) enum Node<'a> {
    Statement(&'a Statement),
    Expr(&'a Expr),
}

/// Visits every statement and expression of a block, outer ones first and in the order of the
/// text, also those in functions.
pub(super) fn each_node<'a>(block: &'a Block, visit: &mut dyn FnMut(Node<'a>)) {
    for statement in block {
        visit(Node::Statement(statement));
        for expr in statement.exprs() {
            each_in_expr(expr, visit);
        }
        for inner in statement.blocks() {
            each_node(inner, visit);
        }
    }
}

fn each_in_expr<'a>(expr: &'a Expr, visit: &mut dyn FnMut(Node<'a>)) {
    visit(Node::Expr(expr));
    if let ExprKind::Function(body) = &expr.kind {
        each_node(&body.block, visit);
    }
    for part in expr.parts() {
        each_in_expr(part, visit);
    }
}
