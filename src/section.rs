//! Points to columns to packed runs: what a section is on the host and, word for word, on the device.
//!
//! While points arrive a section is a sparse grid of 8×8 blocks ([`Columns`]); the winner of every
//! (column, class) is kept by an order-free maximum. [`Columns::pack`] turns it into the one buffer that is
//! uploaded: a header, block offsets, counts and runs; the words after them are derived on the device.

use crate::attribute::{Record, bias};
use crate::coords::{Height, SECTION_COLUMNS, SECTION_LOG2, SECTION_SIDE};
use crate::source::FLAG_WITHHELD;

/// log2 of a block's side in columns.
pub const BLOCK_LOG2: u32 = 3;
/// Columns in a block.
pub const BLOCK_COLUMNS: usize = 1 << (2 * BLOCK_LOG2);
/// Blocks in a section.
pub const SECTION_BLOCKS: usize = SECTION_COLUMNS / BLOCK_COLUMNS;
/// Blocks on a section's side.
const BLOCKS_SIDE: u32 = SECTION_SIDE >> BLOCK_LOG2;

/// The best record of one class in one column, and where the column's next class is.
#[derive(Clone, Copy)]
struct Best {
    record: Record,
    /// Index into `Columns::more`; 0 ends the chain.
    next: u32,
}

const NO_BEST: Best = Best { record: Record::EMPTY, next: 0 };

/// Whether two records belong to the same run: same class, and both withheld or both not (a withheld
/// point must not hide one that is not).
#[inline]
fn same_run(a: Record, b: Record) -> bool {
    a.class() == b.class() && (a.flags() ^ b.flags()) & FLAG_WITHHELD == 0
}

/// A section while points arrive: one best record for each column and class.
///
/// Memory follows the occupied 8×8 blocks: 1 KiB each, 16 bytes for every further class of a column.
pub struct Columns {
    /// Row-major over the section's blocks.
    blocks: Box<[Option<Box<[Best; BLOCK_COLUMNS]>>]>,
    /// Further classes of columns; the first is empty and the end of every chain.
    more: Vec<Best>,
    points: u64,
    occupied_blocks: usize,
    /// Runs that the device will hold: at most [`MOST_RUNS`] a column.
    runs: u32,
    /// Of all points ever, so that it does not depend on which of them were kept meanwhile.
    lowest: Height,
    highest: Height,
}

impl Default for Columns {
    fn default() -> Self {
        Columns {
            blocks: (0..SECTION_BLOCKS).map(|_| None).collect(),
            more: vec![NO_BEST],
            points: 0,
            occupied_blocks: 0,
            runs: 0,
            lowest: Height(i32::MAX),
            highest: Height(i32::MIN),
        }
    }
}

/// Index in block order (block · 64 + column in it) of the column at (x, y), both 0..256, counted from the south-west.
#[inline]
pub fn column_index(x: u32, y: u32) -> u16 {
    let mask = (1 << BLOCK_LOG2) - 1;
    let block = (y >> BLOCK_LOG2) * BLOCKS_SIDE + (x >> BLOCK_LOG2);
    (block << (2 * BLOCK_LOG2) | (y & mask) << BLOCK_LOG2 | (x & mask)) as u16
}

impl Columns {
    /// Takes in one point at column (x, y), each 0..256: kept if it beats what the column holds of its class.
    /// The result does not depend on the order of calls.
    pub fn add(&mut self, x: u32, y: u32, record: Record) {
        self.points += 1;
        let height = of_record(&record);
        self.lowest = self.lowest.min(height);
        self.highest = self.highest.max(height);
        self.insert(column_index(x, y), record);
    }

