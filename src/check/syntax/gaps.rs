//! Rules for missing or superfluous elements: an `end`, a bracket, a value, a word.

use super::super::lexer::{KEYWORDS, Span, Token, TokenKind};
use super::super::parser;
use super::{ErrorSite, Explanation, closing, word};

impl ErrorSite<'_> {
    /// Blocks written as in other languages, with `{` or `:`, or without `then` or `do`.
    pub(super) fn blocks(&self) -> Option<Explanation> {
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
            return Some(Explanation {
                at: last.span,
                message: format!("'{}' does not begin a block", self.text(last)),
                help,
            });
        }
        let complains = !word.is_empty() && self.words.contains(&format!("'{word}'"));
        let missing = complains && !behind.iter().any(|token| self.text(token) == word);
        missing.then(|| Explanation {
            at: Span {
                start: last.span.end,
                end: last.span.end,
            },
            message: format!("`{keyword}` needs `{word}` after it"),
            help: format!("write `{word}` at the end of this line"),
        })
    }

    pub(super) fn extra_end(&self) -> Option<Explanation> {
        if !self.words.contains("<eof>, got 'end'") && !self.words.contains("got 'end'") {
            return None;
        }
        let end = self
            .on_line()
            .into_iter()
            .find(|token| self.text(token) == "end")?;
        let head = self.tokens.iter().enumerate().find(|(at, token)| {
            let before = at.checked_sub(1).map(|at| self.text(&self.tokens[at]));
            let starts_line = at
                .checked_sub(1)
                .is_none_or(|at| self.line_of(&self.tokens[at]) < self.line_of(token));
            let called = self
                .tokens
                .get(at + 1)
                .is_some_and(|next| self.text(next) == "(");
            let indented = self.is_followed_by_indent(self.line_of(token));
            token.kind == TokenKind::Name
                && starts_line
                && called
                && indented
                && before != Some("function")
        });
        if !self.words.contains("<eof>") {
            return None;
        }
        Some(match head {
            Some((_, token)) => Explanation {
                at: token.span,
                message: format!(
                    "the word `function` is missing before `{}`",
                    self.text(token)
                ),
                help: format!("write function {}(...)", self.text(token)),
            },
            None => Explanation {
                at: end.span,
                message: "this `end` closes nothing: there is one too many".to_owned(),
                help: "each function, if, for, while and do has exactly one end".to_owned(),
            },
        })
    }

    pub(super) fn is_followed_by_indent(&self, line: usize) -> bool {
        let indent = |line: usize| {
            let text = self.source.lines().nth(line - 1)?;
            Some(text.len() - text.trim_start().len())
        };
        indent(line + 1) > indent(line)
    }

    /// `Expected ')' (to close '(' at line 3), got ...`
    pub(super) fn brackets(&self) -> Option<Explanation> {
        let mut open: Vec<&Token> = Vec::new();
        for token in &self.tokens {
            if self.line_of(token) > self.line {
                break;
            }
            match self.text(token) {
                "(" | "[" | "{" => open.push(token),
                ")" | "]" | "}" => {
                    let fits = open
                        .pop()
                        .is_some_and(|open| closing(self.text(open)) == self.text(token));
                    if !fits {
                        return Some(Explanation {
                            at: token.span,
                            message: format!("this '{}' closes nothing", self.text(token)),
                            help: "each bracket is opened once and closed once".to_owned(),
                        });
                    }
                }
                _ => {}
            }
        }
        if !["')'", "']'", "'}'"]
            .iter()
            .any(|one| self.words.contains(one))
        {
            return None;
        }
        let token = open.last()?;
        let close = closing(self.text(token));
        Some(Explanation {
            at: token.span,
            message: format!("this '{}' is never closed", self.text(token)),
            help: format!("a '{close}' or a comma is missing"),
        })
    }

    /// `Incomplete statement: expected assignment or a function call`.
    pub(super) fn lone_name(&self) -> Option<Explanation> {
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
            None => format!("to call it, write {}()", span.of(self.source)),
            Some((_, "==")) => "to set a variable, write a single =".to_owned(),
            Some((TokenKind::Name | TokenKind::Number | TokenKind::Keyword, _)) => {
                format!(
                    "the arguments of a function go in brackets: {}(...)",
                    span.of(self.source)
                )
            }
            Some(_) => String::new(),
        };
        Some(Explanation {
            at: span,
            message: format!("`{}` alone does nothing", span.of(self.source)),
            help,
        })
    }

    /// `Expected identifier when parsing expression, got ...`
    pub(super) fn missing_value(&self) -> Option<Explanation> {
        if !self.words.contains("when parsing expression") {
            return None;
        }
        let failed_at = match parser::parse(self.source) {
            Err(error) => error.at,
            Ok(_) => return None,
        };
        let before = self
            .tokens
            .iter()
            .rfind(|token| token.span.end <= failed_at.start && token.kind != TokenKind::End)?;
        let found = failed_at.of(self.source);
        if matches!(found, ")" | "]" | "}")
            && let Some(open) = self.open_block(failed_at.start)
        {
            return Some(self.without_end(open, self.line_at(failed_at.start)));
        }
        let before_text = self.text(before);
        let (message, help) = match (before_text, found) {
            ("end", ")" | "]" | "}") => (
                format!("`{found}` does not belong after this `end`"),
                "there is a bracket too many, or its opening bracket is missing",
            ),
            ("repeat", found) if found.starts_with(|c: char| c.is_ascii_digit()) => (
                format!("`repeat` takes no number: `{found}` cannot come after it"),
                "to count, write for count = 1, 10 do ... end",
            ),
            (_, "") => (format!("a value is missing after `{before_text}`"), ""),
            _ => (
                format!("a value is missing after `{before_text}`: `{found}` is not one"),
                "",
            ),
        };
        Some(Explanation {
            at: before.span,
            message,
            help: help.to_owned(),
        })
    }

    /// `Expected '(', '{' or <string> when parsing function call, got ...`
    pub(super) fn method_without_brackets(&self) -> Option<Explanation> {
        if !self.words.contains("when parsing function call") {
            return None;
        }
        let failed_at = parser::parse(self.source).err()?.at;
        let before: Vec<&Token> = self
            .tokens
            .iter()
            .filter(|token| token.span.end <= failed_at.start && token.kind != TokenKind::End)
            .collect();
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
        Some(Explanation {
            at: name.span,
            message: format!("`{name_text}` needs brackets after it"),
            help: format!("to call it, write {object}:{name_text}()"),
        })
    }

    /// `Expected 'X' when parsing Y, got 'Z'`.
    pub(super) fn missing_word(&self) -> Option<Explanation> {
        let (_, rest) = self.words.split_once("Expected ")?;
        let (expected, rest) = rest.split_once(", got ")?;
        let expected = expected
            .split(" when parsing ")
            .next()?
            .split(" (")
            .next()?;
        let got = rest.split(';').next()?.trim();
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
        Some(Explanation {
            at: self.location(),
            message,
            help: String::new(),
        })
    }
}
