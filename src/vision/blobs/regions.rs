//! Labels the connected components of a picture in one pass: runs of one label are joined with
//! those they touch in the row above (8-connectivity, as by default in OpenCV) by union-find, and
//! counts, boxes and moments are summed up on the way. After the first pictures nothing is
//! allocated.

use crate::picture::{Roi, Spans};

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Region {
    /// The region itself if it is a root; otherwise a region that it joined.
    parent: u32,
    pub(crate) label: u8,
    pub(crate) moments: Moments,
    /// Number of border pixels; computed by [`Regions::measure_perimeters`].
    pub(crate) perimeter: u64,
    pub(crate) left: u32,
    pub(crate) right: u32,
    pub(crate) top: u32,
    pub(crate) bottom: u32,
}

/// Neighbouring pixels of one label in one row, from `start` to before `end`.
#[derive(Debug, Clone, Copy)]
struct Run {
    start: u32,
    end: u32,
    region: u32,
    label: u8,
}

#[derive(Debug, Default)]
pub(crate) struct Regions {
    row: Vec<u8>,
    runs: Vec<Run>,
    /// Index of the first run of each row, followed by the total number of runs.
    rows: Vec<usize>,
    regions: Vec<Region>,
}

impl Regions {
    /// Scans the window row by row. `label_row(y, row)` writes the labels of row `y` and returns
    /// the spans that may contain any; label 0 is background, and so is everything outside the
    /// spans.
    pub(crate) fn scan(&mut self, window: Roi, mut label_row: impl FnMut(u32, &mut [u8]) -> Spans) {
        self.runs.clear();
        self.rows.clear();
        self.regions.clear();
        self.row.resize(window.w as usize, 0);
        self.rows.push(0);
        let mut above = 0;
        for y in window.y..window.y + window.h {
            let spans = label_row(y, &mut self.row);
            let first = self.runs.len();
            for span in spans.ranges(self.row.len()) {
                let x = window.x + span.start as u32;
                append_runs(&self.row[span], x, &mut self.runs);
            }
            self.join(above, first, y);
            self.rows.push(self.runs.len());
            above = first;
        }
    }

    /// The regions in the order of their first pixel.
    pub(crate) fn found(&self) -> impl Iterator<Item = (u32, &Region)> {
        (0..)
            .zip(&self.regions)
            .filter(|(index, region)| *index == region.parent)
    }

    pub(crate) fn region(&self, index: u32) -> Region {
        self.regions[index as usize]
    }

    /// Assigns a region to each run of the newest row (from `first` on), using the runs above it.
    fn join(&mut self, above: usize, first: usize, y: u32) {
        let (before, newest) = self.runs.split_at_mut(first);
        let mut above = &before[above..];
        for run in newest {
            while let Some((passed, rest)) = above.split_first()
                && passed.end < run.start
            {
                above = rest;
            }
            let mut root = None;
            for touching in above.iter().take_while(|other| other.start <= run.end) {
                if touching.label == run.label {
                    let other = find(&mut self.regions, touching.region);
                    root = Some(root.map_or(other, |root| unite(&mut self.regions, root, other)));
                }
            }
            run.region = match root {
                Some(root) => root,
                None => {
                    let index = self.regions.len() as u32;
                    self.regions.push(Region::empty(index, run.label));
                    index
                }
            };
            self.regions[run.region as usize].add(run, y);
        }
    }

    /// Counts the border pixels of the regions for which `wanted` returns true: pixels with at
    /// least one of their four neighbours outside the region.
    pub(crate) fn measure_perimeters(&mut self, wanted: impl Fn(&Region) -> bool) {
        for row in 0..self.rows.len() - 1 {
            let of = |row: usize| self.rows[row]..self.rows[row + 1];
            let above = if row == 0 { 0..0 } else { of(row - 1) };
            let below = if row + 2 == self.rows.len() {
                0..0
            } else {
                of(row + 1)
            };
            let mut above = &self.runs[above];
            let mut below = &self.runs[below];
            for run in &self.runs[of(row)] {
                let root = find(&mut self.regions, run.region) as usize;
                if wanted(&self.regions[root]) {
                    let inner = enclosed(run, &mut above, &mut below);
                    self.regions[root].perimeter += u64::from(run.end - run.start - inner);
                }
            }
        }
    }
}

