//! Measures where the camera is from one picture of sheets of paper on the floor: the lens and the
//! size of the paper are known, so the four sides of a sheet determine height, pitch and roll.

use image::imageops::interpolate_bilinear;
use image::{GrayImage, Luma};
use imageproc::contours::{BorderType, Contour, find_contours_with_threshold};
use imageproc::geometry::{contour_area, convex_hull};
use imageproc::point::Point as ContourPoint;
use nalgebra::{Matrix2, Matrix3, SMatrix, SVector, Vector2, Vector3};
use thiserror::Error;

use super::camera::{Camera, Direction, FloorPosition};
use super::picture::{Image, Size};

/// Levels, of 255, from which on a pixel may be paper: paper has no colour, so its smallest channel
/// counts.
const THRESHOLDS: std::ops::RangeInclusive<u8> = 70..=245;
const THRESHOLD_STEP: usize = 7;
/// Share of the picture that a sheet covers.
const AREA: std::ops::RangeInclusive<f64> = 0.0012..=0.5;
/// Least share of a bright outline that four sides enclose.
const FOUR_SIDED: f64 = 0.88;
/// A hole less than this many times larger than what lies in it is print on a larger sheet.
const PRINTED: f64 = 2.0;
/// How far on both sides of a side its edge is looked for, pixels: first from the corners of a bright
/// area, which blur rounds by up to 7 pixels, and then from where the sides meet.
const REACH: f64 = 5.0;
const NEAR_REACH: f64 = 3.0;
/// Points along a side at most, and how far from the corners they stay, pixels.
const POINTS: f64 = 60.0;
const CORNER: f64 = 2.5;
/// Least step of the brightness at an edge.
const CONTRAST: f64 = 15.0;
const LEAST_POINTS: usize = 5;
/// A side is straight if this share of its points is within so many pixels of a straight line.
const STRAIGHT: f64 = 0.6;
const STRAIGHT_SHARE: f64 = 0.6;
/// What the lens's numbers and the picture's compression add to the error of a side, pixels.
const SIDE_ERROR: f64 = 0.3;
/// Overexposed paper spreads over its edges by about this, pixels.
const SPREAD: f64 = 0.4;
/// Standard error of a sheet's length and width, metres: ISO 216 allows them to be 2 mm off.
const SIZE_ERROR: f64 = 0.001;
/// Corners within this many pixels are those of the same sheet.
const SAME: f64 = 6.0;
/// The sum of the squared errors, in standard errors, above which something is no such sheet.
const MAX_SQUARES: f64 = 12.0;
/// A difference of this sum tells two poses apart.
const TELLING: f64 = 6.0;
/// Sheets agree if their squared differences are at most this many times those expected.
const AGREEING: f64 = 4.0;
/// What a useful measurement leaves open: metres, degrees, degrees.
const USEFUL: [f64; 3] = [0.03, 2.0, 2.0];
/// What a person may round a measurement by: metres, degrees, degrees.
const CAREFUL: [f64; 3] = [0.01, 1.0, 1.0];
/// Paper is brighter than pale tiles: the least share of the brightest sheet's brightness.
const AS_BRIGHT: f64 = 0.85;
/// What is brighter than this share of a sheet's brightness is of its kind.
const ALIKE: f64 = 0.9;
/// Poses of a robot's camera, on genuine robots 0.29 m above the floor; anything else is a sheet that
/// does not lie on the floor, or is no sheet of this size.
const HEIGHTS: std::ops::RangeInclusive<f64> = 0.23..=0.36;
const PITCHES: std::ops::RangeInclusive<f64> = -50.0..=30.0;
const MAX_ROLL: f64 = 25.0;
/// Pitches in radians from which the search starts.
const STARTS: [f64; 6] = [-1.2, -0.7, -0.4, -0.2, -0.05, 0.1];
const MAX_STEPS: usize = 60;

/// A size of paper.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Paper {
    /// 297 x 210 mm.
    A4,
    /// 11 x 8.5 inches.
    Letter,
}

impl Paper {
    /// Its sides in metres, the longer one first.
    pub fn sides(self) -> [f64; 2] {
        match self {
            Paper::A4 => [0.297, 0.210],
            Paper::Letter => [0.2794, 0.2159],
        }
    }
}

/// The camera's pose, as sheets on the floor tell it.
#[derive(Debug, Clone, PartialEq)]
pub struct SheetPose {
    /// The given camera in the pose that was found.
    pub camera: Camera,
    /// Height in metres, pitch and roll in degrees: 95 of 100 times the truth is within.
    pub uncertainty: [f64; 3],
    /// Whether all sheets tell the same pose, within what is expected.
    pub agree: bool,
    /// What it was measured from.
    pub sheets: Vec<Sheet>,
}

