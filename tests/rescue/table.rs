//! The table by world and strategy.

use std::fmt;

use super::place::Name;
use super::play::{Efforts, End, Played};
use super::strategy::Strategy;

/// The table's first line.
pub fn heading() -> String {
    format!(
        "{:<12} {:<9} {:>10} {:>7} {:>9} {:>7} {:>8} {:>9} {:>6} {:>6}",
        "world",
        "strategy",
        "home",
        "share",
        "median",
        "p90",
        "battery",
        "searches",
        "moves",
        "grants"
    )
}

/// A line of it: one strategy in one world.
#[derive(Debug, Clone)]
pub struct Row {
    pub world: Name,
    pub strategy: Strategy,
    pub starts: usize,
    pub home: usize,
    /// Until home, of those who came home, in seconds; sorted.
    seconds: Vec<f64>,
    /// What was left then, in percent; sorted.
    batteries: Vec<f64>,
    /// Of all.
    efforts: Efforts,
}

impl Row {
    /// Without those that never were away.
    pub fn new(world: Name, strategy: Strategy, played: &[Played]) -> Row {
        let played: Vec<&Played> = played
            .iter()
            .filter(|one| one.end != End::NeverAway)
            .collect();
        let home: Vec<&&Played> = played.iter().filter(|one| one.is_home()).collect();
        let mut efforts = Efforts::default();
        for one in &played {
            efforts.searches += one.efforts.searches;
            efforts.blind_moves += one.efforts.blind_moves;
            efforts.grants += one.efforts.grants;
        }
        Row {
            world,
            strategy,
            starts: played.len(),
            home: home.len(),
            seconds: sorted(home.iter().map(|one| one.took.as_secs_f64())),
            batteries: sorted(home.iter().map(|one| one.battery)),
            efforts,
        }
    }

    /// The share that came home, percent.
    pub fn percent(&self) -> f64 {
        100.0 * self.home as f64 / self.starts as f64
    }

    /// Whether the default strategy brings home too few.
    pub fn misses_its_goal(&self) -> bool {
        self.strategy == Strategy::Builtin && self.percent() < self.world.goal()
    }
}

impl fmt::Display for Row {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Efforts {
            searches,
            blind_moves,
            grants,
        } = self.efforts;
        write!(
            f,
            "{:<12} {:<9} {:>3} of {:>3} {:>5.1} % {:>7} s {:>5} s {:>6} % {searches:>9} {blind_moves:>6} \
             {grants:>6}",
            self.world.text(),
            self.strategy.text(),
            self.home,
            self.starts,
            self.percent(),
            number(quantile(&self.seconds, 0.5), 0),
            number(quantile(&self.seconds, 0.9), 0),
            number(quantile(&self.batteries, 0.5), 1),
        )
    }
}

fn sorted(numbers: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut numbers: Vec<f64> = numbers.collect();
    numbers.sort_by(f64::total_cmp);
    numbers
}

/// The least that this share of them does not exceed.
fn quantile(sorted: &[f64], share: f64) -> Option<f64> {
    let at = (sorted.len() as f64 * share).ceil() as usize;
    sorted.get(at.saturating_sub(1)).copied()
}

fn number(number: Option<f64>, digits: usize) -> String {
    number.map_or("-".to_owned(), |number| format!("{number:.digits$}"))
}
