//! Generates flats from a seed, so that no rule is tuned to a room that somebody drew: two to five
//! rooms, often along a corridor, with doorways, furniture, rugs, posts, balls and people; floors,
//! walls, light, camera and tracks differ too. The same seed gives the same flat.

pub mod station_distances;

use std::collections::BTreeMap;

use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use spykee::sim::{Point, World};

use self::station_distances::StationDistances;

/// Least free width between two things, metres: the robot is 0.3 m wide.
const GAP: f64 = 0.5;
/// Most drafts until one is a good flat.
const MAX_DRAFTS: usize = 50;

/// A flat.
pub struct Flat {
    pub yaml: String,
    pub world: World,
    /// A place in each room from which there is a way to the station.
    pub places: Vec<Point>,
}

/// Generates the flat of a seed. The robot can start there, and gets to its station and into every
/// room.
pub fn flat(seed: u64) -> Flat {
    let mut random = StdRng::seed_from_u64(seed);
    let flat = (0..MAX_DRAFTS).find_map(|_| Draft::draw(&mut random).finish(seed, &mut random));
    flat.unwrap_or_else(|| panic!("no flat with seed {seed}"))
}

/// A rectangle along the axes.
#[derive(Debug, Clone, Copy)]
struct Area {
    x: (f64, f64),
    y: (f64, f64),
}

impl Area {
    fn around(x: f64, y: f64, width: f64, depth: f64) -> Area {
        Area {
            x: (x - width / 2.0, x + width / 2.0),
            y: (y - depth / 2.0, y + depth / 2.0),
        }
    }

    /// Whether there is less than `gap` metres between two rectangles.
    fn is_near(&self, other: &Area, gap: f64) -> bool {
        let apart = |one: (f64, f64), other: (f64, f64)| (other.0 - one.1).max(one.0 - other.1);
        apart(self.x, other.x).max(apart(self.y, other.y)) < gap
    }

    /// A random place at least `margin` metres from the sides.
    fn place(&self, margin: f64, random: &mut StdRng) -> (f64, f64) {
        (
            random.random_range(self.x.0 + margin..self.x.1 - margin),
            random.random_range(self.y.0 + margin..self.y.1 - margin),
        )
    }
}

/// A flat that is being drawn.
#[derive(Default)]
struct Draft {
    width: f64,
    depth: f64,
    rooms: Vec<Area>,
    corridor: Option<Area>,
    /// Where nothing may stand: doorways and the lane in front of the station.
    clear: Vec<Area>,
    /// Where something stands.
    taken: Vec<Area>,
    station: String,
    /// The lists of the document.
    lists: BTreeMap<&'static str, Vec<String>>,
}

impl Draft {
    fn draw(random: &mut StdRng) -> Draft {
        let mut draft = Draft::default();
        let count = random.random_range(2..=5);
        if count > 2 || random.random_bool(0.5) {
            draft.add_rooms_along_a_corridor(count, random);
        } else {
            draft.add_two_rooms(random);
        }
        draft.add_station(random);
        for room in draft.rooms.clone() {
            draft.furnish(&room, random);
        }
        if random.random_bool(0.3) {
            draft.add_person(random);
        }
        draft
    }

    /// A row of rooms below the corridor and one above it.
    fn add_rooms_along_a_corridor(&mut self, count: usize, random: &mut StdRng) {
        let lower_count = count.div_ceil(2);
        let low = random.random_range(2.5..4.2);
        let high = low + random.random_range(1.1..1.7);
        self.depth = high + random.random_range(2.5..4.2);
        self.width = lower_count as f64 * random.random_range(2.6..3.8);
        self.corridor = Some(Area {
            x: (0.0, self.width),
            y: (low, high),
        });
        self.add_row(lower_count, (0.0, low), random);
        self.add_row(count - lower_count, (high, self.depth), random);
        for room in self.rooms.clone() {
            let y = if room.y.0 == 0.0 { low } else { high };
            let width = random.random_range(0.8..1.05);
            let middle = random.random_range(room.x.0 + 0.9..room.x.1 - 0.9);
            self.clear.push(Area::around(middle, y, width + 0.3, 1.4));
            self.add_wall((room.x.0, y), (middle - width / 2.0, y));
            self.add_wall((middle + width / 2.0, y), (room.x.1, y));
        }
    }

