//! Expressions, by precedence climbing.

use super::super::lexer::{Span, Token, TokenKind};
use super::super::tree::{Entry, Expr, ExprKind, MAX_DEPTH};
use super::{OPERATORS, Parsed, Parser, UNARY};

impl<'a> Parser<'a> {
    pub(super) fn exprs(&mut self) -> Parsed<Vec<Expr>> {
        let mut exprs = vec![self.expr()?];
        while self.accept(",") {
            exprs.push(self.expr()?);
        }
        Ok(exprs)
    }

    pub(super) fn expr(&mut self) -> Parsed<Expr> {
        self.stronger_than(0)
    }

    pub(super) fn stronger_than(&mut self, least: u8) -> Parsed<Expr> {
        self.deeper(|parser| {
            let start = parser.token().span;
            let mut left = match parser.word() {
                operator @ ("not" | "-" | "#") => {
                    parser.advance();
                    let operand = parser.stronger_than(UNARY)?;
                    parser.made(
                        start,
                        ExprKind::Unary(operator.to_owned(), Box::new(operand)),
                    )?
                }
                _ => parser.simple()?,
            };
            loop {
                let word = parser.word();
                let known = OPERATORS.iter().find(|(text, ..)| *text == word);
                let Some((operator, _, right)) = known.filter(|(_, left, _)| *left > least) else {
                    return Ok(left);
                };
                parser.advance();
                let value = parser.stronger_than(*right)?;
                let kind =
                    ExprKind::Binary((*operator).to_owned(), Box::new(left), Box::new(value));
                left = parser.made(start, kind)?;
            }
        })
    }

    /// Builds an expression that ends before the next token.
    pub(super) fn made(&self, start: Span, kind: ExprKind) -> Parsed<Expr> {
        let mut expr = Expr {
            kind,
            span: start.to(self.before()),
            depth: 0,
        };
        let deepest = expr.parts().iter().map(|part| part.depth).max();
        expr.depth = deepest.unwrap_or(0) + 1;
        if expr.depth > MAX_DEPTH {
            Err(self.parse_error())
        } else {
            Ok(expr)
        }
    }

    pub(super) fn wrap(
        &self,
        inner: Expr,
        kind: impl FnOnce(Box<Expr>) -> ExprKind,
    ) -> Parsed<Expr> {
        let start = inner.span;
        self.made(start, kind(Box::new(inner)))
    }

    pub(super) fn variable(&self, name: &str, span: Span) -> Expr {
        let kind = match self.find(name) {
            Some(id) => ExprKind::Local(id),
            None => ExprKind::Global(name.to_owned()),
        };
        Expr {
            kind,
            span,
            depth: 1,
        }
    }

    pub(super) fn simple(&mut self) -> Parsed<Expr> {
        let start = self.token();
        let text = start.span.of(self.source);
        let literal = match (start.kind, self.word()) {
            (TokenKind::Number, _) => Some(ExprKind::Number(
                number(text).ok_or_else(|| self.parse_error())?,
            )),
            (TokenKind::Text, _) => Some(ExprKind::Text(contents(text))),
            (_, "nil") => Some(ExprKind::Nil),
            (_, "true") => Some(ExprKind::Boolean(true)),
            (_, "false") => Some(ExprKind::Boolean(false)),
            (_, "...") => Some(ExprKind::Varargs),
            _ => None,
        };
        let expr = match literal {
            Some(kind) => {
                self.advance();
                self.made(start.span, kind)?
            }
            None => self.composed(start)?,
        };
        self.cast(expr)
    }

    pub(super) fn composed(&mut self, start: Token) -> Parsed<Expr> {
        match self.word() {
            "{" => self.table(),
            "function" => {
                self.advance();
                let body = self.body()?;
                self.made(start.span, ExprKind::Function(Box::new(body)))
            }
            "if" => self.choose(),
            _ if self.begins_pieces(0) => self.pieces(),
            _ => self.suffixed(),
        }
    }

    pub(super) fn cast(&mut self, mut expr: Expr) -> Parsed<Expr> {
        while self.accept("::") {
            self.skip_type()?;
            expr = self.wrap(expr, ExprKind::Inner)?;
        }
        Ok(expr)
    }

    pub(super) fn choose(&mut self) -> Parsed<Expr> {
        let start = self.token().span;
        let mut parts = Vec::new();
        loop {
            self.advance();
            parts.push(self.expr()?);
            self.expect("then")?;
            parts.push(self.expr()?);
            if self.word() != "elseif" {
                break;
            }
        }
        self.expect("else")?;
        parts.push(self.expr()?);
        self.made(start, ExprKind::Choose(parts))
    }

