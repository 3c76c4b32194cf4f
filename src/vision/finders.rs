//! Bounds the work of the search for QR codes. The crate that reads them tries every triple of
//! squares that look like a finder pattern and repeatedly flood-fills the areas around them: a
//! sheet of paper with seventy such squares took longer than a script may run. This module counts
//! the squares in the same way, on the same binarised picture, and erases those beyond the limits;
//! then fewer codes are read.

use std::collections::{BTreeMap, BTreeSet};

use super::alignment_cost::{Square, candidate_triples};

/// Most finder patterns that are searched: those of four codes. The work grows with their third
/// power.
pub const MAX_FINDERS: usize = 12;
/// Most pixels that are flood-filled in the search for finder patterns.
pub const MAX_FILLED: u64 = 8_000_000;
/// Most steps in the search for alignment patterns.
pub const MAX_STEPS: u64 = 4_000_000;
/// Number of areas that the crate caches.
const CACHED_AREAS: usize = 250;
/// How often patterns are erased before the picture is rejected.
const MAX_ROUNDS: u32 = 8;
/// Run lengths, in modules, across the centre of a finder pattern: dark, light, dark, light, dark.
const PATTERN: [usize; 5] = [1, 1, 3, 1, 1];

/// A binarised picture.
#[derive(Debug, Clone)]
pub(super) struct Bitmap {
    width: usize,
    black: Vec<bool>,
}

/// Upper bounds for the work of a search.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct QrWork {
    /// Squares that may be finder patterns.
    pub finders: usize,
    /// Pixels that are flood-filled.
    pub filled: u64,
    /// Steps in the search for alignment patterns.
    pub steps: u64,
    /// Codes that were decoded.
    pub decoded: usize,
}

/// A run of black pixels in a row.
#[derive(Debug, Clone, Copy)]
struct Run {
    start: usize,
    end: usize,
    area: usize,
}

impl Run {
    fn len(&self) -> usize {
        self.end - self.start
    }
}

/// The runs of a picture and the connected components (areas) that they belong to.
struct Areas {
    runs: Vec<Run>,
    /// Index of the first run of each row, followed by the total number of runs.
    rows: Vec<usize>,
    /// Number of pixels of each area, indexed by the area's number.
    pixels: Vec<u64>,
}

/// A finder pattern: the areas of its outer ring and of its inner square.
#[derive(Debug, Clone, Copy)]
struct Finder {
    ring: usize,
    inner: usize,
    /// The pixel of the ring where it was found.
    at: (usize, usize),
}

impl Bitmap {
    pub(super) fn new(width: usize, height: usize, black: impl Fn(usize, usize) -> bool) -> Bitmap {
        let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        Bitmap {
            width,
            black: pixels.map(|(x, y)| black(x, y)).collect(),
        }
    }

    pub(super) fn is_black(&self, x: usize, y: usize) -> bool {
        self.black[y * self.width + x]
    }

    /// Erases surplus patterns. Returns the remaining work; `None` if too many pixels would have to
    /// be flood-filled, or if patterns beyond the limits remain after [`MAX_ROUNDS`].
    pub(super) fn limit_work(&mut self) -> Option<QrWork> {
        for _ in 0..MAX_ROUNDS {
            let areas = self.areas();
            let (mut finders, filled) = areas.find_patterns();
            if filled > MAX_FILLED {
                return None;
            }
            // The largest patterns are kept: they are the nearest.
            finders.sort_by_key(|finder| std::cmp::Reverse(areas.pixels[finder.ring]));
            let mut surplus = finders.split_off(finders.len().min(MAX_FINDERS));
            let (steps, removed) = areas.remove_expensive(&mut finders);
            surplus.extend(removed);
            if surplus.is_empty() {
                return Some(QrWork {
                    finders: finders.len(),
                    filled,
                    steps,
                    decoded: 0,
                });
            }
            self.erase(&areas, &surplus.iter().map(|finder| finder.inner).collect());
        }
        None
    }

    fn erase(&mut self, areas: &Areas, which: &BTreeSet<usize>) {
        for (y, runs) in areas.by_row().enumerate() {
            for run in runs.iter().filter(|run| which.contains(&run.area)) {
                let row = y * self.width;
                self.black[row + run.start..row + run.end].fill(false);
            }
        }
    }