/// A sheet in the picture, and the pose that it alone tells.
#[derive(Debug, Clone, PartialEq)]
pub struct Sheet {
    /// The given camera in the pose that was found.
    pub camera: Camera,
    /// Where the middle of the sheet is.
    pub middle: FloorPosition,
    brightness: f64,
    /// The inverse of the covariance of height, pitch and roll.
    information: Matrix3<f64>,
}

/// Why a picture gives no pose; the last reasons know most.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Error)]
pub enum SheetError {
    /// Nothing bright has four straight sides.
    #[error("no whole sheet of white paper is in the picture")]
    NoSheet,
    /// There is something with four sides that is no such sheet, or a bent one.
    #[error("what is white in the picture does not have the shape of a flat sheet of paper")]
    OtherShape,
    /// It is a sheet of this shape in another plane or of another size.
    #[error("the paper does not lie flat on the floor, or has another size")]
    NotFlat,
    /// It is a sheet, but too few pixels large.
    #[error("the sheet of paper is too small in the picture")]
    TooSmall,
}

/// A position in the picture: column and row.
type Point = Vector2<f64>;

/// Finds white sheets of this paper on the floor, and computes the camera's pose from them; the
/// lens is that of `camera`.
pub fn pose_from_sheets(
    image: &Image,
    camera: Camera,
    paper: Paper,
) -> Result<SheetPose, SheetError> {
    let mut error = SheetError::NoSheet;
    let mut sheets: Vec<Sheet> = Vec::new();
    for outline in outlines(image, camera, &mut error) {
        match outline.fit(camera, paper) {
            Ok(sheet) => sheets.push(sheet),
            Err(reason) => error = error.max(reason),
        }
    }
    let brightness = sheets.iter().map(|sheet| sheet.brightness);
    let least = AS_BRIGHT * brightness.fold(0.0, f64::max);
    sheets.retain(|sheet| sheet.brightness >= least);
    SheetPose::new(camera, sheets).ok_or(error)
}

/// Height, pitch and roll.
fn pose(camera: &Camera) -> Vector3<f64> {
    Vector3::new(camera.height, camera.pitch, camera.roll)
}

impl SheetPose {
    /// Whether this camera is where the sheets say, as far as they and a person's care can tell.
    pub fn fits(&self, camera: &Camera) -> bool {
        let off = (pose(camera) - pose(&self.camera)).abs();
        (0..3).all(|index| off[index] <= self.uncertainty[index] + CAREFUL[index])
    }

    /// The mean, weighted by what each sheet knows.
    fn new(camera: Camera, sheets: Vec<Sheet>) -> Option<SheetPose> {
        let information: Matrix3<f64> = sheets.iter().map(|sheet| sheet.information).sum();
        let covariance = information.try_inverse()?;
        let known = sheets
            .iter()
            .map(|sheet| sheet.information * pose(&sheet.camera));
        let mean = covariance * known.sum::<Vector3<f64>>();
        let squares = sheets.iter().map(|sheet| {
            let off = pose(&sheet.camera) - mean;
            off.dot(&(sheet.information * off))
        });
        let expected = 3.0 * (sheets.len() as f64 - 1.0);
        let ratio = squares.sum::<f64>() / expected.max(1.0);
        let factor = 2.0 * ratio.max(1.0).sqrt();
        Some(SheetPose {
            camera: Camera {
                height: mean[0],
                pitch: mean[1],
                roll: mean[2],
                ..camera
            },
            uncertainty: covariance
                .diagonal()
                .map(|square| factor * square.sqrt())
                .into(),
            agree: ratio <= AGREEING,
            sheets,
        })
    }
}

fn cross(a: Point, b: Point, c: Point) -> f64 {
    (b - a).perp(&(c - a))
}

/// A bright area with four straight sides, as a lens without distortion would show it.
#[derive(Debug, Clone)]
struct Outline {
    size: Size,
    /// Where the picture shows the corners, roughly.
    rough: [Point; 4],
    /// Clockwise.
    corners: [Point; 4],
    sides: [Side; 4],
    /// Of the unprinted paper, 0 to 255.
    brightness: f64,
}

/// A straight line through the points of an edge.
#[derive(Debug, Clone, Copy)]
struct Side {
    from: Point,
    to: Point,
    /// Standard error at its ends, pixels.
    error: f64,
}