    /// Rooms side by side, with walls between them.
    fn add_row(&mut self, count: usize, y: (f64, f64), random: &mut StdRng) {
        let mut left = 0.0;
        for number in 1..=count {
            let mut right = self.width * number as f64 / count as f64;
            if number < count {
                right += random.random_range(-0.3..0.3);
                self.add_wall((right, y.0), (right, y.1));
            }
            let x = (left, right);
            self.rooms.push(Area { x, y });
            left = right;
        }
    }

    /// Two rooms with a doorway between them.
    fn add_two_rooms(&mut self, random: &mut StdRng) {
        self.depth = random.random_range(2.6..4.5);
        self.width = random.random_range(5.2..8.0);
        let x = self.width / 2.0 + random.random_range(-0.4..0.4);
        for x in [(0.0, x), (x, self.width)] {
            let y = (0.0, self.depth);
            self.rooms.push(Area { x, y });
        }
        let width = random.random_range(0.8..1.3);
        let middle = random.random_range(0.9..self.depth - 0.9);
        self.clear.push(Area::around(x, middle, 1.4, width + 0.3));
        self.add_wall((x, 0.0), (x, middle - width / 2.0));
        self.add_wall((x, middle + width / 2.0), (x, self.depth));
    }

    fn add(&mut self, list: &'static str, entry: String) {
        self.lists.entry(list).or_default().push(entry);
    }

    fn add_wall(&mut self, (x, y): (f64, f64), (to_x, to_y): (f64, f64)) {
        let ends = format!("from: [{x:.3}, {y:.3}], to: [{to_x:.3}, {to_y:.3}]");
        self.add("walls", ends);
    }

    /// Puts the station at the outer wall of a room.
    fn add_station(&mut self, random: &mut StdRng) {
        let room = self.rooms[random.random_range(0..self.rooms.len())];
        let x = random.random_range(room.x.0 + 0.6..room.x.1 - 0.6);
        let (y, ahead, degrees) = if room.y.0 == 0.0 {
            (0.0, 0.7, 90)
        } else {
            (self.depth, -0.7, 270)
        };
        self.clear.push(Area::around(x, y + ahead, 0.9, 1.4));
        self.station = format!("at: [{x:.3}, {y:.3}], heading_degrees: {degrees}");
    }

    fn furnish(&mut self, room: &Area, random: &mut StdRng) {
        for _ in 0..random.random_range(2..=8) {
            self.try_furniture(room, random);
        }
        for (list, chance) in [("posts", 0.4), ("balls", 0.3)] {
            let (x, y) = room.place(0.3, random);
            let colours = ["red", "green", "blue", "yellow", "orange"];
            let colour = colours[random.random_range(0..colours.len())];
            let area = Area::around(x, y, 0.2, 0.2);
            if random.random_bool(chance) && self.is_free(&area) {
                self.taken.push(area);
                self.add(list, format!("at: [{x:.2}, {y:.2}], colour: {colour}"));
            }
        }
        let (x, y) = room.place(0.8, random);
        if random.random_bool(0.4) {
            let side = random.random_range(0.7..1.5);
            let colour = pale(random);
            let rug = format!("at: [{x:.2}, {y:.2}], width: {side:.2}, depth: 1, colour: {colour}");
            self.add("rugs", rug);
        }
        if random.random_bool(0.4) {
            let brightness = random.random_range(0.3..0.9);
            self.add(
                "lamps",
                format!("at: [{x:.2}, {y:.2}], brightness: {brightness:.2}"),
            );
        }
    }

    /// A piece of furniture, usually along a wall, sometimes turned in the middle of the room.
    fn try_furniture(&mut self, room: &Area, random: &mut StdRng) {
        let length = random.random_range(0.4..1.9);
        let width = random.random_range(0.3..0.8);
        let wall = random.random_range(0..5);
        let (across, down) = match wall {
            0 | 1 => (width, length),
            2 | 3 => (length, width),
            _ => (f64::hypot(length, width), f64::hypot(length, width)),
        };
        let least = (room.x.0 + across / 2.0 + 0.06, room.y.0 + down / 2.0 + 0.06);
        let most = (room.x.1 - across / 2.0 - 0.06, room.y.1 - down / 2.0 - 0.06);
        if least.0 >= most.0 || least.1 >= most.1 {
            return;
        }
        let mut x = random.random_range(least.0..most.0);
        let mut y = random.random_range(least.1..most.1);
        let mut degrees = 0;
        match wall {
            0 => (x, degrees) = (least.0, 90),
            1 => (x, degrees) = (most.0, 90),
            2 => y = least.1,
            3 => y = most.1,
            _ => degrees = random.random_range(0..180),
        }
        let area = Area::around(x, y, across, down);
        if self.is_free(&area) {
            self.taken.push(area);
            let height = random.random_range(0.3..1.9);
            let colour = pale(random);
            self.add(
                "furniture",
                format!(
                    "at: [{x:.2}, {y:.2}], length: {length:.2}, width: {width:.2}, \
                     height: {height:.2}, heading_degrees: {degrees}, colour: {colour}"
                ),
            );
        }
    }

