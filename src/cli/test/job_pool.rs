//! Runs scenarios in parallel, each in its own process, until all are done or a signal arrives.

use std::io;
use std::num::NonZeroUsize;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use tokio::sync::mpsc;

use crate::cli::interrupt::interruption;
use crate::cli::startup::runtime;
use crate::cli::{Console, Failure};
use crate::scenario::{RunSettings, Scenario, ScenarioFile, ScenarioProcess, ScenarioResult};

#[derive(Clone, Copy)]
pub(in crate::cli) struct Job<'a> {
    pub(in crate::cli) file: &'a ScenarioFile,
    pub(in crate::cli) scenario: &'a Scenario,
    pub(in crate::cli) seed: u64,
}

pub(in crate::cli) struct JobResult<'a> {
    pub(in crate::cli) job: Job<'a>,
    pub(in crate::cli) result: ScenarioResult,
    /// Duration in real time.
    pub(in crate::cli) took: Duration,
}

pub(in crate::cli) struct JobPool {
    threads: usize,
    settings: RunSettings,
    scenario_process: ScenarioProcess,
}

impl JobPool {
    /// Creates a pool with this many threads [default: one per processor].
    pub(in crate::cli) fn new(
        threads: Option<u16>,
        settings: RunSettings,
        scenario_process: ScenarioProcess,
    ) -> JobPool {
        let processors = || thread::available_parallelism().map_or(1, NonZeroUsize::get);
        JobPool {
            threads: threads.map_or_else(processors, usize::from),
            settings,
            scenario_process,
        }
    }

    /// Runs all jobs, calls `take` with each result and shows the progress, such as `12 of 40 runs, 1
    /// failed`. After an interruption, starts no more jobs and returns false.
    pub(in crate::cli) fn run<'a>(
        &self,
        jobs: &[Job<'a>],
        console: &Console,
        take: impl FnMut(JobResult<'a>),
    ) -> Result<bool, Failure> {
        let runtime = runtime()?;
        let next = AtomicUsize::new(0);
        let (done, finished) = mpsc::channel(16);
        thread::scope(|scope| {
            for _ in 0..self.threads.min(jobs.len()) {
                let done = done.clone();
                let next = &next;
                thread::Builder::new()
                    .name("scenarios".into())
                    .spawn_scoped(scope, move || self.work(jobs, next, &done))
                    .map_err(no_simulation)?;
            }
            drop(done);
            runtime.block_on(self.collect(finished, jobs.len(), console, take))
        })
    }

    /// Takes all results; returns whether none is missing.
    async fn collect<'a>(
        &self,
        mut finished: mpsc::Receiver<io::Result<JobResult<'a>>>,
        all: usize,
        console: &Console,
        mut take: impl FnMut(JobResult<'a>),
    ) -> Result<bool, Failure> {
        let interrupted = interruption()?;
        tokio::pin!(interrupted);
        let stop = &self.settings.stop;
        let mut count = 0;
        let mut failed = 0;
        loop {
            tokio::select! {
                result = finished.recv() => match result {
                    None => break,
                    Some(Err(error)) => {
                        stop.cancel();
                        return Err(no_simulation(error));
                    }
                    Some(Ok(done)) if !stop.is_cancelled() => {
                        count += 1;
                        failed += usize::from(done.result.failure.is_some());
                        let progress = progress(count, all, failed);
                        let file = done.job.file.file().display();
                        console.status(format!("{progress} · {file}"));
                        take(done);
                    }
                    Some(Ok(_)) => {}
                },
                () = &mut interrupted, if !stop.is_cancelled() => stop.cancel(),
            }
        }
        console.status("");
        Ok(!stop.is_cancelled())
    }

    fn work<'a>(
        &self,
        jobs: &[Job<'a>],
        next: &AtomicUsize,
        done: &mpsc::Sender<io::Result<JobResult<'a>>>,
    ) {
        while let Some(job) = jobs.get(next.fetch_add(1, Ordering::Relaxed)) {
            if self.settings.stop.is_cancelled() {
                return;
            }
            let began = Instant::now();
            let process = &self.scenario_process;
            let result = process.run(job.file, job.scenario, job.seed, &self.settings);
            let Some(result) = result.transpose() else {
                return;
            };
            let finished = result.map(|result| JobResult {
                job: *job,
                result,
                took: began.elapsed(),
            });
            if done.blocking_send(finished).is_err() {
                return;
            }
        }
    }
}

pub(in crate::cli) fn scenario_process(timeout: Duration) -> Result<ScenarioProcess, Failure> {
    ScenarioProcess::new(timeout)
        .map_err(|error| Failure::io("find this program's own file", error))
}

fn progress(count: usize, all: usize, failed: usize) -> String {
    match failed {
        0 => format!("{count} of {all} runs"),
        failed => format!("{count} of {all} runs, {failed} failed"),
    }
}

fn no_simulation(error: io::Error) -> Failure {
    Failure::io("run the scenario", error)
}
