//! Decodes what cameras send, baseline JPEG in one scan, straight into planes that are reused.
//!
//! Nothing is allocated once warm, brightness and colour stay apart as they are in the frame, and
//! data that ends early, goes on too long or makes no sense is an error, where other decoders show
//! half a picture. What is rarer (progressive, CMYK, several scans) is [`Unsure::Rarer`]: somebody
//! else's work.

use std::ops::Range;

use super::bits::{Bits, Cursor, Scan};
use super::frame::{FrameError, Segment, Segments};
use super::huffman::{STANDARD_TABLES, Table};
use super::idct;
use crate::vision::picture::image::{Image, Plane};
use crate::vision::picture::size::Size;

/// Most bytes that may be left over when all blocks are decoded; some cameras pad.
const MOST_LEFT_OVER: i64 = 16;

/// Bits that a block cannot exceed: 64 values, a code of 16 and 11 of their own each.
const MOST_OF_A_BLOCK: usize = 64 * (16 + 11);

/// Why a frame was not decoded here.
#[derive(Debug)]
pub(crate) enum Unsure {
    /// A kind that is not decoded here, but may be sound.
    Rarer,
    /// It is broken.
    Broken(FrameError),
}

impl From<FrameError> for Unsure {
    fn from(error: FrameError) -> Unsure {
        Unsure::Broken(error)
    }
}

fn broken(what: &str) -> Unsure {
    Unsure::Broken(FrameError::damaged(what))
}

/// One of brightness, blueness and redness, as the frame's headers describe it.
#[derive(Debug, Clone, Copy, Default)]
struct Component {
    id: u8,
    /// Blocks of it in a unit, across and down.
    across: u32,
    down: u32,
    quantiser: usize,
    /// Huffman tables of first and other frequencies.
    first: usize,
    others: usize,
}

/// Tables and buffers that live from frame to frame.
#[derive(Debug, Clone, Default)]
pub(crate) struct Baseline {
    quantisers: [Option<[i32; 64]>; 4],
    firsts: [Table; 4],
    others: [Table; 4],
    /// Which of the tables this frame has brought.
    have: [[bool; 4]; 2],
    components: Vec<Component>,
    size: Option<Size>,
    /// Units between restart markers; 0 for none.
    interval: usize,
    scan: Scan,
    /// The frame whose end has not come yet.
    ahead: Option<Progress>,
    /// All that has come of it.
    beginning: Vec<u8>,
}

/// How far a frame is decoded.
#[derive(Debug, Clone, Copy, Default)]
struct Progress {
    /// Bytes of the frame that the scan has taken.
    taken: usize,
    cursor: Cursor,
    /// The next unit.
    unit: usize,
    /// See [`Part`].
    before: [i32; 3],
}

impl Baseline {
    /// Decodes a frame that has been surveyed. On an error the image is whatever it is.
    pub(crate) fn decode(
        &mut self,
        jpeg: &[u8],
        has_tables: bool,
        image: &mut Image,
    ) -> Result<(), Unsure> {
        let start = self.read_headers(jpeg, has_tables)?;
        if self.scan.load(&jpeg[start..])? != 0xD9 {
            return Err(Unsure::Rarer);
        }
        let (units, parts) = self.shape(image, [0; 3])?;
        decode_units(&self.scan, self.interval, units, parts)
    }

    /// Decodes as much as there is of a frame that is still coming, of which the headers have been
    /// surveyed. What cannot be done now is left for later.
    pub(crate) fn look_ahead(&mut self, jpeg: &[u8], has_tables: bool, image: &mut Image) {
        let before = self.ahead.take();
        let known = before.filter(|_| jpeg.starts_with(&self.beginning));
        let progress = match known {
            Some(progress) => Ok(progress),
            None => self.read_headers(jpeg, has_tables).map(|start| Progress {
                taken: start,
                ..Progress::default()
            }),
        };
        self.ahead = progress
            .and_then(|progress| self.advance(jpeg, progress, image))
            .ok();
        self.beginning.clear();
        self.beginning.extend_from_slice(jpeg);
    }

