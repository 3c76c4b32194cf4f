//! Blocks and statements.

use super::super::lexer::{Span, TokenKind};
use super::super::tree::{Block, Body, Expr, ExprKind, Statement, StatementKind};
use super::{Parsed, Parser};

impl<'a> Parser<'a> {
    pub(super) fn block(&mut self) -> Parsed<Block> {
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

    pub(super) fn inner_block(&mut self) -> Parsed<Block> {
        self.scoped(Self::block)
    }

    pub(super) fn statement(&mut self) -> Parsed<Statement> {
        let start = self.token().span;
        let kind = self.statement_kind()?;
        let span = start.to(self.before());
        Ok(Statement { kind, span })
    }

    pub(super) fn statement_kind(&mut self) -> Parsed<StatementKind> {
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
    pub(super) fn other_statement(&mut self) -> Parsed<StatementKind> {
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

    pub(super) fn assignment_or_call(&mut self) -> Parsed<StatementKind> {
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

    pub(super) fn changes(&mut self, target: &Expr) {
        if let ExprKind::Local(id) = target.kind {
            self.locals[id.0].changes = true;
        }
    }

    pub(super) fn local(&mut self) -> Parsed<StatementKind> {
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

    /// Parses a list of names, with or without types.
    pub(super) fn names(&mut self) -> Parsed<Vec<(&'a str, Span)>> {
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

    pub(super) fn if_statement(&mut self) -> Parsed<StatementKind> {
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

    pub(super) fn for_statement(&mut self) -> Parsed<StatementKind> {
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

    pub(super) fn function_statement(&mut self) -> Parsed<StatementKind> {
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

    /// Parses a function from its parameters to its `end`.
    pub(super) fn body(&mut self) -> Parsed<Body> {
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
}
