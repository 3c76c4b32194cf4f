//! Runs scenarios in parallel, each in its own process, until all are done or a signal arrives.

use std::num::NonZeroUsize;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use tokio::sync::mpsc;

use super::super::Failure;
use super::super::interrupt::interruption;
use crate::cli::argument::ArgumentError;
use crate::scenario::{Book, Played, Scenario, Setting, Trials};

/// One scenario with one seed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in super::super) struct Job<'a> {
    /// Index of its book.
    pub(in super::super) book: usize,
    pub(in super::super) scenario: &'a Scenario,
    pub(in super::super) seed: u64,
}

/// A job and its result.
pub(in super::super) struct JobResult<'a> {
    pub(in super::super) job: Job<'a>,
    pub(in super::super) played: Played,
    /// Duration in real time.
    pub(in super::super) took: Duration,
}

/// A pool of threads with their common settings.
pub(in super::super) struct JobPool {
    threads: usize,
    setting: Setting,
    trials: Trials,
}

impl JobPool {
    /// Creates a pool with this many threads [default: one per processor].
    pub(in super::super) fn new(threads: Option<u16>, setting: Setting, trials: Trials) -> JobPool {
        let processors = || thread::available_parallelism().map_or(1, NonZeroUsize::get);
        JobPool {
            threads: threads.map_or_else(processors, usize::from),
            setting,
            trials,
        }
    }

    /// Runs all jobs and calls `take` with each result. Starts no more jobs after an interruption.
    ///
    /// # Errors
    /// Threads, processes or signal handlers that cannot be started.
    pub(in super::super) fn run<'a>(
        &self,
        books: &[&Book],
        jobs: &[Job<'a>],
        mut take: impl FnMut(JobResult<'a>),
    ) -> Result<(), Failure> {
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .build()
            .map_err(|error| Failure::io("start the runtime", error))?;
        let next = AtomicUsize::new(0);
        let (done, mut finished) = mpsc::channel(16);
        thread::scope(|scope| {
            for _ in 0..self.threads.min(jobs.len()) {
                let (done, next) = (done.clone(), &next);
                thread::Builder::new()
                    .name("scenarios".into())
                    .spawn_scoped(scope, move || self.work(books, jobs, next, &done))
                    .map_err(no_lab)?;
            }
            drop(done);
            runtime.block_on(async {
                let interrupted = interruption()?;
                tokio::pin!(interrupted);
                let stop = &self.setting.stop;
                loop {
                    tokio::select! {
                        result = finished.recv() => match result {
                            None => return Ok(()),
                            Some(Err(error)) => {
                                stop.cancel();
                                return Err(no_lab(error));
                            }
                            Some(Ok(result)) if !stop.is_cancelled() => take(result),
                            Some(Ok(_)) => {}
                        },
                        () = &mut interrupted, if !stop.is_cancelled() => stop.cancel(),
                    }
                }
            })
        })
    }

    fn work<'a>(
        &self,
        books: &[&Book],
        jobs: &[Job<'a>],
        next: &AtomicUsize,
        done: &mpsc::Sender<std::io::Result<JobResult<'a>>>,
    ) {
        while let Some(job) = jobs.get(next.fetch_add(1, Ordering::Relaxed)) {
            if self.setting.stop.is_cancelled() {
                return;
            }
            let began = Instant::now();
            let book = books[job.book];
            let played = self
                .trials
                .play(book, job.scenario, job.seed, &self.setting);
            let Some(played) = played.transpose() else {
                return;
            };
            let result = played.map(|played| JobResult {
                job: *job,
                played,
                took: began.elapsed(),
            });
            if done.blocking_send(result).is_err() {
                return;
            }
        }
    }
}

/// The launcher of the processes that run scenarios.
pub(in super::super) fn trials(timeout: Duration) -> Result<Trials, Failure> {
    Trials::new(timeout).map_err(|error| Failure::io("find this program's own file", error))
}

/// Parses `--timeout`: seconds of real time.
pub(in super::super) fn parse_timeout(text: &str) -> Result<Duration, ArgumentError> {
    let seconds = text.parse().ok();
    let seconds = seconds.filter(|seconds| (0.1..=86_400.0).contains(seconds));
    let timeout = seconds.and_then(|seconds| Duration::try_from_secs_f64(seconds).ok());
    timeout.ok_or(ArgumentError::Timeout)
}

fn no_lab(error: std::io::Error) -> Failure {
    Failure::io("run the scenario", error)
}
