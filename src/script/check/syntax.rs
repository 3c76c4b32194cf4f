//! The compiler's complaint in words for people who write their first scripts: what was probably
//! meant, and the place with its column, which the compiler does not tell.

use super::finding::{Finding, Severity};
use super::lexer::{Kind, Span, Token, tokens};
use super::parser;

/// A source with its tokens, and where the compiler gave up.
struct Scene<'a> {
    source: &'a str,
    tokens: Vec<Token>,
    line: usize,
    words: &'a str,
    /// Where lines end.
    ends: Vec<usize>,
}

/// What is wrong, and what to do.
struct Remark {
    at: Span,
    message: String,
    help: String,
}

/// The finding for a complaint such as `a.lua:3: Expected 'then' when parsing if statement`.
pub(super) fn finding((chunk, source): (&str, &str), complaint: &str) -> Finding {
    let rest = complaint.strip_prefix(chunk).unwrap_or(complaint);
    let rest = rest.strip_prefix(':').unwrap_or(rest);
    let (line, words) = match rest.split_once(':') {
        Some((line, words)) => (line.trim().parse().unwrap_or(1), words.trim()),
        None => (1, rest.trim()),
    };
    let words = words.lines().next().unwrap_or_default();
    let scene = Scene {
        source,
        tokens: tokens(source),
        line,
        words,
        ends: source.match_indices('\n').map(|(at, _)| at).collect(),
    };
    let remark = scene.remark();
    Finding::new((chunk, source), remark.at, Severity::Error, remark.message).help(remark.help)
}

