//! What the timetable will do, and what it will not and why.

use jiff::Timestamp;

use super::Timetable;

/// The most lines that are looked for behind one another.
const MOST: usize = 10_000;

/// One start to come.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Outlook {
    /// When.
    pub at: Timestamp,
    /// The behaviour.
    pub run: String,
    /// When it is ended, if it has not ended by itself.
    pub until: Option<Timestamp>,
    /// What is to be said of it.
    pub reasons: Vec<Reason>,
}

impl Outlook {
    /// Whether it will be started, as far as can be foreseen.
    pub fn happens(&self) -> bool {
        self.reasons.iter().all(|reason| *reason == Reason::Quiet)
    }
}

/// What is to be said of a start to come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reason {
    /// It makes no sound and shows no bright light then.
    Quiet,
    /// It still runs from the start before.
    Overlap,
    /// The config has no such behaviour.
    Unknown,
}

impl Timetable {
    /// What is wrong with the names, in the order of the rules: those that no behaviour has.
    pub fn unknown<'a>(&'a self, known: &[String]) -> Vec<&'a str> {
        let runs = self.rules.iter().map(|rule| rule.run.as_str());
        runs.filter(|run| !known.iter().any(|name| name == run))
            .collect()
    }
}

/// The next starts after an instant, if all goes as planned; `known` are the config's behaviours.
pub fn outlook(
    table: &Timetable,
    known: &[String],
    after: Timestamp,
    count: usize,
) -> Vec<Outlook> {
    let next = |rule: usize, after| table.rules[rule].at.next_after(after, &table.zone);
    let mut due: Vec<Option<Timestamp>> = (0..table.rules.len())
        .map(|rule| next(rule, after))
        .collect();
    let mut found: Vec<Outlook> = Vec::new();
    while found.len() < count.min(MOST) {
        let soonest = due.iter().enumerate();
        let soonest = soonest.filter_map(|(rule, at)| Some(((*at)?, rule)));
        let Some((at, rule)) = soonest.min() else {
            break;
        };
        due[rule] = next(rule, at);
        let rule = &table.rules[rule];
        let lasts = rule.lasts.map(|lasts| lasts.get());
        let mut reasons = Vec::new();
        if !known.contains(&rule.run) {
            reasons.push(Reason::Unknown);
        }
        let runs = |other: &&Outlook| other.run == rule.run && other.happens();
        let last = found.iter().rev().find(runs);
        if last.is_some_and(|last| last.at == at || last.until.is_some_and(|until| until > at)) {
            reasons.push(Reason::Overlap);
        }
        if table
            .quiet
            .is_some_and(|quiet| quiet.covers(at, &table.zone))
        {
            reasons.push(Reason::Quiet);
        }
        found.push(Outlook {
            at,
            run: rule.run.clone(),
            until: lasts.and_then(|lasts| at.checked_add(lasts).ok()),
            reasons,
        });
    }
    found
}
