//! Brightness and colour of the light in a world: daylight, and lamps that switch by schedule.

use crate::geometry::Point;
use crate::geometry::obstacles::Obstacles;
use crate::world::World;
use crate::world::fixtures::Lamp;

use super::texture::Pixel;

/// Maximum number of points of the light map along the longer side of a room.
const MAX_POINTS: usize = 96;
/// Minimum distance between points of the light map, metres.
const FINEST: f64 = 0.15;
/// Share of a hidden lamp's light that comes through doors and over walls.
const SPILL: f32 = 0.06;

/// Light per colour channel; 1 is full.
pub(crate) type Light = [f32; 3];

/// The value of a light channel in a pixel that means full light.
const FULL: f32 = 128.0;

pub(super) fn light(light: Light) -> Pixel {
    let [r, g, b] = light.map(|channel| (channel * FULL) as u8);
    [r, g, b, 0]
}

/// Values at the corners of square cells, interpolated in between.
#[derive(Debug)]
pub(super) struct Grid<const N: usize> {
    columns: usize,
    rows: usize,
    values: Vec<[f32; N]>,
}

impl<const N: usize> Grid<N> {
    /// Creates a grid of the values at each column and row.
    pub(super) fn new(
        columns: usize,
        rows: usize,
        value: impl Fn(usize, usize) -> [f32; N],
    ) -> Grid<N> {
        let corners = (0..columns * rows).map(|index| value(index % columns, index / columns));
        Grid {
            columns,
            rows,
            values: corners.collect(),
        }
    }

    /// Returns the values at a place, given as column and row.
    pub(super) fn at(&self, x: f32, y: f32) -> [f32; N] {
        let x = x.clamp(0.0, (self.columns - 2) as f32);
        let y = y.clamp(0.0, (self.rows - 2) as f32);
        let column = x as usize;
        let row = y as usize;
        let dx = x - column as f32;
        let dy = y - row as f32;
        let near = row * self.columns + column;
        let far = near + self.columns;
        std::array::from_fn(|i| {
            let front = self.values[near][i] * (1.0 - dx) + self.values[near + 1][i] * dx;
            let back = self.values[far][i] * (1.0 - dx) + self.values[far + 1][i] * dx;
            front * (1.0 - dy) + back * dy
        })
    }
}

#[derive(Debug)]
pub(crate) struct Lighting {
    day: f32,
    lamps: Vec<Lamp>,
    /// The share of each lamp's light at each point of the light map.
    shares: Vec<Grid<1>>,
    lit: Vec<bool>,
    cell: f32,
    map: Grid<3>,
    /// Factor applied to the world's own light.
    gain: f32,
}

impl Lighting {
    pub(crate) fn new(world: &World) -> Lighting {
        let room = &world.room;
        let cell = (room.width.max(room.depth) / MAX_POINTS as f64).max(FINEST);
        let points = |side: f64| (side / cell).ceil() as usize + 2;
        let columns = points(room.width);
        let rows = points(room.depth);
        let obstacles = world.fixed_obstacles();
        let share = |lamp: &Lamp| {
            Grid::new(columns, rows, |column, row| {
                let place = Point::new(column as f64 * cell, row as f64 * cell);
                [share_of(lamp, place, &obstacles)]
            })
        };
        let mut lighting = Lighting {
            day: world.light as f32,
            shares: world.lamps.iter().map(share).collect(),
            lit: vec![false; world.lamps.len()],
            lamps: world.lamps.clone(),
            cell: cell as f32,
            map: Grid::new(columns, rows, |_, _| [0.0; 3]),
            gain: 1.0,
        };
        lighting.draw();
        lighting.advance_to(0.0);
        lighting
    }

    /// Switches the lamps according to their schedules at a time, in seconds; returns whether any
    /// of them changed.
    pub(crate) fn advance_to(&mut self, seconds: f64) -> bool {
        let now = |lamp: &Lamp| lamp.lit(seconds);
        let mut lamps = self.lamps.iter().zip(&self.lit);
        let switched = lamps.any(|(lamp, lit)| now(lamp) != *lit);
        if switched {
            self.lit = self.lamps.iter().map(now).collect();
            self.draw();
        }
        switched
    }

    pub(crate) fn set_gain(&mut self, gain: f32) {
        self.gain = gain;
        self.draw();
    }

    fn draw(&mut self) {
        let lamps = self.lamps.iter().zip(&self.shares).zip(&self.lit);
        let lit: Vec<(Light, &Grid<1>)> = lamps
            .filter(|(_, lit)| **lit)
            .map(|((lamp, shares), _)| {
                let bright = lamp.brightness as f32 / 255.0;
                let light = lamp.colour.0.map(|channel| f32::from(channel) * bright);
                (light, shares)
            })
            .collect();
        for (index, light) in self.map.values.iter_mut().enumerate() {
            let sum = lit.iter().fold([self.day; 3], |sum, (colour, shares)| {
                std::array::from_fn(|i| sum[i] + colour[i] * shares.values[index][0])
            });
            *light = sum.map(|channel| channel * self.gain);
        }
    }

    pub(crate) fn at(&self, x: f32, y: f32) -> Light {
        if self.lamps.is_empty() {
            return [self.day * self.gain; 3];
        }
        self.map.at(x / self.cell, y / self.cell)
    }

    pub(crate) fn is_uniform(&self) -> bool {
        self.lamps.is_empty()
    }
}

fn share_of(lamp: &Lamp, place: Point, obstacles: &Obstacles) -> f32 {
    let at = lamp.at.point();
    let far = (at.distance(place) / lamp.reach) as f32;
    let seen = if obstacles.is_behind_wall(at, place) {
        SPILL
    } else {
        1.0
    };
    seen / (1.0 + far * far)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lighting() -> Lighting {
        let text = "room: {width: 6, depth: 4}\nstation: {at: [0, 2], heading_degrees: 0}\nlight: 0.1\n\
                    walls: [{from: [3, 0], to: [3, 4]}]\n\
                    lamps: [{at: [1, 2], colour: \"#ff8000\", on: {after: 10, for: 5}}]\n";
        Lighting::new(&World::from_yaml(text, "test").unwrap())
    }

    #[test]
    fn a_lamp_switches_and_casts_its_colour() {
        let mut lighting = lighting();
        assert!(lighting.at(1.0, 2.0)[0] < 0.11);
        lighting.advance_to(12.0);
        let [red, green, blue] = lighting.at(1.0, 2.0);
        assert!(
            red > 1.0 && (0.5..0.7).contains(&green) && blue < 0.11,
            "{red} {green} {blue}"
        );
        lighting.advance_to(15.0);
        assert!(lighting.at(1.0, 2.0)[0] < 0.11);
    }

    #[test]
    fn light_fades_with_distance_and_is_blocked_by_walls() {
        let mut lighting = lighting();
        lighting.advance_to(12.0);
        assert!(lighting.at(1.0, 2.0)[0] > lighting.at(2.5, 3.5)[0] + 0.1);
        assert!(
            lighting.at(4.0, 2.0)[0] < 0.2,
            "{:?}",
            lighting.at(4.0, 2.0)
        );
    }
}
