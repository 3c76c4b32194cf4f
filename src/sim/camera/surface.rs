//! The look of vertical surfaces: a colour for each place on a wall, a piece of furniture or the
//! station. Everything except balls, posts and colours set in the world file is pale, so that a
//! behaviour that searches for a colour finds only the things meant to have it.

use crate::world::objects::{Decor, Paint};

/// A colour under full light, 0..=255 for each of red, green and blue.
pub(crate) type Rgb = [f32; 3];

/// Distance between the centres of things on a wall, metres.
const BAY: f32 = 1.7;
/// Height of a door, metres; walls that are less than 0.1 m higher stay bare.
const DOOR: f32 = 2.0;

#[derive(Debug, Clone, Copy)]
pub(crate) enum Surface {
    /// A wall; the number varies its look.
    Wall {
        paint: Rgb,
        number: u32,
        decor: Decor,
    },
    Furniture {
        paint: Rgb,
    },
    StationFront,
    StationSide,
    /// A sign; the number is the index of its code.
    Sign(usize),
}

/// The place of an upright strip on a surface, in metres.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SurfacePoint {
    /// Distance from the left end of the surface.
    pub(crate) along: f32,
    pub(crate) length: f32,
    pub(crate) top: f32,
}

#[derive(Debug, Clone, Copy)]
pub(crate) enum Thing {
    /// A picture; the number, 0..1, varies its look.
    Picture(f32),
    Window,
    Door,
    WhiteDoor,
    Whiteboard,
    Switch,
}

/// The colours of an upright strip by the height above the floor, with everything precomputed that
/// does not depend on the height.
pub(crate) type Strip = Box<dyn Fn(f32) -> Rgb>;

impl Surface {
    pub(crate) fn strip(self, place: SurfacePoint) -> Strip {
        match self {
            Surface::Wall {
                paint,
                number,
                decor,
            } => {
                let paper = wallpaper(paint, number, place, decor);
                let thing = wall_decoration(number, place, decor);
                match decor {
                    Decor::Home => Box::new(move |height| wall(paper, thing, height)),
                    Decor::Laboratory => {
                        Box::new(move |height| laboratory_wall(paper, thing, height))
                    }
                }
            }
            Surface::Furniture { paint } => furniture(paint, place),
            Surface::StationFront => {
                let aside = (place.along - place.length / 2.0).abs();
                Box::new(move |height| station(aside, place.top, height))
            }
            // `scene` paints the code of a sign; this is its back.
            Surface::StationSide | Surface::Sign(_) => Box::new(|_| [46.0, 48.0, 54.0]),
        }
    }
}

impl From<Paint> for Surface {
    fn from(paint: Paint) -> Surface {
        Surface::Furniture { paint: rgb(paint) }
    }
}

pub(crate) fn rgb(paint: Paint) -> Rgb {
    paint.0.map(f32::from)
}

pub(crate) fn scaled(colour: Rgb, gain: f32) -> Rgb {
    colour.map(|channel| channel * gain)
}

/// Returns a pseudo-random number, 0..1, that depends only on the two arguments.
pub(crate) fn scatter(a: i32, b: i32) -> f32 {
    let mut mixed = (a as u32).wrapping_mul(0x9E37_79B1) ^ (b as u32).wrapping_mul(0x85EB_CA77);
    mixed = (mixed ^ (mixed >> 15)).wrapping_mul(0x2C1B_3C6D);
    mixed ^= mixed >> 13;
    (mixed & 0xFFFF) as f32 / 65_536.0
}

fn wall(paper: Rgb, thing: Option<(Thing, f32)>, height: f32) -> Rgb {
    const SKIRTING: f32 = 0.09;
    if height < SKIRTING {
        let edge = if height > SKIRTING - 0.012 { 0.82 } else { 1.0 };
        return scaled([228.0, 226.0, 220.0], edge * contact_shadow(height));
    }
    thing_colour(thing, height).unwrap_or(paper)
}

/// Doors interrupt the skirting board.
fn laboratory_wall(paper: Rgb, thing: Option<(Thing, f32)>, height: f32) -> Rgb {
    const SKIRTING: f32 = 0.08;
    thing_colour(thing, height).unwrap_or(match height {
        _ if height < SKIRTING => scaled([150.0, 147.0, 150.0], contact_shadow(height)),
        _ => paper,
    })
}

