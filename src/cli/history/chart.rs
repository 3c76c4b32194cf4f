//! Draws a story: the battery level over time, charging, dockings and alarms, and a lane for each
//! behaviour that ran.

use image::RgbImage;
use jiff::Timestamp;
use jiff::tz::TimeZone;

use super::scale::ticks;
use super::story::{Level, MAX_GAP, Mark, Run, Story};
use crate::canvas::{Canvas, Ink, TextStyle};
use crate::clean;

const WIDTH: u32 = 1280;
/// Height above the battery plot.
const HEAD: f32 = 104.0;
/// Height of the battery plot.
const HEIGHT: f32 = 300.0;
/// Height of the time axis.
const AXIS: f32 = 34.0;
/// Height of a lane.
const LANE: f32 = 30.0;
const RIGHT: f32 = 36.0;
const FOOT: f32 = 28.0;
/// Maximum number of lanes; the behaviours that ran longest get one.
const MAX_LANES: usize = 10;
/// Longer names are cut to this many characters.
const LONGEST_NAME: usize = 18;

const DARK: Ink = [33, 37, 41, 255];
const PALE: Ink = [108, 117, 125, 255];
const GRID: Ink = [0, 0, 0, 22];
const DAY: Ink = [0, 0, 0, 60];
const LINE: Ink = [26, 105, 176, 255];
const AREA: Ink = [26, 105, 176, 38];
const CHARGING: Ink = [52, 160, 88, 78];
const OFFLINE: Ink = [90, 90, 100, 38];
const RUN: Ink = [86, 140, 196, 255];
const GOOD: Ink = [46, 140, 78, 255];
const BAD: Ink = [200, 52, 62, 255];
const STRIPE: Ink = [0, 0, 0, 9];
const TEXT: TextStyle = TextStyle::small(DARK);
const NOTE: TextStyle = TextStyle::small(PALE);

/// Draws the story.
pub(super) fn draw(story: &Story, zone: &TimeZone) -> RgbImage {
    let lanes = lanes(&story.runs, story);
    let height = HEAD + HEIGHT + AXIS + LANE * (lanes.len() + 1) as f32 + FOOT;
    let Some(canvas) = Canvas::new(WIDTH, height as u32) else {
        return RgbImage::default();
    };
    let longest = lanes.iter().map(|lane| lane.name.chars().count()).max();
    let letters = longest.unwrap_or(0).max("docking".len());
    let left = 20.0 + TEXT.size(&"x".repeat(letters)).0 + 14.0;
    let mut chart = Chart {
        canvas,
        left,
        story,
    };
    chart.head(zone);
    chart.gaps();
    chart.axis(zone, lanes.len() + 1);
    chart.level();
    chart.docks();
    for (number, lane) in lanes.iter().enumerate() {
        chart.lane(number + 1, lane);
    }
    chart.canvas.finish()
}

/// A behaviour and its runs.
struct Lane<'a> {
    name: String,
    runs: Vec<&'a Run>,
}

/// The lanes of the behaviours that ran longest, sorted by name.
fn lanes<'a>(runs: &'a [Run], story: &Story) -> Vec<Lane<'a>> {
    let mut names: Vec<&str> = runs.iter().map(|run| run.behaviour.as_str()).collect();
    names.sort_unstable();
    names.dedup();
    let of =
        |name: &str| -> Vec<&'a Run> { runs.iter().filter(|run| run.behaviour == name).collect() };
    let time = |name: &str| -> i64 {
        let long = |run: &Run| {
            let (began, ended) = bounds(run, story);
            ended.duration_since(began).as_secs()
        };
        of(name).into_iter().map(long).sum()
    };
    names.sort_by_key(|name| std::cmp::Reverse(time(name)));
    names.truncate(MAX_LANES);
    names.sort_unstable();
    let lane = |name: &str| Lane {
        name: clean::line(name).chars().take(LONGEST_NAME).collect(),
        runs: of(name),
    };
    names.into_iter().map(lane).collect()
}

/// The start and end of a run, clipped to the picture. A run without an end ends with the picture.
fn bounds(run: &Run, story: &Story) -> (Timestamp, Timestamp) {
    let began = run
        .began
        .unwrap_or(story.since)
        .clamp(story.since, story.until);
    let ended = run.ended.unwrap_or(story.until).clamp(began, story.until);
    (began, ended)
}

struct Chart<'a> {
    canvas: Canvas,
    left: f32,
    story: &'a Story,
}

