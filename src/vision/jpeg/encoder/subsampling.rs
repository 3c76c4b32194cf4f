//! Chroma subsampling.

use jpeg_encoder::SamplingFactor;
use serde::Deserialize;

/// How much of the chroma resolution a JPEG omits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
pub enum Subsampling {
    /// Full chroma resolution.
    #[serde(rename = "4:4:4")]
    None,
    /// Half the columns.
    #[serde(rename = "4:2:2")]
    Half,
    /// Half the columns and half the rows.
    #[default]
    #[serde(rename = "4:2:0")]
    Quarter,
}

/// The corresponding value of `jpeg_encoder`.
pub(super) fn factor(subsampling: Subsampling) -> SamplingFactor {
    match subsampling {
        Subsampling::None => SamplingFactor::F_1_1,
        Subsampling::Half => SamplingFactor::F_2_1,
        Subsampling::Quarter => SamplingFactor::F_2_2,
    }
}
