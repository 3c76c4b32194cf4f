//! Validates a world as a whole: too many things, things outside the room, a start inside
//! something.

use super::World;
use super::fixtures::{MAX_TEXT, qr_code};
use super::objects::Spot;
use crate::document::Step::{self, Index, Key};
use crate::geometry::{Point, Pose, RADIUS};

/// Maximum number of things of one kind, and of corners of one line or path; each takes time in
/// every frame.
pub(super) const MAX_OBJECTS: usize = 200;
/// Maximum number of lamps; each has its own light map.
pub(super) const MAX_LAMPS: usize = 16;

/// The path of a value, and what was found, what was expected, what to do.
type Mistake = (Vec<Step>, String);

fn mistake(path: &[Step], message: impl Into<String>) -> Result<(), Mistake> {
    Err((path.to_vec(), message.into()))
}

pub(super) fn check(world: &World) -> Result<(), Mistake> {
    check_counts(world)?;
    check_corners(world)?;
    check_signs(world)?;
    check_lens(world)?;
    check_heights(world)?;
    check_places(world)?;
    check_start(world)
}

fn check_counts(world: &World) -> Result<(), Mistake> {
    let counts = [
        ("walls", world.walls.len()),
        ("furniture", world.furniture.len()),
        ("rugs", world.rugs.len()),
        ("sills", world.sills.len()),
        ("balls", world.balls.len()),
        ("posts", world.posts.len()),
        ("lines", world.lines.len()),
        ("walkers", world.walkers.len()),
        ("signs", world.signs.len()),
        ("sounds", world.sounds.len()),
        ("lamps", world.lamps.len()),
    ];
    for (list, count) in counts {
        let most = match list {
            "lamps" => MAX_LAMPS,
            _ => MAX_OBJECTS,
        };
        if count > most {
            let message = format!("{count} {list} are too many: at most {most}");
            return mistake(&[Key(list)], message);
        }
    }
    Ok(())
}

/// Checks the number of corners: lines need two, paths one.
fn check_corners(world: &World) -> Result<(), Mistake> {
    let lines = world.lines.iter().enumerate();
    let lines = lines.map(|(i, line)| ("lines", i, "through", line.through.len(), 2));
    let routes = world.routes();
    let routes = routes.map(|(list, i, route)| (list, i, "path", route.through.len(), 1));
    for (list, index, key, count, least) in lines.chain(routes) {
        if !(least..=MAX_OBJECTS).contains(&count) {
            let path = [Key(list), Index(index), Key(key)];
            let message = format!("{count} corners; expected {least} to {MAX_OBJECTS}");
            return mistake(&path, message);
        }
    }
    Ok(())
}

fn check_signs(world: &World) -> Result<(), Mistake> {
    let mut signs = world.signs.iter().enumerate();
    let Some((index, sign)) = signs.find(|(_, sign)| qr_code(&sign.text).is_none()) else {
        return Ok(());
    };
    let long = sign.text.len();
    let message = format!("{long} bytes are too many for a sign: at most {MAX_TEXT}");
    let path = [Key("signs"), Index(index), Key("text")];
    mistake(&path, message)
}

/// Checks that the lens does not fold the image: it would show two directions at one place.
fn check_lens(world: &World) -> Result<(), Mistake> {
    if !world.camera.folds() {
        return Ok(());
    }
    let message = format!(
        "{:?} folds the image: use values nearer to 0 or a narrower view",
        world.camera.calibrated().distortion
    );
    let path = [Key("camera"), Key("distortion")];
    mistake(&path, message)
}

/// Checks that all things are higher than the camera: no top surfaces are drawn.
fn check_heights(world: &World) -> Result<(), Mistake> {
    let furniture = world.furniture.iter().map(|item| item.height);
    let posts = world.posts.iter().map(|post| post.height);
    let people = world.walkers.iter().map(|walker| walker.height);
    let lowest = furniture
        .chain(posts)
        .chain(people)
        .fold(f64::INFINITY, f64::min);
    if world.camera.height < lowest {
        return Ok(());
    }
    let message = format!(
        "{} m is not below the top of the lowest thing, {lowest} m: use a lower camera or higher things",
        world.camera.height
    );
    let path = [Key("camera"), Key("height")];
    mistake(&path, message)
}

