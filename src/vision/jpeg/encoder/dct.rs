//! The forward discrete cosine transform.

/// Number of rows and of columns of a block.
pub(super) const SIDE: usize = 8;

/// A block as rows of columns; after the transform, horizontal coefficients of vertical ones.
pub(super) type Block = [[f32; SIDE]; SIDE];

/// Transforms every column at once; the results are scaled by [`scale`] (Arai, Agui and Nakajima,
/// 1988).
pub(super) fn transform(block: &mut Block) {
    const COS_2: f32 = 0.382_683_43;
    const COS_4: f32 = std::f32::consts::FRAC_1_SQRT_2;
    #[expect(clippy::needless_range_loop, reason = "every row has the column")]
    for column in 0..SIDE {
        let (a, b) = (block[0][column], block[1][column]);
        let (c, d) = (block[2][column], block[3][column]);
        let (e, f) = (block[4][column], block[5][column]);
        let (g, h) = (block[6][column], block[7][column]);
        let outer = [a + h, b + g, c + f, d + e];
        let [s0, s1, s2, s3] = [d - e, c - f, b - g, a - h];
        let (p0, p3) = (outer[0] + outer[3], outer[0] - outer[3]);
        let (p1, p2) = (outer[1] + outer[2], outer[1] - outer[2]);
        let turned = (p2 + p3) * COS_4;
        let (q0, q1, q2) = (s0 + s1, s1 + s2, s2 + s3);
        let shared = (q0 - q2) * COS_2;
        let low = q0 * 0.541_196_1 + shared;
        let high = q2 * 1.306_563 + shared;
        let middle = q1 * COS_4;
        let (near, far) = (s3 + middle, s3 - middle);
        let coefficients = [
            p0 + p1,
            near + high,
            p3 + turned,
            far - low,
            p0 - p1,
            far + low,
            p3 - turned,
            near - high,
        ];
        for (row, coefficient) in coefficients.into_iter().enumerate() {
            block[row][column] = coefficient;
        }
    }
}

/// The transposed block.
pub(super) fn transposed(block: &Block) -> Block {
    std::array::from_fn(|i| std::array::from_fn(|j| block[j][i]))
}

/// The factor by which [`transform`] makes a coefficient too large.
pub(super) fn scale(coefficient: usize) -> f64 {
    let angle = coefficient as f64 * std::f64::consts::PI / 16.0;
    let scale = if coefficient == 0 {
        1.0
    } else {
        angle.cos() * std::f64::consts::SQRT_2
    };
    scale * 8f64.sqrt()
}
