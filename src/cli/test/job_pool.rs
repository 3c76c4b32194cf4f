//! Runs scenarios in parallel, each in its own process, until all are done or a signal arrives.

use std::num::NonZeroUsize;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use tokio::sync::mpsc;

use super::super::Failure;
use super::super::interrupt::interruption;
use crate::cli::argument::ArgumentError;
use crate::scenario::{RunSettings, Scenario, ScenarioFile, ScenarioProcess, ScenarioResult};

#[derive(Debug, Clone, Copy, PartialEq)]
pub(in super::super) struct Job<'a> {
    pub(in super::super) scenario_file: usize,
    pub(in super::super) scenario: &'a Scenario,
    pub(in super::super) seed: u64,
}

pub(in super::super) struct JobResult<'a> {
    pub(in super::super) job: Job<'a>,
    pub(in super::super) result: ScenarioResult,
    /// Duration in real time.
    pub(in super::super) took: Duration,
}

pub(in super::super) struct JobPool {
    threads: usize,
    settings: RunSettings,
    scenario_process: ScenarioProcess,
}

impl JobPool {
    /// Creates a pool with this many threads [default: one per processor].
    pub(in super::super) fn new(
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

    /// Runs all jobs and calls `take` with each result. Starts no more jobs after an interruption.
    pub(in super::super) fn run<'a>(
        &self,
        scenario_files: &[&ScenarioFile],
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
                let done = done.clone();
                let next = &next;
                thread::Builder::new()
                    .name("scenarios".into())
                    .spawn_scoped(scope, move || self.work(scenario_files, jobs, next, &done))
                    .map_err(no_simulation)?;
            }
            drop(done);
            runtime.block_on(async {
                let interrupted = interruption()?;
                tokio::pin!(interrupted);
                let stop = &self.settings.stop;
                loop {
                    tokio::select! {
                        result = finished.recv() => match result {
                            None => return Ok(()),
                            Some(Err(error)) => {
                                stop.cancel();
                                return Err(no_simulation(error));
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
        scenario_files: &[&ScenarioFile],
        jobs: &[Job<'a>],
        next: &AtomicUsize,
        done: &mpsc::Sender<std::io::Result<JobResult<'a>>>,
    ) {
        while let Some(job) = jobs.get(next.fetch_add(1, Ordering::Relaxed)) {
            if self.settings.stop.is_cancelled() {
                return;
            }
            let began = Instant::now();
            let scenario_file = scenario_files[job.scenario_file];
            let result =
                self.scenario_process
                    .run(scenario_file, job.scenario, job.seed, &self.settings);
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

pub(in super::super) fn scenario_process(timeout: Duration) -> Result<ScenarioProcess, Failure> {
    ScenarioProcess::new(timeout)
        .map_err(|error| Failure::io("find this program's own file", error))
}

pub(in super::super) fn parse_timeout(text: &str) -> Result<Duration, ArgumentError> {
    let seconds = text.parse().ok();
    let seconds = seconds.filter(|seconds| (0.1..=86_400.0).contains(seconds));
    let timeout = seconds.and_then(|seconds| Duration::try_from_secs_f64(seconds).ok());
    timeout.ok_or(ArgumentError::Timeout)
}

fn no_simulation(error: std::io::Error) -> Failure {
    Failure::io("run the scenario", error)
}
