//! QR codes of signs, as dots.

use qrcode::{Color, QrCode};

/// Longest text, bytes: longer ones have dots too small to be seen.
pub(crate) const MAX_TEXT: usize = 100;

/// A code, by dots.
#[derive(Debug)]
pub(crate) struct Code {
    width: usize,
    dark: Vec<bool>,
}

impl Code {
    /// Of a text; `None` if it is too long.
    pub(crate) fn of(text: &str) -> Option<Code> {
        if text.len() > MAX_TEXT {
            return None;
        }
        let code = QrCode::new(text).ok()?;
        let dark = code
            .to_colors()
            .into_iter()
            .map(|colour| colour == Color::Dark);
        Some(Code {
            width: code.width(),
            dark: dark.collect(),
        })
    }

    /// Dots along one side.
    pub(crate) fn width(&self) -> usize {
        self.width
    }

    /// Whether a dot is dark; those outside of the code are not.
    pub(crate) fn dark(&self, column: usize, row: usize) -> bool {
        column < self.width && self.dark.get(row * self.width + column) == Some(&true)
    }
}