    fn is_free(&self, area: &Area) -> bool {
        let is_clear = self.clear.iter().all(|clear| !clear.is_near(area, 0.0));
        is_clear && self.taken.iter().all(|taken| !taken.is_near(area, GAP))
    }

    /// Somebody who walks up and down in the corridor, or in the first room.
    fn add_person(&mut self, random: &mut StdRng) {
        let area = self.corridor.unwrap_or(self.rooms[0]);
        let (x, y) = area.place(0.4, random);
        let (to_x, to_y) = area.place(0.4, random);
        let speed = random.random_range(0.3..0.9);
        self.add(
            "walkers",
            format!(
                "at: [{x:.2}, {y:.2}], path: {{ through: [[{x:.2}, {y:.2}], [{to_x:.2}, \
                 {to_y:.2}]], speed: {speed:.1}, pause: 4 }}"
            ),
        );
    }

    /// The flat, with a start; `None` if the robot could not get around in it.
    fn finish(self, seed: u64, random: &mut StdRng) -> Option<Flat> {
        let document = self.document(seed, random);
        let world = World::from_yaml(&document, "flat").ok()?;
        let distances = StationDistances::new(&world);
        let reached = |place: &Point| distances.length(*place).is_some();
        let mut place_in = |room: &Area| {
            let mut places = (0..20).map(|_| room.place(0.3, random));
            places.find_map(|(x, y)| Some(Point::new(x, y)).filter(reached))
        };
        let places: Option<Vec<Point>> = self.rooms.iter().map(&mut place_in).collect();
        let places = places?;
        let start = places[random.random_range(0..places.len())];
        let degrees = random.random_range(0..360);
        let yaml = format!(
            "{document}start: {{ at: [{:.3}, {:.3}], heading_degrees: {degrees} }}\n",
            start.x, start.y
        );
        let world = World::from_yaml(&yaml, "flat").ok()?;
        Some(Flat {
            yaml,
            world,
            places,
        })
    }

    /// The YAML of the world without a start: walls that are plain or, where they are high, with
    /// doors, windows and pictures; a floor; light; the camera and the tracks.
    fn document(&self, seed: u64, random: &mut StdRng) -> String {
        let floors = ["wood", "tiles", "concrete"];
        let floor = floors[random.random_range(0..floors.len())];
        let height = if random.random_bool(0.4) { 1.5 } else { 2.4 };
        let walls = pale(random);
        let mut text = format!(
            "name: flat {seed}\nroom: {{ width: {:.3}, depth: {:.3}, height: {height}, floor: \
             {floor}, walls: {walls} }}\nstation: {{ {} }}\n",
            self.width, self.depth, self.station
        );
        for (list, entries) in &self.lists {
            text += &format!("{list}:\n");
            for entry in entries {
                text += &format!("  - {{ {entry} }}\n");
            }
        }
        let light = random.random_range(0.25..1.0);
        let noise = random.random_range(0.1..0.4);
        let latency = random.random_range(0.0..0.25);
        let fps = random.random_range(8..=15);
        let unequal = random.random_range(0.0..0.03);
        let slip = random.random_range(0.0..0.05);
        text + &format!(
            "light: {light:.2}\ncamera: {{ noise: {noise:.2}, latency: {latency:.2}, fps: {fps}, \
             exposure: 0.5 }}\ntracks: {{ unequal: {unequal:.3}, slip: {slip:.3} }}\n"
        )
    }
}

/// A colour of walls and furniture.
fn pale(random: &mut StdRng) -> String {
    let grey: i32 = random.random_range(100..215);
    let [red, green, blue] = [0; 3].map(|_: i32| grey + random.random_range(-12..=12));
    format!("\"#{red:02x}{green:02x}{blue:02x}\"")
}
