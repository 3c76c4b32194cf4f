//! Records the program's log events of one thread, independent of the log level shown elsewhere.

use std::cell::Cell;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use tokio::time::Instant;
use tracing::level_filters::LevelFilter;
use tracing::span::{Attributes, Id, Record};
use tracing::subscriber::Interest;
use tracing::{Dispatch, Metadata, Subscriber};

use super::event::Event;

thread_local! {
    /// When this thread's simulation was set up.
    static BEGAN: Cell<Option<Instant>> = const { Cell::new(None) };
}

/// Returns the virtual time on the thread of a simulation; `None` on any other thread.
pub fn now() -> Option<Duration> {
    BEGAN.get().map(|began| began.elapsed())
}

/// Starts this thread's virtual time at zero.
pub(super) fn begin() -> Instant {
    let began = Instant::now();
    BEGAN.set(Some(began));
    began
}

/// Receives each event when it happens, on the simulation's thread. Cheap to clone.
#[derive(Clone)]
pub struct Recorder {
    take: Arc<Mutex<dyn FnMut(Event) + Send>>,
}

impl Recorder {
    /// Creates a recorder that calls `take` with each event. `take` must neither block nor write to
    /// the program's log.
    pub fn new(take: impl FnMut(Event) + Send + 'static) -> Recorder {
        Recorder {
            take: Arc::new(Mutex::new(take)),
        }
    }

    /// Creates a recorder that keeps all events, for reading after the run.
    pub fn keeping() -> (Recorder, Arc<Mutex<Vec<Event>>>) {
        let kept = Arc::new(Mutex::new(Vec::new()));
        let keep = kept.clone();
        let recorder = Recorder::new(move |event| {
            keep.lock()
                .unwrap_or_else(PoisonError::into_inner)
                .push(event);
        });
        (recorder, kept)
    }

    fn take(&self, event: Event) {
        let mut take = self.take.lock().unwrap_or_else(PoisonError::into_inner);
        take(event);
    }
}

/// Runs `work` on this thread, with its log events going to `parent` and to the recorder.
pub(super) fn with_recorder<T>(
    parent: Dispatch,
    recorder: Option<Recorder>,
    work: impl FnOnce() -> T,
) -> T {
    let dispatch = match recorder {
        Some(recorder) => Dispatch::new(Tee { recorder, parent }),
        None => parent,
    };
    tracing::dispatcher::with_default(&dispatch, work)
}

/// A subscriber that forwards events to the recorder and to the parent.
struct Tee {
    recorder: Recorder,
    parent: Dispatch,
}

impl Subscriber for Tee {
    fn register_callsite(&self, _: &'static Metadata<'static>) -> Interest {
        // The parent's interest may change.
        Interest::sometimes()
    }

    fn max_level_hint(&self) -> Option<LevelFilter> {
        // The parent's hint is not available here; a higher one only costs extra checks.
        Some(LevelFilter::TRACE)
    }

    fn enabled(&self, metadata: &Metadata<'_>) -> bool {
        Event::is_wanted(metadata) || self.parent.enabled(metadata)
    }

    fn event(&self, event: &tracing::Event<'_>) {
        if Event::is_wanted(event.metadata()) {
            self.recorder
                .take(Event::from_tracing(now().unwrap_or_default(), event));
        }
        if self.parent.enabled(event.metadata()) {
            self.parent.event(event);
        }
    }

    fn new_span(&self, span: &Attributes<'_>) -> Id {
        self.parent.new_span(span)
    }

    fn record(&self, span: &Id, values: &Record<'_>) {
        self.parent.record(span, values);
    }

    fn record_follows_from(&self, span: &Id, follows: &Id) {
        self.parent.record_follows_from(span, follows);
    }

    fn enter(&self, span: &Id) {
        self.parent.enter(span);
    }

    fn exit(&self, span: &Id) {
        self.parent.exit(span);
    }
}