    /// Takes in points: their columns ([`column_index`]), their heights, and the record of the point at an index.
    /// Equal to [`Columns::add`] of each.
    pub fn add_all(&mut self, columns: &[u16], heights: &[Height], record: impl Fn(usize) -> Record) {
        self.points += columns.len() as u64;
        self.lowest = heights.iter().fold(self.lowest, |low, &h| low.min(h));
        self.highest = heights.iter().fold(self.highest, |high, &h| high.max(h));
        for (i, &column) in columns.iter().enumerate() {
            self.insert(column, record(i));
        }
    }

    #[inline]
    fn insert(&mut self, column: u16, record: Record) {
        let block = match &mut self.blocks[usize::from(column) / BLOCK_COLUMNS] {
            Some(block) => block,
            empty => {
                self.occupied_blocks += 1;
                empty.insert(Box::new([NO_BEST; BLOCK_COLUMNS]))
            }
        };
        let first = &mut block[usize::from(column) % BLOCK_COLUMNS];
        if first.record.is_empty() {
            first.record = record;
            self.runs += 1;
            return;
        }
        if same_run(first.record, record) {
            if record > first.record {
                first.record = record;
            }
            return;
        }
        // Further classes of a column hang in a chain; columns rarely hold more than three.
        let mut at = first.next;
        let mut runs = 1;
        while at != 0 {
            let other = &mut self.more[at as usize];
            if same_run(other.record, record) {
                if record > other.record {
                    other.record = record;
                }
                return;
            }
            at = other.next;
            runs += 1;
        }
        self.runs += u32::from(runs < MOST_RUNS);
        self.more.push(Best { record, next: first.next });
        first.next = self.more.len() as u32 - 1;
    }

    /// Points taken in so far.
    pub fn points(&self) -> u64 {
        self.points
    }

    /// Heap bytes held.
    pub fn bytes(&self) -> usize {
        SECTION_BLOCKS * size_of::<Option<Box<[Best; BLOCK_COLUMNS]>>>()
            + self.occupied_blocks * size_of::<[Best; BLOCK_COLUMNS]>()
            + (self.more.len() - 1) * size_of::<Best>()
    }

    /// Where each part of the packed section starts.
    pub fn layout(&self) -> Layout {
        Layout::new(self.runs, self.code())
    }

    fn code(&self) -> HeightCode {
        HeightCode::fit(self.lowest.0, self.highest.0)
    }

    /// Calls `each(x, y, records)` for every occupied column in block order; the records of a column are
    /// in no particular order.
    fn columns(&self, mut each: impl FnMut(u32, u32, &mut Vec<Record>)) {
        let mut records = Vec::with_capacity(8);
        let mask = (1 << BLOCK_LOG2) - 1;
        for (b, block) in self.blocks.iter().enumerate() {
            let Some(block) = block else { continue };
            let (bx, by) = (b as u32 % BLOCKS_SIDE, b as u32 / BLOCKS_SIDE);
            for (c, first) in block.iter().enumerate() {
                if first.record.is_empty() {
                    continue;
                }
                records.clear();
                records.extend(chain(*first, &self.more));
                let c = c as u32;
                each((bx << BLOCK_LOG2) + (c & mask), (by << BLOCK_LOG2) + (c >> BLOCK_LOG2), &mut records);
            }
        }
    }

    /// Puts this section's records into `parent`, whose cells are twice as wide; (i, j) are this section's
    /// own indices. Equal to binning the points at the coarser size, since maximum and rounding up commute.
    pub fn coarsen_into(&self, i: i32, j: i32, parent: &mut Columns) {
        let half = SECTION_SIDE / 2;
        let (x0, y0) = ((i & 1) as u32 * half, (j & 1) as u32 * half);
        parent.points += self.points;
        parent.lowest = parent.lowest.min(self.lowest);
        parent.highest = parent.highest.max(self.highest);
        self.columns(|x, y, records| {
            for &record in records.iter() {
                parent.insert(column_index(x0 + x / 2, y0 + y / 2), record);
            }
        });
    }

