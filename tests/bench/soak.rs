//! `scripts/soak`: virtual hours alone, and the table of promises.

#![allow(clippy::unwrap_used, unreachable_pub)]

use std::process::ExitCode;
use std::time::Instant;

#[path = "../soak/mod.rs"]
mod weeks;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    if arguments.iter().any(|argument| argument == "--test") {
        return ExitCode::SUCCESS;
    }
    let value = |name: &str, default: u64| {
        let at = arguments.iter().position(|argument| argument == name);
        let text = at.and_then(|at| arguments.get(at + 1));
        text.map_or(Ok(default), |text| text.parse())
    };
    let (Ok(hours @ 1..), Ok(seed)) = (value("--hours", 24), value("--seed", 1)) else {
        eprintln!(
            "error: --hours and --seed take whole numbers\n  help: scripts/soak --hours 24 --seed 1"
        );
        return ExitCode::from(2);
    };
    let (folder, began) = (tempfile::tempdir().unwrap(), Instant::now());
    println!("{hours} h alone, seed {seed}");
    let ledger = weeks::soak(hours, seed, folder.path(), &mut |hour, size| {
        println!(
            "{hour:>4} h  {:>6} KiB  {:>3} threads  {:>3} descriptors  {:>5.0} s",
            size.resident_kib,
            size.threads,
            size.descriptors,
            began.elapsed().as_secs_f64()
        );
    });
    print!("{ledger}");
    let untested = ledger.untested(&weeks::CORE);
    if !untested.is_empty() {
        println!("never put to the test: {}", untested.join("; "));
    }
    match ledger.is_kept() && untested.is_empty() {
        true => ExitCode::SUCCESS,
        false => ExitCode::FAILURE,
    }
}
