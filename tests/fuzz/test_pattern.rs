//! Paints adversarial test images from arbitrary bytes: finder patterns of QR codes, lattices of
//! them, rings, chequers, noise, lines of text. Used by fuzz targets and a test.

/// Sizes of the images, up to the largest that a camera may send.
const SIZES: [(usize, usize); 4] = [(320, 240), (160, 120), (640, 480), (317, 241)];
/// Bytes of one stroke: kind, place, size, count and shade.
const STROKE: usize = 6;
/// Maximum number of strokes; further ones are ignored.
const MAX_STROKES: usize = 400;

/// A greyscale image.
pub struct TestPattern {
    pub width: usize,
    pub height: usize,
    pub pixels: Vec<u8>,
}

/// Paints the image described by these bytes.
pub fn paint(bytes: &[u8]) -> TestPattern {
    let (first, strokes) = bytes.split_first().unwrap_or((&0, &[]));
    let (width, height) = SIZES[usize::from(*first) % SIZES.len()];
    let mut test_pattern = TestPattern {
        width,
        height,
        pixels: vec![235; width * height],
    };
    for stroke in strokes.chunks_exact(STROKE).take(MAX_STROKES) {
        let &[what, x, y, large, many, shade] = stroke else {
            continue;
        };
        let at = (usize::from(x) * width / 256, usize::from(y) * height / 256);
        test_pattern.stroke(what % 8, at, usize::from(large), usize::from(many), shade);
    }
    test_pattern
}

impl TestPattern {
    fn stroke(&mut self, what: u8, at: (usize, usize), large: usize, many: usize, shade: u8) {
        let module = large % 9 + 1;
        match what {
            0 => self.corner(at, module, shade),
            1 => self.lattice(at, module, many % 12 + 2, shade),
            2 => self.rings(at, module, many % 16 + 2, shade),
            3 => self.chequers(at, module, many * 2, shade),
            4 => self.noise(at, many, u64::from(shade) << 8 | large as u64),
            5 => self.text(at, module, many, shade),
            6 => self.code(at, module, many % 40 + 21, shade),
            _ => self.leaning(at, module, many % 40, shade),
        }
    }

    fn dot(&mut self, x: usize, y: usize, shade: u8) {
        if x < self.width && y < self.height {
            self.pixels[y * self.width + x] = shade;
        }
    }

    fn block(&mut self, (x, y): (usize, usize), w: usize, h: usize, shade: u8) {
        for row in y..(y + h).min(self.height) {
            for column in x..(x + w).min(self.width) {
                self.dot(column, row, shade);
            }
        }
    }

    /// Draws a finder pattern, one of the three squares at the corners of a code.
    fn corner(&mut self, (x, y): (usize, usize), module: usize, shade: u8) {
        self.block((x, y), 7 * module, 7 * module, shade);
        self.block((x + module, y + module), 5 * module, 5 * module, 235);
        self.block(
            (x + 2 * module, y + 2 * module),
            3 * module,
            3 * module,
            shade,
        );
    }

    fn lattice(&mut self, (x, y): (usize, usize), module: usize, many: usize, shade: u8) {
        for (row, column) in (0..many).flat_map(|row| (0..many).map(move |column| (row, column))) {
            self.corner(
                (x + column * 9 * module, y + row * 9 * module),
                module,
                shade,
            );
        }
    }

    fn rings(&mut self, (x, y): (usize, usize), module: usize, many: usize, shade: u8) {
        for ring in 0..many {
            let side = (2 * (many - ring)).saturating_sub(1) * module;
            let grey = if ring.is_multiple_of(2) { shade } else { 235 };
            self.block((x + ring * module, y + ring * module), side, side, grey);
        }
    }

    fn chequers(&mut self, (x, y): (usize, usize), module: usize, side: usize, shade: u8) {
        for row in y..(y + side).min(self.height) {
            for column in x..(x + side).min(self.width) {
                if (column / module + row / module).is_multiple_of(2) {
                    self.dot(column, row, shade);
                }
            }
        }
    }

    fn noise(&mut self, (x, y): (usize, usize), side: usize, seed: u64) {
        let mut state = seed | 1;
        for row in y..(y + side).min(self.height) {
            for column in x..(x + side).min(self.width) {
                state = state
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1_442_695_040_888_963_407);
                self.dot(column, row, (state >> 56) as u8);
            }
        }
    }

    /// Draws letter-like bars, line by line.
    fn text(&mut self, (x, y): (usize, usize), module: usize, many: usize, shade: u8) {
        for letter in 0..many {
            let line = letter / 20;
            let place = letter % 20;
            let left = x + place * 4 * module;
            let top = y + line * 9 * module;
            self.block((left, top), module, 7 * module, shade);
            self.block(
                (left, top + 3 * module * (letter % 3)),
                3 * module,
                module,
                shade,
            );
        }
    }

    /// Draws three finder patterns with timing patterns, and noise between them.
    fn code(&mut self, (x, y): (usize, usize), module: usize, size: usize, shade: u8) {
        let mut state = size as u64;
        for (row, column) in (0..size).flat_map(|row| (0..size).map(move |column| (row, column))) {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            let timing = row == 6 || column == 6;
            let dark = if timing {
                (row + column).is_multiple_of(2)
            } else {
                state >> 63 == 1
            };
            if dark {
                self.block(
                    (x + column * module, y + row * module),
                    module,
                    module,
                    shade,
                );
            }
        }
        let far = (size - 7) * module;
        for (left, top) in [(0, 0), (far, 0), (0, far)] {
            self.block((x + left, y + top), 8 * module, 8 * module, 235);
            self.corner((x + left, y + top), module, shade);
        }
    }

    /// Draws a finder pattern whose rows are shifted and shrink towards the top, as in perspective.
    fn leaning(&mut self, (x, y): (usize, usize), module: usize, lean: usize, shade: u8) {
        let side = 7 * module;
        for row in 0..side {
            let wide = (side * (40 - lean) + row * lean) / 40;
            for column in 0..wide {
                let u = column * 7 / wide.max(1);
                let v = row / module;
                let ring = u == 0 || v == 0 || u == 6 || v == 6;
                let inner = (2..5).contains(&u) && (2..5).contains(&v);
                let grey = if ring || inner { shade } else { 235 };
                self.dot(x + column + (side - row) * lean / 40, y + row, grey);
            }
        }
    }
}