    /// Packs the section into memory of its own.
    pub fn pack(&self) -> Packed {
        let layout = self.layout();
        let mut words = vec![0; layout.words as usize];
        let highest_of = self.pack_into(&mut words);
        Packed { words, layout, points: self.points, highest_of }
    }

    /// Packs the section into the front of `words`, which has room for [`Layout::words`]; gives the highest
    /// record of each (class, withheld) present.
    ///
    /// Each word is written once, front to back within each part, and none is read: the memory may be write-combined.
    pub fn pack_into(&self, words: &mut [u32]) -> Vec<(u8, bool, Height)> {
        let layout = self.layout();
        let (header, rest) = words[..layout.words as usize].split_at_mut(layout.blocks as usize);
        let (first_runs, rest) = rest.split_at_mut(SECTION_BLOCKS);
        let (counts, rest) = rest.split_at_mut(SECTION_COLUMNS / 4);
        let (heights, attributes) = rest.split_at_mut((layout.attributes - layout.heights) as usize);
        header.copy_from_slice(&layout.header());
        let mut runs = Runs {
            code: layout.code,
            heights,
            attributes: attributes.as_chunks_mut().0,
            half: None,
            written: 0,
            highest: [0; 512],
        };
        let mut chains = Chains::default();
        for ((block, first_run), counts) in
            self.blocks.iter().zip(first_runs).zip(counts.as_chunks_mut::<{ BLOCK_COLUMNS / 4 }>().0)
        {
            *first_run = runs.written;
            let of_column = match block {
                None => [0; BLOCK_COLUMNS],
                Some(block) => match runs.put_single(block) {
                    Some(counts) => counts,
                    None => chains.put(block, &self.more, &mut runs),
                },
            };
            *counts =
                std::array::from_fn(|w| u32::from_le_bytes(std::array::from_fn(|c| of_column[4 * w + c])));
        }
        runs.finish()
    }
}

/// Writes runs one behind the other.
struct Runs<'w> {
    code: HeightCode,
    /// What is left to write.
    heights: &'w mut [u32],
    attributes: &'w mut [[u32; 2]],
    /// A code of 16 bits whose word is not full.
    half: Option<u32>,
    written: u32,
    /// First word of the highest record of each class, withheld or not: `class << 1 | withheld`.
    highest: [u32; 512],
}