/// Finds what may be sheets; sets the reason if something is none.
fn outlines(image: &Image, camera: Camera, error: &mut SheetError) -> Vec<Outline> {
    let Size { width, height } = image.size();
    let white = GrayImage::from_fn(width, height, |x, y| {
        let channels = image.pixel(x, y).unwrap_or_default();
        Luma([channels.into_iter().min().unwrap_or(0)])
    });
    let luma = GrayImage::from_fn(width, height, |x, y| Luma([image.luma_row(y)[x as usize]]));
    let mut found: Vec<Outline> = Vec::new();
    for threshold in THRESHOLDS.step_by(THRESHOLD_STEP) {
        let contours = find_contours_with_threshold::<i32>(&white, threshold);
        for contour in &contours {
            let outline = four_corners(contour, &contours, image.size())
                .and_then(|corners| Outline::new(&luma, camera, corners));
            match outline {
                Ok(outline) => match found.iter_mut().find(|known| known.is_same(&outline)) {
                    Some(known) if outline.error() < known.error() => *known = outline,
                    Some(_) => {}
                    None => found.push(outline),
                },
                Err(reason) => *error = (*error).max(reason),
            }
        }
    }
    let mut refined: Vec<Outline> = Vec::new();
    for outline in found {
        match outline.refined(&luma, camera) {
            Ok(outline) if refined.iter().any(|known| known.is_same(&outline)) => {}
            Ok(outline) => refined.push(outline),
            Err(reason) => *error = (*error).max(reason),
        }
    }
    refined
}

/// The corners, clockwise, of a whole bright area if it has four.
fn four_corners(
    contour: &Contour<i32>,
    all: &[Contour<i32>],
    size: Size,
) -> Result<[Point; 4], SheetError> {
    let width = size.width as i32;
    let height = size.height as i32;
    let hull = convex_hull(contour.points.clone());
    let area = contour_area(&hull);
    let share = area / f64::from(width * height);
    let hole = contour.parent.and_then(|parent| all.get(parent));
    if contour.border_type != BorderType::Outer
        || !AREA.contains(&share)
        || hole.is_some_and(|hole| contour_area(&hole.points) < PRINTED * area)
    {
        return Err(SheetError::NoSheet);
    }
    let is_cut =
        |at: &ContourPoint<i32>| at.x == 0 || at.y == 0 || at.x + 1 == width || at.y + 1 == height;
    if hull.iter().any(is_cut) {
        return Err(SheetError::NoSheet);
    }
    let point = |at: &ContourPoint<i32>| Point::new(at.x.into(), at.y.into());
    let hull: Vec<Point> = hull.iter().map(point).collect();
    let mut best = [hull[0]; 4];
    let mut largest = 0.0;
    for first in 0..hull.len() {
        for third in first + 2..hull.len() {
            let aside = |point: &&Point| cross(hull[first], hull[third], **point);
            let beside = |a: &&Point, b: &&Point| aside(a).total_cmp(&aside(b));
            let Some(left) = hull.iter().min_by(beside) else {
                continue;
            };
            let Some(right) = hull.iter().max_by(beside) else {
                continue;
            };
            let enclosed = (aside(&right) - aside(&left)) / 2.0;
            if enclosed > largest {
                largest = enclosed;
                best = [hull[first], *left, hull[third], *right];
            }
        }
    }
    if largest < FOUR_SIDED * area {
        return Err(SheetError::NoSheet);
    }
    Ok(best)
}

impl Outline {
    /// Measures the sides to fractions of a pixel.
    fn new(luma: &GrayImage, camera: Camera, coarse: [Point; 4]) -> Result<Outline, SheetError> {
        let (width, height) = luma.dimensions();
        let size = Size { width, height };
        let middle = coarse.iter().sum::<Point>() / 4.0;
        let inside = coarse.iter().flat_map(|corner| {
            let towards = |share: i32| middle.lerp(corner, f64::from(share) / 20.0);
            (0..18).map(towards)
        });
        let levels = inside.filter_map(|point| {
            let Luma([level]) = interpolate_bilinear(luma, point.x as f32, point.y as f32)?;
            Some(level)
        });
        let brightness = levels.max().unwrap_or(0);
        // Tiles have others of their kind beyond their corners; paper lies alone.
        let is_tile = coarse.iter().any(|corner| {
            let beyond = middle.lerp(corner, 1.25);
            interpolate_bilinear(luma, beyond.x as f32, beyond.y as f32)
                .is_some_and(|Luma([level])| f64::from(level) > ALIKE * f64::from(brightness))
        });
        if is_tile {
            return Err(SheetError::NoSheet);
        }
        let sides = straight_sides(luma, camera, coarse, REACH)?;
        Ok(Outline {
            size,
            rough: coarse,
            corners: corners_of(&sides)?,
            sides,
            brightness: brightness.into(),
        })
    }

    /// Measures the sides again, between where they meet. Between the corners of the bright area,
    /// which blur rounds, each side seems to be a tenth of a pixel too far inside, and the camera
    /// some millimetres too high.
    fn refined(self, luma: &GrayImage, camera: Camera) -> Result<Outline, SheetError> {
        let mut rough = self.rough;
        for reach in [REACH, NEAR_REACH] {
            let sides = sides(&rough, |from, to| edge_points(luma, from, to, reach))?;
            rough = corners_of(&sides)?;
        }
        let sides = straight_sides(luma, camera, rough, NEAR_REACH)?;
        Ok(Outline {
            rough,
            corners: corners_of(&sides)?,
            sides,
            ..self
        })
    }

    fn is_same(&self, other: &Outline) -> bool {
        let near = |corner: &Point| other.corners.iter().any(|c| (c - corner).norm() < SAME);
        self.corners.iter().all(near)
    }

