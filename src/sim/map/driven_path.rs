//! The map of a run: the robot's path and the events along it.

use image::RgbImage;

use super::canvas::{Ink, MapCanvas, Pixel, TextStyle};
use crate::sim::body::trace::{Sample, Trace, TraceEvent, TraceEventKind};
use crate::sim::geometry::{Point, Pose, RADIUS};
use crate::sim::map;
use crate::sim::world::World;

/// Width of the legend beside the map, pixels.
const BESIDE: u32 = 320;
/// Approximate number of time labels along the path.
const CLOCKS: u32 = 6;
/// Marks of one kind that are nearer than this are drawn once, metres.
const SAME: f64 = 0.08;

const START: Ink = [20, 150, 90, 255];
const END: Ink = [30, 90, 200, 255];
const PALE: Ink = [110, 112, 118, 255];

// Outlines of marks, 1 is their size.
const HOUSE: [(f32, f32); 5] = [
    (0.0, -1.2),
    (1.0, -0.2),
    (1.0, 1.0),
    (-1.0, 1.0),
    (-1.0, -0.2),
];
const SQUARE: [(f32, f32); 4] = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
const DIAMOND: [(f32, f32); 4] = [(0.0, -1.0), (1.0, 0.0), (0.0, 1.0), (-1.0, 0.0)];
const STAR: [(f32, f32); 8] = [
    (0.0, -1.0),
    (0.3, -0.3),
    (1.0, 0.0),
    (0.3, 0.3),
    (0.0, 1.0),
    (-0.3, 0.3),
    (-1.0, 0.0),
    (-0.3, -0.3),
];
const FLAG: [(f32, f32); 5] = [
    (0.0, 1.0),
    (0.0, -1.2),
    (1.4, -0.7),
    (0.2, -0.2),
    (0.2, 1.0),
];

/// Kinds of marks, with a row in the legend for each.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Mark {
    Collision,
    FindBase,
    Docked,
    Undocked,
    NotFound,
    Photo,
    Sound,
    Light,
    Note,
}

const MARKS: [(Mark, &str, Ink); 9] = [
    (Mark::Collision, "collision", [220, 20, 20, 255]),
    (Mark::FindBase, "sent to the station", [235, 120, 0, 255]),
    (Mark::Docked, "on the station", [0, 130, 60, 255]),
    (Mark::Undocked, "left the station", [90, 190, 120, 255]),
    (Mark::NotFound, "station not found", [120, 0, 60, 255]),
    (Mark::Photo, "photo", [0, 110, 220, 255]),
    (Mark::Sound, "sound", [150, 60, 190, 255]),
    (Mark::Light, "light", [225, 170, 0, 255]),
    (Mark::Note, "note", [60, 60, 66, 255]),
];

impl Trace {
    /// Draws the path on the map of its world, green at the start and blue at the end, with times,
    /// marks for events, and a legend.
    pub fn draw(&self, world: &World) -> RgbImage {
        let Some(mut canvas) = map::blank_canvas(world, BESIDE) else {
            return RgbImage::new(1, 1);
        };
        map::draw_onto(world, &mut canvas);
        let samples: Vec<Sample> = self.samples().collect();
        draw_path(&mut canvas, &samples);
        for (ball, place) in world.balls.iter().zip(self.balls()) {
            let [r, g, b] = ball.colour.0;
            canvas.dot(*place, ball.radius as f32 * canvas.scale, [r, g, b, 255]);
        }
        draw_marks(&mut canvas, self.events());
        if let (Some(first), Some(last)) = (samples.first(), samples.last()) {
            map::robot(&mut canvas, first.pose, START);
            map::robot(&mut canvas, last.pose, END);
        }
        draw_clocks(&mut canvas, &samples);
        draw_legend(&mut canvas, world, self);
        canvas.finish()
    }
}

