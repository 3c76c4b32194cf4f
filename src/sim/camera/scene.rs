//! The scene for the camera: upright panels, posts, people and balls, and the columns of the frame
//! in which they appear.

use qrcode::{Color, QrCode};

use super::surface::{Rgb, Surface, SurfacePoint, rgb};
use super::texture::Texture;
use super::view::View;
use crate::geometry::obstacles::Obstacles;
use crate::geometry::{Point, Rectangle, Segment};
use crate::world::fixtures::{Sign, qr_code};
use crate::world::objects::Paint;
use crate::world::{World, station};

/// Depth of the near plane: nothing nearer is drawn, metres.
const NEAR: f32 = 0.01;
/// Side of a texel of a panel, metres, unless the panel is huge.
const PIXEL: f32 = 0.01;
/// Approximate maximum number of texels of a panel.
const MAX_TEXELS: f32 = 4e5;
/// Distance between a sign and the thing on which it hangs, metres.
const SIGN_DISTANCE: f64 = 0.01;
/// Maximum thickness of a thing on which a sign hangs, metres.
const MAX_THICKNESS: f64 = 0.6;

#[derive(Debug)]
pub(crate) struct Panel {
    line: Segment,
    pub(crate) length: f32,
    pub(crate) bottom: f32,
    pub(crate) top: f32,
    pub(crate) surface: Surface,
    /// Share of the room's light on it, which depends on its orientation.
    pub(crate) light: f32,
    picture: Option<Texture>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum RoundKind {
    Ball,
    Post { top: f32 },
    Person { top: f32 },
}

#[derive(Debug, Clone, Copy)]
pub(crate) struct Round {
    pub(crate) middle: Point,
    pub(crate) radius: f32,
    pub(crate) kind: RoundKind,
    pub(crate) paint: Rgb,
}

pub(crate) struct Scene {
    pub(crate) panels: Vec<Panel>,
    /// Balls and people, in the order of the world's lists, then posts.
    pub(crate) rounds: Vec<Round>,
    codes: Vec<(QrCode, Sign)>,
}

/// An intersection of a column's ray with a thing, `depth` metres ahead.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Hit {
    pub(crate) depth: f32,
    pub(crate) thing: Thing,
}

/// The thing that the ray hit, as an index into the scene.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Thing {
    /// A panel, at this share of its line.
    Panel { index: usize, share: f32 },
    /// A round thing, `aside` of its radius to the right of the middle, -1..=1.
    Round { index: usize, aside: f32 },
}

impl Scene {
    pub(crate) fn new(world: &World) -> Scene {
        let mut scene = Scene {
            panels: Vec::new(),
            rounds: Vec::new(),
            codes: Vec::new(),
        };
        scene.add_walls(world);
        for item in &world.furniture {
            scene.add_box(item.footprint(), item.height, item.colour.into());
        }
        let front = scene.panels.len();
        let body = world.station.footprint();
        scene.add_box(body, station::HEIGHT, Surface::StationSide);
        scene.panels[front].surface = Surface::StationFront;
        scene.add_signs(world);
        let balls = world.balls.iter();
        let balls = balls.map(|b| Round::new(b.at.point(), b.radius, RoundKind::Ball, b.colour));
        let people = world.walkers.iter().map(|w| {
            let top = w.height as f32;
            Round::new(w.at.point(), w.radius, RoundKind::Person { top }, w.colour)
        });
        let posts = world.posts.iter().map(|p| {
            let top = p.height as f32;
            Round::new(p.at.point(), p.radius, RoundKind::Post { top }, p.colour)
        });
        scene.rounds.extend(balls.chain(people).chain(posts));
        scene
    }

    pub(crate) fn move_rounds(&mut self, places: impl Iterator<Item = Point>) -> bool {
        let mut moved = false;
        for (round, place) in self.rounds.iter_mut().zip(places) {
            moved |= round.middle != place;
            round.middle = place;
        }
        moved
    }

