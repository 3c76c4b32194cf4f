//! Rephrases the compiler's error for people who write their first scripts: what was probably
//! meant, and the position with its column, which the compiler does not report.

mod gaps;

use super::diagnostic::{Diagnostic, SourceText};
use super::lexer::{Span, Token, TokenKind, tokens};
use super::parser;

/// A source with its tokens, and the line and words of the compiler's error.
struct ErrorSite<'a> {
    source: SourceText<'a>,
    tokens: Vec<Token>,
    line: usize,
    words: &'a str,
    ends: Vec<usize>,
}

/// For an error such as `a.lua:3: Expected 'then' when parsing if statement`.
pub(super) fn diagnostic(source: SourceText<'_>, complaint: &str) -> Diagnostic {
    let chunk = source.file;
    let rest = complaint.strip_prefix(chunk).unwrap_or(complaint);
    let rest = rest.strip_prefix(':').unwrap_or(rest);
    let (line, words) = match rest.split_once(':') {
        Some((line, words)) => (line.trim().parse().unwrap_or(1), words.trim()),
        None => (1, rest.trim()),
    };
    let words = words.lines().next().unwrap_or_default();
    let site = ErrorSite {
        source,
        tokens: tokens(source.text),
        line,
        words,
        ends: source.text.match_indices('\n').map(|(at, _)| at).collect(),
    };
    site.explanation()
}

