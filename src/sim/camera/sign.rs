//! Textures of QR codes on boards.

use super::texture::Texture;
use crate::sim::world::code::Code;
use crate::sim::world::fixtures::Sign;

/// Width of the quiet zone around a code, in modules; readers need four.
const MARGIN: usize = 4;
/// Texels along one module.
const FINE: f32 = 4.0;

/// Paints the board with the code; the first axis runs from left to right, the second upwards.
pub(crate) fn picture(code: &Code, sign: &Sign) -> Texture {
    let side = sign.side as f32;
    let dot = side / (code.width() + 2 * MARGIN) as f32;
    let index = move |place: f32| ((place / dot) as usize).checked_sub(MARGIN);
    Texture::paint([side; 2], dot / FINE, |along| {
        move |up| {
            let column = index(along);
            let row = index(side - up);
            let dark = column
                .zip(row)
                .is_some_and(|(column, row)| code.dark(column, row));
            [if dark { 22.0 } else { 240.0 }; 3]
        }
    })
}
