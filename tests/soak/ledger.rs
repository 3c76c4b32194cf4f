//! What was promised, how often it was put to the test, and how often it was broken.

use std::collections::VecDeque;
use std::fmt;

/// The promise that each robot which runs flat puts to the test.
pub const HOME: &str = "never flat off the station while a way exists and the energy suffices";

/// A robot that ran flat off its station.
#[derive(Debug, Clone)]
pub struct Loss {
    /// A way was there, and time and charge for it.
    pub avoidable: bool,
    /// One paragraph.
    pub story: String,
}

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
    losses: Vec<Loss>,
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
            promise.keep(how);
        }
    }

    /// Notes that a robot ran flat off its station. If it could have come home, a promise is broken.
    pub fn lose(&mut self, Loss { avoidable, story }: Loss) {
        let name = format!("loss {}", self.losses.len() + 1);
        self.note(HOME, avoidable.then(|| name.clone()));
        let story = format!("{name}: {story}");
        self.losses.push(Loss { avoidable, story });
    }

    /// Adds what another run found, under its name.
    pub fn add(&mut self, name: &str, other: Ledger) {
        for theirs in other.promises {
            let ours = self.promise(theirs.words);
            if ours.breaks == 0 {
                ours.before = theirs.before;
            }
            ours.tested += theirs.tested;
            ours.breaks += theirs.breaks;
            let named = theirs
                .broken
                .into_iter()
                .map(|how| format!("{name}: {how}"));
            named.for_each(|how| ours.keep(how));
        }
        for Loss { avoidable, story } in other.losses {
            let story = format!("{name}, {story}");
            self.losses.push(Loss { avoidable, story });
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

    /// Whether all were kept, and each of these was put to the test; what was not is noted as broken.
    pub fn proves(&mut self, core: &[&'static str]) -> bool {
        for words in core {
            if self.promise(words).tested == 0 {
                self.note(words, Some("never put to the test".to_owned()));
            }
        }
        self.promises.iter().all(|promise| promise.breaks == 0)
    }

    /// One line: how much was put to the test, and what came of it.
    pub fn summary(&self) -> String {
        let tested: u64 = self.promises.iter().map(|one| one.tested).sum();
        let broken: u64 = self.promises.iter().map(|one| one.breaks).sum();
        let helpless = self.losses.iter().filter(|loss| !loss.avoidable).count();
        format!(
            "{} promises looked at {tested} times, broken {broken} times; {} robots flat, {helpless} \
             of them could not be helped",
            self.promises.len(),
            self.losses.len()
        )
    }

    fn write_losses(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let helpless = self.losses.iter().filter(|loss| !loss.avoidable).count();
        let count = self.losses.len();
        writeln!(
            f,
            "{count:>9} robots flat off the station, {helpless} could not be helped"
        )?;
        for loss in &self.losses {
            writeln!(f, "{:>9}{}", "- ", loss.story)?;
        }
        Ok(())
    }
}

impl Promise {
    fn keep(&mut self, how: String) {
        if self.broken.len() < MAX_KEPT {
            self.broken.push(how);
        }
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
        self.write_losses(f)
    }
}