impl ErrorSite<'_> {
    fn explanation(&self) -> Diagnostic {
        // The most certain rules first.
        let rules: [fn(&Self) -> Option<Diagnostic>; 20] = [
            Self::quotes,
            Self::unfinished,
            Self::unknown_symbols,
            Self::counting_loop,
            Self::unit,
            Self::comments,
            Self::increments,
            Self::other_languages,
            Self::other_forms,
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
        found.unwrap_or_else(|| self.error(self.location(), plain(self.words)))
    }

    fn error(&self, span: Span, message: impl Into<String>) -> Diagnostic {
        self.source.error(span, message)
    }

    fn text(&self, token: &Token) -> &str {
        token.span.of(self.source.text)
    }

    fn line_of(&self, token: &Token) -> usize {
        self.line_at(token.span.start)
    }

    fn line_at(&self, position: usize) -> usize {
        self.ends.partition_point(|end| *end < position) + 1
    }

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
        let mut tokens = self.tokens.iter();
        let before =
            tokens.rfind(|token| self.line_of(token) < self.line && token.kind != TokenKind::End);
        before.map_or_else(Vec::new, |token| self.of_line(self.line_of(token)))
    }

    /// Where our own parser failed, if that is on the line; otherwise the whole line.
    fn location(&self) -> Span {
        if let Err(failed_at) = parser::parse(self.source.text)
            && self.line_at(failed_at.start) == self.line
        {
            return failed_at;
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
        let end = self.source.text.trim_end().len();
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

/// Whether the test of an `if` or of a loop is open after these tokens.
fn is_tested(before: &[&str]) -> bool {
    let words = ["if", "elseif", "while", "until", "then", "do"];
    let opening = before.iter().rposition(|text| words.contains(text));
    opening.is_some_and(|opening| {
        let inside = &before[opening..];
        let count = |bracket| inside.iter().filter(|text| **text == bracket).count();
        words[..4].contains(&before[opening]) && count("(") == count(")")
    })
}

impl ErrorSite<'_> {
    fn quotes(&self) -> Option<Diagnostic> {
        let typographic = ['“', '”', '„', '‘', '’', '«', '»'];
        let is_one = |token: &&Token| self.text(token).starts_with(typographic);
        let token = self.around().into_iter().find(|token| is_one(&token))?;
        let message = "these are typographic quotes";
        let help = "a string is written in straight quotes: \"text\"";
        Some(self.error(token.span, message).help(help))
    }

    fn unfinished(&self) -> Option<Diagnostic> {
        let token = self
            .tokens
            .iter()
            .find(|token| token.kind == TokenKind::Unfinished)?;
        if self.line_of(token) > self.line {
            return None;
        }
        let open_string = "this string has no closing quote";
        let (message, help) = match self.text(token).chars().next() {
            Some('-' | '[') => ("this has no end", "a long comment ends with ]]"),
            Some('`' | '}') => (open_string, "a string in backticks ends with `"),
            Some('\'') => (open_string, "it ends with ', in the same line"),
            _ => (open_string, "it ends with \", in the same line"),
        };
        Some(self.error(token.span, message).help(help))
    }

    /// Symbols that this language does not have.
    fn unknown_symbols(&self) -> Option<Diagnostic> {
        let tokens = self.around();
        for (at, token) in tokens.iter().enumerate() {
            let next = tokens.get(at + 1).map_or("", |next| self.text(next));
            let help = match (self.text(token), next) {
                ("!", "=") | ("!", "==") => "\"not equal\" is written ~=",
                ("!", _) => "\"not\" is written not",
                ("&", "&") => "\"and\" is written and",
                ("|", "|") => "\"or\" is written or",
                ("$" | "\\" | "~", _) => "this sign has no meaning here",
                _ => continue,
            };
            let end = match (self.text(token), next) {
                ("!", "=" | "==") | ("&", "&") | ("|", "|") => tokens[at + 1].span,
                _ => token.span,
            };
            let whole = token.span.to(end);
            let message = format!("'{}' is not known here", whole.of(self.source.text));
            return Some(self.error(whole, message).help(help));
        }
        None
    }

    fn comments(&self) -> Option<Diagnostic> {
        let tokens = self.on_line();
        let first = tokens.first()?;
        let second = tokens.get(1).map_or("", |token| self.text(token));
        let comment =
            matches!(self.text(first), "//" | "#") || (self.text(first) == "/" && second == "*");
        let mut behind = tokens.iter().skip(1);
        let behind = behind.find(|token| matches!(self.text(token), "//" | "#"));
        let before_words = |token: &&Token| {
            let after = tokens
                .iter()
                .filter(|other| other.span.start > token.span.end);
            let words = after.take(2).filter(|other| other.kind == TokenKind::Name);
            words.count() == 2
        };
        let token = if comment {
            first
        } else {
            behind.filter(before_words)?
        };
        let error = self.error(token.span, "this is not a comment here");
        Some(error.help("a comment begins with --"))
    }

    /// `x++`, and `x--`, where `--` begins a comment.
    fn increments(&self) -> Option<Diagnostic> {
        for tokens in [self.last_line_before(), self.on_line()] {
            for pair in tokens.windows(3) {
                let [name, one, two] = pair else { continue };
                if name.kind == TokenKind::Name && self.text(one) == "+" && self.text(two) == "+" {
                    let text = self.text(name);
                    let message = "there is no ++";
                    let help = format!("write {text} += 1");
                    return Some(self.error(one.span.to(two.span), message).help(help));
                }
            }
        }
        let tokens = self.last_line_before();
        let [name] = tokens.as_slice() else {
            return None;
        };
        let behind = self.source.text[name.span.end..]
            .lines()
            .next()
            .unwrap_or_default();
        if name.kind != TokenKind::Name || !behind.starts_with("--") {
            return None;
        }
        let message = "there is no operator --: it begins a comment";
        let help = format!("write {} -= 1", self.text(name));
        Some(self.error(name.span, message).help(help))
    }

    /// A line that begins with a keyword of another language.
    fn other_languages(&self) -> Option<Diagnostic> {
        for tokens in [self.on_line(), self.last_line_before()] {
            let Some(first) = tokens
                .iter()
                .find(|token| !matches!(self.text(token), "}" | "local"))
            else {
                continue;
            };
            let second = tokens
                .iter()
                .find(|token| token.span.start > first.span.start);
            let named = second.is_some_and(|token| matches!(token.kind, TokenKind::Name));
            let help = match self.text(first) {
                "def" | "func" | "fn" | "fun" | "void" if named => {
                    "a function begins with: function name(...), and ends with end"
                }
                "var" | "let" | "const" | "int" | "float" | "double" | "string" | "bool"
                | "auto"
                    if named =>
                {
                    "a variable begins with the word local: local name = value"
                }
                "import" | "from" | "include" | "using" if second.is_some() => {
                    "load a module with local name = require(\"./name\")"
                }
                "elif" | "elsif" => "it is written elseif ... then",
                "switch" | "case" | "match" => {
                    "there is no such word; write if ... then ... elseif ... then ... end"
                }
                "try" | "except" | "catch" => {
                    "there is no such word; pcall(fn) calls a function and tells whether it failed"
                }
                "class" if named => "there are no classes; use a table and functions",
                "loop" | "forever" => "write while true do ... end",
                "foreach" => "write for _, thing in list do ... end",
                _ => continue,
            };
            let message = format!("'{}' is not a word of this language", self.text(first));
            return Some(self.error(first.span, message).help(help));
        }
        None
    }

    /// Forms of other languages that begin within a line.
    fn other_forms(&self) -> Option<Diagnostic> {
        let tokens = self.around();
        let texts: Vec<&str> = tokens.iter().map(|token| self.text(token)).collect();
        let is_number = |at: usize| {
            let token = tokens.get(at);
            token.is_some_and(|token| token.kind == TokenKind::Number)
        };
        let adjoins = |at: usize| tokens[at + 1].span.start == tokens[at].span.end;
        for (at, token) in tokens.iter().enumerate() {
            let (last, message, help) = match &texts[at..] {
                ["=", ">", ..] if adjoins(at) && (is_number(at + 2) || is_tested(&texts[..at])) => {
                    let help = "\"greater or equal\" is written >=";
                    (at + 1, "'=>' is not known here", help.to_owned())
                }
                ["=", "<", ..] if adjoins(at) => {
                    let help = "\"less or equal\" is written <=";
                    (at + 1, "'=<' is not known here", help.to_owned())
                }
                ["=", ">", ..] if adjoins(at) => {
                    let help = "write function(name) ... end";
                    (at + 1, "a function is not written with =>", help.to_owned())
                }
                ["require", "(", "@" | "." | "..", rest @ ..] => {
                    let length = rest.iter().position(|text| *text == ")");
                    let last = at + 2 + length.unwrap_or(rest.len());
                    let name = tokens[at + 2].span.to(tokens[last].span);
                    let help = format!("write require(\"{}\")", name.of(self.source.text));
                    (last, "the name of a module is written in quotes", help)
                }
                ["goto", ..] if at + 1 < tokens.len() => {
                    let help = "write break, continue or return";
                    (at, "there is no goto", help.to_owned())
                }
                ["for", number, ",", ..] if is_number(at + 1) => {
                    let help = format!("write for i = {number}, ... do");
                    (at + 1, "a `for` needs a name that counts", help)
                }
                ["=", "(", _, ",", ..] if is_number(at + 2) => {
                    let help = "write it in braces: { 1, 2, 3 }".to_owned();
                    (at + 1, "a list is not written in round brackets", help)
                }
                _ => continue,
            };
            let span = token.span.to(tokens[last].span);
            return Some(self.error(span, message).help(help));
        }
        None
    }

    /// `for i == 1, 3 do`, `for i = 1; 3 do` and `for i = 3 do`.
    fn counting_loop(&self) -> Option<Diagnostic> {
        let tokens = self.on_line();
        let begins = tokens.iter().position(|token| self.text(token) == "for")?;
        let header = tokens[begins..].iter();
        let header = header.take_while(|token| self.text(token) != "do");
        let header: Vec<&Token> = header.collect();
        let [_, name, equals, first, ..] = header.as_slice() else {
            return None;
        };
        let semicolon = header.iter().find(|token| self.text(token) == ";");
        let (at, message) = match (self.text(equals), semicolon) {
            ("==", _) if self.words.contains("'=='") => {
                (equals, "the counter of a `for` is set with a single =")
            }
            ("=", Some(semicolon)) if self.words.contains("';'") => {
                (semicolon, "these numbers are separated by commas")
            }
            ("=", None) if self.words.contains("','") && self.words.contains("got 'do'") => {
                (first, "a `for` needs two numbers: the first and the last")
            }
            _ => return None,
        };
        let numbers = first.span.to(header.last()?.span).of(self.source.text);
        let numbers = match numbers.replace(';', ",") {
            condition if condition.contains(['<', '>', '+']) => "1, 10".to_owned(),
            last if at.span == first.span => format!("1, {last}"),
            numbers => numbers,
        };
        let help = format!("write for {} = {numbers} do", self.text(name));
        Some(self.error(at.span, message).help(help))
    }

    /// `50cm`.
    fn unit(&self) -> Option<Diagnostic> {
        let mut numbers = self.on_line().into_iter();
        let token = numbers.find(|token| {
            token.kind == TokenKind::Number
                && self.words.contains("Malformed number")
                && self.text(token).ends_with(char::is_alphabetic)
        })?;
        let text = self.text(&token);
        let number = text.trim_end_matches(char::is_alphabetic);
        let scaled = |by: f64| number.parse().map_or(0.0, |number: f64| number / by);
        let help = match &text[number.len()..] {
            "cm" => format!("a number has no unit; in metres, this is {}", scaled(100.0)),
            "mm" => format!(
                "a number has no unit; in metres, this is {}",
                scaled(1000.0)
            ),
            "ms" => format!(
                "a number has no unit; in seconds, this is {}",
                scaled(1000.0)
            ),
            _ => format!("a number has no unit: write {number}"),
        };
        Some(self.error(token.span, "this is not a number").help(help))
    }

    fn single_equals(&self) -> Option<Diagnostic> {
        let tokens = self.on_line();
        let texts: Vec<&str> = tokens.iter().map(|token| self.text(token)).collect();
        let is_opening = |text: &&str| matches!(*text, "if" | "elseif" | "while" | "until");
        let begins = texts.iter().position(is_opening)? + 1;
        let find = |from: usize, words: &[&str]| {
            let found = texts[from..].iter().position(|text| words.contains(text));
            found.map(|found| from + found)
        };
        let at = find(begins, &["=", "then", "do"])?;
        let equals = tokens[at];
        if texts[at] != "=" {
            return None;
        }
        let names = &texts[begins..at];
        let end = find(at, &["then", "do"]).unwrap_or(texts.len());
        let is_call = names.len() == 1 && texts[at..end].contains(&"(");
        if is_call || names.contains(&",") && !names.contains(&"(") {
            let message = if is_call {
                "a result cannot be set here"
            } else {
                "several results cannot be set here"
            };
            let help = format!(
                "on the line before, write local {} = ...; here test {}",
                names.concat().replace(',', ", "),
                names[0]
            );
            return Some(self.error(equals.span, message).help(help));
        }
        let error = self.error(equals.span, "a single = sets a variable");
        Some(error.help("to compare, write =="))
    }

    /// `else if` opens a second `if`, which needs its own `end`.
    fn else_if(&self) -> Option<Diagnostic> {
        if !self.words.contains("'end'") {
            return None;
        }
        let pair = self.tokens.windows(2).find(|pair| {
            self.text(&pair[0]) == "else"
                && self.text(&pair[1]) == "if"
                && self.line_of(&pair[0]) == self.line_of(&pair[1])
        })?;
        let both = pair[0].span.to(pair[1].span);
        let message = "`else if` begins a second if, which needs its own end";
        Some(self.error(both, message).help("write elseif, in one word"))
    }

    /// A block in braces. The compiler notices it only at its end, because `f() {` is a call of `f`
    /// with a table.
    fn braces(&self) -> Option<Diagnostic> {
        let lines = self
            .tokens
            .chunk_by(|a, b| self.line_of(a) == self.line_of(b));
        let mut above = lines.filter(|line| {
            line.first()
                .is_some_and(|first| self.line_of(first) <= self.line)
        });
        let (keyword, brace) = above.find_map(|line| {
            let first = line.iter().find(|token| self.text(token) != "}")?;
            let opens = matches!(self.text(first), "if" | "elseif" | "else" | "while" | "for");
            let closed = line
                .iter()
                .any(|token| matches!(self.text(token), "then" | "do"));
            let last = line.iter().rfind(|token| token.kind != TokenKind::End)?;
            (opens && !closed && self.text(last) == "{").then_some((first, last))
        })?;
        let begin = match self.text(keyword) {
            "if" | "elseif" => "`then` here, and ",
            "else" => "",
            _ => "`do` here, and ",
        };
        let message = "'{' does not begin a block";
        let help = format!("write {begin}`end` where the block ends");
        Some(self.error(brace.span, message).help(help))
    }
}
