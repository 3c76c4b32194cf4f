//! A diagnostic: what is wrong in a script, where, and how it is shown (the line with a caret
//! below).

use serde::{Deserialize, Serialize};

use super::lexer::Span;

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Severity {
    /// The script cannot work.
    Error,
    /// The script works, but probably not as intended.
    Warning,
}

#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Diagnostic {
    pub file: String,
    pub line: u32,
    /// The column, from 1, in characters.
    pub column: u32,
    /// Number of characters of the line that are marked; at least 1.
    pub width: u32,
    pub severity: Severity,
    /// What is wrong, in one sentence without a full stop.
    pub message: String,
    /// What to do, if that is not clear from the message.
    pub help: Option<String>,
    pub source: String,
}

/// The help for a name that was perhaps meant as a text.
pub(super) fn in_quotes(text: &str) -> String {
    format!("if this is a text, write it in quotes: \"{text}\"")
}

#[derive(Clone, Copy)]
pub(crate) struct SourceText<'a> {
    pub(crate) file: &'a str,
    pub(crate) text: &'a str,
}

impl SourceText<'_> {
    pub(crate) fn error(self, span: Span, message: impl Into<String>) -> Diagnostic {
        Diagnostic::new(self, span, Severity::Error, message)
    }
}

/// Maximum length of the source line shown, in characters.
const LONGEST_LINE: usize = 160;

impl Diagnostic {
    pub(crate) fn new(
        SourceText { file, text }: SourceText<'_>,
        span: Span,
        severity: Severity,
        message: impl Into<String>,
    ) -> Diagnostic {
        let start = span.start.min(text.len());
        let before = text.get(..start).unwrap_or_default();
        let line_start = before.rfind('\n').map_or(0, |at| at + 1);
        let line = text[line_start..].lines().next().unwrap_or_default();
        let column = before[line_start..].chars().count();
        let wide = text.get(span.start..span.end).unwrap_or_default();
        let wide = wide.lines().next().unwrap_or_default().chars().count();
        let number = |count: usize| u32::try_from(count).unwrap_or(u32::MAX);
        Diagnostic {
            file: file.to_owned(),
            line: number(before.matches('\n').count() + 1),
            column: number(column + 1),
            width: number(wide.max(1)),
            severity,
            message: message.into(),
            help: None,
            source: line
                .chars()
                .filter(|c| !c.is_control() || *c == '\t')
                .take(LONGEST_LINE)
                .collect(),
        }
    }

    pub(crate) fn help(self, help: impl Into<String>) -> Diagnostic {
        let help = help.into();
        Diagnostic {
            help: Some(help).filter(|help| !help.is_empty()),
            ..self
        }
    }

    /// Returns the position, such as `patrol.lua:3:7`.
    pub fn location(&self) -> String {
        format!("{}:{}:{}", self.file, self.line, self.column)
    }

    /// Returns the line, the carets below it, and the help.
    pub fn excerpt(&self) -> String {
        let number = self.line.to_string();
        let margin = " ".repeat(number.len());
        let mut text = format!("{number} | {}\n{margin} | {}", self.source, self.carets());
        if let Some(help) = &self.help {
            text += &format!("\n{margin} = help: {help}");
        }
        text
    }

    /// Returns position, message and excerpt, without the severity, which the caller shows itself.
    pub fn text(&self) -> String {
        format!("{}: {}\n{}", self.location(), self.message, self.excerpt())
    }

    /// Returns the line of carets: blanks up to the column (tabs where the line has tabs), and
    /// carets below the marked characters.
    pub fn carets(&self) -> String {
        let column = self.column.saturating_sub(1) as usize;
        let length = self.source.chars().count();
        let before = self.source.chars().take(column);
        let mut text: String = before.map(|c| if c == '\t' { '\t' } else { ' ' }).collect();
        let room = length.saturating_sub(column).max(1);
        text.extend(std::iter::repeat_n('^', (self.width as usize).min(room)));
        text
    }
}

impl std::fmt::Display for Diagnostic {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let severity = match self.severity {
            Severity::Error => "error",
            Severity::Warning => "warning",
        };
        write!(
            f,
            "{}: {severity}: {}\n{}",
            self.location(),
            self.message,
            self.excerpt()
        )
    }
}
