//! The messages between agent and host. A message has at most [`super::pipe::MAX_MESSAGE_LEN`]
//! bytes in either direction, and a message that cannot be decoded ends the host.

use bytes::Bytes;
use serde::{Deserialize, Serialize};

use super::library::Library;
use crate::robot::{Detection, EndReason, Event, Frame, ParamValue};
use crate::script::{ModuleFile, ModuleName, NoModule, Options, Output, ScriptExit};

/// A script and everything it needs to run, without secrets.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Launch {
    /// The script's text, exactly as in its file.
    pub source: Vec<u8>,
    /// The VM's options.
    pub options: Options,
    /// Where `require` finds files. Not sent to the host.
    #[serde(skip)]
    pub library: Library,
}

/// From the agent to the host.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub enum ToHost {
    /// Load this script; answered by [`FromHost::Ready`] or [`FromHost::Ended`].
    Load(Box<Launch>),
    /// Run the loaded script.
    Run,
    /// An event for the script.
    Event(Event),
    /// A frame, in answer to [`FromHost::WantFrame`].
    Frame(Frame),
    /// A further part of the frame that is being received, in answer to [`FromHost::WantFrame`].
    PartialFrame {
        /// Offset of this part in the frame, in bytes.
        at: usize,
        /// A part of the JPEG.
        jpeg: Bytes,
    },
    /// Run a text that a user typed; answered by [`Output::Evaluated`].
    Evaluate {
        /// The Luau source text.
        text: String,
        /// Whether further lines may follow.
        more: bool,
    },
    /// A user changes the value of a parameter.
    SetParam {
        /// The name of the parameter.
        name: String,
        /// Its new value.
        value: ParamValue,
    },
    /// Stop the tracks, tasks and handlers that typed lines have started.
    Interrupt,
    /// In answer to [`Output::Module`]: the module's file, or why it cannot be loaded.
    Module(ModuleName, Result<ModuleFile, NoModule>),
    /// End within half a second.
    Stop(EndReason),
}

/// From the host to the agent. Each of them is a sign of life.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub enum FromHost {
    /// Loaded without an error.
    Ready,
    /// A request or an output of the script.
    Output(Output),
    /// A sign of life, without further content.
    Alive,
    /// Requests one frame newer than the last, as soon as there is one.
    WantFrame {
        /// Also send the parts of it that have already been received.
        partial: bool,
        /// The last frame was damaged: the one before it is also acceptable.
        damaged: bool,
    },
    /// The objects that the script found in a frame, for viewers.
    Found {
        /// The frame's number.
        frame: u64,
        /// The objects found.
        list: Vec<Detection>,
    },
    /// The script has ended; the host exits.
    Ended(ScriptExit),
}