    fn error(&self) -> f64 {
        self.sides.iter().map(|side| side.error).sum()
    }

    /// The pose that explains the sides best; one that a robot has, if two explain them as well.
    fn fit(&self, camera: Camera, paper: Paper) -> Result<Sheet, SheetError> {
        let camera = Camera {
            distortion: [0.0; 4],
            ..camera
        };
        let [long, short] = paper.sides();
        let mut best: Option<(Fitting, Unknowns)> = None;
        let mut least = f64::INFINITY;
        for lengths in [[long, short], [short, long]] {
            let fitting = Fitting {
                outline: self,
                camera,
                lengths,
            };
            for pitch in STARTS {
                let Some(found) = fitting.start(pitch).and_then(|start| fitting.solve(start))
                else {
                    continue;
                };
                let mut badness = fitting.squares(&found);
                if !is_plausible(&fitting.camera_at(&found)) {
                    badness += TELLING;
                }
                if badness < least {
                    least = badness;
                    best = Some((fitting, found));
                }
            }
        }
        let fits = best.filter(|(fitting, found)| fitting.squares(found) <= MAX_SQUARES);
        let (fitting, unknowns) = fits.ok_or(SheetError::OtherShape)?;
        let camera = fitting.camera_at(&unknowns);
        if !is_plausible(&camera) {
            return Err(SheetError::NotFlat);
        }
        let covariance = fitting.covariance(&unknowns).ok_or(SheetError::TooSmall)?;
        let is_vague = |index: usize| 2.0 * covariance[(index, index)].sqrt() > USEFUL[index];
        if (0..3).any(is_vague) {
            return Err(SheetError::TooSmall);
        }
        Ok(Sheet {
            camera,
            middle: FloorPosition {
                ahead: unknowns[3],
                left: unknowns[4],
            },
            brightness: self.brightness,
            information: covariance.try_inverse().ok_or(SheetError::TooSmall)?,
        })
    }
}

/// Whether a robot's camera can be so.
fn is_plausible(camera: &Camera) -> bool {
    HEIGHTS.contains(&camera.height)
        && PITCHES.contains(&camera.pitch)
        && camera.roll.abs() < MAX_ROLL
}

/// The sides of an outline, whose points between two corners `points` finds.
fn sides(
    corners: &[Point; 4],
    points: impl Fn(Point, Point) -> Vec<Point>,
) -> Result<[Side; 4], SheetError> {
    let mut sides = [Side::between(corners[0], corners[1]); 4];
    for (index, side) in sides.iter_mut().enumerate() {
        *side = Side::through(&points(corners[index], corners[(index + 1) % 4]))?;
    }
    Ok(sides)
}

/// The sides as a lens without distortion would show them, between corners in the picture.
fn straight_sides(
    luma: &GrayImage,
    camera: Camera,
    corners: [Point; 4],
    reach: f64,
) -> Result<[Side; 4], SheetError> {
    let (width, height) = luma.dimensions();
    let straight = |point: Point| {
        let (x, y) = camera.straighten(point.x, point.y, Size { width, height });
        Point::new(x, y)
    };
    sides(&corners, |from, to| {
        let points = edge_points(luma, from, to, reach);
        points.into_iter().map(straight).collect()
    })
}

/// Where successive sides meet.
fn corners_of(sides: &[Side; 4]) -> Result<[Point; 4], SheetError> {
    let mut corners = [Point::zeros(); 4];
    for (index, corner) in corners.iter_mut().enumerate() {
        let met = sides[(index + 3) % 4].meets(&sides[index]);
        *corner = met.ok_or(SheetError::NoSheet)?;
    }
    Ok(corners)
}

impl Side {
    /// The line through most of these points, apart from those that print beside the edge moves.
    fn through(points: &[Point]) -> Result<Side, SheetError> {
        if points.len() < LEAST_POINTS {
            return Err(SheetError::NoSheet);
        }
        let mut rough = Side::between(points[0], points[points.len() - 1]);
        let mut least = f64::INFINITY;
        for (index, from) in points.iter().enumerate() {
            for to in points.iter().skip(index + points.len() / 4 + 1) {
                let side = Side::between(*from, *to);
                let mut off: Vec<f64> = points.iter().map(|point| side.distance(point)).collect();
                let middle = off.len() / 2;
                let median = *off.select_nth_unstable_by(middle, f64::total_cmp).1;
                if median < least {
                    least = median;
                    rough = side;
                }
            }
        }
        let near = points
            .iter()
            .filter(|point| rough.distance(point) < STRAIGHT);
        let kept: Vec<Point> = near.copied().collect();
        let count = kept.len() as f64;
        if count < STRAIGHT_SHARE * points.len() as f64 {
            return Err(SheetError::OtherShape);
        }
        let middle = kept.iter().sum::<Point>() / count;
        let offsets = kept.iter().map(|point| point - middle);
        let spread: Matrix2<f64> = offsets.map(|offset| offset * offset.transpose()).sum();
        let angle = 0.5 * (2.0 * spread[(0, 1)]).atan2(spread[(0, 0)] - spread[(1, 1)]);
        let along = Point::new(angle.cos(), angle.sin());
        let end = |point: Point| middle + along.dot(&(point - middle)) * along;
        let mut side = Side::between(end(kept[0]), end(kept[kept.len() - 1]));
        let squares = kept.iter().map(|point| side.distance(point).powi(2));
        // The mean square error of the mean is doubled by the slope at the ends.
        side.error = (4.0 * squares.sum::<f64>()).sqrt() / count;
        side.error = side.error.hypot(SIDE_ERROR);
        Ok(side)
    }

