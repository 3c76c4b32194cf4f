//! Solves small systems of linear equations.

/// A symmetric matrix, stored row by row.
pub(super) struct Symmetric {
    pub(super) size: usize,
    pub(super) cells: Vec<f64>,
}

impl Symmetric {
    pub(super) fn zero(size: usize) -> Symmetric {
        Symmetric {
            size,
            cells: vec![0.0; size * size],
        }
    }

    pub(super) fn add(&mut self, row: usize, column: usize, value: f64) {
        self.cells[row * self.size + column] += value;
    }

    pub(super) fn at(&self, row: usize, column: usize) -> f64 {
        self.cells[row * self.size + column]
    }

    /// Solves the system with this matrix and the right-hand side `right` by Cholesky
    /// decomposition; `None` if the matrix is not positive definite.
    pub(super) fn solve(&self, right: &[f64]) -> Option<Vec<f64>> {
        let size = self.size;
        let mut lower = vec![0.0; size * size];
        for row in 0..size {
            for column in 0..=row {
                let done: f64 = (0..column)
                    .map(|k| lower[row * size + k] * lower[column * size + k])
                    .sum();
                let rest = self.at(row, column) - done;
                lower[row * size + column] = if row == column {
                    if rest.is_nan() || rest <= 0.0 {
                        return None;
                    }
                    rest.sqrt()
                } else {
                    rest / lower[column * size + column]
                };
            }
        }
        let mut found = right.to_vec();
        for row in 0..size {
            let done: f64 = (0..row).map(|k| lower[row * size + k] * found[k]).sum();
            found[row] = (found[row] - done) / lower[row * size + row];
        }
        for row in (0..size).rev() {
            let done: f64 = (row + 1..size)
                .map(|k| lower[k * size + row] * found[k])
                .sum();
            found[row] = (found[row] - done) / lower[row * size + row];
        }
        Some(found)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_positive_definite_system_is_solved_and_others_are_not() {
        let matrix = Symmetric {
            size: 2,
            cells: vec![4.0, 1.0, 1.0, 3.0],
        };
        let found = matrix.solve(&[1.0, 2.0]).unwrap();
        assert!((found[0] - 1.0 / 11.0).abs() < 1e-12 && (found[1] - 7.0 / 11.0).abs() < 1e-12);
        assert_eq!(Symmetric::zero(2).solve(&[1.0, 2.0]), None);
    }
}
