//! Why a link is lost.

use crate::link::LinkError;

/// The link is of no use any more: hang up and connect anew.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{reason}")]
pub(super) struct LinkLost {
    reason: String,
}

impl LinkLost {
    /// For a reason that is no [`LinkError`].
    pub(super) fn because(reason: impl Into<String>) -> LinkLost {
        let reason = reason.into();
        LinkLost { reason }
    }
}

impl From<LinkError> for LinkLost {
    fn from(error: LinkError) -> LinkLost {
        LinkLost::because(error.to_string())
    }
}