    fn between(from: Point, to: Point) -> Side {
        Side {
            from,
            to,
            error: SIDE_ERROR,
        }
    }

    fn distance(&self, point: &Point) -> f64 {
        let along = self.to - self.from;
        along.perp(&(point - self.from)).abs() / along.norm().max(1e-9)
    }

    fn meets(&self, other: &Side) -> Option<Point> {
        let along = self.to - self.from;
        let across = other.to - other.from;
        let sine = along.perp(&across);
        let share = (other.from - self.from).perp(&across) / sine;
        (sine.abs() > 0.02 * along.norm() * across.norm()).then(|| self.from + share * along)
    }
}

/// Where the brightness passes the middle between floor and paper, along a side of a clockwise
/// outline, up to `reach` pixels beside it. It is looked for from the floor inwards, since paper may
/// be printed.
fn edge_points(luma: &GrayImage, from: Point, to: Point, reach: f64) -> Vec<Point> {
    let length = (to - from).norm().max(1e-9);
    let along = (to - from) / length;
    let inwards = Point::new(-along.y, along.x) * reach / 8.0;
    let usable = (length - 2.0 * CORNER).max(0.0);
    let count = usable.min(POINTS) as usize;
    let mut points = Vec::new();
    for number in 0..count {
        let share = (number as f64 + 0.5) / count as f64;
        let middle = from + (CORNER + share * usable) * along;
        let values = (-8..=8).map(|step| {
            let point = middle + f64::from(step) * inwards;
            let Luma([value]) = interpolate_bilinear(luma, point.x as f32, point.y as f32)?;
            Some(f64::from(value))
        });
        let Some(values) = values.collect::<Option<Vec<f64>>>() else {
            continue;
        };
        let floor = values[..4].iter().sum::<f64>() / 4.0;
        let paper = values[8..].iter().copied().fold(0.0, f64::max);
        let level = (floor + paper) / 2.0;
        let index = values.iter().position(|value| *value >= level).unwrap_or(0);
        if paper - floor >= CONTRAST && index > 0 {
            let part = (level - values[index - 1]) / (values[index] - values[index - 1]);
            points.push(middle + (index as f64 - 9.0 + part) * inwards);
        }
    }
    points
}

/// Height, pitch, roll, the sheet's place and direction, the spread of its brightness in units of
/// [`SPREAD`], and how much longer and wider it is than it should be, in units of [`SIZE_ERROR`].
type Unknowns = SVector<f64, UNKNOWNS>;
const UNKNOWNS: usize = 9;
/// Two ends of each side, the spread, and the sheet's size.
const ERRORS: usize = 11;

/// The sides to explain by a sheet whose sides have these lengths.
#[derive(Debug, Clone, Copy)]
struct Fitting<'a> {
    outline: &'a Outline,
    camera: Camera,
    lengths: [f64; 2],
}