    /// Labels the connected components, with 4-connectivity.
    fn areas(&self) -> Areas {
        let (mut runs, mut rows, mut parents) = (Vec::<Run>::new(), vec![0], Vec::<usize>::new());
        let mut above = 0..0;
        for row in self.black.chunks(self.width.max(1)) {
            let first = runs.len();
            let mut x = 0;
            while x < row.len() {
                let Some(start) = row[x..].iter().position(|black| *black).map(|at| at + x) else {
                    break;
                };
                let long = row[start..].iter().position(|black| !black);
                let end = long.map_or(row.len(), |long| start + long);
                parents.push(runs.len());
                runs.push(Run {
                    start,
                    end,
                    area: 0,
                });
                x = end;
            }
            let mut upper = above.start;
            for lower in first..runs.len() {
                while upper < above.end && runs[upper].end <= runs[lower].start {
                    upper += 1;
                }
                let mut touching = upper;
                while touching < above.end && runs[touching].start < runs[lower].end {
                    let (one, other) = (root(&mut parents, touching), root(&mut parents, lower));
                    parents[one.max(other)] = one.min(other);
                    touching += 1;
                }
            }
            above = first..runs.len();
            rows.push(runs.len());
        }
        let mut pixels = vec![0; runs.len()];
        for (index, run) in runs.iter_mut().enumerate() {
            run.area = root(&mut parents, index);
            pixels[run.area] += run.len() as u64;
        }
        Areas { runs, rows, pixels }
    }
}

fn root(parents: &mut [usize], mut index: usize) -> usize {
    while parents[index] != index {
        parents[index] = parents[parents[index]];
        index = parents[index];
    }
    index
}

impl Areas {
    fn by_row(&self) -> impl Iterator<Item = &[Run]> {
        self.rows
            .windows(2)
            .map(|pair| &self.runs[pair[0]..pair[1]])
    }

    /// Finds the patterns and counts the pixels that are flood-filled for this.
    fn find_patterns(&self) -> (Vec<Finder>, u64) {
        let (mut found, mut filled) = (BTreeMap::new(), 0);
        let (mut requests, mut last) = (0_usize, BTreeMap::new());
        for (y, runs) in self.by_row().enumerate() {
            for three in runs.windows(3).filter(|three| looks_like_a_square(three)) {
                let (ring, inner) = (three[2].area, three[1].area);
                for area in [ring, inner] {
                    requests += 1;
                    let before = last.insert(area, requests);
                    // The cache drops an area at the earliest after this many requests for others;
                    // the area is then cleared and filled again.
                    if before.is_none_or(|before| requests - before > CACHED_AREAS) {
                        filled += 2 * self.pixels[area];
                    }
                }
                if self.is_square(three) && !found.contains_key(&ring) {
                    filled += 2 * self.pixels[ring];
                    let at = (three[2].start, y);
                    found.insert(ring, Finder { ring, inner, at });
                }
            }
        }
        (found.into_values().collect(), filled)
    }

    /// Removes patterns until the estimated search is within the limit. Returns its steps and the
    /// removed patterns.
    fn remove_expensive(&self, finders: &mut Vec<Finder>) -> (u64, Vec<Finder>) {
        let mut squares: Vec<Square> = finders.iter().map(|finder| self.square(finder)).collect();
        let mut removed = Vec::new();
        loop {
            let triples = candidate_triples(&squares);
            let sum: f64 = triples.iter().map(|(_, steps)| steps).sum();
            if sum <= MAX_STEPS as f64 {
                return (sum as u64, removed);
            }
            let share = |index: usize| -> f64 {
                let of_it = triples.iter().filter(|(three, _)| three.contains(&index));
                // NaN and infinity are the worst.
                of_it
                    .map(|(_, steps)| {
                        if steps.is_finite() {
                            *steps
                        } else {
                            f64::MAX / 1e6
                        }
                    })
                    .sum()
            };
            let worst = (0..squares.len()).max_by(|a, b| share(*a).total_cmp(&share(*b)));
            let Some(worst) = worst else {
                return (0, removed);
            };
            squares.remove(worst);
            removed.push(finders.remove(worst));
        }
    }

