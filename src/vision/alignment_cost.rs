//! Estimates how far the QR code reader would search for the alignment pattern of a code, given
//! three finder patterns. It searches outward from the expected position, and the worse the three
//! patterns fit together, the farther: with some skewed patterns this takes seconds. Such patterns
//! are therefore removed beforehand.

/// A position in a picture.
pub(super) type Place = (f64, f64);

/// A finder pattern, 7 modules wide and possibly skewed: its corners in order.
#[derive(Debug, Clone, Copy)]
pub(super) struct Square {
    corners: [Place; 4],
}

/// Steps of the fixed work for every triple of patterns that roughly fits.
const FIXED: f64 = 20_000.0;
/// Two distances count as equal if they differ by less than this share of the larger one.
const MAX_DIFFERENCE: f64 = 0.25;

impl Square {
    /// A pattern with these corners, in order.
    pub(super) fn new(corners: [Place; 4]) -> Square {
        Square { corners }
    }

    /// The same pattern, starting with the corner that is farthest to one side of a line.
    fn turned_to_side(self, through: Place, along: Place) -> Square {
        let side = |(x, y): Place| (y - through.1) * along.0 - (x - through.0) * along.1;
        let mut corners = self.corners;
        let at = |corner: &usize| side(self.corners[*corner]);
        let first = (0..corners.len()).min_by(|a, b| at(a).total_cmp(&at(b)));
        corners.rotate_left(first.unwrap_or(0));
        Square { corners }
    }

    /// The projective transforms from modules to positions and back.
    fn view(&self) -> View {
        let [(x0, y0), (x1, y1), (x2, y2), (x3, y3)] = self.corners;
        let (dx1, dx2, sx) = (x1 - x2, x3 - x2, x0 - x1 + x2 - x3);
        let (dy1, dy2, sy) = (y1 - y2, y3 - y2, y0 - y1 + y2 - y3);
        let det = dx1 * dy2 - dx2 * dy1;
        let (g, h) = ((sx * dy2 - dx2 * sy) / det, (dx1 * sy - sx * dy1) / det);
        let (a, b) = (x1 - x0 + g * x1, x3 - x0 + h * x3);
        let (d, e) = (y1 - y0 + g * y1, y3 - y0 + h * y3);
        let to = [[a, b, x0], [d, e, y0], [g, h, 1.0]];
        let minor = |r: usize, c: usize| {
            let (r1, r2, c1, c2) = ((r + 1) % 3, (r + 2) % 3, (c + 1) % 3, (c + 2) % 3);
            to[r1][c1] * to[r2][c2] - to[r1][c2] * to[r2][c1]
        };
        let row = |c: usize| [minor(0, c), minor(1, c), minor(2, c)];
        View {
            to,
            back: [row(0), row(1), row(2)],
        }
    }
}

struct View {
    to: [[f64; 3]; 3],
    back: [[f64; 3]; 3],
}

fn apply(matrix: &[[f64; 3]; 3], (x, y): Place) -> Place {
    let row = |row: &[f64; 3]| row[0] * x + row[1] * y + row[2];
    let by = row(&matrix[2]);
    (row(&matrix[0]) / by, row(&matrix[1]) / by)
}

impl View {
    fn place(&self, (u, v): Place) -> Place {
        apply(&self.to, (u / 7.0, v / 7.0))
    }

    fn modules(&self, place: Place) -> Place {
        let (u, v) = apply(&self.back, place);
        (u * 7.0, v * 7.0)
    }

    fn middle(&self) -> Place {
        self.place((3.5, 3.5))
    }
}

/// Each triple of patterns that the reader would try, with its estimated steps.
pub(super) fn candidate_triples(squares: &[Square]) -> Vec<([usize; 3], f64)> {
    let views: Vec<View> = squares.iter().map(Square::view).collect();
    let mut triples = Vec::new();
    for (middle, view) in views.iter().enumerate() {
        let (mut along, mut across) = (Vec::new(), Vec::new());
        for other in (0..squares.len()).filter(|other| *other != middle) {
            let (u, v) = view.modules(views[other].middle());
            let (u, v) = ((u - 3.5).abs(), (v - 3.5).abs());
            // NaN counts as both: such patterns are removed later as the most expensive ones.
            if u < 0.2 * v || u.is_nan() {
                along.push((other, v));
            }
            if v < 0.2 * u || v.is_nan() {
                across.push((other, u));
            }
        }
        for &(one, far) in &along {
            for &(other, wide) in &across {
                let difference = 1.0 - far.min(wide) / far.max(wide);
                if difference < MAX_DIFFERENCE || difference.is_nan() {
                    let three = [one, middle, other];
                    triples.push((three, steps(three, squares, &views)));
                }
            }
        }
    }
    triples
}

