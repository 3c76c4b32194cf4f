//! What a terminal, or a file in its place, is to be sent. Pure: text in, bytes out.

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
        let text = clean(text.trim_end(), self.features.colour).replace('\n', CONTINUATION);
        if !self.features.redraw {
            return format!("{text}\n");
        }
        format!("{CLEAR_LINE}{text}\n{}", self.visible_status(columns))
    }

    /// A new status line; nothing where lines cannot be redrawn.
    pub(super) fn status(&mut self, text: &str, columns: usize) -> String {
        self.status = clean(text, false).replace(['\n', '\t'], " ");
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

/// Text without what a terminal obeys. Line breaks and tabs stay, and with `colour` the sequences
/// that set colours; other escape sequences lose their first character and so all effect.
pub(super) fn clean(text: &str, colour: bool) -> String {
    let mut cleaned = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(c) = rest.chars().next() {
        let sequence = colour_sequence_len(rest);
        let length = sequence.unwrap_or(c.len_utf8());
        let (head, tail) = rest.split_at(length);
        let harmless = matches!(c, '\n' | '\t') || !(c.is_control() || reorders(c));
        if if sequence.is_some() { colour } else { harmless } {
            cleaned.push_str(head);
        }
        rest = tail;
    }
    cleaned
}

/// Characters that make text read in another order than it stands.
fn reorders(c: char) -> bool {
    matches!(c, '\u{202A}'..='\u{202E}' | '\u{2066}'..='\u{2069}')
}

/// Length of `ESC [ digits and semicolons m` at the start of `text`.
fn colour_sequence_len(text: &str) -> Option<usize> {
    let parameters = text.strip_prefix("\x1b[")?;
    let end = parameters.find(|c: char| !(c.is_ascii_digit() || c == ';'))?;
    parameters[end..]
        .starts_with('m')
        .then_some("\x1b[".len() + end + 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const TERMINAL: Features = Features {
        redraw: true,
        colour: true,
    };
    const FILE: Features = Features {
        redraw: false,
        colour: false,
    };

    #[test]
    fn the_status_line_stays_below_the_log_and_within_the_window() {
        let mut screen = Screen::new(TERMINAL);
        assert_eq!(screen.status("driving 80 %", 9), "\r\x1b[Kdriving ");
        assert_eq!(screen.record("hello\n", 80), "\r\x1b[Khello\ndriving 80 %");
        assert_eq!(screen.end(), "\r\x1b[K");
        assert_eq!(screen.end(), "");
    }

    #[test]
    fn a_file_gets_lines_and_nothing_else() {
        let mut screen = Screen::new(FILE);
        assert_eq!(screen.status("driving", 80), "");
        assert_eq!(screen.record("\x1b[31mred\x1b[0m\n", 80), "red\n");
        assert_eq!(screen.end(), "");
    }

    #[test]
    fn colours_pass_on_a_terminal_and_nothing_else_that_it_obeys() {
        let text = "\x1b[1;31mred\x1b[0m \x1b]0;title\x07 \x1b[2J \u{9b}2J \rover \u{202e}txt";
        let expected = "\x1b[1;31mred\x1b[0m ]0;title [2J 2J over txt";
        assert_eq!(clean(text, true), expected);
    }

    #[test]
    fn a_line_break_in_a_text_cannot_pass_for_a_record() {
        let screen = Screen::new(FILE);
        let shown = screen.record("INFO said\nERROR forged", 80);
        assert_eq!(shown, "INFO said\n  ERROR forged\n");
    }

    proptest! {
        #[test]
        fn no_control_character_survives_in_a_file(text in "\\PC*|[\\x00-\\xff\u{1b}\\[m0-9;]{0,60}") {
            let shown = Screen::new(FILE).record(&text, 80);
            let bad = shown.chars().any(|c| c.is_control() && !matches!(c, '\n' | '\t'));
            prop_assert!(!bad, "{:?}", shown);
        }

        #[test]
        fn on_a_terminal_every_escape_left_is_a_colour(text in "[\u{1b}\\[m0-9;a-z\u{9b}\r\n]{0,60}") {
            let cleaned = clean(&text, true);
            for (at, _) in cleaned.match_indices('\u{1b}') {
                prop_assert!(colour_sequence_len(&cleaned[at..]).is_some(), "{:?}", cleaned);
            }
        }
    }
}