    fn advance(
        &mut self,
        jpeg: &[u8],
        mut progress: Progress,
        image: &mut Image,
    ) -> Result<Progress, Unsure> {
        if self.interval != 0 {
            return Err(Unsure::Rarer);
        }
        progress.taken += self.scan.take(&jpeg[progress.taken..]);
        let ((across, down), mut parts) = self.shape(image, progress.before)?;
        let blocks: usize = parts.iter().map(|part| part.across * part.down).sum();
        let mut bits = self.scan.bits_from(progress.cursor);
        while progress.unit < across * down && bits.left() > (blocks * MOST_OF_A_BLOCK) as i64 {
            decode_unit(&mut bits, &mut parts, progress.unit, across)?;
            progress.unit += 1;
        }
        progress.cursor = bits.cursor();
        progress.before = parts.each_ref().map(|part| part.before);
        Ok(progress)
    }

    /// Decodes the rest of a frame that has been looked at ahead, into the same image; nothing if
    /// this is another one.
    pub(crate) fn finish(&mut self, jpeg: &[u8], image: &mut Image) -> Option<Result<(), Unsure>> {
        let progress = self.ahead.take()?;
        let known = jpeg.starts_with(&self.beginning);
        known.then(|| self.decode_rest(jpeg, progress, image))
    }

    fn decode_rest(
        &mut self,
        jpeg: &[u8],
        progress: Progress,
        image: &mut Image,
    ) -> Result<(), Unsure> {
        if self.scan.load(&jpeg[progress.taken..])? != 0xD9 {
            return Err(Unsure::Rarer);
        }
        if self.scan.intervals() != 1 {
            return Err(broken("a part of its data is missing"));
        }
        let ((across, down), mut parts) = self.shape(image, progress.before)?;
        let bits = self.scan.bits_from(progress.cursor);
        decode_interval(bits, progress.unit..across * down, across, &mut parts)
    }

    /// Reads all that stands before the data; returns where that begins.
    fn read_headers(&mut self, jpeg: &[u8], has_tables: bool) -> Result<usize, Unsure> {
        self.forget();
        if !has_tables {
            self.read_tables(&STANDARD_TABLES[4..])?;
        }
        let mut segments = Segments::of(jpeg);
        loop {
            let segment = segments.next()?;
            match segment.marker {
                0xC0 | 0xC1 => self.read_frame(segment.body)?,
                0xC4 => self.read_tables(segment.body)?,
                0xDB => self.read_quantisers(segment.body)?,
                0xDD => self.read_interval(segment.body)?,
                0xDA => break self.read_scan(segment)?,
                0xC2..=0xCF => return Err(Unsure::Rarer),
                0xEE if segment.body.starts_with(b"Adobe") => return Err(Unsure::Rarer),
                _ => {}
            }
        }
        Ok(segments.at)
    }

    fn forget(&mut self) {
        self.ahead = None;
        self.scan.clear();
        self.quantisers = [None; 4];
        self.have = Default::default();
        self.components.clear();
        self.size = None;
        self.interval = 0;
    }

    fn read_frame(&mut self, body: &[u8]) -> Result<(), Unsure> {
        let &[8, h1, h0, w1, w0, count, ref rest @ ..] = body else {
            return Err(Unsure::Rarer);
        };
        let side = |high, low| u32::from(u16::from_be_bytes([high, low]));
        self.size = Some(Size {
            width: side(w1, w0),
            height: side(h1, h0),
        });
        self.components.clear();
        let (parts, _) = rest.as_chunks::<3>();
        if !matches!(count, 1 | 3) || parts.len() < usize::from(count) {
            return Err(Unsure::Rarer);
        }
        for &[id, factors, quantiser] in &parts[..usize::from(count)] {
            let (across, down) = (u32::from(factors >> 4), u32::from(factors & 15));
            if !matches!(across, 1 | 2 | 4) || !matches!(down, 1 | 2 | 4) || quantiser > 3 {
                return Err(Unsure::Rarer);
            }
            let quantiser = usize::from(quantiser);
            self.components.push(Component {
                id,
                across,
                down,
                quantiser,
                ..Component::default()
            });
        }
        self.check_factors(count)
    }

    /// Brightness must be the finest; alone, it is not divided into units.
    fn check_factors(&mut self, count: u8) -> Result<(), Unsure> {
        let finest = self.components[0];
        if count == 1 {
            (self.components[0].across, self.components[0].down) = (1, 1);
        }
        let coarser = |part: &Component| part.across <= finest.across && part.down <= finest.down;
        if self.components.iter().all(coarser) {
            Ok(())
        } else {
            Err(Unsure::Rarer)
        }
    }