impl Chart<'_> {
    fn right(&self) -> f32 {
        WIDTH as f32 - RIGHT
    }

    fn x(&self, at: Timestamp) -> f32 {
        let all = self.story.until.duration_since(self.story.since);
        let part = at.duration_since(self.story.since);
        let share = part.as_secs_f64() / all.as_secs_f64().max(1e-3);
        self.left + (self.right() - self.left) * share.clamp(0.0, 1.0) as f32
    }

    fn y(percent: f64) -> f32 {
        HEAD + HEIGHT * (1.0 - percent.clamp(0.0, 100.0) as f32 / 100.0)
    }

    /// The top of a lane; lane 0 is for dockings.
    fn lane_top(number: usize) -> f32 {
        HEAD + HEIGHT + AXIS + LANE * number as f32
    }

    fn rectangle(&mut self, (left, top): (f32, f32), (right, bottom): (f32, f32), ink: Ink) {
        let corners = [(left, top), (right, top), (right, bottom), (left, bottom)];
        self.canvas.fill(&corners, ink);
    }

    fn head(&mut self, zone: &TimeZone) {
        let title = TextStyle {
            large: true,
            bold: true,
            ..TEXT
        };
        let of = match self.story.robots.as_slice() {
            [] => String::new(),
            [one] => format!(" of {}", clean::line(one)),
            several => format!(" of {} robots", several.len()),
        };
        self.canvas
            .write((20.0, 18.0), &format!("Battery{of}"), title);
        let local = |at: Timestamp| {
            let at = at.to_zoned(zone.clone());
            at.strftime("%a %-d %b %Y, %H:%M").to_string()
        };
        let times = format!("{} to {}", local(self.story.since), local(self.story.until));
        self.canvas.write((20.0, 44.0), &times, NOTE);
        self.legend();
    }

    /// Draws the legend, right-aligned in the head.
    fn legend(&mut self) {
        let entries: [(&str, Sign); 8] = [
            ("level", Sign::Line),
            ("charging", Sign::Area(CHARGING)),
            ("no link", Sign::Area(OFFLINE)),
            ("docked", Sign::Dot(GOOD)),
            ("not docked", Sign::Dot(BAD)),
            ("alarm", Sign::Alarm),
            ("run", Sign::Area(RUN)),
            ("failed", Sign::Area(BAD)),
        ];
        let (gap, sign) = (22.0, 20.0);
        let long: f32 = entries
            .iter()
            .map(|(text, _)| sign + NOTE.size(text).0 + gap)
            .sum();
        let mut x = self.right() - long + gap;
        let y = 72.0;
        for (text, kind) in entries {
            self.sign(kind, (x + 6.0, y + 8.0));
            self.canvas.write((x + sign, y), text, NOTE);
            x += sign + NOTE.size(text).0 + gap;
        }
    }

    fn sign(&mut self, sign: Sign, (x, y): (f32, f32)) {
        match sign {
            Sign::Line => self
                .canvas
                .line(&[(x - 7.0, y), (x + 7.0, y)], 3.0, None, LINE),
            Sign::Area(ink) => self.rectangle((x - 6.0, y - 6.0), (x + 6.0, y + 6.0), ink),
            Sign::Dot(ink) => self.canvas.dot((x, y), 5.0, ink),
            Sign::Alarm => self.triangle((x, y)),
        }
    }

    fn triangle(&mut self, (x, y): (f32, f32)) {
        let corners = [(x, y - 7.0), (x + 7.0, y + 6.0), (x - 7.0, y + 6.0)];
        self.canvas.fill(&corners, BAD);
        self.canvas.write(
            (x - 5.0, y - 7.0),
            "!",
            TextStyle {
                bold: true,
                ..TextStyle::small([255, 255, 255, 255])
            },
        );
    }

    /// Shades the spans without a link.
    fn gaps(&mut self) {
        let (top, bottom) = (HEAD, HEAD + HEIGHT);
        for &(from, to) in &self.story.offline {
            let (from, to) = (self.x(from), self.x(to));
            self.rectangle((from, top), (to.max(from + 1.0), bottom), OFFLINE);
        }
    }

    fn axis(&mut self, zone: &TimeZone, lanes: usize) {
        for percent in [0, 25, 50, 75, 100] {
            let y = Chart::y(f64::from(percent));
            let ink = if percent == 0 { DAY } else { GRID };
            self.canvas
                .line(&[(self.left, y), (self.right(), y)], 1.0, None, ink);
            let label = format!("{percent} %");
            let (width, height) = NOTE.size(&label);
            self.canvas
                .write((self.left - 10.0 - width, y - height / 2.0), &label, NOTE);
        }
        for lane in (0..lanes).step_by(2) {
            let top = Chart::lane_top(lane);
            self.rectangle((self.left, top), (self.right(), top + LANE), STRIPE);
        }
        let bottom = Chart::lane_top(lanes);
        for tick in ticks(self.story.since, self.story.until, zone, 12) {
            let x = self.x(tick.at);
            let ink = if tick.strong { DAY } else { GRID };
            self.canvas
                .line(&[(x, HEAD), (x, HEAD + HEIGHT)], 1.0, None, ink);
            self.canvas
                .line(&[(x, HEAD + HEIGHT + AXIS), (x, bottom)], 1.0, None, ink);
            let style = if tick.strong { TEXT } else { NOTE };
            let width = style.size(&tick.label).0;
            let most = WIDTH as f32 - width - 4.0;
            let place = ((x - width / 2.0).clamp(4.0, most), HEAD + HEIGHT + 8.0);
            self.canvas.write(place, &tick.label, style);
        }
    }

    fn level(&mut self) {
        let together =
            |one: &Level, next: &Level| next.at.duration_since(one.at).as_secs() <= MAX_GAP;
        let story = self.story;
        for part in story.levels.chunk_by(together) {
            let line: Vec<(f32, f32)> = part
                .iter()
                .map(|level| (self.x(level.at), Chart::y(level.percent)))
                .collect();
            if let [only] = line.as_slice() {
                let only = *only;
                self.canvas.dot(only, 2.0, LINE);
                continue;
            }
            for (from, to, charging) in phases(part) {
                let ink = if charging { CHARGING } else { AREA };
                let floor = Chart::y(0.0);
                let mut area = line[from..=to].to_vec();
                area.extend([(line[to].0, floor), (line[from].0, floor)]);
                self.canvas.fill(&area, ink);
            }
            self.canvas.line(&line, 2.5, None, LINE);
        }
    }

    fn name(&mut self, number: usize, name: &str) {
        let (width, height) = TEXT.size(name);
        let y = Chart::lane_top(number) + (LANE - height) / 2.0;
        self.canvas.write((self.left - 10.0 - width, y), name, TEXT);
    }

    fn docks(&mut self) {
        self.name(0, "docking");
        let y = Chart::lane_top(0) + LANE / 2.0;
        let story = self.story;
        // Failures and alarms are drawn on top.
        let rank = |mark: &&Mark| (!mark.good, mark.alarm);
        let mut marks: Vec<&Mark> = story.marks.iter().collect();
        marks.sort_by_key(rank);
        for mark in marks {
            let x = self.x(mark.at);
            match mark {
                Mark { alarm: true, .. } => self.triangle((x, y)),
                Mark { good: true, .. } => self.dot((x, y), GOOD),
                Mark { good: false, .. } => self.dot((x, y), BAD),
            }
        }
    }

    /// Draws a dot with a white edge, so that overlapping dots can be told apart.
    fn dot(&mut self, place: (f32, f32), ink: Ink) {
        self.canvas.dot(place, 6.5, [255, 255, 255, 255]);
        self.canvas.dot(place, 5.0, ink);
    }

    fn lane(&mut self, number: usize, lane: &Lane<'_>) {
        self.name(number, &lane.name);
        let top = Chart::lane_top(number);
        for run in &lane.runs {
            let (began, ended) = bounds(run, self.story);
            let (from, to) = (self.x(began), self.x(ended));
            let to = to.max(from + 2.0);
            self.rectangle((from, top + 8.0), (to, top + LANE - 8.0), RUN);
            if run.failed() {
                self.rectangle((to - 4.0, top + 5.0), (to, top + LANE - 5.0), BAD);
            }
        }
    }
}

/// A symbol in the legend.
#[derive(Debug, Clone, Copy)]
enum Sign {
    Line,
    Area(Ink),
    Dot(Ink),
    Alarm,
}

/// Splits the levels into phases of charging and not charging, as (first, last, charging); each
/// phase begins where the one before ends.
fn phases(levels: &[Level]) -> Vec<(usize, usize, bool)> {
    let mut phases: Vec<(usize, usize, bool)> = Vec::new();
    for (at, pair) in levels.windows(2).enumerate() {
        let [one, _] = pair else { continue };
        match phases.last_mut() {
            Some((_, to, charging)) if *charging == one.charging => *to = at + 1,
            _ => phases.push((at, at + 1, one.charging)),
        }
    }
    phases
}

#[cfg(test)]
mod tests;