    pub(super) fn pieces(&mut self) -> Parsed<Expr> {
        let start = self.token().span;
        let mut parts = Vec::new();
        loop {
            match self.advance().kind {
                TokenKind::PieceLast => return self.made(start, ExprKind::Pieces(parts)),
                TokenKind::PieceBefore => parts.push(self.expr()?),
                _ => {
                    self.at -= 1;
                    return Err(self.parse_error());
                }
            }
        }
    }

    pub(super) fn table(&mut self) -> Parsed<Expr> {
        let start = self.token().span;
        self.expect("{")?;
        let mut entries = Vec::new();
        while self.word() != "}" {
            entries.push(self.entry()?);
            if !(self.accept(",") || self.accept(";")) {
                break;
            }
        }
        self.expect("}")?;
        self.made(start, ExprKind::Table(entries))
    }

    pub(super) fn entry(&mut self) -> Parsed<Entry> {
        if self.accept("[") {
            let key = self.expr()?;
            self.expect("]")?;
            self.expect("=")?;
            return Ok(Entry::Keyed(key, self.expr()?));
        }
        if self.token().kind == TokenKind::Name && self.peek_word(1) == "=" {
            let (name, span) = self.name()?;
            self.advance();
            return Ok(Entry::Named(name.to_owned(), span, self.expr()?));
        }
        Ok(Entry::Item(self.expr()?))
    }

    /// Parses a name or a parenthesised expression with the field accesses and calls that follow
    /// it.
    pub(super) fn suffixed(&mut self) -> Parsed<Expr> {
        let start = self.token().span;
        let mut expr = if self.accept("(") {
            let inner = self.expr()?;
            self.expect(")")?;
            self.made(start, ExprKind::Inner(Box::new(inner)))?
        } else {
            let (name, span) = self.name()?;
            self.variable(name, span)
        };
        loop {
            expr = match self.word() {
                "." => {
                    self.advance();
                    let (name, at) = self.name()?;
                    self.wrap(expr, |object| ExprKind::Field(object, name.to_owned(), at))?
                }
                "[" => {
                    self.advance();
                    let index = self.expr()?;
                    self.expect("]")?;
                    self.wrap(expr, |object| ExprKind::Item(object, Box::new(index)))?
                }
                ":" => {
                    self.advance();
                    let (name, at) = self.name()?;
                    let arguments = self.arguments()?.ok_or_else(|| self.parse_error())?;
                    self.wrap(expr, |object| {
                        ExprKind::Method(object, name.to_owned(), at, arguments)
                    })?
                }
                _ => match self.arguments()? {
                    Some(arguments) => {
                        self.wrap(expr, |callee| ExprKind::Call(callee, arguments))?
                    }
                    None => return Ok(expr),
                },
            };
        }
    }

    pub(super) fn arguments(&mut self) -> Parsed<Option<Vec<Expr>>> {
        let token = self.token();
        if token.kind == TokenKind::Text {
            self.advance();
            let text = ExprKind::Text(contents(token.span.of(self.source)));
            return Ok(Some(vec![self.made(token.span, text)?]));
        }
        if self.begins_pieces(0) {
            return Ok(Some(vec![self.pieces()?]));
        }
        if self.word() == "{" {
            return Ok(Some(vec![self.deeper(Self::table)?]));
        }
        if !self.accept("(") {
            return Ok(None);
        }
        let arguments = match self.word() {
            ")" => Vec::new(),
            _ => self.exprs()?,
        };
        self.expect(")")?;
        Ok(Some(arguments))
    }
}

fn number(text: &str) -> Option<f64> {
    let text = text.replace('_', "").to_lowercase();
    if let Some(digits) = text.strip_prefix("0x") {
        return u64::from_str_radix(digits, 16)
            .ok()
            .map(|value| value as f64);
    }
    if let Some(digits) = text.strip_prefix("0b") {
        return u64::from_str_radix(digits, 2)
            .ok()
            .map(|value| value as f64);
    }
    text.parse().ok()
}

/// Returns a string without its quotes. Escapes are kept as written: names contain none.
fn contents(text: &str) -> String {
    let inside = match text.strip_prefix('[') {
        Some(rest) => {
            let level = rest.len() - rest.trim_start_matches('=').len();
            text.get(level + 2..text.len().saturating_sub(level + 2))
        }
        None => text.get(1..text.len().saturating_sub(1)),
    };
    inside.unwrap_or_default().to_owned()
}
