//! What agent and host say to each other. Both sides are bounded: a message is at most
//! [`super::pipe::MAX_MESSAGE_LEN`] bytes, and what is not understood ends the host.

use bytes::Bytes;
use serde::{Deserialize, Serialize};

use super::library::Library;
use crate::robot::{EndReason, Event, Finding, Frame, ParamValue};
use crate::script::{Ending, ModuleFile, ModuleName, NoModule, Options, Output};

/// A script and all it needs; no secrets.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Launch {
    /// The script's text, as it stands in its file.
    pub source: Vec<u8>,
    /// The VM's options.
    pub options: Options,
    /// Where `require` finds files. Stays with the agent.
    #[serde(skip)]
    pub library: Library,
}

/// From the agent to the host.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub enum ToHost {
    /// Load this; answered by [`FromHost::Ready`] or [`FromHost::Ended`].
    Load(Box<Launch>),
    /// Run.
    Go,
    /// Something has happened.
    Event(Event),
    /// A frame, in answer to [`FromHost::WantFrame`].
    Frame(Frame),
    /// More of the frame on its way, in answer to [`FromHost::WantFrame`].
    Ahead {
        /// Bytes of it that came before.
        at: usize,
        /// A part of the JPEG.
        jpeg: Bytes,
    },
    /// Run what a person typed; answered by [`Output::Evaluated`].
    Evaluate {
        /// Luau.
        text: String,
        /// Whether further lines may follow.
        more: bool,
    },
    /// A person gives a parameter another value.
    Turn {
        /// Which.
        name: String,
        /// This.
        value: ParamValue,
    },
    /// Bring to rest what typed lines have begun.
    Interrupt,
    /// In answer to [`Output::Module`]: its file, or why there is none.
    Module(ModuleName, Result<ModuleFile, NoModule>),
    /// Come to an end within half a second.
    Stop(EndReason),
}

/// From the host to the agent. Each of them is a sign of life.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub enum FromHost {
    /// Loaded without an error.
    Ready,
    /// The script asks for something, or has something to say.
    Output(Output),
    /// Nothing to say, but alive.
    Alive,
    /// One frame, newer than the last, as soon as there is one.
    WantFrame {
        /// Also what has come of it.
        ahead: bool,
        /// The last one was damaged: the one before it will do.
        damaged: bool,
    },
    /// What the script found in a frame, for people who look on.
    Found {
        /// The frame's number.
        frame: u64,
        /// The things.
        list: Vec<Finding>,
    },
    /// The script has ended; the host exits.
    Ended(Ending),
}
