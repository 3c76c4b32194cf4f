//! QR codes on boards, as pictures.

use super::texture::Texture;
use crate::sim::world::code::Code;
use crate::sim::world::fittings::Sign;

/// White dots around a code; readers need four.
const MARGIN: usize = 4;
/// Pixels of the picture along one dot.
const FINE: f32 = 4.0;

/// The board with the code; its first axis is from left to right, its second up.
pub(crate) fn picture(code: &Code, sign: &Sign) -> Texture {
    let side = sign.side as f32;
    let dot = side / (code.width() + 2 * MARGIN) as f32;
    let index = move |place: f32| ((place / dot) as usize).checked_sub(MARGIN);
    Texture::paint([side; 2], dot / FINE, |along| {
        move |up| {
            let (column, row) = (index(along), index(side - up));
            let dark = column
                .zip(row)
                .is_some_and(|(column, row)| code.dark(column, row));
            [if dark { 22.0 } else { 240.0 }; 3]
        }
    })
}