impl Runs<'_> {
    /// Writes a block if no column has more than one run; gives the counts.
    #[inline]
    fn put_single(&mut self, block: &[Best; BLOCK_COLUMNS]) -> Option<[u8; BLOCK_COLUMNS]> {
        let mut heights = [0; BLOCK_COLUMNS];
        let mut attributes = [[0; 2]; BLOCK_COLUMNS];
        let mut counts = [0; BLOCK_COLUMNS];
        let (mut n, mut chained) = (0, 0);
        for (best, count) in block.iter().zip(&mut counts) {
            let [h, w1, w2] = best.record.0;
            // An empty column is written over by the next.
            heights[n % BLOCK_COLUMNS] = h;
            attributes[n % BLOCK_COLUMNS] = [w1, w2];
            *count = u8::from(h != 0);
            n += usize::from(h != 0);
            chained |= best.next;
        }
        if chained != 0 {
            return None;
        }
        self.put(&heights[..n], &attributes[..n]);
        Some(counts)
    }

    /// Keeps the highest of each class.
    #[inline]
    fn see(&mut self, heights: &[u32], attributes: &[[u32; 2]]) {
        const WITHHELD: u32 = FLAG_WITHHELD as u32;
        for (&h, &[w1, w2]) in heights.iter().zip(attributes) {
            let highest = &mut self.highest[(w1 >> 24 << 1 | u32::from(w2 & WITHHELD != 0)) as usize];
            // Seldom stored, so that one point does not wait for the last.
            if h > *highest {
                *highest = h;
            }
        }
    }

    /// Writes runs: first words of their records, and the other two.
    #[inline]
    fn put(&mut self, mut heights: &[u32], attributes: &[[u32; 2]]) {
        let n = heights.len();
        self.see(heights, attributes);
        self.written += n as u32;
        let (to, rest) = std::mem::take(&mut self.attributes).split_at_mut(n);
        to.copy_from_slice(attributes);
        self.attributes = rest;

        let base = bias(Height(self.code.base));
        if self.code.wide {
            let (to, rest) = std::mem::take(&mut self.heights).split_at_mut(n);
            to.iter_mut().zip(heights).for_each(|(to, &h)| *to = h.wrapping_sub(base));
            self.heights = rest;
            return;
        }
        if let (Some(low), [first, others @ ..]) = (self.half, heights) {
            let (to, rest) = std::mem::take(&mut self.heights).split_first_mut().expect("a word a pair");
            *to = low | first.wrapping_sub(base) << 16;
            (self.heights, self.half, heights) = (rest, None, others);
        }
        let (pairs, odd) = heights.as_chunks::<2>();
        let (to, rest) = std::mem::take(&mut self.heights).split_at_mut(pairs.len());
        for (to, &[low, high]) in to.iter_mut().zip(pairs) {
            *to = low.wrapping_sub(base) | high.wrapping_sub(base) << 16;
        }
        self.heights = rest;
        if let [h] = odd {
            self.half = Some(h.wrapping_sub(base));
        }
    }

    /// Writes what is left; gives the highest of each (class, withheld).
    fn finish(self) -> Vec<(u8, bool, Height)> {
        if let (Some(low), [last]) = (self.half, self.heights) {
            *last = low;
        }
        let present = self.highest.iter().enumerate().filter(|(_, h)| **h != 0);
        present.map(|(key, &h)| ((key >> 1) as u8, key & 1 != 0, Height((h ^ 0x8000_0000) as i32))).collect()
    }
}

/// Runs of a column that are sorted without branches.
const FEW_RUNS: usize = 4;

/// Scratch for blocks with chains.
struct Chains {
    heights: [u32; BLOCK_COLUMNS * FEW_RUNS],
    attributes: [[u32; 2]; BLOCK_COLUMNS * FEW_RUNS],
    column: Vec<Record>,
}

impl Default for Chains {
    fn default() -> Chains {
        const MOST: usize = BLOCK_COLUMNS * FEW_RUNS;
        Chains { heights: [0; MOST], attributes: [[0; 2]; MOST], column: Vec::new() }
    }
}

impl Chains {
    /// Writes a block; gives the counts.
    fn put(&mut self, block: &[Best; BLOCK_COLUMNS], more: &[Best], runs: &mut Runs) -> [u8; BLOCK_COLUMNS] {
        let mut n = 0;
        let mut counts = [0; BLOCK_COLUMNS];
        for (first, count) in block.iter().zip(&mut counts) {
            if first.next == 0 {
                // What is empty is written over by the next column.
                let [h, w1, w2] = first.record.0;
                self.heights[n] = h;
                self.attributes[n] = [w1, w2];
                *count = u8::from(h != 0);
                n += usize::from(h != 0);
                continue;
            }
            // The end of a chain is followed by itself, which is empty.
            let second = more[first.next as usize];
            if second.next == 0 {
                // By far the most common chain.
                let pair = [first.record, second.record];
                let pair = if pair[0] < pair[1] { [pair[1], pair[0]] } else { pair };
                for (k, Record([h, w1, w2])) in pair.into_iter().enumerate() {
                    self.heights[n + k] = h;
                    self.attributes[n + k] = [w1, w2];
                }
                *count = 2;
                n += 2;
                continue;
            }
            let third = more[second.next as usize];
            let fourth = more[third.next as usize];
            if fourth.next != 0 {
                runs.put(&self.heights[..n], &self.attributes[..n]);
                n = 0;
                *count = self.put_long(*first, more, runs);
                continue;
            }
            let records = sorted([first, &second, &third, &fourth].map(|best| best.record.as_number()));
            // What is empty comes last.
            let of_column = n..n + FEW_RUNS;
            let heights = &mut self.heights[of_column.clone()];
            heights.iter_mut().zip(records).for_each(|(to, r)| *to = (r >> 64) as u32);
            let attributes = &mut self.attributes[of_column];
            attributes.iter_mut().zip(records).for_each(|(to, r)| *to = [(r >> 32) as u32, r as u32]);
            let held = 2 + usize::from(second.next != 0) + usize::from(third.next != 0);
            *count = held as u8;
            n += held;
        }
        runs.put(&self.heights[..n], &self.attributes[..n]);
        counts
    }

