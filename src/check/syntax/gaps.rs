//! Rules for missing or superfluous elements: an `end`, a bracket, a value, a word.

use super::super::diagnostic::{Diagnostic, in_quotes};
use super::super::lexer::{KEYWORDS, Span, Token, TokenKind};
use super::super::parser;
use super::{ErrorSite, closing, word};

impl ErrorSite<'_> {
    /// Blocks written as in other languages, with `{` or `:`, or without `then` or `do`.
    pub(super) fn blocks(&self) -> Option<Diagnostic> {
        let tokens = self.around();
        let (at, begins) = tokens.iter().enumerate().rfind(|(_, token)| {
            matches!(
                self.text(token),
                "if" | "elseif" | "while" | "for" | "else" | "function"
            )
        })?;
        let keyword = self.text(begins);
        let word = match keyword {
            "if" | "elseif" => "then",
            "while" | "for" => "do",
            _ => "",
        };
        let line = self.line_of(begins);
        let behind: Vec<_> = tokens[at..]
            .iter()
            .filter(|token| self.line_of(token) == line)
            .collect();
        let last = behind.last()?;
        let opened = matches!(self.text(last), "{" | ":")
            && !behind
                .iter()
                .any(|token| matches!(self.text(token), "then" | "do"));
        if opened {
            let help = match word {
                "" => {
                    format!(
                        "the block of `{keyword}` ends with end, and needs no other sign before it"
                    )
                }
                word => format!("write `{word}` here, and `end` where the block ends"),
            };
            let message = format!("'{}' does not begin a block", self.text(last));
            return Some(self.error(last.span, message).help(help));
        }
        let complains = !word.is_empty() && self.words.contains(&format!("'{word}'"));
        if !complains || behind.iter().any(|token| self.text(token) == word) {
            return None;
        }
        let end = last.span.end;
        let message = format!("`{keyword}` needs `{word}` after it");
        let help = format!("write `{word}` at the end of this line");
        Some(self.error(Span { start: end, end }, message).help(help))
    }

    pub(super) fn extra_end(&self) -> Option<Diagnostic> {
        if !self.words.contains("got 'end'") || !self.words.contains("<eof>") {
            return None;
        }
        let mut on_line = self.on_line().into_iter();
        let end = on_line.find(|token| self.text(token) == "end")?;
        let head = self.tokens.iter().enumerate().find(|(at, token)| {
            let called = self
                .tokens
                .get(at + 1)
                .is_some_and(|next| self.text(next) == "(");
            token.kind == TokenKind::Name
                && self.begins_line(token)
                && called
                && self.is_followed_by_indent(self.line_of(token))
        });
        if let Some((_, token)) = head {
            let name = self.text(token);
            let message = format!("the word `function` is missing before `{name}`");
            return Some(
                self.error(token.span, message)
                    .help(format!("write function {name}(...)")),
            );
        }
        let message = "this `end` closes nothing: there is one too many";
        let help = "each function, if, for, while and do has exactly one end";
        Some(self.error(end.span, message).help(help))
    }

    pub(super) fn is_followed_by_indent(&self, line: usize) -> bool {
        let indent = |line: usize| {
            let text = self.source.text.lines().nth(line - 1)?;
            Some(text.len() - text.trim_start().len())
        };
        indent(line + 1) > indent(line)
    }

    /// `Expected ')' (to close '(' at line 3), got ...`
    pub(super) fn brackets(&self) -> Option<Diagnostic> {
        // The brackets and the blocks that are open, and the last `end` inside each.
        let mut open: Vec<(&Token, Option<usize>)> = Vec::new();
        let is_bracket =
            |one: &(&Token, Option<usize>)| matches!(self.text(one.0), "(" | "[" | "{");
        let expects = ["')'", "']'", "'}'"];
        let expects = expects.iter().any(|one| self.words.contains(one));
        let tokens = self.tokens.iter().zip(self.opens_blocks()).enumerate();
        for (at, (token, opens)) in tokens {
            if self.line_of(token) > self.line {
                break;
            }
            match self.text(token) {
                _ if opens => open.push((token, None)),
                "(" | "[" | "{" => open.push((token, None)),
                "end" | "until" => {
                    let block = open.iter().rposition(|one| !is_bracket(one));
                    let Some(block) = block.filter(|at| !expects || at + 1 == open.len()) else {
                        break;
                    };
                    open.truncate(block);
                    if let Some(outer) = open.last_mut() {
                        outer.1 = Some(at);
                    }
                }
                ")" | "]" | "}" => {
                    let opened = open.iter().rposition(is_bracket);
                    let fits =
                        opened.is_some_and(|at| closing(self.text(open[at].0)) == self.text(token));
                    open.truncate(opened.unwrap_or_default());
                    if !fits {
                        let message = format!("this '{}' closes nothing", self.text(token));
                        let help = "each bracket is opened once and closed once";
                        return Some(self.error(token.span, message).help(help));
                    }
                }
                _ => {}
            }
        }
        if !expects {
            return None;
        }
        let (token, end) = open.into_iter().rfind(is_bracket)?;
        Some(self.never_closed(token, end))
    }

    /// An open bracket, and the last `end` of a block inside it.
    fn never_closed(&self, token: &Token, end: Option<usize>) -> Diagnostic {
        let close = closing(self.text(token));
        if let Some(at) = end
            && let Some(next) = self.tokens.get(at + 1)
            && (next.kind == TokenKind::End || self.begins_line(next))
        {
            let line = self.line_of(token);
            let message = format!(
                "after this `end`, the '{}' of line {line} is still open",
                self.text(token)
            );
            let help = format!("write end{close}");
            return self.error(self.tokens[at].span, message).help(help);
        }
        let message = format!("this '{}' is never closed", self.text(token));
        let help = format!("a '{close}' or a comma is missing");
        self.error(token.span, message).help(help)
    }

    /// `Incomplete statement: expected assignment or a function call`.
    pub(super) fn lone_name(&self) -> Option<Diagnostic> {
        if !self.words.contains("Incomplete statement") {
            return None;
        }
        let tokens: Vec<_> = self.on_line();
        let path: Vec<_> = tokens
            .iter()
            .take_while(|token| token.kind == TokenKind::Name || self.text(token) == ".")
            .collect();
        let first = path.first()?;
        let last = path.last()?;
        let span = first.span.to(last.span);
        let next = tokens.get(path.len());
        let lower = self.text(first).to_ascii_lowercase();
        let help = match next.map(|next| (next.kind, self.text(next))) {
            _ if KEYWORDS.contains(&lower.as_str()) => {
                format!("`{lower}` is written in small letters")
            }
            None => format!("to call it, write {}()", span.of(self.source.text)),
            Some((_, "==")) => "to set a variable, write a single =".to_owned(),
            Some((TokenKind::Name | TokenKind::Number | TokenKind::Keyword, _)) => {
                format!(
                    "the arguments of a function go in brackets: {}(...)",
                    span.of(self.source.text)
                )
            }
            Some(_) => {
                let whole = self.whole_line().of(self.source.text);
                format!("keep the result: local result = {whole}")
            }
        };
        let message = format!("`{}` alone does nothing", span.of(self.source.text));
        Some(self.error(span, message).help(help))
    }

    /// `Expected identifier when parsing expression, got ...`
    pub(super) fn missing_value(&self) -> Option<Diagnostic> {
        if !self.words.contains("when parsing expression") {
            return None;
        }
        let failed_at = parser::parse(self.source.text).err()?;
        let before = self.tokens_before(failed_at);
        let index = before.len();
        let before = *before.last()?;
        let found = failed_at.of(self.source.text);
        if matches!(found, ")" | "]" | "}")
            && let Some(open) = self.open_block(failed_at.start)
        {
            return Some(self.without_end(open, self.line_at(failed_at.start)));
        }
        let before_text = self.text(before);
        let is_alone = self.line_at(failed_at.start) > self.line_of(before)
            && found.starts_with(|c: char| c.is_alphanumeric() || c == '"')
            && self.begins_statement(index);
        let (message, help) = match (before_text, found) {
            ("end", ")" | "]" | "}") => (
                format!("`{found}` does not belong after this `end`"),
                "there is a bracket too many, or its opening bracket is missing",
            ),
            ("repeat", found) if found.starts_with(|c: char| c.is_ascii_digit()) => (
                format!("`repeat` takes no number: `{found}` cannot come after it"),
                "to count, write for count = 1, 10 do ... end",
            ),
            ("do" | "then" | "else" | "repeat", "{") => (
                "'{' does not begin a block".to_owned(),
                "a block needs no braces: write `end` where it ends",
            ),
            (_, "[") => (
                format!("a value is missing after `{before_text}`: `[` is not one"),
                "a list is written in braces: { 1, 2, 3 }",
            ),
            (_, found) if is_alone => (
                format!("`{found}` alone does nothing"),
                "a line begins with a name or a word such as if, for or local",
            ),
            (_, "") => (format!("a value is missing after `{before_text}`"), ""),
            _ => (
                format!("a value is missing after `{before_text}`: `{found}` is not one"),
                "",
            ),
        };
        let span = if is_alone { failed_at } else { before.span };
        Some(self.error(span, message).help(help))
    }

    fn tokens_before(&self, span: Span) -> Vec<&Token> {
        let tokens = self.tokens.iter();
        tokens
            .filter(|token| token.span.end <= span.start && token.kind != TokenKind::End)
            .collect()
    }

    /// `Expected '(', '{' or <string> when parsing function call, got ...`
    pub(super) fn method_without_brackets(&self) -> Option<Diagnostic> {
        if !self.words.contains("when parsing function call") {
            return None;
        }
        let failed_at = parser::parse(self.source.text).err()?;
        let before = self.tokens_before(failed_at);
        let [.., object, colon, name] = before.as_slice() else {
            return None;
        };
        if self.text(colon) != ":" || name.kind != TokenKind::Name {
            return None;
        }
        let object = match object.kind {
            TokenKind::Name => self.text(object),
            _ => "...",
        };
        let name_text = self.text(name);
        let message = format!("`{name_text}` needs brackets after it");
        let help = format!("to call it, write {object}:{name_text}()");
        Some(self.error(name.span, message).help(help))
    }

    /// `Expected 'X' when parsing Y, got 'Z'`.
    pub(super) fn missing_word(&self) -> Option<Diagnostic> {
        let (_, rest) = self.words.split_once("Expected ")?;
        let (expected, rest) = rest.split_once(", got ")?;
        let expected = expected.split(" when parsing ").next()?;
        let expected = expected.split(" (").next()?;
        let got = rest.split("; ").next()?.trim();
        let value = got.starts_with(['"', '\''])
            && got
                .trim_matches('\'')
                .starts_with(|c: char| c.is_alphanumeric() || c == '"');
        let message = match (expected, got) {
            ("')'" | "'}'" | "']'", got) if value => {
                format!("a comma is missing before {}", word(got))
            }
            ("<eof>", got) => format!("{} cannot be here", word(got)),
            (expected, "<eof>") => format!("{} is missing at the end", word(expected)),
            (expected, got) => format!("expected {} here, found {}", word(expected), word(got)),
        };
        let location = self.location();
        let before = self.tokens_before(location);
        let words = value && before.last().is_some_and(|one| one.kind == TokenKind::Name);
        let help = if words
            && location
                .of(self.source.text)
                .starts_with(char::is_alphabetic)
        {
            in_quotes("...")
        } else {
            String::new()
        };
        Some(self.error(location, message).help(help))
    }

    /// `Expected 'end' (to close 'function' at line 3), got <eof>`; the same with `'until'`.
    pub(super) fn missing_end(&self) -> Option<Diagnostic> {
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

    /// An `elseif` or `else` after the `else` of its `if`, which is this token. One that is
    /// indented less belongs to an outer `if`.
    fn branch_after_else(&self, opened: &Token) -> Option<Diagnostic> {
        if self.text(opened) != "else" || !self.words.contains("got 'else") {
            return None;
        }
        let late = self.tokens.iter().find(|token| {
            token.span.start > opened.span.start
                && self.line_of(token) == self.line
                && matches!(self.text(token), "elseif" | "else")
        })?;
        if self.indent_of(late) < self.indent_of(self.head(opened)) {
            return None;
        }
        let message = format!(
            "this `{}` comes after the `else` on line {}",
            self.text(late),
            self.line_of(opened)
        );
        let help = "an if has at most one else, after each elseif";
        Some(self.error(late.span, message).help(help))
    }

    /// The explanation of a block without `end`, or without `until`, that begins with this token;
    /// the error was noticed on the line `noticed`.
    pub(super) fn without_end(&self, opened: &Token, noticed: usize) -> Diagnostic {
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
        let message =
            format!("the `{keyword}` that begins here has no `{closing}`: it is missing {place}");
        self.error(head.span, message).help(help)
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

    /// The keyword of the statement: `if` for `then` and `else`, `while` or `for` for `do`.
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

    /// The first line after the beginning of an indented block that is no further indented.
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
        let rest = self.source.text.get(start..).unwrap_or_default();
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

    /// An `if` elsewhere is an expression, which has no `end`.
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

fn number_after(text: &str, words: &str) -> Option<usize> {
    let (_, rest) = text.split_once(words)?;
    let end = rest.find(|c: char| !c.is_ascii_digit());
    rest[..end.unwrap_or(rest.len())].parse().ok()
}
