//! Why a link is lost, or could not be established.

use crate::link::LinkError;

/// The link is unusable: close it and reconnect.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{reason}")]
pub(super) struct LinkLost {
    reason: String,
}

impl LinkLost {
    /// For a reason that is not a [`LinkError`].
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

/// The error of a link event, by what it ends.
#[derive(Debug, thiserror::Error)]
pub(super) enum LinkEventError {
    /// The link.
    #[error(transparent)]
    Lost(#[from] LinkLost),
    /// The run: the very first connection has failed, and a person can read the error.
    #[error(transparent)]
    First(LinkError),
}