impl Fitting<'_> {
    fn camera_at(&self, unknowns: &Unknowns) -> Camera {
        Camera {
            height: unknowns[0],
            pitch: unknowns[1].to_degrees(),
            roll: unknowns[2].to_degrees(),
            ..self.camera
        }
    }

    /// The first guess with this pitch: where that camera sees the corners on the floor, from the
    /// height at which the outline is as long as that of the sheet.
    fn start(&self, pitch: f64) -> Option<Unknowns> {
        let camera = self.camera_at(&Unknowns::from_iterator(
            [1.0, pitch].into_iter().chain([0.0; UNKNOWNS - 2]),
        ));
        let mut places = Vec::new();
        for corner in self.outline.corners {
            let place = camera.floor_position(corner.x, corner.y, self.outline.size)?;
            places.push(Point::new(place.ahead, place.left));
        }
        let sides = (0..4).map(|index| (places[(index + 1) % 4] - places[index]).norm());
        let height = 2.0 * (self.lengths[0] + self.lengths[1]) / sides.sum::<f64>();
        let middle = height * places.iter().sum::<Point>() / 4.0;
        let along = places[1] - places[0];
        let turned = along.y.atan2(along.x);
        Some(
            [
                height, pitch, 0.0, middle.x, middle.y, turned, 0.0, 0.0, 0.0,
            ]
            .into(),
        )
    }

    /// Distances of the sides' ends from where they should be, the spread and the excess of the size,
    /// in standard errors; `None` if a corner is not in front of the camera.
    fn errors(&self, unknowns: &Unknowns) -> Option<SVector<f64, ERRORS>> {
        let camera = self.camera_at(unknowns);
        let (sin, cos) = unknowns[5].sin_cos();
        let mut corners = [Point::zeros(); 4];
        let halves = [[-0.5, 0.5], [0.5, 0.5], [0.5, -0.5], [-0.5, -0.5]];
        for (corner, [along, across]) in corners.iter_mut().zip(halves) {
            let along = along * (self.lengths[0] + SIZE_ERROR * unknowns[7]);
            let across = across * (self.lengths[1] + SIZE_ERROR * unknowns[8]);
            let ahead = unknowns[3] + cos * along - sin * across;
            let left = unknowns[4] + sin * along + cos * across;
            let direction = Direction {
                bearing: left.atan2(ahead),
                elevation: -camera.height.atan2(ahead.hypot(left)),
            };
            let (x, y) = camera.pixel(direction, self.outline.size)?;
            *corner = Point::new(x, y);
        }
        let mut errors = SVector::<f64, ERRORS>::zeros();
        for (index, side) in self.outline.sides.iter().enumerate() {
            let along = (corners[(index + 1) % 4] - corners[index]).try_normalize(1e-9)?;
            for (number, end) in [side.from, side.to].into_iter().enumerate() {
                let outside = -along.perp(&(end - corners[index]));
                errors[2 * index + number] = (outside - SPREAD * unknowns[6]) / side.error;
            }
        }
        errors
            .fixed_rows_mut::<3>(8)
            .copy_from(&unknowns.fixed_rows::<3>(6));
        Some(errors)
    }

    fn squares(&self, unknowns: &Unknowns) -> f64 {
        let errors = self.errors(unknowns);
        errors.map_or(f64::INFINITY, |errors| errors.norm_squared())
    }

    fn jacobian(&self, unknowns: &Unknowns) -> Option<SMatrix<f64, ERRORS, UNKNOWNS>> {
        const STEP: f64 = 1e-6;
        let mut jacobian = SMatrix::<f64, ERRORS, UNKNOWNS>::zeros();
        for index in 0..UNKNOWNS {
            let mut step = Unknowns::zeros();
            step[index] = STEP;
            let slope = self.errors(&(unknowns + step))? - self.errors(&(unknowns - step))?;
            jacobian.set_column(index, &(slope / (2.0 * STEP)));
        }
        Some(jacobian)
    }

    /// Levenberg and Marquardt's method.
    fn solve(&self, start: Unknowns) -> Option<Unknowns> {
        let mut unknowns = start;
        let mut damping = 1e-3;
        for _ in 0..MAX_STEPS {
            let jacobian = self.jacobian(&unknowns)?;
            let mut normal = jacobian.transpose() * jacobian;
            normal.set_diagonal(&(normal.diagonal() * (1.0 + damping)));
            let gradient = jacobian.transpose() * self.errors(&unknowns)?;
            let step = normal.cholesky()?.solve(&gradient);
            let next = unknowns - step;
            if next[0] > 0.0 && self.squares(&next) < self.squares(&unknowns) {
                unknowns = next;
                damping = f64::max(damping / 10.0, 1e-12);
            } else {
                damping *= 10.0;
            }
            if step.norm() < 1e-9 {
                break;
            }
        }
        Some(unknowns)
    }

    /// Covariance of height in metres, pitch and roll in degrees.
    fn covariance(&self, unknowns: &Unknowns) -> Option<Matrix3<f64>> {
        let jacobian = self.jacobian(unknowns)?;
        let all = (jacobian.transpose() * jacobian).try_inverse()?;
        let units = Vector3::new(1.0, 1f64.to_degrees(), 1f64.to_degrees());
        let covariance = all
            .fixed_view::<3, 3>(0, 0)
            .component_mul(&(units * units.transpose()));
        let excess = (self.squares(unknowns) / 2.0).max(1.0);
        Some(excess * covariance)
    }
}

#[cfg(test)]
mod tests {
    use image::{ImageBuffer, Rgb, RgbImage};
    use imageproc::filter::gaussian_blur_f32;
    use rand::rngs::StdRng;
    use rand::{RngExt, SeedableRng};

    use super::*;

    const SIZE: Size = Size {
        width: 320,
        height: 240,
    };

    /// Paper on a tiled floor, in front of a wall.
    #[derive(Debug, Clone)]
    struct Scene {
        camera: Camera,
        /// The middle of each sheet, and the radians by which it is turned.
        sheets: Vec<(FloorPosition, f64)>,
        sides: [f64; 2],
        printed: bool,
        /// Levels; more than 255 is overexposed.
        floor: f64,
        paper: f64,
        wall: f64,
        /// Pixels.
        blur: f64,
        noise: f64,
    }

