//! The parser: turns tokens into a tree. The compiler checks the syntax; this parser only has to
//! understand valid sources, and otherwise gives up and reports the position. Its depth is bounded,
//! its work linear.

mod annotations;
mod expressions;
mod statements;

use std::collections::HashMap;

use super::lexer::{Span, Token, TokenKind, tokens};
use super::tree::{Local, LocalId, MAX_DEPTH, Tree};

/// The position where parsing failed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct ParseError {
    pub(super) at: Span,
}

type Parsed<T> = Result<T, ParseError>;

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

/// Parses a source into a tree.
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
        self.accept(word)
            .then_some(())
            .ok_or_else(|| self.parse_error())
    }

    fn parse_error(&self) -> ParseError {
        ParseError {
            at: self.token().span,
        }
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
}