    fn read_quantisers(&mut self, mut body: &[u8]) -> Result<(), Unsure> {
        while let Some((&kind, rest)) = body.split_first() {
            let (wide, index) = (kind >> 4 == 1, usize::from(kind & 15));
            let len = if wide { 128 } else { 64 };
            if kind >> 4 > 1 || index > 3 || rest.len() < len {
                return Err(broken("a quantisation table is cut short"));
            }
            let value = |at: usize| {
                if wide {
                    u16::from_be_bytes([rest[2 * at], rest[2 * at + 1]])
                } else {
                    rest[at].into()
                }
            };
            self.quantisers[index] = Some(idct::scaled(&std::array::from_fn(value)));
            body = &rest[len..];
        }
        Ok(())
    }

    fn read_tables(&mut self, mut body: &[u8]) -> Result<(), Unsure> {
        while let Some((&kind, rest)) = body.split_first() {
            let (class, index) = (usize::from(kind >> 4), usize::from(kind & 15));
            let Some((counts, rest)) = rest.split_first_chunk::<16>() else {
                return Err(broken("a table is cut short"));
            };
            let len: usize = counts.iter().copied().map(usize::from).sum();
            if class > 1 || index > 3 || rest.len() < len {
                return Err(broken("a Huffman table is cut short"));
            }
            let tables = if class == 0 {
                &mut self.firsts
            } else {
                &mut self.others
            };
            if !tables[index].load(counts, &rest[..len]) {
                return Err(broken("a Huffman table contradicts itself"));
            }
            self.have[class][index] = true;
            body = &rest[len..];
        }
        Ok(())
    }

    fn read_interval(&mut self, body: &[u8]) -> Result<(), Unsure> {
        let &[high, low, ..] = body else {
            return Err(broken("a restart interval is cut short"));
        };
        self.interval = usize::from(u16::from_be_bytes([high, low]));
        Ok(())
    }

    /// Which tables each component uses; all components must be in this one scan, in their order.
    fn read_scan(&mut self, segment: Segment<'_>) -> Result<(), Unsure> {
        let Some((&count, rest)) = segment.body.split_first() else {
            return Err(broken("its scan header is empty"));
        };
        let (parts, _) = rest.as_chunks::<2>();
        if usize::from(count) != self.components.len() || parts.len() < usize::from(count) {
            return Err(Unsure::Rarer);
        }
        for (component, &[id, tables]) in self.components.iter_mut().zip(parts) {
            (component.first, component.others) =
                (usize::from(tables >> 4), usize::from(tables & 15));
            if id != component.id || component.first > 3 || component.others > 3 {
                return Err(Unsure::Rarer);
            }
            if !self.have[0][component.first] || !self.have[1][component.others] {
                return Err(broken("a Huffman table is missing"));
            }
        }
        Ok(())
    }

    /// Gives the image its shape; units across and down, and what the blocks after those `before`
    /// need.
    fn shape<'a>(
        &'a self,
        image: &'a mut Image,
        before: [i32; 3],
    ) -> Result<((usize, usize), [Part<'a>; 3]), Unsure> {
        let (Some(size), Some(&finest)) = (self.size, self.components.first()) else {
            return Err(broken("its size is missing before its data"));
        };
        let across = size.width.div_ceil(8 * finest.across) as usize;
        let down = size.height.div_ceil(8 * finest.down) as usize;
        image.size = size;
        image.grey = self.components.len() == 1;
        for (plane, component) in image.planes.iter_mut().zip(&self.components) {
            let shifts = (
                finest.across / component.across,
                finest.down / component.down,
            );
            let blocks = (
                across * component.across as usize,
                down * component.down as usize,
            );
            plane.shape(
                (blocks.0 * 8, blocks.1 * 8),
                (shifts.0.ilog2(), shifts.1.ilog2()),
            );
        }
        Ok(((across, down), self.parts(&mut image.planes, before)?))
    }

    /// Everything that a component's blocks need; surplus parts have no blocks in a unit.
    fn parts<'a>(
        &'a self,
        planes: &'a mut [Plane; 3],
        before: [i32; 3],
    ) -> Result<[Part<'a>; 3], Unsure> {
        let quantisers = &self.quantisers;
        if self
            .components
            .iter()
            .any(|component| quantisers[component.quantiser].is_none())
        {
            return Err(broken("a quantisation table is missing"));
        }
        let mut components = self.components.iter().copied();
        let mut before = before.into_iter();
        Ok(planes.each_mut().map(|plane| {
            let component = components.next().unwrap_or_default();
            Part {
                across: component.across as usize,
                down: component.down as usize,
                quantiser: quantisers[component.quantiser].unwrap_or([0; 64]),
                first: &self.firsts[component.first],
                others: &self.others[component.others],
                before: before.next().unwrap_or_default(),
                plane,
            }
        }))
    }
}

