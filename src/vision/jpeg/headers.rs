//! Parses the headers of a baseline JPEG whose markers have been validated: its tables, and which
//! component uses which table.

use super::frame::{FrameError, Segment, Segments};
use super::huffman::{STANDARD_TABLES, Table};
use super::idct;

const RARE_SAMPLING: &str = "a sampling that cameras do not use";
const SEVERAL_SCANS: &str = "several scans";

/// Luma, Cb or Cr, as described by the frame header.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Component {
    id: u8,
    /// Horizontal and vertical sampling factors: blocks of the component in an MCU (T.81: H and V).
    pub(super) h: u32,
    pub(super) v: u32,
    pub(super) quantiser: usize,
    pub(super) dc_table: usize,
    pub(super) ac_table: usize,
}

/// A quantisation table in its [`scaled`](idct::scaled) form.
#[derive(Debug, Clone)]
pub(super) struct Quantiser {
    source: [u16; 64],
    pub(super) scaled: [i32; 64],
    pub(super) present: bool,
}

impl Default for Quantiser {
    fn default() -> Self {
        Quantiser {
            source: [0; 64],
            scaled: [0; 64],
            present: false,
        }
    }
}

impl Quantiser {
    fn load(&mut self, source: [u16; 64]) {
        self.present = true;
        if self.source != source {
            self.scaled = idct::scaled(&source);
            self.source = source;
        }
    }
}

/// The headers of a frame. Tables are kept from frame to frame: an unchanged table is not rebuilt.
#[derive(Debug, Clone, Default)]
pub(super) struct Headers {
    pub(super) quantisers: [Quantiser; 4],
    /// The tables of DC and of AC coefficients.
    pub(super) tables: [[Table; 4]; 2],
    /// Which tables the current frame has defined: DC, AC.
    present: [[bool; 4]; 2],
    pub(super) components: Vec<Component>,
    /// MCUs between restart markers; 0 for none.
    pub(super) restart_interval: usize,
}

impl Headers {
    /// Parses everything before the data. Returns where the data begins.
    pub(super) fn read(&mut self, jpeg: &[u8]) -> Result<usize, FrameError> {
        self.forget();
        let mut has_tables = false;
        let mut segments = Segments::new(jpeg);
        loop {
            let segment = segments.next()?;
            match segment.marker {
                0xC0 | 0xC1 => self.read_frame(segment.body)?,
                0xC4 => {
                    has_tables = true;
                    self.read_tables(segment.body)?;
                }
                0xDB => self.read_quantisers(segment.body)?,
                0xDD => self.read_restart_interval(segment.body)?,
                0xDA => {
                    // MJPEG cameras omit the Huffman tables.
                    if !has_tables {
                        self.read_tables(&STANDARD_TABLES[4..])?;
                    }
                    break self.read_scan(segment)?;
                }
                0xC2..=0xCF => return Err(FrameError::Unsupported("not baseline")),
                // The last byte is 1 for luma, Cb and Cr.
                0xEE if segment.body.starts_with(b"Adobe") && segment.body.get(11) != Some(&1) => {
                    return Err(FrameError::Unsupported(
                        "colours other than luma, Cb and Cr",
                    ));
                }
                _ => {}
            }
        }
        Ok(segments.at)
    }

    fn forget(&mut self) {
        for quantiser in &mut self.quantisers {
            quantiser.present = false;
        }
        self.present = Default::default();
        self.components.clear();
        self.restart_interval = 0;
    }

    fn read_frame(&mut self, body: &[u8]) -> Result<(), FrameError> {
        let &[_, _, _, _, _, count, ref rest @ ..] = body else {
            return Err(FrameError::damaged("its size header is too short"));
        };
        self.components.clear();
        let (parts, _) = rest.as_chunks::<3>();
        if !matches!(count, 1 | 3) || parts.len() < usize::from(count) {
            return Err(FrameError::Unsupported("neither grey nor colour"));
        }
        for &[id, factors, quantiser] in &parts[..usize::from(count)] {
            let h = u32::from(factors >> 4);
            let v = u32::from(factors & 15);
            if !matches!(h, 1 | 2 | 4) || !matches!(v, 1 | 2 | 4) || quantiser > 3 {
                return Err(FrameError::Unsupported(RARE_SAMPLING));
            }
            let quantiser = usize::from(quantiser);
            self.components.push(Component {
                id,
                h,
                v,
                quantiser,
                ..Component::default()
            });
        }
        self.check_factors(count)
    }

