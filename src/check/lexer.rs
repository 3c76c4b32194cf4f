//! The lexer: splits Luau source text into tokens. Never fails: what is not a Luau token becomes
//! [`TokenKind::Stray`], and [`super::syntax`] may know what was meant.

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
pub(crate) struct Span {
    pub(crate) start: usize,
    pub(crate) end: usize,
}

impl Span {
    pub(super) fn to(self, other: Span) -> Span {
        Span {
            start: self.start,
            end: other.end.max(self.start),
        }
    }

    pub(crate) fn of<'a>(&self, source: &'a str) -> &'a str {
        source.get(self.start..self.end).unwrap_or_default()
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum TokenKind {
    Name,
    Keyword,
    Number,
    Text,
    /// From the backtick or the closing brace to the next opening brace.
    PieceBefore,
    /// From the backtick or the closing brace to the backtick that ends it.
    PieceLast,
    /// An unterminated string or long comment.
    Unfinished,
    Symbol,
    Stray,
    End,
}

#[derive(Debug, Clone, Copy)]
pub(super) struct Token {
    pub(super) kind: TokenKind,
    pub(super) span: Span,
}

pub(super) const KEYWORDS: [&str; 21] = [
    "and", "break", "do", "else", "elseif", "end", "false", "for", "function", "if", "in", "local",
    "nil", "not", "or", "repeat", "return", "then", "true", "until", "while",
];

/// Longer symbols come before their prefixes.
const SYMBOLS: [&str; 41] = [
    "...", "..=", "//=", "::", "==", "~=", "<=", ">=", "->", "..", "//", "+=", "-=", "*=", "/=",
    "%=", "^=", "+", "-", "*", "/", "%", "^", "#", "<", ">", "=", "(", ")", "{", "}", "[", "]",
    ";", ":", ",", ".", "?", "|", "&", "@",
];

/// Returns all tokens, followed by one [`TokenKind::End`].
pub(super) fn tokens(source: &str) -> Vec<Token> {
    let mut lexer = Lexer {
        source,
        at: 0,
        braces: Vec::new(),
    };
    let mut tokens = Vec::new();
    loop {
        let token = lexer.next();
        tokens.push(token);
        if token.kind == TokenKind::End {
            return tokens;
        }
    }
}

struct Lexer<'a> {
    source: &'a str,
    at: usize,
    /// For each open brace, whether it belongs to an interpolated string.
    braces: Vec<bool>,
}

impl Lexer<'_> {
    fn rest(&self) -> &str {
        &self.source[self.at..]
    }

    fn byte(&self, ahead: usize) -> u8 {
        let bytes = self.source.as_bytes();
        bytes.get(self.at + ahead).copied().unwrap_or(0)
    }

    fn next(&mut self) -> Token {
        if let Some(unfinished) = self.skip_blank() {
            return unfinished;
        }
        let start = self.at;
        let kind = match self.rest().chars().next() {
            None => TokenKind::End,
            Some('a'..='z' | 'A'..='Z' | '_') => self.name(),
            Some('0'..='9') => self.number(),
            Some('.') if self.byte(1).is_ascii_digit() => self.number(),
            Some(quote @ ('"' | '\'')) => self.text(quote as u8),
            Some('`') => self.text(b'`'),
            Some('[') if self.long_bracket().is_some() => self.long_text(),
            Some('}') if self.braces.pop() == Some(true) => self.text(b'`'),
            Some(c) => self.symbol(c),
        };
        let span = Span {
            start,
            end: self.at,
        };
        Token { kind, span }
    }

    /// Skips blanks and comments. Returns a token only for an unterminated comment.
    fn skip_blank(&mut self) -> Option<Token> {
        loop {
            let rest = self.rest();
            let blank = rest.len() - rest.trim_start().len();
            self.at += blank;
            if !self.rest().starts_with("--") {
                return None;
            }
            let start = self.at;
            self.at += 2;
            if self.long_bracket().is_some() {
                if self.long_text() == TokenKind::Unfinished {
                    let span = Span {
                        start,
                        end: self.at,
                    };
                    let kind = TokenKind::Unfinished;
                    return Some(Token { kind, span });
                }
            } else {
                self.at += self.rest().find('\n').unwrap_or(self.rest().len());
            }
        }
    }

    fn name(&mut self) -> TokenKind {
        let rest = self.rest();
        let end = rest.find(|c: char| !(c.is_ascii_alphanumeric() || c == '_'));
        let word = &rest[..end.unwrap_or(rest.len())];
        let keyword = KEYWORDS.contains(&word);
        self.at += word.len();
        if keyword {
            TokenKind::Keyword
        } else {
            TokenKind::Name
        }
    }

    fn number(&mut self) -> TokenKind {
        let mut last = 0;
        loop {
            let byte = self.byte(0);
            let sign = matches!(byte, b'+' | b'-') && matches!(last, b'e' | b'E');
            let dots = byte == b'.' && self.byte(1) == b'.';
            if dots || !(byte.is_ascii_alphanumeric() || byte == b'_' || byte == b'.' || sign) {
                return TokenKind::Number;
            }
            last = byte;
            self.at += 1;
        }
    }

    /// Reads a string, or a piece of an interpolated one, which starts at its backtick or closing
    /// brace.
    fn text(&mut self, quote: u8) -> TokenKind {
        let is_piece = quote == b'`';
        self.at += 1;
        loop {
            match self.byte(0) {
                byte if byte == quote => {
                    self.at += 1;
                    return if is_piece {
                        TokenKind::PieceLast
                    } else {
                        TokenKind::Text
                    };
                }
                b'{' if is_piece => {
                    self.at += 1;
                    self.braces.push(true);
                    return TokenKind::PieceBefore;
                }
                b'\\' => self.skip_escape(),
                b'\n' | b'\r' => return TokenKind::Unfinished,
                _ if self.at >= self.source.len() => return TokenKind::Unfinished,
                _ => self.at += 1,
            }
        }
    }

    fn skip_escape(&mut self) {
        let z = self.byte(1) == b'z';
        self.at = (self.at + 2).min(self.source.len());
        while !self.source.is_char_boundary(self.at) {
            self.at += 1;
        }
        if z {
            self.at += self.rest().len() - self.rest().trim_start().len();
        }
    }

    /// Returns the number of `=` in the long bracket at this position, if there is one.
    fn long_bracket(&self) -> Option<usize> {
        let inside = self.rest().strip_prefix('[')?;
        let level = inside.len() - inside.trim_start_matches('=').len();
        inside[level..].starts_with('[').then_some(level)
    }

    fn long_text(&mut self) -> TokenKind {
        let level = self.long_bracket().unwrap_or(0);
        let close = format!("]{}]", "=".repeat(level));
        match self.rest().find(&close) {
            Some(at) => {
                self.at += at + close.len();
                TokenKind::Text
            }
            None => {
                self.at = self.source.len();
                TokenKind::Unfinished
            }
        }
    }

    fn symbol(&mut self, c: char) -> TokenKind {
        let symbol = SYMBOLS.iter().find(|one| self.rest().starts_with(**one));
        let Some(symbol) = symbol else {
            self.at += c.len_utf8();
            return TokenKind::Stray;
        };
        if c == '{' {
            self.braces.push(false);
        }
        self.at += symbol.len();
        TokenKind::Symbol
    }
}