impl Scene<'_> {
    fn remark(&self) -> Remark {
        // The most certain first.
        let rules: [fn(&Self) -> Option<Remark>; 16] = [
            Self::quotes,
            Self::unfinished,
            Self::strangers,
            Self::comments,
            Self::steps,
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
            Self::missing_word,
        ];
        let found = rules.iter().find_map(|rule| rule(self));
        found.unwrap_or_else(|| Remark {
            at: self.place(),
            message: plain(self.words),
            help: String::new(),
        })
    }

    fn text(&self, token: &Token) -> &str {
        token.span.of(self.source)
    }

    fn line_of(&self, token: &Token) -> usize {
        self.ends.partition_point(|end| *end < token.span.start) + 1
    }

    /// The tokens of the line where the compiler gave up.
    fn on_line(&self) -> Vec<Token> {
        self.of_line(self.line)
    }

    fn of_line(&self, line: usize) -> Vec<Token> {
        let tokens = self.tokens.iter();
        tokens
            .filter(|token| self.line_of(token) == line && token.kind != Kind::End)
            .copied()
            .collect()
    }

    /// That line and the one before it: a line that is cut short is noticed on the next.
    fn around(&self) -> Vec<Token> {
        let mut tokens = self.last_line_before();
        tokens.extend(self.on_line());
        tokens
    }

    fn last_line_before(&self) -> Vec<Token> {
        let before = self
            .tokens
            .iter()
            .rfind(|token| self.line_of(token) < self.line && token.kind != Kind::End);
        before.map_or_else(Vec::new, |token| self.of_line(self.line_of(token)))
    }

    /// Where it is: where our own parser was lost, if that is the line; else the line's first word.
    fn place(&self) -> Span {
        if let Err(lost) = parser::parse(self.source)
            && self.ends.partition_point(|end| *end < lost.at.start) + 1 == self.line
        {
            return lost.at;
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

    // Rules ------------------------------------------------------------------------------------

    fn quotes(&self) -> Option<Remark> {
        let typographic = ['“', '”', '„', '‘', '’', '«', '»'];
        let is_one = |token: &&Token| self.text(token).starts_with(typographic);
        let token = self.around().into_iter().find(|token| is_one(&token))?;
        Some(Remark {
            at: token.span,
            message: "these are typographic quotes".to_owned(),
            help: "a text stands in straight quotes: \"text\"".to_owned(),
        })
    }

    fn unfinished(&self) -> Option<Remark> {
        let token = self
            .tokens
            .iter()
            .find(|token| token.kind == Kind::Unfinished)?;
        if self.line_of(token) > self.line {
            return None;
        }
        let (message, help) = match self.text(token).chars().next() {
            Some('-' | '[') => ("this has no end", "a long comment ends with ]]"),
            Some('`') => (
                "this text has no closing quote",
                "a text in backticks ends with `",
            ),
            Some('}') => (
                "this text has no closing quote",
                "a text in backticks ends with `",
            ),
            Some('\'') => (
                "this text has no closing quote",
                "it ends with ', in the same line",
            ),
            _ => (
                "this text has no closing quote",
                "it ends with \", in the same line",
            ),
        };
        Some(Remark {
            at: token.span,
            message: message.to_owned(),
            help: help.to_owned(),
        })
    }

    /// Signs that are not of this language.
    fn strangers(&self) -> Option<Remark> {
        let tokens = self.around();
        for (at, token) in tokens.iter().enumerate() {
            let next = tokens.get(at + 1).map_or("", |next| self.text(next));
            let help = match (self.text(token), next) {
                ("!", "=") | ("!", "==") => "\"not equal\" is written ~=",
                ("!", _) => "\"not\" is written not",
                ("&", "&") => "\"and\" is written and",
                ("|", "|") => "\"or\" is written or",
                ("$" | "\\" | "~", _) => "this sign means nothing here",
                _ => continue,
            };
            let end = match (self.text(token), next) {
                ("!", "=" | "==") | ("&", "&") | ("|", "|") => tokens[at + 1].span,
                _ => token.span,
            };
            let whole = token.span.to(end);
            return Some(Remark {
                at: whole,
                message: format!("'{}' is not known here", whole.of(self.source)),
                help: help.to_owned(),
            });
        }
        None
    }

    fn comments(&self) -> Option<Remark> {
        let tokens = self.on_line();
        let first = tokens.first()?;
        let second = tokens.get(1).map_or("", |token| self.text(token));
        let comment =
            matches!(self.text(first), "//" | "#") || (self.text(first) == "/" && second == "*");
        let behind = tokens
            .iter()
            .skip(1)
            .find(|token| matches!(self.text(token), "//" | "#"));
        let behind = behind.filter(|token| {
            let next = tokens
                .iter()
                .filter(|other| other.span.start > token.span.end);
            next.take(2)
                .filter(|other| other.kind == Kind::Name)
                .count()
                == 2
        });
        let token = match comment {
            true => first,
            false => behind?,
        };
        Some(Remark {
            at: token.span,
            message: "this is no comment here".to_owned(),
            help: "a comment begins with --".to_owned(),
        })
    }

    /// `x++`, and `x--`, whose second half is a comment.
    fn steps(&self) -> Option<Remark> {
        for tokens in [self.last_line_before(), self.on_line()] {
            for pair in tokens.windows(3) {
                let [name, one, two] = pair else { continue };
                if name.kind == Kind::Name && self.text(one) == "+" && self.text(two) == "+" {
                    let text = self.text(name);
                    return Some(Remark {
                        at: one.span.to(two.span),
                        message: "there is no ++".to_owned(),
                        help: format!("write {text} += 1"),
                    });
                }
            }
        }
        let tokens = self.last_line_before();
        let [name] = tokens.as_slice() else {
            return None;
        };
        let behind = self.source[name.span.end..]
            .lines()
            .next()
            .unwrap_or_default();
        (name.kind == Kind::Name && behind.starts_with("--")).then(|| Remark {
            at: name.span,
            message: "there is no --: it begins a comment".to_owned(),
            help: format!("write {} -= 1", self.text(name)),
        })
    }

    /// A line that begins with a word of another language.
    fn other_languages(&self) -> Option<Remark> {
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
            let named = second.is_some_and(|token| matches!(token.kind, Kind::Name));
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
                    "modules come with local name = require(\"./name\")"
                }
                "elif" | "elsif" => "it is written elseif ... then",
                "switch" | "case" | "match" => {
                    "there is no such word; write if ... then ... elseif ... then ... end"
                }
                "try" | "except" | "catch" => {
                    "there is no such word; pcall(fn) calls a function and tells whether it failed"
                }
                "class" if named => "there are no classes; a table and functions do",
                "loop" | "forever" => "write while true do ... end",
                "foreach" => "write for _, thing in list do ... end",
                _ => continue,
            };
            return Some(Remark {
                at: first.span,
                message: format!("'{}' is not a word of this language", self.text(first)),
                help: help.to_owned(),
            });
        }
        None
    }

    fn single_equals(&self) -> Option<Remark> {
        let tokens = self.on_line();
        let begins = tokens
            .iter()
            .position(|token| matches!(self.text(token), "if" | "elseif" | "while" | "until"))?;
        let equals = tokens[begins..]
            .iter()
            .find(|token| matches!(self.text(token), "=" | "then" | "do"))?;
        (self.text(equals) == "=").then(|| Remark {
            at: equals.span,
            message: "a single = sets a variable".to_owned(),
            help: "to compare, write ==".to_owned(),
        })
    }

    /// `else if` opens a second `if`, which needs an `end` of its own.
    fn else_if(&self) -> Option<Remark> {
        if !self.words.contains("'end'") {
            return None;
        }
        let pair = self.tokens.windows(2).find(|pair| {
            self.text(&pair[0]) == "else"
                && self.text(&pair[1]) == "if"
                && self.line_of(&pair[0]) == self.line_of(&pair[1])
        })?;
        Some(Remark {
            at: pair[0].span.to(pair[1].span),
            message: "`else if` begins a second if, which needs an end of its own".to_owned(),
            help: "write elseif, in one word".to_owned(),
        })
    }

    /// A block in braces is noticed at its end only, for `f() {` calls `f` with a table.
    fn braces(&self) -> Option<Remark> {
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
            let last = line.iter().rfind(|token| token.kind != Kind::End)?;
            (opens && !closed && self.text(last) == "{").then_some((first, last))
        })?;
        let begin = match self.text(keyword) {
            "if" | "elseif" => "`then` here, and ",
            "else" => "",
            _ => "`do` here, and ",
        };
        Some(Remark {
            at: brace.span,
            message: "'{' does not begin a block".to_owned(),
            help: format!("write {begin}`end` where the block ends"),
        })
    }

    /// Blocks as other languages write them.
    fn blocks(&self) -> Option<Remark> {
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
                    format!("the block of `{keyword}` ends with end, and needs no sign before it")
                }
                word => format!("write `{word}` here, and `end` where the block ends"),
            };
            return Some(Remark {
                at: last.span,
                message: format!("'{}' does not begin a block", self.text(last)),
                help,
            });
        }
        let complains = !word.is_empty() && self.words.contains(&format!("'{word}'"));
        let missing = complains && !behind.iter().any(|token| self.text(token) == word);
        missing.then(|| Remark {
            at: Span {
                start: last.span.end,
                end: last.span.end,
            },
            message: format!("`{keyword}` needs `{word}` behind it"),
            help: format!("write `{word}` at the end of this line"),
        })
    }

    /// `Expected 'end' (to close 'function' at line 3), got <eof>`.
    fn missing_end(&self) -> Option<Remark> {
        let rest = self.words.split_once("Expected 'end' (to close '")?.1;
        let (keyword, rest) = rest.split_once('\'')?;
        // What the compiler thinks was forgotten further in is nearer to the truth.
        let (keyword, rest) = match rest.split_once("did you forget to close '") {
            Some((_, hint)) => hint.split_once('\'')?,
            None => (keyword, rest),
        };
        let digits: String = rest
            .chars()
            .skip_while(|c| !c.is_ascii_digit())
            .take_while(char::is_ascii_digit)
            .collect();
        let line = digits.parse().unwrap_or(self.line);
        let opened = self
            .of_line(line)
            .into_iter()
            .find(|token| self.text(token) == keyword);
        let (at, where_) = match opened {
            Some(token) => (token.span, String::new()),
            None => (self.place(), format!(" of line {line}")),
        };
        let keyword = match keyword {
            "then" => "if",
            "do" => "loop",
            other => other,
        };
        Some(Remark {
            at,
            message: format!("the `{keyword}`{where_} that begins here has no `end`"),
            help: "each function, if, for, while and do is closed by its own end".to_owned(),
        })
    }

    fn extra_end(&self) -> Option<Remark> {
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
            token.kind == Kind::Name
                && starts_line
                && called
                && indented
                && before != Some("function")
        });
        if !self.words.contains("<eof>") {
            return None;
        }
        Some(match head {
            Some((_, token)) => Remark {
                at: token.span,
                message: format!(
                    "the word `function` is missing before `{}`",
                    self.text(token)
                ),
                help: format!("write function {}(...)", self.text(token)),
            },
            None => Remark {
                at: end.span,
                message: "this `end` closes nothing: there is one too many".to_owned(),
                help: "each function, if, for, while and do has exactly one end".to_owned(),
            },
        })
    }

    fn is_followed_by_indent(&self, line: usize) -> bool {
        let indent = |line: usize| {
            let text = self.source.lines().nth(line - 1)?;
            Some(text.len() - text.trim_start().len())
        };
        indent(line + 1) > indent(line)
    }

    /// `Expected ')' (to close '(' at line 3), got ...`
    fn brackets(&self) -> Option<Remark> {
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
                        return Some(Remark {
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
        Some(Remark {
            at: token.span,
            message: format!("this '{}' is never closed", self.text(token)),
            help: format!("a '{close}' or a comma is missing"),
        })
    }

    /// `Incomplete statement: expected assignment or a function call`.
    fn lone_name(&self) -> Option<Remark> {
        if !self.words.contains("Incomplete statement") {
            return None;
        }
        let tokens: Vec<_> = self.on_line();
        let path: Vec<_> = tokens
            .iter()
            .take_while(|token| token.kind == Kind::Name || self.text(token) == ".")
            .collect();
        let (first, last) = (path.first()?, path.last()?);
        let span = first.span.to(last.span);
        let next = tokens.get(path.len());
        let help = match next.map(|next| (next.kind, self.text(next))) {
            None => format!("to call it, write {}()", span.of(self.source)),
            Some((_, "==")) => "to set a variable, write a single =".to_owned(),
            Some((Kind::Name | Kind::Number | Kind::Keyword, _)) => {
                format!(
                    "what a function is given stands in brackets: {}(...)",
                    span.of(self.source)
                )
            }
            Some(_) => String::new(),
        };
        Some(Remark {
            at: span,
            message: format!("`{}` alone does nothing", span.of(self.source)),
            help,
        })
    }

    /// `Expected identifier when parsing expression, got ...`
    fn missing_value(&self) -> Option<Remark> {
        if !self.words.contains("when parsing expression") {
            return None;
        }
        let lost = match parser::parse(self.source) {
            Err(lost) => lost.at,
            Ok(_) => return None,
        };
        let before = self
            .tokens
            .iter()
            .rfind(|token| token.span.end <= lost.start && token.kind != Kind::End)?;
        let found = lost.of(self.source);
        let message = match found {
            "" => format!("a value is missing behind `{}`", self.text(before)),
            found => format!(
                "a value is missing behind `{}`: `{found}` cannot stand there",
                self.text(before)
            ),
        };
        Some(Remark {
            at: before.span,
            message,
            help: String::new(),
        })
    }

    /// `Expected 'X' when parsing Y, got 'Z'`.
    fn missing_word(&self) -> Option<Remark> {
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
            ("<eof>", got) => format!("{} cannot stand here", word(got)),
            (expected, "<eof>") => format!("{} is missing at the end", word(expected)),
            (expected, got) => format!("expected {} here, found {}", word(expected), word(got)),
        };
        Some(Remark {
            at: self.place(),
            message,
            help: String::new(),
        })
    }
}

fn closing(open: &str) -> &'static str {
    match open {
        "(" => ")",
        "[" => "]",
        _ => "}",
    }
}

/// `'then'` as people read it, `identifier` as `a name`.
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
