//! Shortest paths to the station over the free floor, on a grid; not available to the robot.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use spykee::sim::{Obstacles, Point, RADIUS, World};

/// Distance between two neighbours on the grid, metres.
const GRID: f64 = 0.05;
/// Lengths of a straight and of a diagonal step to a neighbour, in tenths of a millimetre.
const STRAIGHT: u32 = 500;
const ACROSS: u32 = 707;
/// For a place off the grid, the best of its neighbours up to this many steps to each side counts.
const AROUND: i64 = 2;

/// The shortest paths to the station from everywhere in a world. Balls and people do not count as
/// obstacles, because they move or can be pushed aside.
#[derive(Debug, Clone)]
pub struct StationDistances {
    obstacles: Obstacles,
    columns: i64,
    rows: i64,
    /// Path lengths, row by row, in tenths of a millimetre.
    lengths: Vec<Option<u32>>,
}

impl StationDistances {
    /// Computes all paths of a world.
    pub fn new(world: &World) -> StationDistances {
        let count = |side: f64| (side / GRID) as i64 + 1;
        let mut distances = StationDistances {
            obstacles: world.fixed_obstacles(),
            columns: count(world.room.width),
            rows: count(world.room.depth),
            lengths: Vec::new(),
        };
        distances.lengths = vec![None; (distances.columns * distances.rows) as usize];
        distances.compute(world);
        distances
    }

    /// Returns the length in metres of the path from a place to the charging contacts, at most 8 %
    /// more than the shortest one; `None` if there is no path, for example from inside a closed
    /// ring of furniture.
    pub fn length(&self, from: Point) -> Option<f64> {
        let near = self.around(from).filter_map(|(column, row)| {
            let place = place(column, row);
            let further = metres(self.lengths[self.index(column, row)?]?);
            let free = self.obstacles.is_path_free(from, place, RADIUS);
            if free {
                Some(from.distance(place) + further)
            } else {
                None
            }
        });
        near.min_by(f64::total_cmp)
    }

    /// Whether a robot at this place touches no wall, piece of furniture, post or the station. Only
    /// the sides of things count, so a place inside a wide piece of furniture may have room.
    pub fn has_room(&self, place: Point) -> bool {
        self.obstacles.clearance(place) >= RADIUS
    }

    /// Returns all grid places with a path to the station, with its length in metres.
    pub fn places(&self) -> impl Iterator<Item = (Point, f64)> {
        let columns = self.columns;
        let all = self.lengths.iter().zip(0_i64..);
        all.filter_map(move |(length, at)| {
            let place = place(at % columns, at / columns);
            Some((place, metres((*length)?)))
        })
    }

    /// Computes all lengths with Dijkstra's algorithm, starting at the staging pose.
    fn compute(&mut self, world: &World) {
        let staging = world.station.staging_pose();
        let dock = world.station.dock_pose();
        let straight_on = staging.point().distance(dock.point());
        let mut open = BinaryHeap::new();
        for (column, row) in self.around(staging.point()) {
            let place = place(column, row);
            let length = straight_on + staging.point().distance(place);
            if self.has_room(place) {
                open.push(Reverse(((length * 1e4) as u32, column, row)));
            }
        }
        while let Some(Reverse((length, column, row))) = open.pop() {
            let Some(index) = self.index(column, row) else {
                continue;
            };
            if self.lengths[index].is_some() || !self.has_room(place(column, row)) {
                continue;
            }
            self.lengths[index] = Some(length);
            for (right, up) in square(1).filter(|step| *step != (0, 0)) {
                let across = right != 0 && up != 0;
                let step = if across { ACROSS } else { STRAIGHT };
                open.push(Reverse((length + step, column + right, row + up)));
            }
        }
    }

    fn around(&self, place: Point) -> impl Iterator<Item = (i64, i64)> + use<> {
        let nearest = |at: f64| (at / GRID).round() as i64;
        let column = nearest(place.x);
        let row = nearest(place.y);
        square(AROUND).map(move |(right, up)| (column + right, row + up))
    }

    fn index(&self, column: i64, row: i64) -> Option<usize> {
        let inside = (0..self.columns).contains(&column) && (0..self.rows).contains(&row);
        if !inside {
            return None;
        }
        Some((row * self.columns + column) as usize)
    }
}

fn place(column: i64, row: i64) -> Point {
    Point::new(column as f64 * GRID, row as f64 * GRID)
}

fn metres(length: u32) -> f64 {
    f64::from(length) / 1e4
}

/// Returns all offsets of up to `most` to each side.
fn square(most: i64) -> impl Iterator<Item = (i64, i64)> {
    (-most..=most).flat_map(move |right| (-most..=most).map(move |up| (right, up)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn distances(things: &str) -> StationDistances {
        let text = format!(
            "room: {{width: 6, depth: 4}}\nstation: {{at: [0, 2], heading_degrees: 0}}\n{things}\n"
        );
        StationDistances::new(&World::from_yaml(&text, "test").unwrap())
    }

    #[test]
    fn a_straight_path_has_the_right_length() {
        let length = distances("").length(Point::new(4.0, 2.0)).unwrap();
        assert!((length - 3.745).abs() < 0.05, "{length}");
    }

    #[test]
    fn a_path_leads_around_walls_and_through_balls() {
        let wall = "walls: [{from: [3, 0], to: [3, 3]}]";
        let round = distances(wall).length(Point::new(4.0, 1.0)).unwrap();
        assert!((5.2..6.0).contains(&round), "{round}");
        let balls = "balls: [{at: [2, 2], colour: red}, {at: [3, 2], colour: red}]";
        let straight = distances(balls).length(Point::new(4.0, 2.0)).unwrap();
        assert!(straight < 3.8, "{straight}");
    }

    #[test]
    fn there_is_no_path_through_a_gap_too_narrow_for_the_robot() {
        let gap = |to: f64| format!("walls: [{{from: [3, 0], to: [3, {to}]}}]");
        assert_eq!(distances(&gap(3.75)).length(Point::new(4.0, 1.0)), None);
        assert!(distances(&gap(3.5)).length(Point::new(4.0, 1.0)).is_some());
    }

    #[test]
    fn a_robot_that_touches_a_wall_can_leave_it() {
        assert!(
            distances("")
                .length(Point::new(6.0 - RADIUS, 1.234))
                .is_some()
        );
        assert!(
            distances("")
                .length(Point::new(6.0 - RADIUS + 1e-4, 1.234))
                .is_some()
        );
    }

    #[test]
    fn every_place_with_a_path_is_free_floor() {
        let distances =
            distances("furniture: [{at: [3, 1], length: 1, width: 1, height: 1, colour: red}]");
        let inside = |place: Point| (place.x - 3.0).abs() < 0.6 && (place.y - 1.0).abs() < 0.6;
        assert!(distances.places().count() > 5000);
        assert!(distances.places().all(|(place, _)| !inside(place)));
    }
}