    impl Scene {
        fn new(height: f64, pitch: f64, roll: f64) -> Scene {
            let camera = Camera {
                height,
                pitch,
                roll,
                ..Camera::default()
            };
            Scene {
                camera,
                sheets: Vec::new(),
                sides: Paper::A4.sides(),
                printed: true,
                floor: 120.0,
                paper: 270.0,
                wall: 190.0,
                blur: 0.9,
                noise: 2.0,
            }
        }

        fn with(mut self, ahead: f64, left: f64, turned: f64) -> Scene {
            self.sheets.push((FloorPosition { ahead, left }, turned));
            self
        }

        fn random(random: &mut StdRng) -> Scene {
            let mut between = |least: f64, most: f64| random.random_range(least..most);
            let mut scene =
                Scene::new(between(0.25, 0.32), between(-20.0, 2.0), between(-8.0, 8.0));
            let place =
                scene
                    .camera
                    .floor_position(between(110.0, 210.0), between(160.0, 195.0), SIZE);
            let place = place.expect("a row below the horizon");
            scene = scene.with(place.ahead, place.left, between(0.0, 6.3));
            scene.printed = between(0.0, 1.0) < 0.5;
            scene.floor = between(50.0, 170.0);
            scene.paper = between((scene.floor + 60.0).max(160.0), 350.0);
            scene.blur = between(0.6, 1.4);
            scene.noise = between(0.0, 8.0);
            scene
        }

        /// Light from a place on the floor.
        fn level(&self, place: FloorPosition) -> f64 {
            for (middle, turned) in &self.sheets {
                let (sin, cos) = turned.sin_cos();
                let ahead = place.ahead - middle.ahead;
                let left = place.left - middle.left;
                let along = cos * ahead + sin * left;
                let across = cos * left - sin * ahead;
                if along.abs() < self.sides[0] / 2.0 && across.abs() < self.sides[1] / 2.0 {
                    let is_print = along.abs() < self.sides[0] / 2.0 - 0.03
                        && across.abs() < self.sides[1] / 2.0 - 0.03
                        && ((along / 0.03).floor() + (across / 0.03).floor()) % 2.0 == 0.0;
                    let share = if self.printed && is_print { 0.15 } else { 1.0 };
                    return share * self.paper;
                }
            }
            let is_joint = [place.ahead, place.left]
                .iter()
                .any(|way| (way + 9.0) % 0.3 < 0.005);
            if is_joint {
                0.7 * self.floor
            } else {
                self.floor
            }
        }

        /// What the camera sees, with 2x2 samples a pixel; too bright light is cut off after the
        /// lens has blurred it.
        fn picture(&self, random: &mut StdRng) -> Image {
            let light = ImageBuffer::from_fn(640, 480, |column, row| {
                let x = f64::from(column) / 2.0 - 0.25;
                let y = f64::from(row) / 2.0 - 0.25;
                let place = self.camera.floor_position(x, y, SIZE);
                let place = place.filter(|place| place.ahead < 3.0);
                Luma([place.map_or(self.wall, |place| self.level(place)) as f32])
            });
            let light = gaussian_blur_f32(&light, 2.0 * self.blur as f32);
            let pixels = RgbImage::from_fn(320, 240, |x, y| {
                let samples = [(0, 0), (0, 1), (1, 0), (1, 1)];
                let levels = samples.map(|(right, down)| light[(2 * x + right, 2 * y + down)].0[0]);
                let noise = self.noise * random.random_range(-1.0..1.0);
                Rgb([(f64::from(levels.iter().sum::<f32>()) / 4.0 + noise) as u8; 3])
            });
            Image::from_rgb(&pixels)
        }

        fn measured(&self) -> Result<SheetPose, SheetError> {
            let image = self.picture(&mut StdRng::seed_from_u64(1));
            pose_from_sheets(&image, Camera::default(), Paper::A4)
        }
    }

    #[test]
    fn the_truth_is_within_the_stated_uncertainty() {
        let mut found = 0;
        let mut inside = [0; 3];
        for seed in 0..60 {
            let random = &mut StdRng::seed_from_u64(seed);
            let scene = Scene::random(random);
            let Ok(measured) =
                pose_from_sheets(&scene.picture(random), Camera::default(), Paper::A4)
            else {
                continue;
            };
            found += 1;
            let off = (pose(&measured.camera) - pose(&scene.camera)).abs();
            for index in 0..3 {
                inside[index] += u32::from(off[index] <= measured.uncertainty[index]);
                let limit = 2.0 * measured.uncertainty[index];
                assert!(off[index] <= limit, "{seed}: {scene:?} {measured:?}");
            }
        }
        assert!(found >= 40, "{found}");
        assert!(
            inside.iter().all(|count| 100 * count >= 93 * found),
            "{inside:?} of {found}"
        );
    }