    /// Writes a column with more than [`FEW_RUNS`]; gives its count.
    #[cold]
    fn put_long(&mut self, first: Best, more: &[Best], runs: &mut Runs) -> u8 {
        self.column.clear();
        self.column.extend(chain(first, more));
        self.column.sort_unstable_by(|a, b| b.cmp(a));
        let (kept, rest) = self.column.split_at(self.column.len().min(MOST_RUNS));
        for record in kept {
            runs.put(&record.0[..1], &[[record.0[1], record.0[2]]]);
        }
        for record in rest {
            runs.see(&record.0[..1], &[[record.0[1], record.0[2]]]);
        }
        kept.len() as u8
    }
}

/// A sorting network: largest first.
#[inline]
fn sorted(mut n: [u128; FEW_RUNS]) -> [u128; FEW_RUNS] {
    for (a, b) in [(0, 1), (2, 3), (0, 2), (1, 3), (1, 2)] {
        (n[a], n[b]) = if n[a] < n[b] { (n[b], n[a]) } else { (n[a], n[b]) };
    }
    n
}

/// Records of a column.
fn chain(first: Best, more: &[Best]) -> impl Iterator<Item = Record> {
    let next = |best: &Best| (best.next != 0).then(|| more[best.next as usize]);
    std::iter::successors(Some(first), next).map(|best| best.record)
}

/// Height of a record that is not empty.
fn of_record(record: &Record) -> Height {
    record.height().expect("columns hold no empty records")
}

/// Most runs a column can hold on the device (its count is one byte). The highest are kept.
const MOST_RUNS: usize = 255;

/// How a section stores heights: `code = h - base`, never 0 (0 says "no point"). Every height is kept to the
/// last lattice step, so what is seen does not depend on which section a column is in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HeightCode {
    /// Lattice height of code 0.
    pub base: i32,
    /// Codes take 32 bits instead of 16.
    pub wide: bool,
}

impl HeightCode {
    /// 16 bits if lowest..=highest, 64 units of relief, fit them.
    fn fit(lowest: i32, highest: i32) -> HeightCode {
        let spare = 0xFFFE - (i64::from(highest) - i64::from(lowest));
        // What is left goes to both sides: a bridge may lead to a neighbour that lies lower or higher.
        let base = i64::from(lowest) - 1 - spare.max(0) / 2;
        // `lowest` is above i32::MIN, which no height takes.
        HeightCode { base: base.max(i32::MIN.into()) as i32, wide: spare < 0 }
    }

    #[cfg(test)]
    fn encode(self, height: Height) -> u32 {
        (i64::from(height.0) - i64::from(self.base)) as u32
    }

    /// The height that `code` stands for.
    pub fn decode(self, code: u32) -> Height {
        Height((i64::from(self.base) + i64::from(code)) as i32)
    }
}

/// Kind of payload: columns of runs. Others follow (stacks, points, walls); only shaders look at it.
pub const KIND_COLUMNS: u32 = 1;
/// Words of a payload's header: kind, words in all, code, base, runs, and where the parts start.
pub const HEADER_WORDS: u32 = 16;

