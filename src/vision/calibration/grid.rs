//! Arranges corners in the order of a board.

use std::collections::{BTreeMap, VecDeque};

use image::GrayImage;

use super::corners::{Place, corners};

/// Most corners from which the search for the board starts.
const MAX_SEEDS: usize = 40;
/// Largest distance of a corner from its position extrapolated from a neighbour, as a share of the
/// spacing.
const MAX_DEVIATION: f64 = 0.3;
/// Least difference between the two directions of a board: the sine of 25 degrees.
const MIN_SINE: f64 = 0.42;

/// The number of inner corners of a chessboard: one less than its fields in each direction.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Board {
    /// Corners from left to right, at least 3.
    pub columns: usize,
    /// Corners from top to bottom, at least 3.
    pub rows: usize,
}

/// Finds the corners of a board in a picture, row by row, in pixels; the centre of the first pixel
/// is 0, 0. Which row is the first depends on the picture. `None` if the board is not completely
/// visible.
pub fn find_chessboard(picture: &GrayImage, board: Board) -> Option<Vec<[f64; 2]>> {
    let places = corners(picture);
    let seeds = 0..places.len().min(MAX_SEEDS);
    seeds.into_iter().find_map(|seed| {
        let cells = Grid::grown(&places, seed)?.cells;
        let found = order_rows(&cells, board)?;
        Some(found.into_iter().map(|index| places[index]).collect())
    })
}

/// Column and row of a corner, relative to the one where the search started.
type Cell = (i32, i32);

struct Grid {
    cells: BTreeMap<Cell, usize>,
}

impl Grid {
    /// Grows a grid from one corner to all corners that can be reached from neighbour to neighbour.
    fn grown(places: &[Place], seed: usize) -> Option<Grid> {
        let [right, down] = first_steps(places, seed)?;
        let mut cells = BTreeMap::from([((0, 0), seed)]);
        let mut taken = vec![false; places.len()];
        taken[seed] = true;
        let mut edge = VecDeque::from([((0, 0), [right, down])]);
        while let Some((cell, steps)) = edge.pop_front() {
            let here = places[*cells.get(&cell)?];
            for (axis, sign) in [(0, 1), (0, -1), (1, 1), (1, -1)] {
                let next = neighbour(cell, axis, sign);
                if cells.contains_key(&next) {
                    continue;
                }
                let step = steps[axis].map(|length| length * f64::from(sign));
                let wanted = [here[0] + step[0], here[1] + step[1]];
                let reach = MAX_DEVIATION * step[0].hypot(step[1]);
                let near =
                    nearest(places, wanted).filter(|(index, away)| !taken[*index] && *away < reach);
                let Some((index, _)) = near else {
                    continue;
                };
                taken[index] = true;
                cells.insert(next, index);
                let mut steps = steps;
                let there = places[index];
                steps[axis] =
                    [there[0] - here[0], there[1] - here[1]].map(|length| length * f64::from(sign));
                edge.push_back((next, steps));
            }
        }
        Some(Grid { cells })
    }
}

fn neighbour((column, row): Cell, axis: usize, sign: i32) -> Cell {
    if axis == 0 {
        (column + sign, row)
    } else {
        (column, row + sign)
    }
}

/// The offsets to two neighbours of a corner that are not collinear with it.
fn first_steps(places: &[Place], seed: usize) -> Option<[Place; 2]> {
    let here = places[seed];
    let mut others: Vec<Place> = places
        .iter()
        .map(|place| [place[0] - here[0], place[1] - here[1]])
        .filter(|way| way[0].hypot(way[1]) > 0.0)
        .collect();
    others.sort_by(|a, b| a[0].hypot(a[1]).total_cmp(&b[0].hypot(b[1])));
    let first = *others.first()?;
    let second = others.iter().skip(1).take(7).find(|way| {
        let sine = first[0] * way[1] - first[1] * way[0];
        sine.abs() > MIN_SINE * first[0].hypot(first[1]) * way[0].hypot(way[1])
    })?;
    Some([first, *second])
}

fn nearest(places: &[Place], wanted: Place) -> Option<(usize, f64)> {
    let away = |place: &Place| (place[0] - wanted[0]).hypot(place[1] - wanted[1]);
    let all = places.iter().map(away).enumerate();
    all.min_by(|a, b| a.1.total_cmp(&b.1))
}

/// The board's corners row by row; `None` unless the cells form exactly this board.
fn order_rows(cells: &BTreeMap<Cell, usize>, board: Board) -> Option<Vec<usize>> {
    let span = |pick: fn(&Cell) -> i32| {
        let (low, high) = (cells.keys().map(pick).min()?, cells.keys().map(pick).max()?);
        Some((low, (high - low + 1) as usize))
    };
    let (left, columns) = span(|cell| cell.0)?;
    let (top, rows) = span(|cell| cell.1)?;
    if cells.len() != board.columns * board.rows {
        return None;
    }
    let turned = match (columns, rows) {
        (columns, rows) if (columns, rows) == (board.columns, board.rows) => false,
        (columns, rows) if (rows, columns) == (board.columns, board.rows) => true,
        _ => return None,
    };
    let cell = |column: usize, row: usize| {
        if turned {
            (left + row as i32, top + column as i32)
        } else {
            (left + column as i32, top + row as i32)
        }
    };
    let order = (0..board.rows).flat_map(|row| (0..board.columns).map(move |column| (column, row)));
    order
        .map(|(column, row)| cells.get(&cell(column, row)).copied())
        .collect()
}
