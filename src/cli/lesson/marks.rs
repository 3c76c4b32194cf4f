//! The points of a script: a scenario gives its points only if it passes with every seed.

use std::collections::BTreeMap;

use crate::check::Diagnostic;
use crate::scenario::{Cause, Failure, Scenario};

pub(super) struct Marks {
    /// One for each scenario of the lesson.
    pub(super) marks: Vec<Mark>,
    pub(super) diagnostics: Vec<Diagnostic>,
    /// Whether a diagnostic is an error; then no scenario was run.
    pub(super) cannot_run: bool,
}

pub(super) struct Mark {
    pub(super) name: String,
    pub(super) max_points: u32,
    /// The failure of each seed; `None` if it passed.
    tries: BTreeMap<u64, Option<Failure>>,
    seeds: usize,
}

impl Marks {
    pub(super) fn new(
        scenarios: &[Scenario],
        diagnostics: Vec<Diagnostic>,
        cannot_run: bool,
    ) -> Marks {
        let mark = |scenario: &Scenario| Mark {
            name: scenario.name.clone(),
            max_points: scenario.options.points,
            tries: BTreeMap::new(),
            seeds: scenario.seeds().count(),
        };
        Marks {
            marks: scenarios.iter().map(mark).collect(),
            diagnostics,
            cannot_run,
        }
    }

    pub(super) fn take(&mut self, scenario: &Scenario, seed: u64, failure: Option<Failure>) {
        let mark = self
            .marks
            .iter_mut()
            .find(|mark| mark.name == scenario.name);
        if let Some(mark) = mark {
            mark.tries.insert(seed, failure);
        }
    }

    pub(super) fn points(&self) -> u32 {
        self.marks.iter().map(Mark::points).sum()
    }

    pub(super) fn max_points(&self) -> u32 {
        self.marks.iter().map(|mark| mark.max_points).sum()
    }

    pub(super) fn is_full(&self) -> bool {
        !self.cannot_run && self.marks.iter().all(Mark::passed)
    }

    /// The first error of the script itself, as opposed to unmet expectations.
    pub(super) fn script_error(&self) -> Option<&str> {
        self.marks.iter().find_map(Mark::script_error)
    }

    pub(super) fn first_failure(&self) -> Option<&Failure> {
        self.marks.iter().find_map(Mark::failure)
    }

    /// The progress, such as `12 of 30 tries`.
    pub(super) fn progress(&self) -> String {
        let done: usize = self.marks.iter().map(|mark| mark.tries.len()).sum();
        let all: usize = self.marks.iter().map(|mark| mark.seeds).sum();
        format!("{done} of {all} tries")
    }
}

impl Mark {
    pub(super) fn passed(&self) -> bool {
        self.passes() == self.seeds
    }

    pub(super) fn points(&self) -> u32 {
        if self.passed() { self.max_points } else { 0 }
    }

    pub(super) fn seeds(&self) -> usize {
        self.seeds
    }

    pub(super) fn passes(&self) -> usize {
        self.tries.values().filter(|one| one.is_none()).count()
    }

    pub(super) fn failed_seeds(&self) -> Vec<u64> {
        let failed = self.tries.iter().filter(|(_, one)| one.is_some());
        failed.map(|(seed, _)| *seed).collect()
    }

    pub(super) fn failure(&self) -> Option<&Failure> {
        self.tries.values().flatten().next()
    }

    fn script_error(&self) -> Option<&str> {
        self.tries
            .values()
            .flatten()
            .find_map(|failure| match &failure.cause {
                Cause::Behaviour(words) => Some(words.as_str()),
                Cause::Expectation | Cause::Scenario => None,
            })
    }
}
