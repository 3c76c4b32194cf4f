//! The streams that a script has switched on: from the first use of a stream until nothing has used
//! it for a while.

use tokio::time::Instant;

use super::State;
use crate::robot::{Intent, StreamOff};
use crate::script::events::EventName;
use crate::script::streams::Demand;
use crate::wire::Stream;

impl State {
    /// Switches a stream on unless it is on already.
    ///
    /// # Errors
    ///
    /// If the config keeps the stream off.
    pub(in crate::script) fn need_stream(
        &mut self,
        stream: Stream,
        by: Demand,
    ) -> Result<(), StreamOff> {
        self.options.streams.allow(stream)?;
        if self.streams.switch_on(stream, by, self.now) {
            self.output.send(Intent::Stream { stream, on: true });
        }
        Ok(())
    }

    /// Whether a handler listens to a stream or a task waits for it.
    pub(super) fn is_used(&self, stream: Stream) -> bool {
        let mut events = EventName::ALL.iter().copied();
        events.any(|event| event.stream() == Some(stream) && self.has_listener(event))
    }

    /// Records the use of each stream that is listened to. Called when time advances, before
    /// anything else happens.
    pub(super) fn note_used_streams(&mut self) {
        for stream in self.streams.temporary() {
            if self.is_used(stream) {
                self.streams.note_use(stream, self.now);
            }
        }
    }

    /// Switches off the streams that nothing has used for a while.
    pub(in crate::script) fn drop_unused_streams(&mut self) {
        for stream in self.streams.temporary() {
            if !self.is_used(stream) && self.streams.drop_if_unused(stream, self.now) {
                self.output.send(Intent::Stream { stream, on: false });
            }
        }
    }

    /// When the next stream is switched off because nothing uses it.
    pub(super) fn next_stream_end(&self) -> Option<Instant> {
        let unused = |stream: &Stream| !self.is_used(*stream);
        let temporary = self.streams.temporary().into_iter().filter(unused);
        temporary
            .filter_map(|stream| self.streams.end_of(stream))
            .min()
    }
}