fn check_places(world: &World) -> Result<(), Mistake> {
    let mut spots = spots(world).into_iter();
    let Some((path, point)) = spots.find(|(_, point)| !world.room.holds(*point)) else {
        return Ok(());
    };
    let message = format!(
        "[{}, {}] is outside the room, which goes from [0, 0] to [{}, {}]: move it inside",
        point.x, point.y, world.room.width, world.room.depth
    );
    Err((path, message))
}

/// Returns the place that a key of each thing in a list gives, with its path in the document.
fn placed<T>(
    list: &'static str,
    key: &'static str,
    things: &[T],
    place: impl Fn(&T) -> Spot,
) -> impl Iterator<Item = (Vec<Step>, Point)> {
    let places = things.iter().map(move |thing| place(thing).point());
    let paths = (0..).map(move |index| vec![Key(list), Index(index), Key(key)]);
    paths.zip(places)
}

/// Returns every place that must be in the room, with its path in the document.
fn spots(world: &World) -> Vec<(Vec<Step>, Point)> {
    let mut spots: Vec<(Vec<Step>, Point)> =
        placed("furniture", "at", &world.furniture, |item| item.at)
            .chain(placed("rugs", "at", &world.rugs, |rug| rug.at))
            .chain(placed("balls", "at", &world.balls, |ball| ball.at))
            .chain(placed("posts", "at", &world.posts, |post| post.at))
            .chain(placed("walkers", "at", &world.walkers, |who| who.at))
            .chain(placed("lamps", "at", &world.lamps, |lamp| lamp.at))
            .chain(placed("signs", "at", &world.signs, |sign| sign.at))
            .chain(placed("sounds", "at", &world.sounds, |noise| noise.at))
            .chain(placed("walls", "from", &world.walls, |wall| wall.from))
            .chain(placed("walls", "to", &world.walls, |wall| wall.to))
            .chain(placed("sills", "from", &world.sills, |sill| sill.from))
            .chain(placed("sills", "to", &world.sills, |sill| sill.to))
            .collect();
    let mut add = |path: &[Step], spot: Spot| spots.push((path.to_vec(), spot.point()));
    add(&[Key("station"), Key("at")], world.station.at);
    if let Some(wifi) = world.wifi {
        add(&[Key("wifi"), Key("at")], wifi.at);
    }
    if let Some(start) = world.start {
        add(&[Key("start"), Key("at")], start.at);
    }
    for (index, line) in world.lines.iter().enumerate() {
        let path = [Key("lines"), Index(index), Key("through")];
        for (corner, spot) in line.through.iter().enumerate() {
            add(&[&path[..], &[Index(corner)]].concat(), *spot);
        }
    }
    for (kind, index, route) in world.routes() {
        let path = [Key(kind), Index(index), Key("path"), Key("through")];
        for (corner, spot) in route.through.iter().enumerate() {
            add(&[&path[..], &[Index(corner)]].concat(), *spot);
        }
    }
    spots
}

/// Checks that the lane in front of the station and the robot's start are free.
fn check_start(world: &World) -> Result<(), Mistake> {
    let obstacles = world.obstacles();
    let free = |pose: Pose| {
        let clear = obstacles.clearance(pose.point()) >= RADIUS - 1e-6;
        clear && !world.solid(pose.point())
    };
    if !free(world.station.dock_pose()) || !free(world.station.staging_pose()) {
        return mistake(
            &[Key("station"), Key("at")],
            "something blocks the station: keep a lane of 0.4 m width and 1 m length free, in the \
             direction of its heading_degrees",
        );
    }
    if free(world.start_pose()) {
        return Ok(());
    }
    mistake(
        &[Key("start"), Key("at")],
        "the robot would start inside something: move `start` at least 0.15 m away from walls and \
         things",
    )
}
