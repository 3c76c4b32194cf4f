//! `scripts/camera-truth`: the same statistics of simulated and of genuine frames, in one table.

#![allow(clippy::unwrap_used, unreachable_pub)]

#[path = "../camera_truth/mod.rs"]
mod camera_truth;

use std::error::Error;
use std::path::PathBuf;

use camera_truth::{Statistics, frames_in, simulated};
use clap::Parser;
use spykee::sim::World;

/// Prints what frames look like: those of the built-in worlds, and those in folders.
#[derive(Parser)]
#[command(name = "scripts/camera-truth")]
struct Arguments {
    /// Folders with JPEG frames of genuine robots
    #[arg(value_name = "DIR")]
    folders: Vec<PathBuf>,
    /// Given by `cargo bench`
    #[arg(long, hide = true)]
    bench: bool,
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments = Arguments::parse();
    println!("{}", Statistics::HEAD);
    for folder in &arguments.folders {
        let name = folder.file_name().unwrap_or(folder.as_os_str());
        print_row(&name.to_string_lossy(), &frames_in(folder)?)?;
    }
    for name in World::builtin_names() {
        if let Some(world) = World::builtin(name) {
            print_row(name, &simulated(world))?;
        }
    }
    Ok(())
}

fn print_row(name: &str, frames: &[Vec<u8>]) -> Result<(), Box<dyn Error>> {
    let statistics = Statistics::of(frames).map_err(|error| format!("{name}: {error}"))?;
    println!("{name:16} {:3} {statistics}", frames.len());
    Ok(())
}
