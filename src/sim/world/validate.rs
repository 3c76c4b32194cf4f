//! Validates a world as a whole: too many things, things outside the room, a start inside
//! something.

use super::World;
use super::fixtures::{Code, MAX_TEXT};
use super::objects::Spot;
use crate::sim::geometry::{Point, Pose, RADIUS};
use crate::sim::yaml::Step;

/// Maximum number of things of one kind, and of corners of one line or path; each takes time in
/// every frame.
pub(super) const MAX_OBJECTS: usize = 200;
/// Maximum number of lamps; each has its own light map.
pub(super) const MAX_LAMPS: usize = 16;

/// An error in a world.
pub(super) struct ValidationError {
    /// Its place in the document.
    pub(super) path: Vec<Step>,
    /// What was found, what was expected, what to do.
    pub(super) message: String,
}

/// Returns the first error that cannot be detected in a single value.
pub(super) fn check(world: &World) -> Result<(), ValidationError> {
    check_counts(world)?;
    check_corners(world)?;
    check_signs(world)?;
    check_lens(world)?;
    check_places(world)?;
    check_start(world)
}

fn check_counts(world: &World) -> Result<(), ValidationError> {
    let counts = [
        ("walls", world.walls.len()),
        ("furniture", world.furniture.len()),
        ("rugs", world.rugs.len()),
        ("balls", world.balls.len()),
        ("posts", world.posts.len()),
        ("lines", world.lines.len()),
        ("walkers", world.walkers.len()),
        ("signs", world.signs.len()),
        ("sounds", world.sounds.len()),
        ("lamps", world.lamps.len()),
    ];
    for (list, count) in counts {
        let most = if list == "lamps" {
            MAX_LAMPS
        } else {
            MAX_OBJECTS
        };
        if count > most {
            return Err(ValidationError {
                path: vec![Step::Key(list)],
                message: format!("{count} {list} are too many: at most {most}"),
            });
        }
    }
    Ok(())
}

/// Checks the number of corners: lines need two, paths one.
fn check_corners(world: &World) -> Result<(), ValidationError> {
    let lines = world.lines.iter().enumerate();
    let lines = lines.map(|(i, line)| ("lines", i, "through", line.through.len(), 2));
    let routes = world.routes();
    let routes = routes.map(|(list, i, route)| (list, i, "path", route.through.len(), 1));
    for (list, index, key, count, least) in lines.chain(routes) {
        if !(least..=MAX_OBJECTS).contains(&count) {
            return Err(ValidationError {
                path: vec![Step::Key(list), Step::Index(index), Step::Key(key)],
                message: format!("{count} corners; expected {least} to {MAX_OBJECTS}"),
            });
        }
    }
    Ok(())
}

fn check_signs(world: &World) -> Result<(), ValidationError> {
    let mut signs = world.signs.iter().enumerate();
    let Some((index, sign)) = signs.find(|(_, sign)| Code::new(&sign.text).is_none()) else {
        return Ok(());
    };
    let long = sign.text.len();
    Err(ValidationError {
        path: vec![Step::Key("signs"), Step::Index(index), Step::Key("text")],
        message: format!("{long} bytes are too many for a sign: at most {MAX_TEXT}"),
    })
}

/// Checks that the lens does not fold the image: it would show two directions at one place.
fn check_lens(world: &World) -> Result<(), ValidationError> {
    if !world.camera.folds() {
        return Ok(());
    }
    let [k1, k2] = world.camera.distortion();
    Err(ValidationError {
        path: vec![Step::Key("camera"), Step::Key("distortion")],
        message: format!("[{k1}, {k2}] folds the image: use values nearer to 0 or a narrower view"),
    })
}

/// Checks that everything is in the room.
fn check_places(world: &World) -> Result<(), ValidationError> {
    let mut spots = spots(world).into_iter();
    let Some((path, point)) = spots.find(|(_, point)| !world.room.holds(*point)) else {
        return Ok(());
    };
    let message = format!(
        "[{}, {}] is outside the room, which goes from [0, 0] to [{}, {}]: move it inside",
        point.x, point.y, world.room.width, world.room.depth
    );
    Err(ValidationError { path, message })
}

/// Returns every place that must be in the room, with its path in the document.
fn spots(world: &World) -> Vec<(Vec<Step>, Point)> {
    let mut spots = vec![(
        vec![Step::Key("station"), Step::Key("at")],
        world.station.at.point(),
    )];
    spots.extend(
        world
            .start
            .map(|s| (vec![Step::Key("start"), Step::Key("at")], s.at.point())),
    );
    let mut add = |kind, index, key, spot: Spot| {
        spots.push((
            vec![Step::Key(kind), Step::Index(index), Step::Key(key)],
            spot.point(),
        ));
    };
    for (index, wall) in world.walls.iter().enumerate() {
        add("walls", index, "from", wall.from);
        add("walls", index, "to", wall.to);
    }
    let lists: [(&'static str, Vec<Spot>); 8] = [
        (
            "furniture",
            world.furniture.iter().map(|item| item.at).collect(),
        ),
        ("rugs", world.rugs.iter().map(|rug| rug.at).collect()),
        ("balls", world.balls.iter().map(|ball| ball.at).collect()),
        ("posts", world.posts.iter().map(|post| post.at).collect()),
        (
            "walkers",
            world.walkers.iter().map(|walker| walker.at).collect(),
        ),
        ("lamps", world.lamps.iter().map(|lamp| lamp.at).collect()),
        ("signs", world.signs.iter().map(|sign| sign.at).collect()),
        (
            "sounds",
            world.sounds.iter().map(|sound| sound.at).collect(),
        ),
    ];
    for (kind, places) in lists {
        let places = places.into_iter().enumerate();
        places.for_each(|(index, spot)| add(kind, index, "at", spot));
    }
    for (index, line) in world.lines.iter().enumerate() {
        for (corner, spot) in line.through.iter().enumerate() {
            let [kind, key] = [Step::Key("lines"), Step::Key("through")];
            spots.push((
                vec![kind, Step::Index(index), key, Step::Index(corner)],
                spot.point(),
            ));
        }
    }
    for (kind, index, route) in world.routes() {
        for (corner, spot) in route.through.iter().enumerate() {
            let [path, through] = [Step::Key("path"), Step::Key("through")];
            let steps = [
                Step::Key(kind),
                Step::Index(index),
                path,
                through,
                Step::Index(corner),
            ];
            spots.push((steps.to_vec(), spot.point()));
        }
    }
    spots
}

/// Checks that the lane in front of the station and the robot's start are free.
fn check_start(world: &World) -> Result<(), ValidationError> {
    let obstacles = world.obstacles();
    let free = |pose: Pose| {
        let clear = obstacles.clearance(pose.point()) >= RADIUS - 1e-6;
        clear && !world.solid(pose.point())
    };
    if !free(world.station.dock_pose()) || !free(world.station.staging_pose()) {
        return Err(ValidationError {
            path: vec![Step::Key("station"), Step::Key("at")],
            message: "something blocks the station: keep a lane of 0.4 m width and 1 m \
                      length free, in the direction of its heading_degrees"
                .into(),
        });
    }
    if free(world.start_pose()) {
        return Ok(());
    }
    Err(ValidationError {
        path: vec![Step::Key("start"), Step::Key("at")],
        message: "the robot would start inside something: move `start` at least 0.15 m away from \
                  walls and things"
            .into(),
    })
}
