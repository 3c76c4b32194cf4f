//! The parser: turns tokens into a tree. The compiler checks the syntax; this parser only has to
//! understand valid sources, and otherwise gives up and reports the position. Its depth is bounded,
//! its work linear.

use std::collections::HashMap;

use super::lexer::{Span, Token, TokenKind, tokens};
use super::tree::{
    Block, Body, Entry, Expr, ExprKind, Local, LocalId, MAX_DEPTH, Statement, StatementKind, Tree,
};

/// A failure is the place of what the parser does not understand.
type Parsed<T> = Result<T, Span>;

/// Binary operators with their left and right binding power.
const OPERATORS: [(&str, u8, u8); 16] = [
    ("or", 1, 2),
    ("and", 3, 4),
    ("<", 5, 6),
    (">", 5, 6),
    ("<=", 5, 6),
    (">=", 5, 6),
    ("~=", 5, 6),
    ("==", 5, 6),
    ("..", 8, 7),
    ("+", 9, 10),
    ("-", 9, 10),
    ("*", 11, 12),
    ("/", 11, 12),
    ("//", 11, 12),
    ("%", 11, 12),
    ("^", 16, 15),
];
/// Binding power of `not`, `-` and `#`.
const UNARY: u8 = 14;

pub(crate) fn parse(source: &str) -> Parsed<Tree> {
    let mut parser = Parser {
        source,
        tokens: tokens(source),
        at: 0,
        depth: 0,
        locals: Vec::new(),
        scopes: vec![HashMap::new()],
    };
    let block = parser.block()?;
    match parser.token().kind {
        TokenKind::End => Ok(Tree {
            block,
            locals: parser.locals,
        }),
        _ => Err(parser.parse_error()),
    }
}

struct Parser<'a> {
    source: &'a str,
    tokens: Vec<Token>,
    at: usize,
    depth: u32,
    locals: Vec<Local>,
    scopes: Vec<HashMap<&'a str, LocalId>>,
}

impl<'a> Parser<'a> {
    // Tokens ---------------------------------------------------------------------------------

    fn token(&self) -> Token {
        self.peek(0)
    }

    fn peek(&self, by: usize) -> Token {
        let last = self.tokens.len() - 1;
        self.tokens[(self.at + by).min(last)]
    }