/// Where each part of what is uploaded of a section starts, in words from its start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Layout {
    /// How heights are stored.
    pub code: HeightCode,
    /// Runs in all columns.
    pub runs: u32,
    /// First run of each of the 1,024 blocks.
    pub blocks: u32,
    /// Runs in each column: one byte, in block order (block · 64 + column).
    pub counts: u32,
    /// Heights of runs: 16 or 32 bits each.
    pub heights: u32,
    /// Attributes of runs: two words each, `Record`'s second and third.
    pub attributes: u32,
    /// All words.
    pub words: u32,
}

/// Where what is derived of a section lies, in a place of its own: 64×64 blocks of 4×4 columns, row by row, then levels
/// 2 to 8 of the maximum pyramid, row by row each; 16 or 32 bits a code. `shaders/section.glsl` has the same.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Derived {
    /// Codes take 32 bits.
    pub wide: bool,
}

impl Derived {
    /// Blocks on a side.
    pub const SIDE: u32 = SECTION_SIDE / 4;

    /// Words of a block: its level 0 of the pyramid, row by row, from word 0 on; level 1 behind it.
    pub fn block_words(self) -> u32 {
        if self.wide { 48 } else { 32 }
    }

    /// In blocks of even index: which columns of this and the next are measured, a bit each, row by row over both.
    pub fn measured(self) -> u32 {
        if self.wide { 20 } else { 10 }
    }

    /// What each column of the block shows: class, and colour or values, a word each, row by row.
    pub fn shown(self) -> u32 {
        if self.wide { 32 } else { 16 }
    }

    /// First word of the pyramid's levels from 2 on.
    pub fn upper_levels(self) -> u32 {
        self.block_words() * Self::SIDE * Self::SIDE
    }

    /// All bytes.
    pub fn bytes(self) -> u64 {
        // Codes of levels 2 to 8, and one to make them even.
        const UPPER: u64 = 5462;
        4 * u64::from(self.upper_levels()) + UPPER * if self.wide { 4 } else { 2 }
    }
}

impl Layout {
    fn new(runs: u32, code: HeightCode) -> Layout {
        let per_word = if code.wide { 1 } else { 2 };
        let blocks = HEADER_WORDS;
        let counts = blocks + SECTION_BLOCKS as u32;
        let heights = counts + (SECTION_COLUMNS / 4) as u32;
        let attributes = heights + runs.div_ceil(per_word);
        let words = attributes + 2 * runs;
        Layout { code, runs, blocks, counts, heights, attributes, words }
    }

    fn header(&self) -> [u32; HEADER_WORDS as usize] {
        let code = u32::from(self.code.wide) << 8 | SECTION_LOG2 << 16;
        let mut header = [0; HEADER_WORDS as usize];
        let parts = [self.blocks, self.counts, self.heights, self.attributes];
        header[..5].copy_from_slice(&[KIND_COLUMNS, self.words, code, self.code.base as u32, self.runs]);
        header[5..9].copy_from_slice(&parts);
        header
    }

    /// Bytes that are uploaded.
    pub fn uploaded_bytes(&self) -> u64 {
        u64::from(self.words) * 4
    }

    /// Bytes that are derived from them.
    pub fn derived_bytes(&self) -> u64 {
        Derived { wide: self.code.wide }.bytes()
    }
}

/// Highest record of each (class, withheld) that a section holds.
pub type HighestOf = Vec<(u8, bool, Height)>;

/// A section ready for upload. Immutable.
pub struct Packed {
    /// Header and runs: `layout.words` words.
    pub words: Vec<u32>,
    /// Offsets of its parts.
    pub layout: Layout,
    /// Points it was made from.
    pub points: u64,
    /// Highest record of each (class, withheld) present.
    pub highest_of: HighestOf,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attribute::Attributes;
    use proptest::prelude::*;

    fn record(h: i32, class: u8, flags: u8) -> Record {
        Record::pack(Attributes {
            height: Height(h),
            class,
            intensity: 7,
            rgb: [1, 2, 3],
            returns: 0x11,
            flags,
        })
    }

