//! QR codes of signs, as modules.

use qrcode::{Color, QrCode};

/// Maximum length of a text in bytes; longer ones have modules too small for the camera.
pub(crate) const MAX_TEXT: usize = 100;

/// A code as a grid of modules.
#[derive(Debug)]
pub(crate) struct Code {
    width: usize,
    dark: Vec<bool>,
}

impl Code {
    /// Encodes a text; `None` if it is too long.
    pub(crate) fn new(text: &str) -> Option<Code> {
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

    /// Returns the number of modules along one side.
    pub(crate) fn width(&self) -> usize {
        self.width
    }

    /// Whether a module is dark; modules outside the code are not.
    pub(crate) fn dark(&self, column: usize, row: usize) -> bool {
        column < self.width && self.dark.get(row * self.width + column) == Some(&true)
    }
}