    pub(crate) fn picture(&mut self, index: usize) -> &Texture {
        let panel = &mut self.panels[index];
        let codes = &self.codes;
        let surface = panel.surface;
        let length = panel.length;
        let height = panel.top - panel.bottom;
        panel.picture.get_or_insert_with(|| {
            if let Surface::Sign(code) = surface {
                let (code, sign) = &codes[code];
                return sign_texture(code, sign);
            }
            let size = PIXEL.max((length * height / MAX_TEXELS).sqrt());
            Texture::paint([length, height], size, |along| {
                surface.strip(SurfacePoint {
                    along,
                    length,
                    top: height,
                })
            })
        })
    }

    fn add_walls(&mut self, world: &World) {
        let paint = rgb(world.room.walls);
        for (number, line) in (0..).zip(world.wall_sides()) {
            let surface = Surface::Wall {
                paint,
                number,
                decor: world.room.decor,
            };
            let top = world.room.height;
            self.panels.push(Panel::new(line, 0.0, top, surface));
        }
    }

    fn add_box(&mut self, footprint: Rectangle, height: f64, surface: Surface) {
        let sides = footprint.sides().into_iter();
        self.panels
            .extend(sides.map(|side| Panel::new(side, 0.0, height, surface)));
    }

    fn add_signs(&mut self, world: &World) {
        let obstacles = world.fixed_obstacles();
        for sign in &world.signs {
            let Some(code) = qr_code(&sign.text) else {
                continue;
            };
            let heading = sign.heading_degrees.to_radians();
            let middle = outside(world, &obstacles, sign.at.point(), heading);
            let left = std::f64::consts::FRAC_PI_2;
            // `from` is the left end for a viewer in front of the sign.
            let line = Segment {
                from: middle.ahead(heading - left, sign.side / 2.0),
                to: middle.ahead(heading + left, sign.side / 2.0),
            };
            let bottom = (sign.height - sign.side / 2.0).max(0.0);
            let surface = Surface::Sign(self.codes.len());
            let top = bottom + sign.side;
            self.panels.push(Panel::new(line, bottom, top, surface));
            self.codes.push((code, sign.clone()));
        }
    }

    /// Calls `found` for each column in which a panel is visible.
    pub(crate) fn columns_of_panel(
        &self,
        index: usize,
        view: &View,
        mut found: impl FnMut(usize, Hit),
    ) {
        let line = self.panels[index].line;
        let a = view.relative(line.from);
        let b = view.relative(line.to);
        let da = b.0 - a.0;
        let dr = b.1 - a.1;
        // A sign is visible from the front only.
        let back = a.0 * dr - a.1 * da < 0.0;
        if matches!(self.panels[index].surface, Surface::Sign(_)) && back {
            return;
        }
        let Some([left, right]) = slopes([a, b]) else {
            return;
        };
        for column in view.columns(left, right) {
            let slope = view.column(column).slope;
            let share = (slope * a.0 - a.1) / (dr - slope * da);
            if !(-1e-3..=1.001).contains(&share) {
                continue;
            }
            let share = share.clamp(0.0, 1.0);
            let depth = a.0 + share * da;
            if depth > NEAR {
                let thing = Thing::Panel { index, share };
                found(column, Hit { depth, thing });
            }
        }
    }

    /// Calls `found` for each column in which a round thing is visible.
    pub(crate) fn columns_of_round(
        &self,
        index: usize,
        view: &View,
        mut found: impl FnMut(usize, Hit),
    ) {
        let Round { middle, radius, .. } = self.rounds[index];
        let (ahead, right) = view.relative(middle);
        let distance = ahead.hypot(right);
        if distance <= radius || ahead < -radius {
            return;
        }
        let towards = right.atan2(ahead);
        let half = (radius / distance).asin();
        let edge = |angle: f32| angle.clamp(-1.5, 1.5).tan();
        for column in view.columns(edge(towards - half), edge(towards + half)) {
            let slope = view.column(column).slope;
            let length = (1.0 + slope * slope).sqrt();
            let aside = (slope * ahead - right) / length;
            if aside.abs() >= radius {
                continue;
            }
            let nearest = (ahead + right * slope) / length;
            let depth = (nearest - (radius * radius - aside * aside).sqrt()) / length;
            if depth > NEAR {
                let aside = aside / radius;
                let thing = Thing::Round { index, aside };
                found(column, Hit { depth, thing });
            }
        }
    }
}

