//! What was promised, how often it was put to the test, and how often it was broken.

use std::collections::VecDeque;
use std::fmt;

/// One promise.
#[derive(Debug, Clone)]
pub struct Promise {
    pub words: &'static str,
    /// How often it was looked at where it could have been broken.
    pub tested: u64,
    /// When it was broken, and how; of very many only the first.
    pub broken: Vec<String>,
    breaks: u64,
    /// What had happened before it was broken for the first time.
    before: Vec<String>,
}

/// Breaks that are kept in words.
const MAX_KEPT: usize = 5;
/// What happened last, so that a break can be understood.
const RECENT: usize = 60;

/// All of them, by name.
#[derive(Debug, Clone, Default)]
pub struct Ledger {
    promises: Vec<Promise>,
    recent: VecDeque<String>,
}

impl Ledger {
    /// Remembers what happened, for a while.
    pub fn happened(&mut self, text: String) {
        if self.recent.len() == RECENT {
            self.recent.pop_front();
        }
        self.recent.push_back(text);
    }

    /// Notes that a promise was looked at, and how it was broken if it was.
    pub fn note(&mut self, words: &'static str, broken: Option<String>) {
        let recent = broken.is_some().then(|| self.recent.clone());
        let promise = self.promise(words);
        promise.tested += 1;
        if let Some(how) = broken {
            promise.breaks += 1;
            if promise.breaks == 1 {
                promise.before = recent.into_iter().flatten().collect();
            }
            if promise.broken.len() < MAX_KEPT {
                promise.broken.push(how);
            }
        }
    }

    fn promise(&mut self, words: &'static str) -> &mut Promise {
        let found = self.promises.iter().position(|one| one.words == words);
        let at = found.unwrap_or_else(|| {
            self.promises.push(Promise {
                words,
                tested: 0,
                broken: Vec::new(),
                breaks: 0,
                before: Vec::new(),
            });
            self.promises.len() - 1
        });
        &mut self.promises[at]
    }

    /// Whether all were kept.
    pub fn is_kept(&self) -> bool {
        self.promises.iter().all(|promise| promise.breaks == 0)
    }

    /// Those of these promises that were never put to the test.
    pub fn untested<'a>(&self, words: &[&'a str]) -> Vec<&'a str> {
        let tested = |words: &str| self.promises.iter().any(|one| one.words == words);
        words.iter().copied().filter(|one| !tested(one)).collect()
    }
}

impl fmt::Display for Ledger {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{:>9} {:>7}  promise", "tested", "broken")?;
        for promise in &self.promises {
            let Promise {
                words,
                tested,
                breaks,
                broken,
                before,
            } = promise;
            writeln!(f, "{tested:>9} {breaks:>7}  {words}")?;
            for how in broken {
                writeln!(f, "{:>19}  {how}", "")?;
            }
            if !before.is_empty() {
                writeln!(f, "{:>19}  before the first:", "")?;
            }
            for text in before {
                writeln!(f, "{:>19}    {text}", "")?;
            }
        }
        Ok(())
    }
}
