//! `scripts/explore`: explores the state space of the watchdog more deeply than the tests do.

#![allow(clippy::unwrap_used, unreachable_pub)]

use clap::Parser;
use spykee::safety::{Limits, Rescue};

#[path = "../explore/mod.rs"]
mod explore;

#[derive(Debug, Parser)]
struct Args {
    /// Steps after the first login
    #[arg(long, default_value_t = 7)]
    depth: usize,
    /// End after this many states
    #[arg(long, default_value_t = 3_000_000)]
    states: usize,
    #[arg(long, hide = true)]
    bench: bool,
}

fn main() {
    let args = Args::parse();
    let usual = Limits::default();
    let bare = Limits {
        rescue: Rescue::Off,
        recovery_legs: false,
        ..usual.clone()
    };
    let mut broken = false;
    for (name, limits) in [("usual limits", usual), ("no legs, no rescue", bare)] {
        let found = explore::explore(&limits, args.depth, args.states);
        let (states, depth) = (found.states, found.depth);
        println!(
            "{name}: {states} states, all sequences of {depth} steps, {} broken",
            found.broken.len()
        );
        found.broken.iter().for_each(|what| println!("  {what}"));
        broken |= !found.broken.is_empty();
    }
    std::process::exit(i32::from(broken));
}