    fn word(&self) -> &'a str {
        self.peek_word(0)
    }

    fn peek_word(&self, by: usize) -> &'a str {
        let token = self.peek(by);
        match token.kind {
            TokenKind::Keyword | TokenKind::Symbol => token.span.of(self.source),
            _ => "",
        }
    }

    fn advance(&mut self) -> Token {
        let token = self.token();
        self.at = (self.at + 1).min(self.tokens.len() - 1);
        token
    }

    fn before(&self) -> Span {
        self.tokens[self.at.saturating_sub(1)].span
    }

    fn accept(&mut self, word: &str) -> bool {
        let found = self.word() == word;
        if found {
            self.advance();
        }
        found
    }

    fn expect(&mut self, word: &str) -> Parsed<()> {
        if self.accept(word) {
            return Ok(());
        }
        Err(self.parse_error())
    }

    fn parse_error(&self) -> Span {
        self.token().span
    }

    fn name(&mut self) -> Parsed<(&'a str, Span)> {
        match self.token() {
            Token {
                kind: TokenKind::Name,
                span,
            } => {
                self.advance();
                Ok((span.of(self.source), span))
            }
            _ => Err(self.parse_error()),
        }
    }

    fn is_name(&self, by: usize, text: &str) -> bool {
        let token = self.peek(by);
        token.kind == TokenKind::Name && token.span.of(self.source) == text
    }

    /// Whether an interpolated string begins at this token, as opposed to continuing.
    fn begins_pieces(&self, by: usize) -> bool {
        let token = self.peek(by);
        let piece = matches!(token.kind, TokenKind::PieceBefore | TokenKind::PieceLast);
        piece && token.span.of(self.source).starts_with('`')
    }

    fn deeper<T>(&mut self, parse: impl FnOnce(&mut Self) -> Parsed<T>) -> Parsed<T> {
        if self.depth >= MAX_DEPTH {
            return Err(self.parse_error());
        }
        self.depth += 1;
        let parsed = parse(self);
        self.depth -= 1;
        parsed
    }

    // Names ----------------------------------------------------------------------------------

    fn declare(&mut self, name: &'a str, span: Span, bound: bool) -> LocalId {
        let id = LocalId(self.locals.len());
        self.locals.push(Local {
            name: name.to_owned(),
            span,
            changes: false,
            bound,
        });
        if let Some(scope) = self.scopes.last_mut() {
            scope.insert(name, id);
        }
        id
    }

    fn find(&self, name: &str) -> Option<LocalId> {
        let mut scopes = self.scopes.iter().rev();
        scopes.find_map(|scope| scope.get(name).copied())
    }

    fn scoped<T>(&mut self, parse: impl FnOnce(&mut Self) -> Parsed<T>) -> Parsed<T> {
        self.scopes.push(HashMap::new());
        let parsed = parse(self);
        self.scopes.pop();
        parsed
    }

    fn type_statement(&mut self) -> Parsed<StatementKind> {
        if self.accept("function") {
            self.name()?;
            self.scoped(Self::body)?;
            return Ok(StatementKind::Type);
        }
        self.name()?;
        self.skip_generics()?;
        self.expect("=")?;
        self.skip_type()?;
        Ok(StatementKind::Type)
    }

    fn skip_generics(&mut self) -> Parsed<()> {
        if self.word() == "<" {
            self.skip_bracketed()?;
        }
        Ok(())
    }

    /// Skips one type: parts joined by `|`, `&`, `->` and `?`.
    fn skip_type(&mut self) -> Parsed<()> {
        loop {
            while matches!(self.word(), "|" | "&" | "...") {
                self.advance();
            }
            match self.token().kind {
                TokenKind::Name => self.skip_named_type()?,
                TokenKind::Text => {
                    self.advance();
                }
                _ => match self.word() {
                    "nil" | "true" | "false" => {
                        self.advance();
                    }
                    "(" | "{" | "<" => self.skip_bracketed()?,
                    _ => return Err(self.parse_error()),
                },
            }
            while self.accept("?") {}
            if self.word() == "..." {
                self.advance();
            }
            if !(matches!(self.word(), "|" | "&")
                || self.accept("->")
                || self.word_follows_generics())
            {
                return Ok(());
            }
        }
    }

    /// Whether the parameters of a function type follow its generics.
    fn word_follows_generics(&self) -> bool {
        self.word() == "(" && self.before().of(self.source) == ">"
    }

    fn skip_named_type(&mut self) -> Parsed<()> {
        let (name, _) = self.name()?;
        while self.accept(".") {
            self.name()?;
        }
        let computed = name == "typeof" && self.word() == "(";
        if computed || self.word() == "<" {
            self.skip_bracketed()?;
            if self.word_follows_generics() {
                return Err(self.parse_error());
            }
        }
        Ok(())
    }

    fn skip_bracketed(&mut self) -> Parsed<()> {
        let mut open = 0_u32;
        loop {
            match self.word() {
                "(" | "{" | "<" | "[" => open += 1,
                ")" | "}" | ">" | "]" => open = open.saturating_sub(1),
                _ if self.token().kind == TokenKind::End => return Err(self.parse_error()),
                _ => {}
            }
            self.advance();
            if open == 0 {
                return Ok(());
            }
        }
    }

    fn block(&mut self) -> Parsed<Block> {
        self.deeper(|parser| {
            let mut block = Vec::new();
            loop {
                while parser.accept(";") {}
                let ends = matches!(parser.word(), "end" | "else" | "elseif" | "until");
                if ends || parser.token().kind == TokenKind::End {
                    return Ok(block);
                }
                block.push(parser.statement()?);
            }
        })
    }

    fn inner_block(&mut self) -> Parsed<Block> {
        self.scoped(Self::block)
    }

    fn statement(&mut self) -> Parsed<Statement> {
        let start = self.token().span;
        let kind = self.statement_kind()?;
        let span = start.to(self.before());
        Ok(Statement { kind, span })
    }

    fn statement_kind(&mut self) -> Parsed<StatementKind> {
        use StatementKind as S;
        while self.accept("@") {
            self.name()?;
        }
        match self.word() {
            "local" => self.local(),
            "if" => self.if_statement(),
            "while" => {
                self.advance();
                let condition = self.expr()?;
                self.expect("do")?;
                let block = self.inner_block()?;
                self.expect("end")?;
                Ok(S::While(condition, block))
            }
            "do" => {
                self.advance();
                let block = self.inner_block()?;
                self.expect("end")?;
                Ok(S::Do(block))
            }
            "for" => self.for_statement(),
            "repeat" => {
                self.advance();
                self.scoped(|parser| {
                    let block = parser.block()?;
                    parser.expect("until")?;
                    Ok(S::Repeat(block, parser.expr()?))
                })
            }
            "function" => self.function_statement(),
            "return" => {
                self.advance();
                let ends = matches!(self.word(), "end" | "else" | "elseif" | "until" | ";");
                let values = if ends || self.token().kind == TokenKind::End {
                    Vec::new()
                } else {
                    self.exprs()?
                };
                Ok(S::Return(values))
            }
            "break" => {
                self.advance();
                Ok(S::Leave)
            }
            _ => self.other_statement(),
        }
    }

    /// Parses statements that begin with a name, including the contextual keywords.
    fn other_statement(&mut self) -> Parsed<StatementKind> {
        let exported = self.is_name(0, "export") && self.is_name(1, "type");
        if exported || (self.is_name(0, "type") && self.peek(1).kind == TokenKind::Name) {
            self.at += usize::from(exported) + 1;
            return self.type_statement();
        }
        let alone = !matches!(self.peek_word(1), "." | "[" | ":" | "(" | "=" | "{" | ",")
            && self.peek(1).kind != TokenKind::Text
            && !self.begins_pieces(1)
            && !self.peek_word(1).ends_with('=');
        if self.is_name(0, "continue") && alone {
            self.advance();
            return Ok(StatementKind::Leave);
        }
        self.assignment_or_call()
    }

    fn assignment_or_call(&mut self) -> Parsed<StatementKind> {
        let first = self.suffixed()?;
        let word = self.word();
        if let Some(operator) = word.strip_suffix('=')
            && matches!(operator, "+" | "-" | "*" | "/" | "//" | "%" | "^" | "..")
        {
            self.advance();
            self.changes(&first);
            let value = self.expr()?;
            return Ok(StatementKind::Compound(first, operator.to_owned(), value));
        }
        if matches!(word, "=" | ",") {
            let mut targets = vec![first];
            while self.accept(",") {
                targets.push(self.suffixed()?);
            }
            self.expect("=")?;
            targets.iter().for_each(|target| self.changes(target));
            let values = self.exprs()?;
            return Ok(StatementKind::Assign(targets, values));
        }
        match first.kind {
            ExprKind::Call(..) | ExprKind::Method(..) => Ok(StatementKind::Call(first)),
            _ => Err(self.parse_error()),
        }
    }

    fn changes(&mut self, target: &Expr) {
        if let ExprKind::Local(id) = target.kind {
            self.locals[id.0].changes = true;
        }
    }

    fn local(&mut self) -> Parsed<StatementKind> {
        self.advance();
        if self.accept("function") {
            let (name, span) = self.name()?;
            let id = self.declare(name, span, false);
            return Ok(StatementKind::LocalFunction(id, self.body()?));
        }
        let names = self.names()?;
        let values = if self.accept("=") {
            self.exprs()?
        } else {
            Vec::new()
        };
        let declare = |(name, span)| self.declare(name, span, false);
        let ids = names.into_iter().map(declare).collect();
        Ok(StatementKind::Local(ids, values))
    }

    fn names(&mut self) -> Parsed<Vec<(&'a str, Span)>> {
        let mut names = Vec::new();
        loop {
            names.push(self.name()?);
            if self.accept("<") {
                self.name()?;
                self.expect(">")?;
            }
            if self.accept(":") {
                self.skip_type()?;
            }
            if !self.accept(",") {
                return Ok(names);
            }
        }
    }

    fn if_statement(&mut self) -> Parsed<StatementKind> {
        let mut arms = Vec::new();
        let mut otherwise = None;
        // The current token is `if` or `elseif`.
        loop {
            self.advance();
            let condition = self.expr()?;
            self.expect("then")?;
            arms.push((condition, self.inner_block()?));
            if self.word() != "elseif" {
                break;
            }
        }
        if self.accept("else") {
            otherwise = Some(self.inner_block()?);
        }
        self.expect("end")?;
        Ok(StatementKind::If(arms, otherwise))
    }

    fn for_statement(&mut self) -> Parsed<StatementKind> {
        self.advance();
        let names = self.names()?;
        let counts = names.len() == 1 && self.accept("=");
        if !counts {
            self.expect("in")?;
        }
        let values = self.exprs()?;
        self.expect("do")?;
        self.scoped(|parser| {
            let declare = |(name, span)| parser.declare(name, span, true);
            let ids: Vec<_> = names.into_iter().map(declare).collect();
            let block = parser.block()?;
            parser.expect("end")?;
            Ok(match ids.as_slice() {
                [id] if counts => StatementKind::Count(*id, values, block),
                _ => StatementKind::Each(ids, values, block),
            })
        })
    }

    fn function_statement(&mut self) -> Parsed<StatementKind> {
        self.advance();
        let (name, span) = self.name()?;
        let mut target = self.variable(name, span);
        let mut method = false;
        while matches!(self.word(), "." | ":") && !method {
            method = self.word() == ":";
            self.advance();
            let (name, at) = self.name()?;
            let kind = |object| ExprKind::Field(object, name.to_owned(), at);
            target = self.wrap(target, kind)?;
        }
        self.changes(&target);
        self.scoped(|parser| {
            if method {
                parser.declare("self", span, true);
            }
            Ok(StatementKind::Function(target, parser.body()?))
        })
    }

    fn body(&mut self) -> Parsed<Body> {
        self.skip_generics()?;
        self.expect("(")?;
        self.scoped(|parser| {
            let mut parameters = Vec::new();
            while parser.word() != ")" {
                if parser.accept("...") {
                    if parser.accept(":") {
                        parser.skip_type()?;
                    }
                    break;
                }
                let (name, span) = parser.name()?;
                parameters.push(parser.declare(name, span, true));
                if parser.accept(":") {
                    parser.skip_type()?;
                }
                if !parser.accept(",") {
                    break;
                }
            }
            parser.expect(")")?;
            if parser.accept(":") {
                parser.skip_type()?;
            }
            let block = parser.block()?;
            parser.expect("end")?;
            Ok(Body { parameters, block })
        })
    }

    fn exprs(&mut self) -> Parsed<Vec<Expr>> {
        let mut exprs = vec![self.expr()?];
        while self.accept(",") {
            exprs.push(self.expr()?);
        }
        Ok(exprs)
    }

    fn expr(&mut self) -> Parsed<Expr> {
        self.stronger_than(0)
    }

    fn stronger_than(&mut self, least: u8) -> Parsed<Expr> {
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
    fn made(&self, start: Span, kind: ExprKind) -> Parsed<Expr> {
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

    fn wrap(&self, inner: Expr, kind: impl FnOnce(Box<Expr>) -> ExprKind) -> Parsed<Expr> {
        let start = inner.span;
        self.made(start, kind(Box::new(inner)))
    }

    fn variable(&self, name: &str, span: Span) -> Expr {
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

    fn simple(&mut self) -> Parsed<Expr> {
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

    fn composed(&mut self, start: Token) -> Parsed<Expr> {
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

    fn cast(&mut self, mut expr: Expr) -> Parsed<Expr> {
        while self.accept("::") {
            self.skip_type()?;
            expr = self.wrap(expr, ExprKind::Inner)?;
        }
        Ok(expr)
    }

    fn choose(&mut self) -> Parsed<Expr> {
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

    fn pieces(&mut self) -> Parsed<Expr> {
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

    fn table(&mut self) -> Parsed<Expr> {
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

    fn entry(&mut self) -> Parsed<Entry> {
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

    fn suffixed(&mut self) -> Parsed<Expr> {
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

    fn arguments(&mut self) -> Parsed<Option<Vec<Expr>>> {
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