impl Region {
    fn empty(index: u32, label: u8) -> Region {
        Region {
            parent: index,
            label,
            moments: Moments::default(),
            perimeter: 0,
            left: u32::MAX,
            right: 0,
            top: u32::MAX,
            bottom: 0,
        }
    }

    pub(crate) fn area(&self) -> u64 {
        u64::from(self.right - self.left + 1) * u64::from(self.bottom - self.top + 1)
    }

    fn add(&mut self, run: &Run, y: u32) {
        self.moments.add_run(run.start, run.end, y);
        self.left = self.left.min(run.start);
        self.right = self.right.max(run.end - 1);
        self.top = self.top.min(y);
        self.bottom = y;
    }

    pub(crate) fn absorb(&mut self, other: &Region) {
        self.moments.absorb(&other.moments);
        self.perimeter += other.perimeter;
        self.left = self.left.min(other.left);
        self.right = self.right.max(other.right);
        self.top = self.top.min(other.top);
        self.bottom = self.bottom.max(other.bottom);
    }
}

/// Finds the root of a region, with path halving.
fn find(regions: &mut [Region], mut index: u32) -> u32 {
    while regions[index as usize].parent != index {
        let grandparent = regions[regions[index as usize].parent as usize].parent;
        regions[index as usize].parent = grandparent;
        index = grandparent;
    }
    index
}

/// Joins two roots and returns the older one, so that regions keep the order of their first pixel.
fn unite(regions: &mut [Region], a: u32, b: u32) -> u32 {
    if a == b {
        return a;
    }
    let root = a.min(b);
    let child = a.max(b);
    let absorbed = regions[child as usize];
    regions[child as usize].parent = root;
    regions[root as usize].absorb(&absorbed);
    root
}

/// Appends the runs of a row whose first pixel is in column `x`.
fn append_runs(row: &[u8], x: u32, runs: &mut Vec<Run>) {
    let mut at = 0;
    while let Some(start) = first_other(row, at, 0) {
        let label = row[start];
        let end = first_other(row, start + 1, label).unwrap_or(row.len());
        runs.push(Run {
            start: x + start as u32,
            end: x + end as u32,
            region: 0,
            label,
        });
        at = end;
    }
}

/// The position of the first label other than `label`, from `at` on; compares eight labels at a
/// time.
fn first_other(row: &[u8], at: usize, label: u8) -> Option<usize> {
    let rest = &row[at..];
    let (words, _) = rest.as_chunks::<8>();
    let same = u64::from_le_bytes([label; 8]);
    for (index, word) in words.iter().enumerate() {
        let differing = u64::from_le_bytes(*word) ^ same;
        if differing != 0 {
            return Some(at + index * 8 + differing.trailing_zeros() as usize / 8);
        }
    }
    let tail = at + words.len() * 8;
    row[tail..]
        .iter()
        .position(|other| *other != label)
        .map(|offset| tail + offset)
}

/// Number of pixels of a run, without its two ends, that have its label above and below. Advances
/// the slices to the runs that later runs of the row may need.
fn enclosed<'a>(run: &Run, above: &mut &'a [Run], below: &mut &'a [Run]) -> u32 {
    for side in [&mut *above, &mut *below] {
        while let Some((passed, rest)) = side.split_first()
            && passed.end <= run.start
        {
            *side = rest;
        }
    }
    let mut up = *above;
    let mut down = *below;
    let mut inner = 0;
    while let (Some(over), Some(under)) = (up.first(), down.first())
        && over.start.max(under.start) < run.end
    {
        if over.label == run.label && under.label == run.label {
            let start = over.start.max(under.start).max(run.start + 1);
            inner += over
                .end
                .min(under.end)
                .min(run.end - 1)
                .saturating_sub(start);
        }
        if over.end <= under.end {
            up = &up[1..];
        } else {
            down = &down[1..];
        }
    }
    inner
}