/// Returns the slopes, from left to right, between which a line is visible; each end is given as
/// its distance ahead and to the right. `None` if the line is behind the camera.
fn slopes([a, b]: [(f32, f32); 2]) -> Option<[f32; 2]> {
    let (near, far) = if a.0 < b.0 { (a, b) } else { (b, a) };
    if far.0 <= NEAR {
        return None;
    }
    let near = if near.0 < NEAR {
        let share = (NEAR - near.0) / (far.0 - near.0);
        (NEAR, near.1 + share * (far.1 - near.1))
    } else {
        near
    };
    let one = near.1 / near.0;
    let other = far.1 / far.0;
    Some([one.min(other), one.max(other)])
}

/// Returns where a sign hangs: slightly outside the wall, furniture or post that contains `at`.
fn outside(world: &World, obstacles: &Obstacles, at: Point, heading: f64) -> Point {
    let on_post = world
        .posts
        .iter()
        .find(|p| p.at.point().distance(at) < p.radius);
    if let Some(post) = on_post {
        return post.at.point().ahead(heading, post.radius + SIGN_DISTANCE);
    }
    let out = if world.solid(at) {
        let beyond = at.ahead(heading, MAX_THICKNESS);
        obstacles
            .first_side(at, beyond)
            .map_or(0.0, |share| share * MAX_THICKNESS)
    } else {
        0.0
    };
    at.ahead(heading, out + SIGN_DISTANCE)
}

impl Panel {
    fn new(line: Segment, bottom: f64, top: f64, surface: Surface) -> Panel {
        // The angle of an assumed lamp to the upper left of the plan: sides facing it are brighter.
        const LAMP: f64 = 2.3;
        let angle = line.from.direction_of(line.to);
        Panel {
            line,
            length: (line.from.distance(line.to) as f32).max(1e-3),
            bottom: bottom as f32,
            top: top as f32,
            surface,
            light: (0.88 + 0.12 * (angle - LAMP).cos()) as f32,
            picture: None,
        }
    }
}

impl Round {
    fn new(middle: Point, radius: f64, kind: RoundKind, colour: Paint) -> Round {
        Round {
            middle,
            radius: radius as f32,
            kind,
            paint: rgb(colour),
        }
    }
}

/// Width of the quiet zone around a code, in modules; readers need four.
const MARGIN: usize = 4;
/// Texels along one module.
const FINE: f32 = 4.0;

/// Paints the board with the code; the first axis runs from left to right, the second upwards.
fn sign_texture(code: &QrCode, sign: &Sign) -> Texture {
    let side = sign.side as f32;
    let width = code.width();
    let dot = side / (width + 2 * MARGIN) as f32;
    let index = move |place: f32| {
        let module = ((place / dot) as usize).checked_sub(MARGIN)?;
        if module < width { Some(module) } else { None }
    };
    Texture::paint([side; 2], dot / FINE, |along| {
        move |up| {
            let module = index(along).zip(index(side - up));
            let is_dark = module.is_some_and(|module| code[module] == Color::Dark);
            [if is_dark { 22.0 } else { 240.0 }; 3]
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::view::WIDTH;

    #[test]
    fn slopes_cover_the_part_ahead_of_the_camera() {
        assert_eq!(slopes([(1.0, 1.0), (1.0, -1.0)]), Some([-1.0, 1.0]));
        assert_eq!(slopes([(-1.0, 1.0), (-1.0, -1.0)]), None);
        let [left, right] = slopes([(-1.0, 1.0), (1.0, 1.0)]).unwrap();
        assert!(left >= 0.99 && right > WIDTH as f32 / 4.0, "{left} {right}");
    }
}
