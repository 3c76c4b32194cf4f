//! Chroma subsampling.

use jpeg_encoder::SamplingFactor;
use serde::Deserialize;

/// How much of the colour is left out in a JPEG.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
pub enum Subsampling {
    /// Nothing.
    #[serde(rename = "4:4:4")]
    None,
    /// Every other pixel of a row.
    #[serde(rename = "4:2:2")]
    Half,
    /// Every other pixel of a row, and every other row.
    #[default]
    #[serde(rename = "4:2:0")]
    Quarter,
}

/// As `jpeg_encoder` names it.
pub(super) fn factor(subsampling: Subsampling) -> SamplingFactor {
    match subsampling {
        Subsampling::None => SamplingFactor::F_1_1,
        Subsampling::Half => SamplingFactor::F_2_1,
        Subsampling::Quarter => SamplingFactor::F_2_2,
    }
}
