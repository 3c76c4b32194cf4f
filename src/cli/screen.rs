//! Computes the output for a terminal, or for a file in its place. Pure.

use crate::sanitize;

/// Returns to the start of the line and clears it.
const CLEAR_LINE: &str = "\r\x1b[K";
/// Replaces a line break within a record, so that no text can imitate a new record.
const CONTINUATION: &str = "\n  ";

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Features {
    /// Whether a line can be redrawn in place.
    pub(super) redraw: bool,
    pub(super) colour: bool,
}

#[cfg(test)]
impl Features {
    pub(super) const TERMINAL: Features = Features {
        redraw: true,
        colour: true,
    };
    pub(super) const FILE: Features = Features {
        redraw: false,
        colour: false,
    };
}

/// The log lines, and the status line below them.
#[derive(Debug)]
pub(super) struct Screen {
    features: Features,
    status: String,
}

impl Screen {
    pub(super) fn new(features: Features) -> Screen {
        Screen {
            features,
            status: String::new(),
        }
    }

    /// The output for a log record: cleaned, with the status line redrawn below it.
    pub(super) fn record(&self, text: &str, columns: usize) -> String {
        let text =
            sanitize::text(text.trim_end(), self.features.colour).replace('\n', CONTINUATION);
        if !self.features.redraw {
            return format!("{text}\n");
        }
        format!("{CLEAR_LINE}{text}\n{}", self.visible_status(columns))
    }

    /// The output for a new status line; empty if lines cannot be redrawn.
    pub(super) fn status(&mut self, text: &str, columns: usize) -> String {
        self.status = sanitize::line(text);
        if !self.features.redraw {
            return String::new();
        }
        format!("{CLEAR_LINE}{}", self.visible_status(columns))
    }

    /// The output that clears the status line, so that the shell's prompt starts on an empty line.
    pub(super) fn end(&mut self) -> &'static str {
        let drawn = !std::mem::take(&mut self.status).is_empty();
        if drawn && self.features.redraw {
            CLEAR_LINE
        } else {
            ""
        }
    }

    /// The status line, cut to leave one column free: many terminals wrap a line that fills the
    /// last column.
    fn visible_status(&self, columns: usize) -> String {
        self.status
            .chars()
            .take(columns.saturating_sub(1))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_status_line_stays_below_the_log_and_within_the_window() {
        let mut screen = Screen::new(Features::TERMINAL);
        assert_eq!(screen.status("driving 80 %", 9), "\r\x1b[Kdriving ");
        assert_eq!(screen.record("hello\n", 80), "\r\x1b[Khello\ndriving 80 %");
        assert_eq!(screen.end(), "\r\x1b[K");
        assert_eq!(screen.end(), "");
    }

    #[test]
    fn a_file_gets_only_lines() {
        let mut screen = Screen::new(Features::FILE);
        assert_eq!(screen.status("driving", 80), "");
        assert_eq!(screen.record("\x1b[31mred\x1b[0m\n", 80), "red\n");
        assert_eq!(screen.end(), "");
    }

    #[test]
    fn a_line_break_in_a_text_cannot_imitate_a_record() {
        let screen = Screen::new(Features::FILE);
        let shown = screen.record("INFO said\nERROR forged", 80);
        assert_eq!(shown, "INFO said\n  ERROR forged\n");
    }

    proptest! {
        #[test]
        fn no_control_character_survives_in_a_file(text in "\\PC*|[\\x00-\\xff\u{1b}\\[m0-9;]{0,60}") {
            let shown = Screen::new(Features::FILE).record(&text, 80);
            let bad = shown.chars().any(|c| c.is_control() && !matches!(c, '\n' | '\t'));
            prop_assert!(!bad, "{:?}", shown);
        }
    }
}