    /// The corners of a ring: the pixel farthest from where the ring was found, and the extremes
    /// along and across the line to it.
    fn square(&self, finder: &Finder) -> Square {
        let ends: Vec<(f64, f64)> = self
            .by_row()
            .enumerate()
            .flat_map(|(y, runs)| {
                let own = runs.iter().filter(|run| run.area == finder.ring);
                own.flat_map(move |run| {
                    [
                        (run.start as f64, y as f64),
                        (run.end as f64 - 1.0, y as f64),
                    ]
                })
            })
            .collect();
        let at = (finder.at.0 as f64, finder.at.1 as f64);
        let farthest = |measure: &dyn Fn((f64, f64)) -> f64| {
            let mut best = at;
            for end in &ends {
                if measure(*end) > measure(best) {
                    best = *end;
                }
            }
            best
        };
        let corner = farthest(&|(x, y)| (x - at.0).powi(2) + (y - at.1).powi(2));
        let along = (corner.0 - at.0, corner.1 - at.1);
        let by = |(x, y): (f64, f64)| x * along.0 + y * along.1;
        let across = |(x, y): (f64, f64)| y * along.0 - x * along.1;
        Square::new([
            farthest(&by),
            farthest(&across),
            farthest(&|end| -by(end)),
            farthest(&|end| -across(end)),
        ])
    }

    /// Whether the outer runs belong to one area, and the middle run belongs to another one of
    /// about the right size.
    fn is_square(&self, three: &[Run]) -> bool {
        let (ring, inner) = (three[0].area, three[1].area);
        let share = self.pixels[inner] * 100 / self.pixels[ring].max(1);
        ring == three[2].area && ring != inner && (11..70).contains(&share)
    }
}

/// Whether three neighbouring runs and the gaps between them have the proportions of a finder
/// pattern.
fn looks_like_a_square(three: &[Run]) -> bool {
    let [left, inner, right] = three else {
        return false;
    };
    let gaps = (inner.start - left.end, right.start - inner.end);
    let lengths = [left.len(), gaps.0, inner.len(), gaps.1, right.len()];
    let module = (lengths[0] + lengths[1] + lengths[3] + lengths[4]) / 4;
    let slack = module * 3 / 4;
    let fits = |(length, times): (usize, usize)| {
        (times * module - slack..=times * module + slack).contains(&length)
    };
    lengths.into_iter().zip(PATTERN).all(fits)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A sheet with finder patterns of 7 modules at these corners; a module is `module` pixels
    /// wide.
    fn sheet(width: usize, height: usize, module: usize, corners: &[(usize, usize)]) -> Bitmap {
        let black = |x: usize, y: usize| {
            corners.iter().any(|&(left, top)| {
                let (Some(x), Some(y)) = (x.checked_sub(left), y.checked_sub(top)) else {
                    return false;
                };
                let (x, y) = (x / module, y / module);
                let ring = x.min(y) == 0 || x.max(y) == 6;
                x < 7 && y < 7 && (ring || ((2..5).contains(&x) && (2..5).contains(&y)))
            })
        };
        Bitmap::new(width, height, black)
    }

    fn lattice(columns: usize, rows: usize, step: usize) -> Vec<(usize, usize)> {
        (0..rows)
            .flat_map(|y| (0..columns).map(move |x| (2 + x * step, 2 + y * step)))
            .collect()
    }

    #[test]
    fn patterns_are_counted_and_the_surplus_is_erased() {
        let mut few = sheet(320, 240, 3, &lattice(3, 2, 40));
        let before = few.black.clone();
        let work = few.limit_work().unwrap();
        assert_eq!(work.finders, 6);
        assert!((1..MAX_FILLED).contains(&work.filled));
        assert_eq!(few.black, before, "nothing is erased");
        let mut many = sheet(320, 240, 3, &lattice(10, 7, 30));
        assert_eq!(many.areas().find_patterns().0.len(), 70);
        assert_eq!(many.limit_work().unwrap().finders, MAX_FINDERS);
        assert_eq!(many.areas().find_patterns().0.len(), MAX_FINDERS);
    }

    #[test]
    fn no_picture_is_too_small() {
        for (width, height) in [(1, 1), (1, 240), (320, 1), (7, 7)] {
            let black = Bitmap::new(width, height, |_, _| true).limit_work();
            assert_eq!(black, Some(QrWork::default()));
            let white = Bitmap::new(width, height, |_, _| false).limit_work();
            assert_eq!(white, Some(QrWork::default()));
        }
    }
}
