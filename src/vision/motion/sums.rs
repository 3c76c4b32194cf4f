//! Box sums: sums over the surroundings of every pixel of the half-size picture.

/// Half the side of a box: this many pixels on each side of the pixel.
pub(super) const REACH: usize = 7;

/// Number of columns and rows of the half-size picture.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq)]
pub(super) struct Size2 {
    pub(super) w: usize,
    pub(super) h: usize,
}

/// Sums over a square around every pixel; at the border the square is clipped.
#[derive(Debug, Default)]
pub(super) struct BoxSums {
    pub(super) sums: Vec<u32>,
    columns: Vec<u32>,
}

impl BoxSums {
    /// Computes the sums with two running sums: down every column, then along every row.
    pub(super) fn sum(&mut self, values: &[u8], Size2 { w, h }: Size2) {
        self.sums.clear();
        self.columns.clear();
        self.columns.resize(w, 0);
        let row = |y: usize| &values[y * w..][..w];
        for y in 0..REACH.min(h) {
            self.columns
                .iter_mut()
                .zip(row(y))
                .for_each(|(sum, value)| *sum += u32::from(*value));
        }
        for y in 0..h {
            if y + REACH < h {
                self.columns
                    .iter_mut()
                    .zip(row(y + REACH))
                    .for_each(|(sum, value)| *sum += u32::from(*value));
            }
            if y > REACH {
                self.columns
                    .iter_mut()
                    .zip(row(y - REACH - 1))
                    .for_each(|(sum, value)| *sum -= u32::from(*value));
            }
            let columns = &self.columns;
            let mut sum: u32 = columns.iter().take(REACH).sum();
            self.sums.extend((0..w).map(|x| {
                sum += columns.get(x + REACH).copied().unwrap_or(0);
                sum -= x.checked_sub(REACH + 1).map_or(0, |left| columns[left]);
                sum
            }));
        }
    }
}
