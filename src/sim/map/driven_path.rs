//! The map of a run: the robot's path and the events along it.

use image::RgbImage;

use super::canvas::{Ink, MapCanvas, Pixel, TextStyle};
use crate::body::trace::{Sample, Trace, TraceEvent, TraceEventKind as Kind};
use crate::geometry::{Point, RADIUS};
use crate::map;
use crate::world::World;

/// Width of the legend beside the map, pixels.
const BESIDE: u32 = 320;
/// Approximate number of time labels along the path.
const CLOCKS: u32 = 6;
/// Marks of one kind that are nearer than this are drawn once, metres.
const SAME: f64 = 0.08;

const START: Ink = [20, 150, 90, 255];
const END: Ink = [30, 90, 200, 255];
const PALE: Ink = [110, 112, 118, 255];

/// A star: its number of points, the radius of the corners between them as a share of the outer one,
/// and by how much it is turned, as a share of the angle between two points.
type Shape = [f32; 3];

const CROSS: Shape = [4.0, 0.3, 0.5];
const TRIANGLE: Shape = [3.0, 0.5, 0.0];
const SQUARE: Shape = [4.0, 0.71, 0.5];
const DIAMOND: Shape = [4.0, 0.71, 0.0];
const STAR: Shape = [8.0, 0.5, 0.0];
const PENTAGON: Shape = [5.0, 0.81, 0.0];

/// A kind of mark, with a row in the legend: its name, its look, and the events that it marks.
type Mark = (&'static str, Shape, Ink, fn(&Kind) -> bool);

/// The most serious kinds come first.
const MARKS: [Mark; 9] = [
    ("collision", CROSS, [220, 20, 20, 255], |kind| {
        matches!(kind, Kind::Collision(_))
    }),
    (
        "sent to the station",
        TRIANGLE,
        [235, 120, 0, 255],
        |kind| matches!(kind, Kind::FindBase),
    ),
    ("on the station", TRIANGLE, [0, 130, 60, 255], |kind| {
        matches!(kind, Kind::Docked)
    }),
    ("left the station", TRIANGLE, [90, 190, 120, 255], |kind| {
        matches!(kind, Kind::Undocked)
    }),
    ("station not found", CROSS, [120, 0, 60, 255], |kind| {
        matches!(kind, Kind::BaseNotFound)
    }),
    ("photo", SQUARE, [0, 110, 220, 255], |kind| {
        matches!(kind, Kind::Photo)
    }),
    ("sound", DIAMOND, [150, 60, 190, 255], |kind| {
        matches!(kind, Kind::Sound(_))
    }),
    ("light", STAR, [225, 170, 0, 255], |kind| {
        matches!(kind, Kind::Light { on: true, .. })
    }),
    ("note", PENTAGON, [60, 60, 66, 255], |kind| {
        matches!(kind, Kind::Note(_))
    }),
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

fn draw_marks(canvas: &mut MapCanvas, events: &[TraceEvent]) {
    // The most serious kinds are drawn last, on top.
    for (_, shape, ink, is_marked) in MARKS.iter().rev() {
        let mut drawn: Vec<Point> = Vec::new();
        for event in events.iter().filter(|event| is_marked(&event.kind)) {
            let place = event.pose.point();
            if drawn.iter().any(|other| other.distance(place) < SAME) {
                continue;
            }
            drawn.push(place);
            let at = canvas.at(mark_place(event));
            symbol(canvas, *shape, at, *ink);
            if let Kind::Note(text) = &event.kind {
                canvas.label(place, 14.0, text, TextStyle::small(*ink));
            }
        }
    }
}

/// Returns the place of a mark: collisions at the bumper, all others at the robot's centre.
fn mark_place(TraceEvent { kind, pose, .. }: &TraceEvent) -> Point {
    match kind {
        Kind::Collision(_) => pose.point().ahead(pose.heading, RADIUS * 0.8),
        _ => pose.point(),
    }
}

/// Draws a mark with a white border.
fn symbol(canvas: &mut MapCanvas, [points, inner, turned]: Shape, at: Pixel, ink: Ink) {
    for (size, ink) in [(9.0, [255, 255, 255, 230]), (7.0, ink)] {
        let corner = |half: u8| {
            let radius = if half.is_multiple_of(2) {
                size
            } else {
                size * inner
            };
            let angle = (f32::from(half) / 2.0 + turned) / points * std::f32::consts::TAU;
            Pixel::from_xy(at.x + radius * angle.sin(), at.y - radius * angle.cos())
        };
        let corners: Vec<Pixel> = (0..2 * points as u8).map(corner).collect();
        canvas.fill_pixels(&corners, ink);
    }
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
    for (name, shape, ink, is_marked) in MARKS {
        let all = trace.events().iter();
        let events: Vec<&TraceEvent> = all.filter(|event| is_marked(&event.kind)).collect();
        if events.is_empty() {
            continue;
        }
        symbol(canvas, shape, Pixel::from_xy(left + 6.0, y + 8.0), ink);
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
            Kind::Collision(name) => format!("{at} {name:.18}"),
            Kind::Sound(sound) => format!("{at} {sound:?}"),
            Kind::Light { led, .. } => format!("{at} {led:?}"),
            Kind::Note(text) => format!("{at} {text:.18}"),
            _ => at,
        }
    };
    let mut lines: Vec<String> = events.iter().take(MAX_EVENTS).map(line).collect();
    if events.len() > MAX_EVENTS {
        lines.push("...".to_owned());
    }
    lines
}
