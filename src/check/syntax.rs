//! Rephrases the compiler's error for people who write their first scripts: what was probably
//! meant, and the position with its column, which the compiler does not report.

mod ends;
mod gaps;
mod habits;

use super::diagnostic::{Diagnostic, Severity};
use super::lexer::{Span, Token, TokenKind, tokens};
use super::parser;

/// A source with its tokens, and the line and words of the compiler's error.
struct ErrorSite<'a> {
    source: &'a str,
    tokens: Vec<Token>,
    line: usize,
    words: &'a str,
    /// Positions of the line ends.
    ends: Vec<usize>,
}

/// What is wrong, and what to do.
struct Explanation {
    at: Span,
    message: String,
    help: String,
}

/// Returns the diagnostic for an error such as `a.lua:3: Expected 'then' when parsing if
/// statement`.
pub(super) fn diagnostic((chunk, source): (&str, &str), complaint: &str) -> Diagnostic {
    let rest = complaint.strip_prefix(chunk).unwrap_or(complaint);
    let rest = rest.strip_prefix(':').unwrap_or(rest);
    let (line, words) = match rest.split_once(':') {
        Some((line, words)) => (line.trim().parse().unwrap_or(1), words.trim()),
        None => (1, rest.trim()),
    };
    let words = words.lines().next().unwrap_or_default();
    let site = ErrorSite {
        source,
        tokens: tokens(source),
        line,
        words,
        ends: source.match_indices('\n').map(|(at, _)| at).collect(),
    };
    let explanation = site.explanation();
    Diagnostic::new(
        (chunk, source),
        explanation.at,
        Severity::Error,
        explanation.message,
    )
    .help(explanation.help)
}

impl ErrorSite<'_> {
    fn explanation(&self) -> Explanation {
        // The most certain rules first.
        let rules: [fn(&Self) -> Option<Explanation>; 17] = [
            Self::quotes,
            Self::unfinished,
            Self::unknown_symbols,
            Self::comments,
            Self::increments,
            Self::other_languages,
            Self::single_equals,
            Self::else_if,
            Self::braces,
            Self::blocks,
            Self::missing_end,
            Self::extra_end,
            Self::brackets,
            Self::lone_name,
            Self::missing_value,
            Self::method_without_brackets,
            Self::missing_word,
        ];
        let found = rules.iter().find_map(|rule| rule(self));
        found.unwrap_or_else(|| Explanation {
            at: self.location(),
            message: plain(self.words),
            help: String::new(),
        })
    }

    fn text(&self, token: &Token) -> &str {
        token.span.of(self.source)
    }

    fn line_of(&self, token: &Token) -> usize {
        self.line_at(token.span.start)
    }

    fn line_at(&self, position: usize) -> usize {
        self.ends.partition_point(|end| *end < position) + 1
    }

    /// Returns the tokens of the line that the compiler reports.
    fn on_line(&self) -> Vec<Token> {
        self.of_line(self.line)
    }

    fn of_line(&self, line: usize) -> Vec<Token> {
        let tokens = self.tokens.iter();
        tokens
            .filter(|token| self.line_of(token) == line && token.kind != TokenKind::End)
            .copied()
            .collect()
    }

    /// Returns the tokens of that line and of the last non-empty line before it: an incomplete line
    /// is only noticed on the next one.
    fn around(&self) -> Vec<Token> {
        let mut tokens = self.last_line_before();
        tokens.extend(self.on_line());
        tokens
    }

    fn last_line_before(&self) -> Vec<Token> {
        let before = self
            .tokens
            .iter()
            .rfind(|token| self.line_of(token) < self.line && token.kind != TokenKind::End);
        before.map_or_else(Vec::new, |token| self.of_line(self.line_of(token)))
    }

    /// Returns the position of the error: where our own parser failed, if that is on the line;
    /// otherwise the whole line.
    fn location(&self) -> Span {
        if let Err(error) = parser::parse(self.source)
            && self.line_at(error.at.start) == self.line
        {
            return error.at;
        }
        self.whole_line()
    }

    fn whole_line(&self) -> Span {
        let tokens = self.on_line();
        match (tokens.first(), tokens.last()) {
            (Some(first), Some(last)) => first.span.to(last.span),
            _ => self.end_of_file(),
        }
    }

    fn end_of_file(&self) -> Span {
        let end = self.source.trim_end().len();
        Span { start: end, end }
    }
}

fn closing(open: &str) -> &'static str {
    match open {
        "(" => ")",
        "[" => "]",
        _ => "}",
    }
}

/// Formats a token of the compiler's message: `'then'` in backticks, `identifier` as `a name`.
fn word(text: &str) -> String {
    match text {
        "identifier" => "a name".to_owned(),
        "<eof>" => "the end of the file".to_owned(),
        quoted => quoted.replace('\'', "`"),
    }
}

fn plain(words: &str) -> String {
    words
        .replace("<eof>", "the end of the file")
        .replace("identifier", "a name")
}