    #[test]
    fn two_sheets_tell_more_than_one_and_say_whether_they_agree() {
        let near = Scene::new(0.29, -10.0, -4.0).with(0.85, -0.03, 0.2);
        let both = near.clone().with(1.2, 0.12, 0.8);
        let one = near.measured().unwrap();
        let two = both.measured().unwrap();
        assert_eq!((one.sheets.len(), two.sheets.len()), (1, 2));
        assert!(two.agree && two.uncertainty[1] < one.uncertainty[1]);
        let ahead = two.sheets.iter().map(|sheet| sheet.middle.ahead);
        assert!(ahead.clone().any(|ahead| (ahead - 0.85).abs() < 0.03));
        assert!(ahead.clone().any(|ahead| (ahead - 1.2).abs() < 0.05));
        // The other lies on a board that slopes, as if the camera looked down more.
        let mut image = near.picture(&mut StdRng::seed_from_u64(1)).to_rgb();
        let sloping = Scene::new(0.29, -13.0, -4.0).with(1.2, 0.1, 0.8);
        let other = sloping.picture(&mut StdRng::seed_from_u64(2)).to_rgb();
        for (pixel, other) in image.pixels_mut().zip(other.pixels()) {
            pixel.0 = [pixel.0[0].max(other.0[0]); 3];
        }
        let image = Image::from_rgb(&image);
        let two = pose_from_sheets(&image, Camera::default(), Paper::A4).unwrap();
        assert!(two.sheets.len() == 2 && !two.agree, "{two:?}");
        assert!(two.uncertainty[0] > 2.0 * one.uncertainty[0]);
    }

    #[test]
    fn letter_paper_is_measured_as_letter() {
        let scene = Scene {
            sides: Paper::Letter.sides(),
            ..Scene::new(0.28, -12.0, 3.0).with(0.8, 0.05, 0.4)
        };
        let image = scene.picture(&mut StdRng::seed_from_u64(1));
        let found = pose_from_sheets(&image, Camera::default(), Paper::Letter).unwrap();
        let off = (pose(&found.camera) - pose(&scene.camera)).abs();
        assert!(off[0] < 0.01 && off[1] < 0.7 && off[2] < 0.7, "{found:?}");
    }

    #[test]
    fn what_is_no_whole_flat_sheet_on_the_floor_is_refused() {
        let scene = Scene::new(0.29, -15.0, 0.0);
        assert_eq!(scene.measured(), Err(SheetError::NoSheet));
        let cut = scene.clone().with(0.8, 0.3, 0.0);
        assert_eq!(cut.measured(), Err(SheetError::NoSheet));
        let strip = Scene {
            sides: [0.4, 0.07],
            printed: false,
            ..scene.clone().with(0.8, 0.0, 1.2)
        };
        assert_eq!(strip.measured(), Err(SheetError::OtherShape));
        let far = Scene::new(0.29, 0.0, 0.0).with(2.2, 0.0, 0.3);
        assert_eq!(far.measured(), Err(SheetError::TooSmall));
        for side in [1, 2, 3, 9] {
            let tiny = Image::from_rgb(&RgbImage::from_pixel(side, side, Rgb([250; 3])));
            let refused = pose_from_sheets(&tiny, Camera::default(), Paper::A4);
            assert_eq!(refused, Err(SheetError::NoSheet));
        }
    }

    #[test]
    fn tiles_of_two_colours_are_no_paper() {
        for (pitch, ahead) in [(-10.0, 0.8), (-18.0, 0.7), (0.0, 1.2)] {
            let mut scene = Scene::new(0.29, pitch, 2.0);
            scene.sides = [0.25, 0.25];
            scene.printed = false;
            for along in -4..5 {
                for across in (-4..5).filter(|across| (along + across) % 2 == 0) {
                    let left = 0.25 * f64::from(across);
                    scene = scene.with(ahead + 0.25 * f64::from(along), left, 0.0);
                }
            }
            let refused = scene.measured();
            assert!(refused.is_err(), "{pitch}: {refused:?}");
        }
    }

    #[test]
    fn doors_windows_and_paper_on_the_wall_are_no_sheets_on_the_floor() {
        for (left, top, width, height) in [
            (60, 0, 90, 100),
            (120, 20, 60, 62),
            (130, 25, 42, 59),
            (100, 25, 85, 60),
        ] {
            let scene = Scene {
                wall: 140.0,
                ..Scene::new(0.29, 5.0, -1.5)
            };
            let mut image = scene.picture(&mut StdRng::seed_from_u64(1)).to_rgb();
            for y in top..top + height {
                for x in left..left + width {
                    image.put_pixel(x, y, Rgb([235; 3]));
                }
            }
            let image = Image::from_rgb(&image);
            let refused = pose_from_sheets(&image, Camera::default(), Paper::A4);
            assert!(refused.is_err(), "{left} {top}: {refused:?}");
        }
    }
}
