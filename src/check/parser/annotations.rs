//! Type annotations, which only the compiler reads: the parser skips them.

use super::super::lexer::TokenKind;
use super::super::tree::StatementKind;
use super::{Parsed, Parser};

impl<'a> Parser<'a> {
    pub(super) fn type_statement(&mut self) -> Parsed<StatementKind> {
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

    pub(super) fn skip_generics(&mut self) -> Parsed<()> {
        if self.word() == "<" {
            self.skip_bracketed()?;
        }
        Ok(())
    }

    /// Skips one type: parts joined by `|`, `&`, `->` and `?`.
    pub(super) fn skip_type(&mut self) -> Parsed<()> {
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
    pub(super) fn word_follows_generics(&self) -> bool {
        self.word() == "(" && self.before().of(self.source) == ">"
    }

    pub(super) fn skip_named_type(&mut self) -> Parsed<()> {
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

    pub(super) fn skip_bracketed(&mut self) -> Parsed<()> {
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
}