/// Exact sums of coordinates and of their products.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Moments {
    pub(crate) pixels: u64,
    sum_x: u64,
    sum_y: u64,
    sum_xx: u64,
    sum_yy: u64,
    sum_xy: u64,
}

impl Moments {
    pub(crate) fn add_run(&mut self, start: u32, end: u32, y: u32) {
        // Sum of the squares below n.
        let squares = |n: u64| n * n.saturating_sub(1) * (2 * n).saturating_sub(1) / 6;
        let start = u64::from(start);
        let end = u64::from(end);
        let y = u64::from(y);
        let pixels = end - start;
        let sum_x = (start + end).saturating_sub(1) * pixels / 2;
        self.pixels += pixels;
        self.sum_x += sum_x;
        self.sum_y += y * pixels;
        self.sum_xx += squares(end) - squares(start);
        self.sum_yy += y * y * pixels;
        self.sum_xy += y * sum_x;
    }

    pub(crate) fn absorb(&mut self, other: &Moments) {
        self.pixels += other.pixels;
        self.sum_x += other.sum_x;
        self.sum_y += other.sum_y;
        self.sum_xx += other.sum_xx;
        self.sum_yy += other.sum_yy;
        self.sum_xy += other.sum_xy;
    }

    pub(crate) fn centroid(&self) -> (f64, f64) {
        let pixels = self.pixels as f64;
        (self.sum_x as f64 / pixels, self.sum_y as f64 / pixels)
    }