    /// Checks that luma has the finest sampling. A single component has MCUs of one block.
    fn check_factors(&mut self, count: u8) -> Result<(), FrameError> {
        let finest = self.components[0];
        if count == 1 {
            (self.components[0].h, self.components[0].v) = (1, 1);
        }
        let coarser = |part: &Component| part.h <= finest.h && part.v <= finest.v;
        if self.components.iter().all(coarser) {
            Ok(())
        } else {
            Err(FrameError::Unsupported(RARE_SAMPLING))
        }
    }

    fn read_quantisers(&mut self, mut body: &[u8]) -> Result<(), FrameError> {
        while let Some((&kind, rest)) = body.split_first() {
            let wide = kind >> 4 == 1;
            let index = usize::from(kind & 15);
            let len = if wide { 128 } else { 64 };
            if kind >> 4 > 1 || index > 3 || rest.len() < len {
                return Err(FrameError::damaged("a quantisation table is cut short"));
            }
            let value = |at: usize| {
                if wide {
                    u16::from_be_bytes([rest[2 * at], rest[2 * at + 1]])
                } else {
                    rest[at].into()
                }
            };
            self.quantisers[index].load(std::array::from_fn(value));
            body = &rest[len..];
        }
        Ok(())
    }

    fn read_tables(&mut self, mut body: &[u8]) -> Result<(), FrameError> {
        while let Some((&kind, rest)) = body.split_first() {
            let class = usize::from(kind >> 4);
            let index = usize::from(kind & 15);
            let Some((counts, rest)) = rest.split_first_chunk::<16>() else {
                return Err(FrameError::damaged("a table is cut short"));
            };
            let len: usize = counts.iter().copied().map(usize::from).sum();
            if class > 1 || index > 3 || rest.len() < len {
                return Err(FrameError::damaged("a Huffman table is cut short"));
            }
            if !self.tables[class][index].load(class == 1, counts, &rest[..len]) {
                return Err(FrameError::damaged("a Huffman table is inconsistent"));
            }
            self.present[class][index] = true;
            body = &rest[len..];
        }
        Ok(())
    }

    fn read_restart_interval(&mut self, body: &[u8]) -> Result<(), FrameError> {
        let &[high, low, ..] = body else {
            return Err(FrameError::damaged("a restart interval is cut short"));
        };
        self.restart_interval = usize::from(u16::from_be_bytes([high, low]));
        Ok(())
    }

    /// Reads which tables each component uses. This single scan must contain all components in
    /// their order.
    fn read_scan(&mut self, segment: Segment<'_>) -> Result<(), FrameError> {
        let Some((&count, rest)) = segment.body.split_first() else {
            return Err(FrameError::damaged("its scan header is empty"));
        };
        let (parts, _) = rest.as_chunks::<2>();
        if usize::from(count) != self.components.len() || parts.len() < usize::from(count) {
            return Err(FrameError::Unsupported(SEVERAL_SCANS));
        }
        for (component, &[id, tables]) in self.components.iter_mut().zip(parts) {
            (component.dc_table, component.ac_table) =
                (usize::from(tables >> 4), usize::from(tables & 15));
            if id != component.id || component.dc_table > 3 || component.ac_table > 3 {
                return Err(FrameError::Unsupported(SEVERAL_SCANS));
            }
            if !self.present[0][component.dc_table] || !self.present[1][component.ac_table] {
                return Err(FrameError::damaged("a Huffman table is missing"));
            }
        }
        Ok(())
    }
}