fn thing_colour(thing: Option<(Thing, f32)>, height: f32) -> Option<Rgb> {
    let (thing, aside) = thing?;
    match thing {
        Thing::Picture(kind) => picture(aside, height, kind),
        Thing::Window => window(aside, height),
        Thing::Door => door(aside, height),
        Thing::WhiteDoor => white_door(aside, height),
        Thing::Whiteboard => whiteboard(aside, height),
        Thing::Switch => switch(aside, height),
    }
}

fn wallpaper(paint: Rgb, number: u32, place: SurfacePoint, decor: Decor) -> Rgb {
    let stripe = if decor == Decor::Laboratory || (place.along / 0.18) as i32 % 2 == 0 {
        1.0
    } else {
        0.955
    };
    let tone = 0.94 + 0.06 * scatter(number as i32, 7);
    let to_corner = place.along.min(place.length - place.along);
    let corner = 0.86 + 0.14 * (to_corner / 0.35).clamp(0.0, 1.0);
    scaled(paint, stripe * tone * corner)
}

/// Returns the thing on the wall in the bay at `place`, if any, and the offset from its centre.
fn wall_decoration(number: u32, place: SurfacePoint, decor: Decor) -> Option<(Thing, f32)> {
    let bay = (place.along / BAY) as i32;
    let middle = (bay as f32 + 0.5) * BAY;
    if middle + BAY / 2.0 > place.length || place.top < DOOR + 0.1 {
        return None;
    }
    let aside = place.along - middle;
    let kind = scatter(number as i32, bay + 100);
    let thing = match (decor, kind) {
        (Decor::Home, _) if kind < 0.30 => Thing::Picture(kind / 0.30),
        (Decor::Home, _) if kind < 0.55 => Thing::Window,
        (Decor::Home, _) if kind < 0.70 => Thing::Door,
        (Decor::Laboratory, _) if kind < 0.44 => Thing::Whiteboard,
        (Decor::Laboratory, _) if kind < 0.60 => Thing::Switch,
        (Decor::Laboratory, _) if kind > 0.70 => Thing::WhiteDoor,
        _ => return None,
    };
    Some((thing, aside))
}

/// A white leaf with a handle, in a white frame behind a dark gap.
fn white_door(aside: f32, height: f32) -> Option<Rgb> {
    let edge = (0.49 - aside.abs()).min(DOOR + 0.06 - height);
    let handle = (0.30..0.40).contains(&aside) && (0.98..1.01).contains(&height);
    match edge {
        _ if edge < 0.0 => None,
        _ if edge < 0.07 => Some([234.0, 232.0, 226.0]),
        _ if edge < 0.085 || height < 0.012 => Some([128.0, 124.0, 116.0]),
        _ if handle => Some([140.0, 140.0, 142.0]),
        _ => Some([235.0, 228.0, 206.0]),
    }
}

fn whiteboard(aside: f32, height: f32) -> Option<Rgb> {
    let edge = (0.7 - aside.abs()).min(height - 0.95).min(1.95 - height);
    let line = (height * 12.5) as i32;
    let written = scatter((aside * 40.0 + 40.0) as i32, line) < 0.4;
    match edge {
        _ if edge < 0.0 => None,
        _ if edge < 0.02 => Some([140.0, 142.0, 150.0]),
        _ if edge > 0.15 && line % 2 == 0 && written => Some([205.0, 207.0, 224.0]),
        _ => Some([226.0, 228.0, 240.0]),
    }
}

fn switch(aside: f32, height: f32) -> Option<Rgb> {
    let inside = aside.abs() < 0.06 && (0.85..0.93).contains(&height);
    if inside {
        Some([38.0, 38.0, 46.0])
    } else {
        None
    }
}

fn picture(aside: f32, height: f32, kind: f32) -> Option<Rgb> {
    let half = 0.22 + 0.12 * kind;
    let low = 0.75;
    let high = 1.25;
    let edge = (half - aside.abs()).min(height - low).min(high - height);
    let hills = 0.85 + 0.15 * (aside * 9.0 + kind * 30.0).sin();
    match edge {
        _ if edge < 0.0 => None,
        _ if edge < 0.03 => Some([70.0, 60.0, 52.0]),
        _ if edge < 0.07 => Some([226.0, 222.0, 212.0]),
        _ if height < low + 0.32 * hills => Some([104.0, 112.0, 98.0]),
        _ => Some([176.0, 184.0, 190.0]),
    }
}