fn draw_path(canvas: &mut MapCanvas, samples: &[Sample]) {
    const PIECES: usize = 64;
    let legs: Vec<&[Sample]> = samples.chunk_by(|_, next| !next.placed).collect();
    for leg in &legs {
        let places: Vec<Point> = leg.iter().map(|sample| sample.pose.point()).collect();
        canvas.line(&places, 5.0, None, [255, 255, 255, 220]);
    }
    let last = samples.last();
    let end = last.map_or(1e-3, |last| last.at.as_secs_f64().max(1e-3));
    for leg in legs {
        for piece in 0..leg.len().div_ceil(PIECES) {
            // One more sample at the end connects the piece to the next one.
            let part = &leg[piece * PIECES..leg.len().min((piece + 1) * PIECES + 1)];
            let places: Vec<Point> = part.iter().map(|sample| sample.pose.point()).collect();
            let share = part[0].at.as_secs_f64() / end;
            canvas.line(&places, 2.5, None, between(share as f32));
        }
    }
    for two in samples.windows(2).filter(|two| two[1].placed) {
        let ends = [two[0].pose.point(), two[1].pose.point()];
        canvas.line(&ends, 1.0, Some(4.0), PALE);
    }
}

fn between(share: f32) -> Ink {
    std::array::from_fn(|i| {
        let from = f32::from(START[i]);
        let to = f32::from(END[i]);
        (from + (to - from) * share.clamp(0.0, 1.0)) as u8
    })
}

fn draw_clocks(canvas: &mut MapCanvas, samples: &[Sample]) {
    let Some(last) = samples.last() else {
        return;
    };
    let mut due = last.at / CLOCKS;
    for sample in samples.iter().filter(|sample| !sample.at.is_zero()) {
        if sample.at < due {
            continue;
        }
        canvas.dot(sample.pose.point(), 3.5, PALE);
        let style = TextStyle::small([60, 62, 70, 255]);
        let text = clock(sample.at.as_secs_f64());
        canvas.label_if_room(sample.pose.point(), 8.0, &text, style);
        while due <= sample.at {
            due += last.at / CLOCKS;
        }
    }
}

fn clock(seconds: f64) -> String {
    let seconds = seconds.round() as u64;
    format!("{}:{:02}", seconds / 60, seconds % 60)
}

fn mark_of(kind: &TraceEventKind) -> Option<Mark> {
    Some(match kind {
        TraceEventKind::Collision(_) => Mark::Collision,
        TraceEventKind::FindBase => Mark::FindBase,
        TraceEventKind::Docked => Mark::Docked,
        TraceEventKind::Undocked => Mark::Undocked,
        TraceEventKind::BaseNotFound => Mark::NotFound,
        TraceEventKind::Photo => Mark::Photo,
        TraceEventKind::Sound(_) => Mark::Sound,
        TraceEventKind::Light { on: true, .. } => Mark::Light,
        TraceEventKind::Light { .. } => return None,
        TraceEventKind::Note(_) => Mark::Note,
    })
}

fn draw_marks(canvas: &mut MapCanvas, events: &[TraceEvent]) {
    let mut drawn: Vec<(Mark, Point)> = Vec::new();
    // The table lists the most serious kinds first; they are drawn last, on top.
    for (mark, _, ink) in MARKS.iter().rev() {
        for event in events
            .iter()
            .filter(|event| mark_of(&event.kind) == Some(*mark))
        {
            let place = event.pose.point();
            let near = |(other, at): &(Mark, Point)| other == mark && at.distance(place) < SAME;
            if drawn.iter().any(near) {
                continue;
            }
            drawn.push((*mark, place));
            let place = canvas.at(mark_place(*mark, event.pose));
            symbol(canvas, *mark, place, *ink);
            if let TraceEventKind::Note(text) = &event.kind {
                canvas.label(event.pose.point(), 14.0, text, TextStyle::small(*ink));
            }
        }
    }
}

/// Returns the place of a mark: collisions at the bumper, all others at the robot's centre.
fn mark_place(mark: Mark, pose: Pose) -> Point {
    match mark {
        Mark::Collision => pose.point().ahead(pose.heading, RADIUS * 0.8),
        _ => pose.point(),
    }
}