    /// Packing as it is specified: in two passes over all columns, in any order of writes.
    fn pack_plainly(columns: &Columns) -> (Vec<u32>, Vec<(u8, bool, Height)>) {
        let mut runs = 0usize;
        let mut highest_of = Vec::<(u8, bool, Height)>::new();
        columns.columns(|_, _, records| {
            runs += records.len().min(MOST_RUNS);
            for record in records.iter() {
                let height = of_record(record);
                let withheld = record.flags() & FLAG_WITHHELD != 0;
                match highest_of.iter_mut().find(|(c, w, _)| *c == record.class() && *w == withheld) {
                    Some((_, _, h)) => *h = height.max(*h),
                    None => highest_of.push((record.class(), withheld, height)),
                }
            }
        });
        highest_of.sort();
        let code = columns.code();
        let layout = Layout::new(runs as u32, code);
        let mut words = vec![0u32; layout.words as usize];
        words[..HEADER_WORDS as usize].copy_from_slice(&layout.header());
        let (mut run, mut next_block) = (0u32, 0usize);
        columns.columns(|x, y, records| {
            records.sort_unstable_by(|a, b| b.cmp(a));
            records.truncate(MOST_RUNS);
            let count_at = usize::from(column_index(x, y));
            let block = count_at / BLOCK_COLUMNS;
            if next_block <= block {
                words[layout.blocks as usize..][next_block..=block].fill(run);
                next_block = block + 1;
            }
            words[layout.counts as usize + count_at / 4] |= (records.len() as u32) << (8 * (count_at % 4));
            for record in records.iter() {
                let code_word = code.encode(of_record(record));
                if code.wide {
                    words[(layout.heights + run) as usize] = code_word;
                } else {
                    words[(layout.heights + run / 2) as usize] |= code_word << (16 * (run % 2));
                }
                let attributes = (layout.attributes + 2 * run) as usize;
                words[attributes..attributes + 2].copy_from_slice(&record.0[1..]);
                run += 1;
            }
        });
        words[layout.blocks as usize..][next_block..SECTION_BLOCKS].fill(run);
        (words, highest_of)
    }

    /// Into memory that holds rubbish, which must be gone, and no further than it should.
    fn check_packing(columns: &Columns) {
        let (words, highest_of) = pack_plainly(columns);
        for rubbish in [0xDEAD_BEEF, !0] {
            let mut ring = vec![rubbish; words.len() + 3];
            assert_eq!(columns.pack_into(&mut ring), highest_of);
            assert_eq!(columns.layout().words as usize, words.len());
            assert!(ring[..words.len()] == words);
            assert!(ring[words.len()..] == [rubbish; 3]);
        }
        assert!(columns.pack().words == words);
    }

    #[test]
    fn packing_is_as_specified_where_it_is_hard() {
        check_packing(&Columns::default());
        // More runs than a count holds, in two columns: 512 of 256 classes, withheld or not.
        let mut columns = Columns::default();
        for k in 0..512 {
            let r = record(k * 37 % 1009, (k % 256) as u8, if k < 256 { 0 } else { FLAG_WITHHELD });
            columns.add(3, 200, r);
            columns.add(77, 5, r);
            columns.add(k as u32 % 256, 99, r);
        }
        assert_eq!(columns.layout().runs, 2 * 255 + 512);
        check_packing(&columns);
        // Every column once.
        let mut full = Columns::default();
        for k in 0..SECTION_COLUMNS as u32 {
            full.add(k % 256, k / 256, record((k * 31 % 4001) as i32, 2, 0));
        }
        check_packing(&full);
    }

    proptest! {
        #[test]
        fn packing_is_as_specified(
            points in prop::collection::vec(
                (0u32..256, 0u32..256, -1000..1000, 0u8..7, 0u8..16), 0..3000),
            crowd in 1u32..=256,
            // 60 units of relief are 16 bits, 200 are not.
            step in prop::sample::select(vec![1, 30, 100]),
        ) {
            let mut columns = Columns::default();
            for (x, y, h, class, flags) in points {
                columns.add(x % crowd, y % crowd, record(h * step, class, flags));
            }
            check_packing(&columns);
        }
    }

