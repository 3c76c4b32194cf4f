//! Why a link is lost, or was never there.

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

/// What an event of the link can end.
#[derive(Debug, thiserror::Error)]
pub(super) enum HearError {
    /// The link.
    #[error(transparent)]
    Lost(#[from] LinkLost),
    /// The run: the very first connection has failed, and a person is there to read it.
    #[error(transparent)]
    First(LinkError),
}
