//! The world as the camera needs it: upright panels, posts and balls, and what a column of the
//! picture meets of them.

use super::geometry::{Point, Segment};
use super::paint::Paint;
use super::station;
use super::surface::{Rgb, Surface, rgb};
use super::world::World;

/// Nearer than this nothing is drawn, metres.
const NEAR: f64 = 0.01;

/// An upright rectangle.
#[derive(Debug)]
pub(super) struct Panel {
    line: Segment,
    pub(super) length: f32,
    pub(super) top: f32,
    pub(super) surface: Surface,
    /// How much of the lamps' light falls on it, from the way it faces.
    pub(super) light: f32,
    /// As high as the room: hides everything behind it.
    full: bool,
}

/// A post, or a ball if it has no top.
#[derive(Debug)]
pub(super) struct Round {
    pub(super) middle: Point,
    pub(super) radius: f32,
    pub(super) top: Option<f32>,
    pub(super) paint: Rgb,
}

/// Everything that stands in a world.
#[derive(Debug)]
pub(super) struct Scene {
    pub(super) panels: Vec<Panel>,
    pub(super) rounds: Vec<Round>,
}

/// What a ray in the plane of the floor meets, `depth` lengths of its direction away.
#[derive(Debug, Clone, Copy)]
pub(super) struct Hit {
    pub(super) depth: f32,
    pub(super) what: What,
}

/// The thing that was met, as an index into the scene.
#[derive(Debug, Clone, Copy)]
pub(super) enum What {
    /// A panel, at this share of its line.
    Panel { index: usize, share: f32 },
    /// A post or a ball, `aside` of its radius to the right of the middle, -1..=1.
    Round { index: usize, aside: f32 },
}

impl Scene {
    /// The scene of a world.
    pub(super) fn of(world: &World) -> Scene {
        let mut scene = Scene {
            panels: Vec::new(),
            rounds: Vec::new(),
        };
        scene.add_walls(world);
        for item in &world.furniture {
            scene.add_box(item.sides(), item.height, item.colour.into());
        }
        scene.add_box(world.station.sides(), station::HEIGHT, Surface::StationSide);
        scene.mark_station(&world.station);
        let ball = |b: &super::Ball| Round::of(b.at.point(), b.radius, None, b.colour);
        let post = |p: &super::Post| Round::of(p.at.point(), p.radius, Some(p.height), p.colour);
        scene.rounds.extend(world.balls.iter().map(ball));
        scene.rounds.extend(world.posts.iter().map(post));
        scene
    }

    fn add_walls(&mut self, world: &World) {
        let paint = rgb(world.room.walls);
        let inner = world.walls.iter().flat_map(|wall| wall.sides());
        for (number, line) in (0..).zip(world.room.sides().into_iter().chain(inner)) {
            let surface = Surface::Wall { paint, number };
            let panel = Panel::of(line, world.room.height, surface);
            self.panels.push(Panel {
                full: true,
                ..panel
            });
        }
    }

    fn add_box(&mut self, sides: [Segment; 4], height: f64, surface: Surface) {
        self.panels
            .extend(sides.map(|side| Panel::of(side, height, surface)));
    }

    fn mark_station(&mut self, station: &station::Station) {
        let front = station.sides()[0];
        let panel = self.panels.iter_mut().rfind(|panel| panel.line == front);
        panel
            .into_iter()
            .for_each(|panel| panel.surface = Surface::StationFront);
    }

    /// What a ray from `origin` along (`dx`, `dy`) meets, farthest first, beginning with the first
    /// full wall if there is one.
    pub(super) fn hits(&self, origin: Point, dx: f64, dy: f64, hits: &mut Vec<Hit>) {
        hits.clear();
        let mut end = f32::MAX;
        for (index, panel) in self.panels.iter().enumerate() {
            let Some((depth, share)) = panel.line.meets_ray(origin, dx, dy) else {
                continue;
            };
            if depth > NEAR && (depth as f32) <= end {
                let share = share as f32;
                hits.push(Hit {
                    depth: depth as f32,
                    what: What::Panel { index, share },
                });
                end = if panel.full { depth as f32 } else { end };
            }
        }
        let rounds = self.rounds.iter().enumerate();
        hits.extend(rounds.filter_map(|(index, round)| round.met(index, origin, dx, dy)));
        hits.retain(|hit| hit.depth <= end);
        hits.sort_by(|a, b| b.depth.total_cmp(&a.depth));
    }
}

impl Panel {
    fn of(line: Segment, height: f64, surface: Surface) -> Panel {
        // A lamp somewhere to the upper left of the plan: sides that face it are brighter.
        const LAMP: f64 = 2.3;
        let angle = line.from.direction_of(line.to);
        Panel {
            line,
            length: line.from.distance(line.to) as f32,
            top: height as f32,
            surface,
            light: (0.88 + 0.12 * (angle - LAMP).cos()) as f32,
            full: false,
        }
    }
}

impl Round {
    fn of(middle: Point, radius: f64, top: Option<f64>, colour: Paint) -> Round {
        Round {
            middle,
            radius: radius as f32,
            top: top.map(|top| top as f32),
            paint: rgb(colour),
        }
    }

    /// Where a ray enters the circle that this thing is from above.
    fn met(&self, index: usize, origin: Point, dx: f64, dy: f64) -> Option<Hit> {
        let (ox, oy) = (self.middle.x - origin.x, self.middle.y - origin.y);
        let length = dx.hypot(dy);
        let nearest = (ox * dx + oy * dy) / length;
        let aside = (oy * dx - ox * dy) / length;
        let radius = f64::from(self.radius);
        if aside.abs() >= radius {
            return None;
        }
        let depth = (nearest - (radius * radius - aside * aside).sqrt()) / length;
        let aside = (aside / radius) as f32;
        (depth > NEAR).then_some(Hit {
            depth: depth as f32,
            what: What::Round { index, aside },
        })
    }
}