    /// The ellipse with the same second moments: the direction of its major axis in radians, 0..pi, from
    /// x towards y, and its roundness, the smaller moment divided by the larger one, 0..1; 0 for a line
    /// and for a single pixel.
    pub(crate) fn axes(&self) -> (f64, f64) {
        let (cx, cy) = self.centroid();
        let pixels = self.pixels as f64;
        let xx = self.sum_xx as f64 / pixels - cx * cx;
        let yy = self.sum_yy as f64 / pixels - cy * cy;
        let xy = self.sum_xy as f64 / pixels - cx * cy;
        let mean = (xx + yy) / 2.0;
        let spread = ((xx - yy) / 2.0).hypot(xy);
        let rotation = (0.5 * (2.0 * xy).atan2(xx - yy)).rem_euclid(std::f64::consts::PI);
        let roundness = if mean > 1e-9 {
            ((mean - spread) / (mean + spread)).clamp(0.0, 1.0)
        } else {
            0.0
        };
        (rotation, roundness)
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::f64::consts::PI;

    use image::{GrayImage, Luma};
    use imageproc::region_labelling::{Connectivity, connected_components};
    use proptest::prelude::*;

    use super::*;

    fn scan(regions: &mut Regions, mask: &GrayImage) {
        let window = Roi {
            x: 0,
            y: 0,
            w: mask.width(),
            h: mask.height(),
        };
        let width = mask.width() as usize;
        regions.scan(window, |y, row| {
            row.copy_from_slice(&mask.as_raw()[y as usize * width..][..width]);
            Spans::ALL
        });
    }

    /// Label, perimeter, box and moments of each region, computed slowly from imageproc's labels.
    type Facts = (u8, u64, [u32; 4], Moments);

    fn expected(mask: &GrayImage) -> Vec<Facts> {
        let mut facts: Vec<Facts> = (1..=3).flat_map(|label| of_label(mask, label)).collect();
        facts.sort_by_key(|facts| format!("{facts:?}"));
        facts
    }

    /// imageproc's union-find is too small for more than two values or for a single row, so it gets
    /// one label at a time, with a border around it.
    fn of_label(mask: &GrayImage, label: u8) -> Vec<Facts> {
        let alone = GrayImage::from_fn(mask.width() + 2, mask.height() + 2, |x, y| {
            let pixel = x
                .checked_sub(1)
                .zip(y.checked_sub(1))
                .and_then(|(x, y)| mask.get_pixel_checked(x, y));
            Luma([u8::from(pixel == Some(&Luma([label])))])
        });
        let labels = connected_components(&alone, Connectivity::Eight, Luma([0]));
        let mut regions: BTreeMap<u32, Facts> = BTreeMap::new();
        for (x, y, &Luma([region])) in labels
            .enumerate_pixels()
            .filter(|(_, _, region)| region.0[0] != 0)
        {
            let neighbours = [(x - 1, y), (x + 1, y), (x, y - 1), (x, y + 1)];
            let enclosed = neighbours
                .iter()
                .all(|&(x, y)| labels.get_pixel(x, y).0[0] == region);
            let x = x - 1;
            let y = y - 1;
            let facts =
                regions
                    .entry(region)
                    .or_insert((label, 0, [x, y, x, y], Moments::default()));
            facts.1 += u64::from(!enclosed);
            facts.2 = [
                facts.2[0].min(x),
                facts.2[1].min(y),
                facts.2[2].max(x),
                facts.2[3].max(y),
            ];
            facts.3.add_run(x, x + 1, y);
        }
        regions.into_values().collect()
    }

    fn found(mask: &GrayImage) -> Vec<Facts> {
        let mut regions = Regions::default();
        scan(&mut regions, &GrayImage::from_pixel(9, 9, Luma([7])));
        scan(&mut regions, mask);
        regions.measure_perimeters(|_| true);
        let facts = |(_, region): (u32, &Region)| {
            let border = [region.left, region.top, region.right, region.bottom];
            (region.label, region.perimeter, border, region.moments)
        };
        let mut facts: Vec<Facts> = regions.found().map(facts).collect();
        facts.sort_by_key(|facts| format!("{facts:?}"));
        facts
    }

    proptest! {
        /// Counts, boxes, centroids, second moments and perimeters, on noise of every density with
        /// up to three labels, in sizes around the eight labels that are compared at a time.
        #[test]
        fn regions_equal_those_of_plain_labelling(
            (width, height) in (1u32..40, 1u32..24),
            share in 1u8..=10,
            labels in 1u8..=3,
            noise in proptest::collection::vec(any::<(u8, u8)>(), 40 * 24),
        ) {
            let mask = GrayImage::from_fn(width, height, |x, y| {
                let (chance, label) = noise[(y * width + x) as usize];
                Luma([if chance % 10 < share { label % labels + 1 } else { 0 }])
            });
            prop_assert_eq!(found(&mask), expected(&mask));
        }
    }

    #[test]
    fn a_spiral_is_one_region() {
        let rows = [
            "#######", "#.....#", "#.###.#", "#.#...#", "#.#####", "#......",
        ];
        let mask = GrayImage::from_fn(7, 6, |x, y| {
            Luma([u8::from(rows[y as usize].as_bytes()[x as usize] == b'#')])
        });
        assert_eq!(found(&mask).len(), 1);
        assert_eq!(found(&mask), expected(&mask));
    }

    fn of(points: &[(u32, u32)]) -> Moments {
        let mut moments = Moments::default();
        points
            .iter()
            .for_each(|&(x, y)| moments.add_run(x, x + 1, y));
        moments
    }

    #[test]
    fn lines_have_their_direction_and_no_roundness() {
        let line = |dx: u32, dy: u32| of(&[0, 1, 2, 3].map(|i| (10 + i * dx, 10 + i * dy))).axes();
        assert_eq!(line(1, 0), (0.0, 0.0));
        assert!((line(1, 1).0 - PI / 4.0).abs() < 1e-9);
        assert!((line(0, 1).0 - PI / 2.0).abs() < 1e-9);
        assert!(line(1, 1).1 < 1e-9);
    }

    #[test]
    fn a_square_is_round_and_a_pixel_has_no_shape() {
        let mut square = Moments::default();
        (10..20).for_each(|y| square.add_run(30, 40, y));
        assert!((square.axes().1 - 1.0).abs() < 1e-9);
        assert_eq!(of(&[(5, 5)]).axes().1, 0.0);
    }
}