/// Estimated steps of the search with this triple; the second pattern is the corner between the
/// others.
fn steps([one, middle, other]: [usize; 3], squares: &[Square], views: &[View]) -> f64 {
    let (mut first, mut last) = (one, other);
    let origin = views[first].middle();
    let far = views[last].middle();
    let mut along = (far.0 - origin.0, far.1 - origin.1);
    let (x, y) = views[middle].middle();
    if (y - origin.1) * along.0 - (x - origin.0) * along.1 > 0.0 {
        std::mem::swap(&mut first, &mut last);
        along = (-along.0, -along.1);
    }
    let first = squares[first].turned_to_side(origin, along);
    let last = squares[last].turned_to_side(origin, along);
    let Some(seed) = crossing(
        (first.corners[0], first.corners[1]),
        (last.corners[0], last.corners[3]),
    ) else {
        return FIXED;
    };
    let beside = |view: &View, by: Place| {
        let (u, v) = view.modules(seed);
        let (x, y) = view.place((u + by.0, v + by.1));
        (x - seed.0, y - seed.1)
    };
    let (a, c) = (
        beside(&first.view(), (0.0, 1.0)),
        beside(&last.view(), (1.0, 0.0)),
    );
    let module = (a.1 * c.0 - a.0 * c.1).abs();
    FIXED + 100.0 * module
}

fn crossing((p0, p1): (Place, Place), (q0, q1): (Place, Place)) -> Option<Place> {
    let (p, q) = ((p1.0 - p0.0, p1.1 - p0.1), (q1.0 - q0.0, q1.1 - q0.1));
    let det = p.0 * q.1 - p.1 * q.0;
    let along = ((q0.0 - p0.0) * q.1 - (q0.1 - p0.1) * q.0) / det;
    (det != 0.0).then(|| ((p0.0 + along * p.0).trunc(), (p0.1 + along * p.1).trunc()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(x: f64, y: f64, side: f64) -> Square {
        Square::new([(x, y), (x + side, y), (x + side, y + side), (x, y + side)])
    }

    #[test]
    fn a_position_survives_the_round_trip_through_a_view() {
        let skewed = Square::new([(10.0, 10.0), (50.0, 14.0), (46.0, 52.0), (8.0, 40.0)]);
        let view = skewed.view();
        assert!(view.place((7.0, 7.0)).0 - 46.0 < 1e-9);
        let (u, v) = view.modules(view.place((3.0, 20.0)));
        assert!((u - 3.0).abs() < 1e-9 && (v - 20.0).abs() < 1e-9);
    }

    #[test]
    fn three_corners_of_a_code_cost_little_and_no_square_makes_the_sum_invalid() {
        let [one, two, three] =
            [(0.0, 0.0), (200.0, 0.0), (0.0, 200.0)].map(|(x, y)| square(x, y, 21.0));
        let cheap: f64 = candidate_triples(&[one, two, three])
            .iter()
            .map(|(_, steps)| steps)
            .sum();
        assert!((FIXED..4.0 * FIXED).contains(&cheap), "{cheap}");
        // Degenerate patterns give NaN or no triple at all, but no panic and no negative sum.
        let flat = Square::new([(60.0, 0.0); 4]);
        let line = Square::new([(0.0, 60.0), (9.0, 60.0), (12.0, 60.0), (20.0, 60.0)]);
        for squares in [[one, flat, three], [one, two, line], [flat, line, flat]] {
            let sum: f64 = candidate_triples(&squares)
                .iter()
                .map(|(_, steps)| steps)
                .sum();
            assert!(sum.is_nan() || sum >= 0.0, "{sum}");
        }
    }
}
