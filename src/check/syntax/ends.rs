//! Rules for blocks that are not closed: which block, and where its `end` is missing.

use super::super::lexer::{Token, TokenKind};
use super::{ErrorSite, Explanation};

impl ErrorSite<'_> {
    /// `Expected 'end' (to close 'function' at line 3), got <eof>`; the same with `'until'`.
    pub(super) fn missing_end(&self) -> Option<Explanation> {
        let (_, rest) = self.words.split_once("Expected '")?;
        let (wanted, rest) = rest.split_once("' (to close '")?;
        if !matches!(wanted, "end" | "until") {
            return None;
        }
        let (keyword, rest) = rest.split_once('\'')?;
        // The compiler's hint at an inner block is more precise.
        let (keyword, rest) = match rest.split_once("did you forget to close '") {
            Some((_, hint)) => hint.split_once('\'')?,
            None => (keyword, rest),
        };
        let opened = self.tokens.iter().find(|token| {
            self.text(token) == keyword
                && match (
                    number_after(rest, "at line "),
                    number_after(rest, "at column "),
                ) {
                    (Some(line), _) => self.line_of(token) == line,
                    (None, Some(column)) => {
                        // The block begins on the line of the error.
                        token.span.start + 1 == self.line_start(self.line) + column
                    }
                    (None, None) => false,
                }
        })?;
        let misplaced = self.branch_after_else(opened);
        Some(misplaced.unwrap_or_else(|| self.without_end(opened, self.line)))
    }

    /// An `elseif` or `else` after the `else` of its `if`, which is this token. One that is indented
    /// less belongs to an outer `if`.
    fn branch_after_else(&self, opened: &Token) -> Option<Explanation> {
        if self.text(opened) != "else" || !self.words.contains("got 'else") {
            return None;
        }
        let late = self.tokens.iter().find(|token| {
            token.span.start > opened.span.start
                && self.line_of(token) == self.line
                && matches!(self.text(token), "elseif" | "else")
        })?;
        let is_own = self.indent_of(late) >= self.indent_of(self.head(opened));
        is_own.then(|| Explanation {
            at: late.span,
            message: format!(
                "this `{}` comes after the `else` on line {}",
                self.text(late),
                self.line_of(opened)
            ),
            help: "an if has at most one else, after each elseif".to_owned(),
        })
    }

    /// The explanation of a block without `end`, or without `until`, that begins with this token;
    /// the error was noticed on the line `noticed`.
    pub(super) fn without_end(&self, opened: &Token, noticed: usize) -> Explanation {
        let head = self.head(opened);
        let taken = self.taken_branch(head);
        let head = taken.map_or(head, |(_, inner)| inner);
        let keyword = self.text(head);
        let place = match self.first_line_outside(head) {
            Some(line) => format!("before line {line}"),
            None if self.words.contains("got <eof>") => "at the end of the file".to_owned(),
            None => format!("on line {noticed} or before it"),
        };
        let named = |branch: &Token| (self.text(branch), self.line_of(branch));
        let last = self.last_branch(head).map(named);
        let help = match (keyword, taken.map(|(branch, _)| named(branch)), last) {
            ("repeat", ..) => "a repeat loop ends with until and a condition".to_owned(),
            (_, Some((branch, line)), _) => {
                format!("without it, the `{branch}` on line {line} belongs to this if")
            }
            (_, _, Some((branch, line))) => {
                format!("one end closes the whole if, after its `{branch}` on line {line}")
            }
            _ => "each function, if, for, while and do is closed by its own end".to_owned(),
        };
        let closing = if keyword == "repeat" { "until" } else { "end" };
        Explanation {
            at: head.span,
            message: format!(
                "the `{keyword}` that begins here has no `{closing}`: it is missing {place}"
            ),
            help,
        }
    }

    /// Returns the token that opens the innermost open block at this position, where a bracket is
    /// closed; `None` if the file has as many ends as blocks. Prefers a block whose `end` is
    /// indented less than its beginning: that `end` was meant for an outer block.
    pub(super) fn open_block(&self, position: usize) -> Option<&Token> {
        let opens = self.opens_blocks();
        let opened = opens.iter().filter(|opens| **opens).count();
        let ends = self.tokens.iter().filter(|token| self.is_end(token));
        if opened <= ends.count() {
            return None;
        }
        let mut open: Vec<&Token> = Vec::new();
        let mut suspect: Option<&Token> = None;
        let before = self.tokens.iter().zip(opens);
        for (token, opens) in before.take_while(|(token, _)| token.span.start < position) {
            match self.text(token) {
                "(" | "[" | "{" => open.push(token),
                _ if opens => open.push(token),
                ")" | "]" | "}" => {
                    open.pop()?;
                }
                "end" | "until" => {
                    let closed = open.pop()?;
                    if self.indent_of(closed) > self.indent_of(token) {
                        suspect = suspect.or(Some(closed));
                    }
                }
                _ => {}
            }
        }
        let innermost = open.pop()?;
        if matches!(self.text(innermost), "(" | "[" | "{") {
            return None;
        }
        let inner = suspect.filter(|suspect| suspect.span.start > innermost.span.start);
        Some(inner.unwrap_or(innermost))
    }

    /// Returns the keyword at the beginning of the statement whose block this token opens: `if` for
    /// `then` and `else`, `while` or `for` for `do`.
    fn head<'a>(&'a self, opened: &'a Token) -> &'a Token {
        match self.text(opened) {
            "then" | "else" => {
                let mut branches = self.branches().into_iter();
                let own = branches.find(|(branch, _)| branch.span.start == opened.span.start);
                own.map_or(opened, |(_, head)| head)
            }
            "do" => {
                let before = self.tokens.iter().rev();
                let mut before = before.skip_while(|token| token.span.start >= opened.span.start);
                let found = before.find(|token| {
                    matches!(
                        self.text(token),
                        "while" | "for" | "do" | "end" | "then" | "else" | "repeat"
                    )
                });
                let own = found.filter(|token| matches!(self.text(token), "while" | "for"));
                own.unwrap_or(opened)
            }
            _ => opened,
        }
    }

    /// Returns the last `elseif` or `else` of an `if`, if it is indented like that.
    fn last_branch(&self, head: &Token) -> Option<&Token> {
        let branches = self.branches().into_iter();
        let mut own = branches.filter(|(_, of)| of.span.start == head.span.start);
        let last = own.rfind(|(branch, _)| {
            self.text(branch) != "then"
                && self.begins_line(branch)
                && self.indent_of(branch) == self.indent_of(head)
        });
        last.map(|(branch, _)| branch)
    }

    /// Returns each `then`, `elseif` and `else`, with the keyword of the innermost block around it:
    /// its own `if`, unless it is part of an expression.
    fn branches(&self) -> Vec<(&Token, &Token)> {
        let (mut open, mut found): (Vec<&Token>, Vec<_>) = (Vec::new(), Vec::new());
        for (token, opens) in self.tokens.iter().zip(self.opens_blocks()) {
            match self.text(token) {
                _ if opens => open.push(token),
                "end" | "until" => {
                    open.pop();
                }
                "then" | "elseif" | "else" => {
                    found.extend(open.last().map(|head| (token, *head)));
                }
                _ => {}
            }
        }
        found
    }

    /// Returns the first `elseif` or `else` inside a block that is indented less than its own `if`,
    /// and that `if`: it was meant for an outer one.
    fn taken_branch(&self, block: &Token) -> Option<(&Token, &Token)> {
        self.branches().into_iter().find(|(branch, head)| {
            head.span.start > block.span.start
                && self.text(head) == "if"
                && self.text(branch) != "then"
                && self.begins_line(branch)
                && self.indent_of(branch) < self.indent_of(head)
        })
    }

    /// Returns the first line after the beginning of a block that is no further indented than that;
    /// `None` if there is none, or if the block is not indented.
    fn first_line_outside(&self, head: &Token) -> Option<usize> {
        let begins = self.line_of(head);
        let indent = self.indent_of(head);
        let mut starts = self.tokens.iter().enumerate().filter(|(index, token)| {
            let line = self.line_of(token);
            let before = index
                .checked_sub(1)
                .map(|at| self.line_of(&self.tokens[at]));
            line > begins && before < Some(line) && token.kind != TokenKind::End
        });
        let (_, body) = starts.next()?;
        if self.indent_of(body) <= indent {
            return None;
        }
        let is_outside = |token: &Token| {
            let goes_on = self.text(head) == "if"
                && self.indent_of(token) == indent
                && matches!(self.text(token), "else" | "elseif");
            self.indent_of(token) <= indent && !goes_on
        };
        let (_, outside) = starts.find(|(_, token)| is_outside(token))?;
        Some(self.line_of(outside))
    }

    /// The width of the indentation of a token's line, in bytes.
    fn indent_of(&self, token: &Token) -> usize {
        let start = self.line_start(self.line_of(token));
        let rest = self.source.get(start..).unwrap_or_default();
        rest.len() - rest.trim_start().len()
    }

    fn begins_line(&self, token: &Token) -> bool {
        let line = self.line_of(token);
        token.span.start == self.line_start(line) + self.indent_of(token)
    }

    fn line_start(&self, line: usize) -> usize {
        let end_before = line.checked_sub(2).and_then(|at| self.ends.get(at));
        end_before.map_or(0, |end| end + 1)
    }

    fn is_end(&self, token: &Token) -> bool {
        matches!(self.text(token), "end" | "until")
    }

    /// Returns for each token whether it opens a block that needs an `end` or `until`.
    fn opens_blocks(&self) -> Vec<bool> {
        // The blocks, and the ifs in expressions (false), that are open.
        let mut open: Vec<bool> = Vec::new();
        let mut after_else = true;
        let classify = |(index, token): (usize, &Token)| {
            let opens = match self.text(token) {
                "function" | "do" | "repeat" => true,
                // Within an `if` that is an expression, another one is too.
                "if" => match index.checked_sub(1).map(|at| self.text(&self.tokens[at])) {
                    Some("then") => open.last().copied().unwrap_or(true),
                    Some("else") => after_else,
                    _ => self.begins_statement(index),
                },
                "else" => {
                    after_else = open.last().copied().unwrap_or(true);
                    if !after_else {
                        open.pop();
                    }
                    return false;
                }
                _ if self.is_end(token) => {
                    while open.pop() == Some(false) {}
                    return false;
                }
                _ => return false,
            };
            open.push(opens);
            opens
        };
        self.tokens.iter().enumerate().map(classify).collect()
    }

    /// Whether the token of this index begins a statement: an `if` elsewhere is an expression,
    /// which has no `end`.
    fn begins_statement(&self, index: usize) -> bool {
        let Some(before) = index.checked_sub(1).map(|at| &self.tokens[at]) else {
            return true;
        };
        match before.kind {
            TokenKind::Name | TokenKind::Number | TokenKind::Text | TokenKind::PieceLast => true,
            _ => matches!(
                self.text(before),
                "do" | "repeat"
                    | "end"
                    | "break"
                    | "nil"
                    | "true"
                    | "false"
                    | "..."
                    | ")"
                    | "]"
                    | "}"
                    | ";"
            ),
        }
    }
}

/// Returns the number that follows these words.
fn number_after(text: &str, words: &str) -> Option<usize> {
    let (_, rest) = text.split_once(words)?;
    let end = rest.find(|c: char| !c.is_ascii_digit());
    rest[..end.unwrap_or(rest.len())].parse().ok()
}