fn window(aside: f32, height: f32) -> Option<Rgb> {
    let half = 0.5;
    let low = 0.65;
    let high = 1.75;
    let edge = (half - aside.abs()).min(height - low).min(high - height);
    match edge {
        _ if edge < 0.0 => None,
        _ if edge < 0.05 || aside.abs() < 0.02 => Some([236.0, 236.0, 232.0]),
        _ => Some([
            206.0 + 14.0 * (height - low),
            218.0 + 10.0 * (height - low),
            228.0,
        ]),
    }
}

fn door(aside: f32, height: f32) -> Option<Rgb> {
    let edge = (0.42 - aside.abs()).min(DOOR - height);
    let inset = (0.28 - aside.abs()).min((height - 0.25).min(0.95 - height));
    match edge {
        _ if edge < 0.0 => None,
        _ if edge < 0.05 => Some([222.0, 218.0, 210.0]),
        _ if inset.abs() < 0.012 => Some([126.0, 116.0, 106.0]),
        _ => Some(scaled([158.0, 147.0, 135.0], contact_shadow(height))),
    }
}

fn furniture(paint: Rgb, place: SurfacePoint) -> Strip {
    let to_side = place.along.min(place.length - place.along);
    let door = place.length / ((place.length / 0.5 + 0.5) as i32).max(1) as f32;
    let joint = place.along - (place.along / door) as i32 as f32 * door;
    let dark = to_side < 0.02 || joint < 0.008;
    let paint = if dark { scaled(paint, 0.62) } else { paint };
    let grain = (place.along * 90.0) as i32;
    Box::new(move |height| cabinet(paint, place.top, grain, height))
}

fn cabinet(paint: Rgb, top: f32, grain: i32, height: f32) -> Rgb {
    let gain = if top - height < 0.035 {
        1.18
    } else if height < 0.06 {
        0.45
    } else {
        0.96 + 0.06 * scatter(grain, (height * 12.0) as i32)
    };
    scaled(paint, gain * contact_shadow(height))
}

/// The station's front: a white plate with a black target between two bars, which is visible from
/// afar and has no colour of a ball.
fn station(aside: f32, top: f32, height: f32) -> Rgb {
    let from_middle = aside.max((height - 0.18).abs());
    match height {
        _ if height < 0.05 => [30.0, 31.0, 34.0],
        _ if aside > 0.165 || top - height < 0.025 => [52.0, 54.0, 60.0],
        _ if (0.115..0.15).contains(&aside) => [24.0, 24.0, 26.0],
        _ if from_middle < 0.03 => [240.0, 240.0, 236.0],
        _ if from_middle < 0.07 => [24.0, 24.0, 26.0],
        _ => [238.0, 238.0, 234.0],
    }
}

/// Ambient occlusion: returns the share of light near the floor.
fn contact_shadow(height: f32) -> f32 {
    0.72 + 0.28 * (height * (1.0 / 0.12)).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn laboratory_walls_are_plain_above_a_grey_skirting_board_except_for_white_doors() {
        let wall = |number: u32, along: f32| {
            let wall = Surface::Wall {
                paint: [236.0; 3],
                number,
                decor: Decor::Laboratory,
            };
            wall.strip(SurfacePoint {
                along,
                length: 12.0,
                top: 2.6,
            })
        };
        let plain = wall(3, 0.5);
        let mut doors = 0;
        for i in 0..60 {
            let along = 0.5 + 0.18 * i as f32;
            let strip = wall(3, along);
            let [foot, above] = [0.05, 0.5].map(&strip);
            if foot == above {
                doors += 1;
                continue;
            }
            assert_eq!(foot, plain(0.05), "{along}");
            assert_eq!(above, plain(0.5), "{along}");
            assert!(foot[0] < 0.75 * above[0], "{along}: {foot:?}");
        }
        assert!((10..50).contains(&doors), "{doors}");
    }
}