fn symbol(canvas: &mut MapCanvas, mark: Mark, at: Pixel, ink: Ink) {
    let Pixel { x, y } = at;
    let polygon = |size: f32, corners: &[(f32, f32)]| -> Vec<Pixel> {
        corners
            .iter()
            .map(|(dx, dy)| Pixel::from_xy(x + dx * size, y + dy * size))
            .collect()
    };
    let (shape, size): (&[(f32, f32)], f32) = match mark {
        Mark::Collision | Mark::NotFound => {
            for sign in [-1.0, 1.0] {
                let from = Pixel::from_xy(x - 6.0, y - 6.0 * sign);
                let to = Pixel::from_xy(x + 6.0, y + 6.0 * sign);
                canvas.rule(from, to, 6.0, [255, 255, 255, 220]);
                canvas.rule(from, to, 3.0, ink);
            }
            return;
        }
        Mark::FindBase | Mark::Docked | Mark::Undocked => (&HOUSE, 7.0),
        Mark::Photo => (&SQUARE, 5.0),
        Mark::Sound => (&DIAMOND, 6.5),
        Mark::Light => (&STAR, 8.0),
        Mark::Note => (&FLAG, 8.0),
    };
    let white = polygon(size + 1.5, shape);
    canvas.fill_pixels(&white, [255, 255, 255, 230]);
    let corners = polygon(size, shape);
    canvas.fill_pixels(&corners, ink);
}

fn draw_legend(canvas: &mut MapCanvas, world: &World, trace: &Trace) {
    let left = canvas.at(Point::new(world.room.width, 0.0)).x + 28.0;
    let mut y = 14.0;
    let text = format!("run of {}", clock(trace.duration().as_secs_f64()));
    canvas.write(Pixel::from_xy(left, y), &text, TextStyle::title(END));
    y += 28.0;
    let text = format!("{:.1} m driven", trace.distance());
    canvas.write(Pixel::from_xy(left, y), &text, TextStyle::small(PALE));
    y += 32.0;
    for (ink, text) in [(START, "start"), (END, "end")] {
        let arrow = [(left, y + 3.0), (left + 12.0, y + 8.0), (left, y + 13.0)];
        canvas.fill_pixels(&arrow.map(Pixel::from), ink);
        canvas.write(Pixel::from_xy(left + 26.0, y), text, map::NAME);
        y += 24.0;
    }
    for (mark, name, ink) in MARKS {
        let all = trace.events().iter();
        let events: Vec<&TraceEvent> = all
            .filter(|event| mark_of(&event.kind) == Some(mark))
            .collect();
        if events.is_empty() {
            continue;
        }
        symbol(canvas, mark, Pixel::from_xy(left + 6.0, y + 8.0), ink);
        let text = format!("{name}: {}", events.len());
        canvas.write(Pixel::from_xy(left + 26.0, y), &text, map::NAME);
        y += 20.0;
        for line in details(&events) {
            canvas.write(
                Pixel::from_xy(left + 26.0, y),
                &line,
                TextStyle::small(PALE),
            );
            y += 18.0;
        }
        y += 6.0;
    }
    if trace.missed() > 0 {
        let text = format!("and {} more", trace.missed());
        canvas.write(Pixel::from_xy(left, y), &text, TextStyle::small(PALE));
    }
}

/// Returns the legend's lines for the first events of a kind: time and detail.
fn details(events: &[&TraceEvent]) -> Vec<String> {
    const MAX_EVENTS: usize = 4;
    let line = |event: &&TraceEvent| {
        let at = clock(event.at.as_secs_f64());
        match &event.kind {
            TraceEventKind::Collision(name) => format!("{at} {name:.18}"),
            TraceEventKind::Sound(sound) => format!("{at} {sound:?}"),
            TraceEventKind::Light { led, .. } => format!("{at} {led:?}"),
            TraceEventKind::Note(text) => format!("{at} {text:.18}"),
            _ => at,
        }
    };
    let mut lines: Vec<String> = events.iter().take(MAX_EVENTS).map(line).collect();
    if events.len() > MAX_EVENTS {
        lines.push("...".to_owned());
    }
    lines
}