/// A component while its blocks are decoded.
struct Part<'a> {
    across: usize,
    down: usize,
    quantiser: [i32; 64],
    first: &'a Table,
    others: &'a Table,
    /// The first frequency of the block before: the next one is told as a difference.
    before: i32,
    plane: &'a mut Plane,
}

fn decode_units(
    scan: &Scan,
    interval: usize,
    (across, down): (usize, usize),
    mut parts: [Part<'_>; 3],
) -> Result<(), Unsure> {
    let units = across * down;
    let interval = if interval == 0 { units } else { interval };
    if scan.intervals() != units.div_ceil(interval) {
        return Err(broken("a part of its data is missing"));
    }
    for index in 0..scan.intervals() {
        parts.iter_mut().for_each(|part| part.before = 0);
        let some = index * interval..units.min((index + 1) * interval);
        decode_interval(scan.bits(index), some, across, &mut parts)?;
    }
    Ok(())
}

/// The units that are all that is left of an interval.
fn decode_interval(
    mut bits: Bits<'_>,
    units: Range<usize>,
    across: usize,
    parts: &mut [Part<'_>; 3],
) -> Result<(), Unsure> {
    for unit in units {
        decode_unit(&mut bits, parts, unit, across)?;
        if bits.left() < 0 {
            return Err(broken("its data ends early"));
        }
    }
    if bits.left() > MOST_LEFT_OVER * 8 {
        return Err(broken("its data goes on behind its end"));
    }
    Ok(())
}

#[inline]
fn decode_unit(
    bits: &mut Bits<'_>,
    parts: &mut [Part<'_>; 3],
    unit: usize,
    across: usize,
) -> Result<(), Unsure> {
    for part in parts {
        decode_blocks(bits, part, unit % across, unit / across)
            .ok_or_else(|| broken("its data makes no sense"))?;
    }
    Ok(())
}

/// The blocks of a component in the unit at column `x`, row `y`.
#[inline]
fn decode_blocks(bits: &mut Bits<'_>, part: &mut Part<'_>, x: usize, y: usize) -> Option<()> {
    for row in 0..part.down {
        for column in 0..part.across {
            let stride = part.plane.stride;
            let at = (y * part.down + row) * 8 * stride + (x * part.across + column) * 8;
            let mut frequencies = [0; 64];
            let others = decode_block(bits, part, &mut frequencies)?;
            let target = &mut part.plane.samples[at..];
            if others {
                idct::transform(&mut frequencies, target, stride);
            } else {
                idct::fill(frequencies[0], target, stride);
            }
        }
    }
    Some(())
}

/// Reads a block's frequencies, multiplied by their quantisers; says whether there are others than the first.
#[inline(never)]
fn decode_block(
    bits: &mut Bits<'_>,
    part: &mut Part<'_>,
    frequencies: &mut [i16; 64],
) -> Option<bool> {
    // A copy of its own stays in registers.
    let mut local = *bits;
    let (run, difference) = part.first.next(&mut local)?;
    if run != 0 {
        return None;
    }
    part.before = part.before.wrapping_add(difference);
    frequencies[0] = idct::dequantised(part.before, part.quantiser[0]);
    let mut index = 1;
    while index < 64 {
        let (run, value) = part.others.next(&mut local)?;
        index += run as usize;
        if value == 0 {
            match run {
                0 => break,
                15 => {}
                _ => return None,
            }
        } else {
            let place = idct::PLACES.get(index)?;
            frequencies[usize::from(place & 63)] =
                idct::dequantised(value, part.quantiser[index & 63]);
        }
        index += 1;
    }
    *bits = local;
    Some(frequencies[1..].iter().any(|value| *value != 0))
}
