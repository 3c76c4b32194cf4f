//! Benchmarks of the simulator's frames and steps: `cargo bench --bench simulator`.
#![allow(clippy::unwrap_used, clippy::expect_used, missing_docs)]

use std::time::Duration;

use divan::{Bencher, black_box};
use spykee::sim::{Firmware, Pose, Robot, Subsampling, World};
use spykee::wire::{Command, Report, Stream};

const STEP: Duration = Duration::from_millis(20);

fn main() {
    divan::main();
}

/// Creates a robot in the built-in world that sends a frame with every step.
fn watching(subsampling: Subsampling) -> Robot {
    let mut world = World::default_world();
    world.camera.fps = 50.0;
    world.camera.subsampling = subsampling;
    let mut robot = Robot::new(world, Firmware::default(), 1);
    robot.begin_session();
    let stream = Stream::Video;
    robot.execute(&Command::Stream { stream, on: true });
    robot
}

fn frame_len(robot: &mut Robot) -> usize {
    robot.step(STEP);
    let len = |report: &Report| match report {
        Report::Video(jpeg) => jpeg.len(),
        _ => 0,
    };
    robot.take_reports().iter().map(len).sum()
}

/// One step with one frame, in another heading each time.
#[divan::bench(args = [Subsampling::Half, Subsampling::Quarter])]
fn render_and_encode_a_frame(bencher: Bencher<'_, '_>, subsampling: Subsampling) {
    let mut robot = watching(subsampling);
    let mut count = 0;
    bencher.bench_local(|| {
        count += 1;
        robot.place(Pose::new(2.4, 2.2, f64::from(count) * 0.1));
        frame_len(&mut robot)
    });
}

/// The same while the robot turns, with motion blur.
#[divan::bench]
fn render_and_encode_while_turning(bencher: Bencher<'_, '_>) {
    let mut robot = watching(Subsampling::Half);
    robot.execute(&Command::Move {
        left: -40,
        right: 40,
    });
    bencher.bench_local(|| frame_len(&mut robot));
}

/// For comparison: only the JPEG encoding of a camera frame, with the `jpeg_encoder` crate.
#[divan::bench]
fn encode_a_frame_by_jpeg_encoder(bencher: Bencher<'_, '_>) {
    let mut robot = watching(Subsampling::Half);
    robot.step(STEP);
    let frame = robot
        .take_reports()
        .into_iter()
        .find_map(|report| match report {
            Report::Video(jpeg) => Some(jpeg),
            _ => None,
        });
    let picture = image::load_from_memory(&frame.unwrap()).unwrap().to_rgba8();
    let mut jpeg = Vec::new();
    bencher.bench_local(|| {
        jpeg.clear();
        let mut encoder = jpeg_encoder::Encoder::new(&mut jpeg, 75);
        encoder.set_sampling_factor(jpeg_encoder::SamplingFactor::F_2_1);
        let kind = jpeg_encoder::ColorType::Rgba;
        encoder.encode(&picture, 320, 240, kind).unwrap();
    });
}

/// One physics step, driving in circles without video.
#[divan::bench]
fn step(bencher: Bencher<'_, '_>) {
    let mut robot = Robot::new(World::default_world(), Firmware::default(), 1);
    robot.execute(&Command::Move {
        left: 30,
        right: 45,
    });
    bencher.bench_local(|| {
        robot.step(STEP);
        black_box(robot.take_reports())
    });
}
