//! What a terminal, or a file in its place, is to be sent. Pure: text in, bytes out.

use crate::clean;

/// Back to the line's start, and away with what stands in it.
const CLEAR_LINE: &str = "\r\x1b[K";
/// Behind a line break within one record, so that no text can pass for a record of its own.
const CONTINUATION: &str = "\n  ";

/// What the output understands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Features {
    /// A line can be redrawn in place.
    pub(super) redraw: bool,
    /// Colours are wanted.
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

/// The lines above and the status line below them.
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

    /// A record for the log, cleaned; the status line moves below it.
    pub(super) fn record(&self, text: &str, columns: usize) -> String {
        let text = clean::text(text.trim_end(), self.features.colour).replace('\n', CONTINUATION);
        if !self.features.redraw {
            return format!("{text}\n");
        }
        format!("{CLEAR_LINE}{text}\n{}", self.visible_status(columns))
    }

    /// A new status line; nothing where lines cannot be redrawn.
    pub(super) fn status(&mut self, text: &str, columns: usize) -> String {
        self.status = clean::line(text);
        if !self.features.redraw {
            return String::new();
        }
        format!("{CLEAR_LINE}{}", self.visible_status(columns))
    }

    /// The status line goes, so that the shell's prompt begins an empty line.
    pub(super) fn end(&mut self) -> &'static str {
        let drawn = !std::mem::take(&mut self.status).is_empty();
        if drawn && self.features.redraw {
            CLEAR_LINE
        } else {
            ""
        }
    }

    /// One column stays free: many terminals break a line that fills the last one.
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
    fn a_file_gets_lines_and_nothing_else() {
        let mut screen = Screen::new(Features::FILE);
        assert_eq!(screen.status("driving", 80), "");
        assert_eq!(screen.record("\x1b[31mred\x1b[0m\n", 80), "red\n");
        assert_eq!(screen.end(), "");
    }

    #[test]
    fn a_line_break_in_a_text_cannot_pass_for_a_record() {
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