    #[test]
    fn order_of_points_changes_nothing() {
        let mut points = Vec::new();
        for k in 0..4000u32 {
            let h = (k.wrapping_mul(2_654_435_761) >> 20) as i32 - 2000;
            points.push((
                k * 7 % 256,
                k * 13 % 256 / 8,
                record(h, (k % 5) as u8, if k % 11 == 0 { 4 } else { 0 }),
            ));
        }
        let (mut forward, mut backward) = (Columns::default(), Columns::default());
        points.iter().for_each(|&(x, y, r)| forward.add(x, y, r));
        points.iter().rev().for_each(|&(x, y, r)| backward.add(x, y, r));
        assert_eq!(forward.pack().words, backward.pack().words);
        assert!(forward.pack().highest_of.len() > 5);
    }

    #[test]
    fn coarse_from_children_equals_coarse_from_points() {
        let (mut direct, mut parent) = (Columns::default(), Columns::default());
        let mut children: [Columns; 4] = Default::default();
        for k in 0..20_000u32 {
            let (x, y) = (k.wrapping_mul(40_503) >> 3 & 511, k.wrapping_mul(30_011) >> 5 & 511);
            let r = record((k.wrapping_mul(2_654_435_761) >> 16) as i32, (k % 3) as u8, 0);
            direct.add(x / 2, y / 2, r);
            children[(y / 256 * 2 + x / 256) as usize].add(x % 256, y % 256, r);
        }
        for (q, child) in children.iter().enumerate() {
            child.coarsen_into(q as i32 % 2 - 2, q as i32 / 2 + 4, &mut parent);
        }
        assert_eq!(direct.pack().words, parent.pack().words);
        assert_eq!(parent.points(), 20_000);
    }

    #[test]
    fn codes_keep_heights_exactly() {
        for (lowest, highest, wide) in [
            (5, 5, false),
            (-30_000, 35_534, false),
            (-30_000, 35_535, true),
            (i32::MIN + 1, i32::MIN + 9, false),
            (i32::MIN + 1, i32::MAX, true),
            (i32::MAX - 9, i32::MAX, false),
        ] {
            let code = HeightCode::fit(lowest, highest);
            assert_eq!(code.wide, wide, "{lowest}..={highest}");
            for h in [lowest, highest, lowest.midpoint(highest)] {
                let word = code.encode(Height(h));
                assert!(word > 0 && (code.wide || word <= 0xFFFF), "{code:?} {h}");
                assert_eq!(code.decode(word), Height(h), "{code:?}");
            }
        }
        // As far below as above.
        assert_eq!(HeightCode::fit(0, 0).base, -0x8000);
    }

    #[test]
    fn runs_are_sorted_downward_and_reached_by_block() {
        let mut columns = Columns::default();
        columns.add(9, 8, record(100, 2, 0));
        columns.add(9, 8, record(900, 5, 0));
        columns.add(9, 8, record(500, 6, 0));
        columns.add(255, 255, record(50, 2, 0));
        let packed = columns.pack();
        let l = packed.layout;
        let (block, column) = (33, 1);
        assert_eq!(packed.words[l.blocks as usize + block], 0);
        assert_eq!(packed.words[l.blocks as usize + SECTION_BLOCKS - 1], 3);
        let count = packed.words[l.counts as usize + (block * 64 + column) / 4] >> (8 * (column % 4)) & 0xFF;
        assert_eq!(count, 3);
        let class = |run: u32| packed.words[(l.attributes + 2 * run) as usize] >> 24;
        assert_eq!([class(0), class(1), class(2), class(3)], [5, 6, 2, 2]);
    }
}
