//! QR codes on boards, as pictures.

use qrcode::{Color, QrCode};

use super::texture::Texture;
use crate::sim::world::fittings::Sign;

/// White dots around a code; readers need four.
const MARGIN: usize = 4;
/// Pixels of the picture along one dot.
const FINE: f32 = 4.0;
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

    /// The board with the code; its first axis is from left to right, its second up.
    pub(crate) fn picture(&self, sign: &Sign) -> Texture {
        let side = sign.side as f32;
        let dot = side / (self.width + 2 * MARGIN) as f32;
        let index = move |place: f32| ((place / dot) as usize).checked_sub(MARGIN);
        Texture::paint([side; 2], dot / FINE, |along| {
            move |up| {
                let (column, row) = (index(along), index(side - up));
                let dark = column
                    .zip(row)
                    .is_some_and(|(column, row)| self.dark(column, row));
                [if dark { 22.0 } else { 240.0 }; 3]
            }
        })
    }

    fn dark(&self, column: usize, row: usize) -> bool {
        column < self.width && self.dark.get(row * self.width + column) == Some(&true)
    }
}
