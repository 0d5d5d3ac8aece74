//! Points to columns: a section while points arrive.
//!
//! While points arrive a section ([`Columns`]) keeps the winner of every column and kind of point (class and flags) by an order-free maximum, columns
//! in the order of 8×8 blocks. What is uploaded has those blocks that hold anything, in the same order, so that
//! [`Columns::pack_into`] mostly copies.
//!
//! Of [stacks](Columns::stacks) it keeps more: see `section::stacks`.

use super::blocks::Blocks;
use super::layout::{
    BLOCK_COLUMNS, BLOCK_WORDS, COUNT_WORDS, FIRST_BLOCK, FIRST_STACK_BLOCK, Floats, HEADER_WORDS,
    HeightCode, Layout, MOST_OTHERS, PLACE_WORDS, RUN_WORDS, SECTION_BLOCKS, STACK_PLACE_WORDS, column_at,
    column_index,
};
use super::measure::{Measure, Measuring, with_code};
use super::payload::{HighestOf, Payload};
use super::stacks::{self, Floating, Gathering, Stacks};
use super::surface::Surface;
use crate::attribute::{Flags, Kind, Record, unbias};
use crate::coords::{Height, SECTION_COLUMNS, SECTION_SIDE, Stacking};
use memmap2::MmapMut;

/// The best record of a further kind of a column.
#[derive(Clone, Copy)]
struct Other {
    record: Record,
    /// Index of the column's next; 0 ends the chain.
    next: u32,
}

/// What stacks are packed as.
struct Spans {
    floating: Floating,
    /// Of the columns of blocks that hold anything, in block order: how deep their highest spans reach, and how many further ones there
    /// are; and these.
    depths: Vec<u16>,
    counts: Vec<u8>,
    further: Vec<(Record, u16)>,
    /// How heights are coded.
    code: HeightCode,
}

/// Whether two records belong to the same run: same kind (a point that is hidden must not hide one that is not).
#[inline]
fn same_run(a: Record, b: Record) -> bool {
    a.kind() == b.kind()
}

/// A section while points arrive: one best record for each column and kind, or each run of stacks.
///
/// Memory follows the pages that are touched: 12 bytes a column, 5 where columns have further kinds, 16 for each of
/// those; of stacks 2 more a column and a run.
pub struct Columns {
    pages: Pages,
    /// Further kinds of columns; the first is empty.
    others: Vec<Other>,
    points: u64,
    /// A bit for each block that holds anything.
    occupied: Blocks,
    /// And for each in which a column has further kinds.
    chained: Blocks,
    touched_pages: u32,
    /// Further runs that the device will hold: at most [`MOST_OTHERS`] a column.
    further_runs: u32,
    /// First word of the highest record of each kind.
    highest: Highest,
    /// Of all points ever, so that it does not depend on which of them were kept meanwhile.
    lowest: Height,
    /// What is kept besides, where these are stacks.
    stacks: Option<Box<Stacks>>,
    /// What is solid of these stacks is a smooth surface.
    is_smooth: bool,
    /// What is gathered besides of what is to stand in the records.
    measuring: Option<Box<Measuring>>,
}

impl Default for Columns {
    fn default() -> Self {
        Columns {
            pages: Pages::new(Surface::Columns),
            others: vec![Other { record: Record::EMPTY, next: 0 }],
            points: 0,
            occupied: Blocks::default(),
            chained: Blocks::default(),
            touched_pages: 0,
            further_runs: 0,
            highest: Highest::default(),
            lowest: Height(i32::MAX),
            stacks: None,
            is_smooth: false,
            measuring: None,
        }
    }
}

/// Of each column, in block order: the highest record; behind all of them, index into `Columns::others` of its other
/// kinds, 0 where there are none; behind those, how many there are, [`MOST_OTHERS`] or more as that; of stacks, behind
/// those, the lows of the highest records.
///
/// Pages of the system, which gives zeros, and memory only for what is touched.
struct Pages(MmapMut);

/// Bytes of the records of all columns, of their heads behind them, of the counts, and of the lows.
const RECORDS_BYTES: usize = size_of::<Record>() * SECTION_COLUMNS;
const HEADS_BYTES: usize = size_of::<u32>() * SECTION_COLUMNS;
const COUNTS_BYTES: usize = SECTION_COLUMNS;
const LOWS_BYTES: usize = size_of::<u16>() * SECTION_COLUMNS;
/// Usual size of a page. Where pages are larger, sparse sections hold more than is counted.
const PAGE: usize = 4096;
/// Blocks whose records fill three pages and whose heads fill one.
const STRIP_BLOCKS: usize = 16;
const _: () = assert!(STRIP_BLOCKS * BLOCK_COLUMNS * size_of::<Record>() == 3 * PAGE);
/// Blocks whose counts fill one.
const COUNTED_BLOCKS: usize = PAGE / BLOCK_COLUMNS;

/// Blocks whose lows fill one.
const LOW_BLOCKS: usize = PAGE / (size_of::<u16>() * BLOCK_COLUMNS);

/// Records, heads, counts; lows of stacks, of columns none.
type Planes<'a> =
    (&'a [Record; SECTION_COLUMNS], &'a [u32; SECTION_COLUMNS], &'a [u8; SECTION_COLUMNS], &'a [u16]);
type PlanesMut<'a> = (
    &'a mut [Record; SECTION_COLUMNS],
    &'a mut [u32; SECTION_COLUMNS],
    &'a mut [u8; SECTION_COLUMNS],
    &'a mut [u16],
);

impl Pages {
    fn new(surface: Surface) -> Pages {
        const BYTES: usize = RECORDS_BYTES + HEADS_BYTES + COUNTS_BYTES;
        let lows_bytes = if surface.floats() { LOWS_BYTES } else { 0 };
        // As where a box finds no memory.
        let failed = |_| std::alloc::handle_alloc_error(std::alloc::Layout::new::<[u8; BYTES]>());
        Pages(MmapMut::map_anon(BYTES + lows_bytes).unwrap_or_else(failed))
    }

    #[inline]
    fn planes(&self) -> Planes<'_> {
        let (records, rest) = self.0.split_at(RECORDS_BYTES);
        let (heads, rest) = rest.split_at(HEADS_BYTES);
        let (counts, lows) = rest.split_at(COUNTS_BYTES);
        let lows = bytemuck::cast_slice(lows);
        (bytemuck::from_bytes(records), bytemuck::from_bytes(heads), bytemuck::from_bytes(counts), lows)
    }

    #[inline]
    fn planes_mut(&mut self) -> PlanesMut<'_> {
        let (records, rest) = self.0.split_at_mut(RECORDS_BYTES);
        let (heads, rest) = rest.split_at_mut(HEADS_BYTES);
        let (counts, lows) = rest.split_at_mut(COUNTS_BYTES);
        (
            bytemuck::from_bytes_mut(records),
            bytemuck::from_bytes_mut(heads),
            bytemuck::from_bytes_mut(counts),
            bytemuck::cast_slice_mut(lows),
        )
    }
}

impl Columns {
    /// Columns of a section as `surface` has them, where stacks are by `stacking`.
    pub fn new(surface: Surface, stacking: Stacking) -> Columns {
        match surface {
            Surface::Columns => Columns::default(),
            Surface::Stacks => Columns::stacks(stacking),
            Surface::Smooth => Columns { is_smooth: true, ..Columns::stacks(stacking) },
        }
    }

    /// No points yet, in stacks: of every column and key the highest record in each slice, and the lowest height there; of
    /// classes that never float the highest alone.
    pub fn stacks(stacking: Stacking) -> Columns {
        let stacks = Some(Box::new(Stacks::new(stacking)));
        Columns { pages: Pages::new(Surface::Stacks), stacks, ..Columns::default() }
    }

    /// The same without points, whose records are to hold `measure`.
    pub fn measuring(self, measure: Option<Measure>) -> Columns {
        let measuring = measure.map(|measure| Box::new(Measuring::new(measure)));
        Columns { measuring, ..self }
    }

    /// What is measured of them.
    pub fn measure(&self) -> Option<Measure> {
        self.measuring.as_ref().map(|measuring| measuring.measure)
    }

    /// Puts the measure into all records. No point may come after that.
    pub fn finish_measure(&mut self) {
        let Some(measuring) = self.measuring.take() else { return };
        let codes = measuring.finish(|each| self.records(|column, record, _| each(column, record)));
        let (first, heads, counts, _) = self.pages.planes_mut();
        for b in (0..SECTION_BLOCKS).filter(|&b| self.occupied.has(b)) {
            for c in b * BLOCK_COLUMNS..(b + 1) * BLOCK_COLUMNS {
                if first[c].is_empty() {
                    continue;
                }
                first[c] = with_code(first[c], codes.of(c as u16, first[c]));
                let mut index = if counts[c] == 0 { 0 } else { heads[c] as usize };
                while index != 0 {
                    let Other { record, next } = self.others[index];
                    self.others[index].record = with_code(record, codes.of(c as u16, record));
                    index = next as usize;
                }
            }
        }
    }

    /// What they are stacked by; `None`: columns.
    pub fn stacking(&self) -> Option<Stacking> {
        self.stacks.as_ref().map(|stacks| stacks.stacking)
    }

    /// Takes in one point at column (x, y), each 0..256: kept if it beats what the column holds of its kind (of stacks:
    /// of its run).
    /// The result does not depend on the order of calls.
    pub fn add(&mut self, x: u32, y: u32, record: Record) {
        self.add_all(&[column_index(x, y)], &[of_record(&record)], |_| record);
    }

    /// Takes in points: their columns ([`column_index`]), their heights, and the record of the point at an index.
    /// Equal to [`Columns::add`] of each.
    pub fn add_all(&mut self, columns: &[u16], heights: &[Height], record: impl Fn(usize) -> Record) {
        self.points += columns.len() as u64;
        self.lowest = heights.iter().fold(self.lowest, |low, &h| low.min(h));
        if let Some(measuring) = &mut self.measuring {
            for (i, (&column, &height)) in columns.iter().zip(heights).enumerate() {
                measuring.see(column, height, record(i));
            }
        }
        match self.stacking() {
            None => {
                for (i, &column) in columns.iter().enumerate() {
                    self.insert::<false>(column, record(i), 0);
                }
            }
            Some(stacking) => {
                for (i, &column) in columns.iter().enumerate() {
                    let record = record(i);
                    self.insert::<true>(column, record, stacks::low_of(stacking, record, heights[i]));
                }
            }
        }
    }

    /// `STACKS`: whether these are stacks; then `low` is that of the record.
    #[inline]
    fn insert<const STACKS: bool>(&mut self, column: u16, record: Record, low: u16) {
        let block = usize::from(column) / BLOCK_COLUMNS;
        if !self.occupied.has(block) {
            self.occupy(block);
        }
        let slice_log2 =
            if STACKS { self.stacks.as_ref().expect("these are stacks").slice_log2() } else { 0 };
        let joins = |a: Record, b: Record| match STACKS {
            true => stacks::same_run(slice_log2, a, b),
            false => same_run(a, b),
        };
        let at = usize::from(column);
        let (records, heads, counts, lows) = self.pages.planes_mut();
        let first = &mut records[at];
        if first.is_empty() {
            *first = record;
            if STACKS {
                lows[at] = low;
                self.stacks.as_mut().expect("these are stacks").begin(column, record);
            }
            return self.highest.see(record);
        }
        if joins(*first, record) {
            if STACKS {
                lows[at] = lows[at].min(low);
            }
            if record > *first {
                *first = record;
                self.highest.see(record);
            }
            return;
        }
        // Further kinds of a column hang in a chain; columns rarely hold more than three.
        let count = &mut counts[at];
        let is_long = STACKS && *count >= stacks::LONG;
        let index = match (is_long, *count) {
            (true, _) => self.stacks.as_ref().expect("these are stacks").find(column, record) as usize,
            (false, 0) => 0,
            (false, _) => {
                let mut index = heads[at] as usize;
                while index != 0 && !joins(self.others[index].record, record) {
                    index = self.others[index].next as usize;
                }
                index
            }
        };
        if index != 0 {
            let other = &mut self.others[index];
            let is_first = record > *first;
            if STACKS {
                let of_other = &mut self.stacks.as_mut().expect("these are stacks").lows[index];
                *of_other = low.min(*of_other);
                if is_first {
                    std::mem::swap(&mut lows[at], of_other);
                }
            }
            if record > other.record {
                other.record = record;
                if is_first {
                    std::mem::swap(first, &mut other.record);
                    if is_long {
                        let stacks = self.stacks.as_mut().expect("these are stacks");
                        stacks.swapped(column, *first, other.record, index as u32);
                    }
                }
                self.highest.see(record);
            }
            return;
        }
        self.highest.see(record);
        let is_highest = record > *first;
        let lower = if is_highest { std::mem::replace(first, record) } else { record };
        let next = if *count == 0 { 0 } else { heads[at] };
        if *count < MOST_OTHERS {
            *count += 1;
            self.further_runs += 1;
        }
        heads[at] = self.others.len() as u32;
        self.others.push(Other { record: lower, next });
        if STACKS {
            let lower_low = if is_highest { std::mem::replace(&mut lows[at], low) } else { low };
            let stacks = self.stacks.as_mut().expect("these are stacks");
            stacks.lows.push(lower_low);
            stacks.begin(column, record);
            if is_long {
                stacks.note(column, lower, heads[at]);
            } else if *count == stacks::LONG {
                let mut index = heads[at];
                while index != 0 {
                    let Other { record, next } = self.others[index as usize];
                    stacks.note(column, record, index);
                    index = next;
                }
            }
        }
        if !self.chained.has(block) {
            let touched = |blocks: &Blocks| {
                u32::from(blocks.among(block, STRIP_BLOCKS) != 0)
                    + u32::from(blocks.among(block, COUNTED_BLOCKS) != 0)
            };
            let before = touched(&self.chained);
            self.chained.insert(block);
            self.touched_pages += touched(&self.chained) - before;
        }
    }

    /// Before anything of a block is read or written.
    #[cold]
    fn occupy(&mut self, block: usize) {
        // A page that is read first is mapped twice, and every core told.
        let (records, ..) = self.pages.planes_mut();
        for column in [0, BLOCK_COLUMNS - 1] {
            records[block * BLOCK_COLUMNS + column] = Record::EMPTY;
        }
        // Of the three pages of records of a strip, those that its blocks lie on.
        let pages =
            |strip: u64| [0x003F, 0x07E0, 0xFC00].iter().filter(|page| strip & **page != 0).count() as u32;
        let before = pages(self.occupied.among(block, STRIP_BLOCKS));
        let first_lows = self.stacks.is_some() && self.occupied.among(block, LOW_BLOCKS) == 0;
        self.occupied.insert(block);
        self.touched_pages +=
            pages(self.occupied.among(block, STRIP_BLOCKS)) - before + u32::from(first_lows);
    }

    /// Points taken in so far.
    pub fn points(&self) -> u64 {
        self.points
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        self.touched_pages as usize * PAGE
            + self.highest.bytes()
            + (self.others.len() - 1) * size_of::<Other>()
            + self.stacks.as_ref().map_or(0, |stacks| stacks.bytes())
            + self.measuring.as_ref().map_or(0, |measuring| measuring.bytes())
    }

    /// Where each part of the packed section starts. Of stacks this joins all of their runs, as packing does.
    pub fn layout(&self) -> Layout {
        match self.spans() {
            None => self.layout_of_columns(),
            Some(spans) => self.layout_of(&spans),
        }
    }

    /// The same, at once; of stacks there may be less than it says.
    pub fn layout_at_most(&self) -> Layout {
        let Some(stacks) = &self.stacks else { return self.layout_of_columns() };
        let code = self.code_above(stacks.stacking.lowest_bottom(self.lowest));
        self.layout_with(self.further_runs, Some(stacks.floats_at_most()), code)
    }

    fn layout_of_columns(&self) -> Layout {
        self.layout_with(self.further_runs, None, self.code_above(self.lowest))
    }

    fn layout_of(&self, spans: &Spans) -> Layout {
        self.layout_with(spans.further.len() as u32, Some(spans.floating.floats()), spans.code)
    }

    fn layout_with(&self, further: u32, floats: Option<Floats>, code: HeightCode) -> Layout {
        let layout = Layout::new(self.occupied.count(), further, code, floats);
        Layout { smooth: self.is_smooth, ..layout }
    }

    fn code_above(&self, lowest: Height) -> HeightCode {
        let highest = self.highest.each().map(|(_, h)| h).max();
        HeightCode::fit(lowest.0, unbias(highest.unwrap_or(0)).0)
    }

    /// Highest record of each kind present.
    fn highest_of(&self) -> HighestOf {
        let mut highest: Vec<_> = self.highest.each().map(|(kind, h)| (kind, unbias(h))).collect();
        highest.sort_unstable();
        highest
    }

    /// Calls `each` with every record, the index of its column, and its low (of columns 0).
    fn records(&self, mut each: impl FnMut(u16, Record, u16)) {
        let (first, heads, counts, lows) = self.pages.planes();
        for b in (0..SECTION_BLOCKS).filter(|&b| self.occupied.has(b)) {
            for c in (b * BLOCK_COLUMNS..(b + 1) * BLOCK_COLUMNS).filter(|&c| !first[c].is_empty()) {
                each(c as u16, first[c], lows.get(c).copied().unwrap_or(0));
                if counts[c] > 0 {
                    self.chain_of(heads[c]).for_each(|(other, low)| each(c as u16, other, low));
                }
            }
        }
    }

    /// Calls `each` with the index of a column and every record of it.
    #[cfg(test)]
    pub(super) fn each_record(&self, mut each: impl FnMut(u16, Record)) {
        self.records(|column, record, _| each(column, record));
    }

    /// A column's further records.
    fn chain(&self, head: u32) -> impl Iterator<Item = Record> {
        let at = |index: u32| (index != 0).then(|| self.others[index as usize]);
        std::iter::successors(at(head), move |other| at(other.next)).map(|o| o.record)
    }

    /// A column's further runs and their lows, of columns 0.
    fn chain_of(&self, head: u32) -> impl Iterator<Item = (Record, u16)> {
        let lows = self.stacks.as_ref().map_or(&[][..], |stacks| &stacks.lows);
        let next = |index: &u32| Some(self.others[*index as usize].next).filter(|next| *next != 0);
        std::iter::successors(Some(head), next).map(move |index| {
            let index = index as usize;
            (self.others[index].record, lows.get(index).copied().unwrap_or(0))
        })
    }

    /// The spans that stacks are packed as; `None`: these are columns.
    fn spans(&self) -> Option<Spans> {
        let stacking = self.stacking()?;
        let mut gathering = Gathering::new(stacking);
        let (first, heads, counts, lows) = self.pages.planes();
        let blocks = || (0..SECTION_BLOCKS).filter(|&b| self.occupied.has(b));
        let mut depths = vec![0; self.occupied.count() as usize * BLOCK_COLUMNS];
        let mut further_counts = vec![0; depths.len()];
        let mut further = Vec::new();
        let (mut runs, mut joined) = (Vec::new(), Vec::new());
        for (n, b) in blocks().enumerate() {
            for at in (0..BLOCK_COLUMNS).filter(|at| !first[b * BLOCK_COLUMNS + at].is_empty()) {
                let c = b * BLOCK_COLUMNS + at;
                runs.clear();
                runs.push((first[c], lows[c]));
                if counts[c] > 0 {
                    runs.extend(self.chain_of(heads[c]));
                }
                stacks::join(stacking, &mut runs, &mut joined);
                gathering.see(c as u16, &joined);
                let (_, depth) = joined[0];
                depths[n * BLOCK_COLUMNS + at] = depth;
                further_counts[n * BLOCK_COLUMNS + at] = (joined.len() - 1) as u8;
                further.extend_from_slice(&joined[1..]);
            }
        }
        let code = self.code_above(gathering.lowest_bottom());
        Some(Spans { floating: gathering.finish(), depths, counts: further_counts, further, code })
    }

    /// Puts this section's records into `parent`, whose cells are twice as wide; (i, j) are this section's
    /// own indices. Equal to binning the points at the coarser size, since maximum, minimum and rounding commute.
    pub fn coarsen_into(&self, i: i32, j: i32, parent: &mut Columns) {
        let half = SECTION_SIDE / 2;
        let (x0, y0) = ((i & 1) as u32 * half, (j & 1) as u32 * half);
        parent.points += self.points;
        parent.lowest = parent.lowest.min(self.lowest);
        let of_parent = |column: u16| {
            let [x, y] = column_at(column);
            column_index(x0 + x / 2, y0 + y / 2)
        };
        match (self.stacking(), parent.stacking()) {
            (None, None) => {
                self.records(|column, record, _| parent.insert::<false>(of_parent(column), record, 0));
            }
            (Some(fine), Some(coarse)) => {
                assert_eq!(coarse.slice_log2, fine.coarser_log2(), "slices are those of cells twice as wide");
                self.records(|column, record, low| {
                    let lowest = fine.low_height(of_record(&record), low);
                    let low = stacks::low_of(coarse, record, lowest);
                    parent.insert::<true>(of_parent(column), record, low);
                });
            }
            _ => panic!("columns and stacks do not mix"),
        }
        match (&self.measuring, &mut parent.measuring) {
            (None, None) => {}
            (Some(fine), Some(coarse)) => fine.coarsen_into(coarse, of_parent),
            _ => panic!("measures do not mix"),
        }
    }

    /// Packs the section into memory of its own.
    pub fn pack(&self) -> Payload {
        let spans = self.spans();
        let layout = match &spans {
            None => self.layout_of_columns(),
            Some(spans) => self.layout_of(spans),
        };
        let mut words = vec![0; layout.words as usize];
        match &spans {
            None => self.pack_columns(&mut words, <[u32]>::copy_from_slice),
            Some(spans) => self.pack_stacks(spans, &mut words),
        }
        Payload { words, layout, points: self.points, highest_of: self.highest_of() }
    }

    /// Packs the section into the front of `words`, which has room for [`Layout::words`]; gives the highest record of
    /// each (class, withheld) present.
    ///
    /// Each word is written once, front to back within each part, and none is read: the memory may be write-combined.
    pub fn pack_into(&self, words: &mut [u32]) -> HighestOf {
        self.pack_with(words, <[u32]>::copy_from_slice)
    }

    /// The same, long stretches by `copy`.
    pub fn pack_with(&self, words: &mut [u32], copy: impl Fn(&mut [u32], &[u32])) -> HighestOf {
        match self.spans() {
            None => self.pack_columns(words, copy),
            Some(spans) => self.pack_stacks(&spans, words),
        }
        self.highest_of()
    }

    fn pack_columns(&self, words: &mut [u32], copy: impl Fn(&mut [u32], &[u32])) {
        let layout = self.layout_of_columns();
        let (header, rest) = words[..layout.words as usize].split_at_mut(HEADER_WORDS as usize);
        let (places, rest) = rest.split_at_mut(PLACE_WORDS * SECTION_BLOCKS);
        let (records, rest) = rest.split_at_mut(layout.blocks as usize * BLOCK_WORDS);
        let (counts, others) = rest.split_at_mut(layout.blocks as usize * COUNT_WORDS);
        header.copy_from_slice(&layout.header());
        let (first, heads, of_columns, _) = self.pages.planes();
        let mut rest_of_records = records;
        let mut rest_of_counts = bytemuck::cast_slice_mut::<u32, u8>(counts);
        let mut others = others.as_chunks_mut::<RUN_WORDS>().0.iter_mut();
        let mut sorted = Vec::new();
        let (mut at, mut written) = (FIRST_BLOCK, 0);
        let mut put = |record: Record| *others.next().expect("as many as are counted") = record.0;
        let places = places.as_chunks_mut::<PLACE_WORDS>().0;
        let mut b = 0;
        while b < SECTION_BLOCKS {
            let end = self.end_of_occupied(b);
            if end == b {
                places[b] = [0; 2];
                b += 1;
                continue;
            }
            let columns = b * BLOCK_COLUMNS..end * BLOCK_COLUMNS;
            let (to, rest) = rest_of_records.split_at_mut((end - b) * BLOCK_WORDS);
            copy(to, bytemuck::cast_slice(&first[columns.clone()]));
            rest_of_records = rest;
            let (to, rest) = rest_of_counts.split_at_mut(columns.len());
            to.copy_from_slice(&of_columns[columns]);
            rest_of_counts = rest;
            for (b, place) in (b..end).zip(&mut places[b..end]) {
                *place = [at, written];
                at += BLOCK_WORDS as u32;
                if !self.chained.has(b) {
                    continue;
                }
                for c in (b * BLOCK_COLUMNS..(b + 1) * BLOCK_COLUMNS).step_by(8) {
                    // Few columns have others; a byte each.
                    let mut some = u64::from_le_bytes(of_columns[c..].as_chunks().0[0]);
                    while some != 0 {
                        let place = some.trailing_zeros() / 8;
                        let count = (some >> (8 * place)) as u8;
                        some &= !(0xFF << (8 * place));
                        let head = heads[c + place as usize];
                        if count == 1 {
                            put(self.others[head as usize].record);
                        } else {
                            sorted.clear();
                            sorted.extend(self.chain(head));
                            sorted.sort_unstable_by(|a, b| b.cmp(a));
                            sorted.truncate(count.into());
                            sorted.iter().for_each(|&record| put(record));
                        }
                        written += u32::from(count);
                    }
                }
            }
            b = end;
        }
    }

    /// As [`Columns::pack_with`], of stacks.
    fn pack_stacks(&self, spans: &Spans, words: &mut [u32]) {
        let layout = self.layout_of(spans);
        let sizes = layout.sizes();
        let (header, rest) = words[..layout.words as usize].split_at_mut(HEADER_WORDS as usize);
        let (places, rest) = rest.split_at_mut(STACK_PLACE_WORDS * SECTION_BLOCKS);
        let (blocks, rest) = rest.split_at_mut((layout.blocks * sizes.block) as usize);
        let (counts, further) = rest.split_at_mut(layout.blocks as usize * COUNT_WORDS);
        let put = |words: &mut [u32], (record, depth): (Record, u16)| {
            let [_, class, rest] = record.0;
            let code = layout.code.encode(of_record(&record));
            match words.len() {
                RUN_WORDS => words.copy_from_slice(&[code | u32::from(depth) << 16, class, rest]),
                _ => words.copy_from_slice(&[code, class, rest, depth.into()]),
            }
        };
        header.copy_from_slice(&layout.header());
        let (first, ..) = self.pages.planes();
        let mut blocks = blocks.chunks_exact_mut(sizes.block as usize);
        let mut of_blocks =
            spans.counts.chunks_exact(BLOCK_COLUMNS).zip(spans.depths.chunks_exact(BLOCK_COLUMNS));
        let (mut at, mut written, mut room, mut lists) = (FIRST_STACK_BLOCK, 0, 0, 0);
        for (b, place) in places.as_chunks_mut::<STACK_PLACE_WORDS>().0.iter_mut().enumerate() {
            if !self.occupied.has(b) {
                *place = [0; STACK_PLACE_WORDS];
                continue;
            }
            let [south, north] = spans.floating.runs[b];
            let [of_south, of_north] = spans.floating.lists[b].map(|is_listed| {
                lists += u32::from(is_listed);
                if is_listed { lists } else { 0 }
            });
            *place = [at, written, room, room + south, of_south, of_north];
            at += sizes.block;
            room += south + north;
            let (block, (counts, depths)) =
                blocks.next().zip(of_blocks.next()).expect("as many as are counted");
            let columns = &first[b * BLOCK_COLUMNS..(b + 1) * BLOCK_COLUMNS];
            for ((words, &record), &depth) in block.chunks_exact_mut(sizes.run).zip(columns).zip(depths) {
                match record.is_empty() {
                    true => words.fill(0),
                    false => put(words, (record, depth)),
                }
            }
            written += counts.iter().map(|count| u32::from(*count)).sum::<u32>();
        }
        bytemuck::cast_slice_mut(counts).copy_from_slice(&spans.counts);
        for (words, &span) in further.chunks_exact_mut(sizes.run).zip(&spans.further) {
            put(words, span);
        }
    }

    /// The first block from `b` on that holds nothing.
    fn end_of_occupied(&self, b: usize) -> usize {
        (b..SECTION_BLOCKS).find(|&b| !self.occupied.has(b)).unwrap_or(SECTION_BLOCKS)
    }
}

/// First word of the highest record of each class; 0: none. By flags, of which few sets occur.
#[derive(Default)]
struct Highest([Option<Box<[u32; 256]>>; Flags::SETS]);

impl Highest {
    #[inline]
    fn see(&mut self, record: Record) {
        let (class, flags) = record.kind();
        let of_flags = self.0[usize::from(flags.bits())].get_or_insert_with(|| Box::new([0; 256]));
        let highest = &mut of_flags[usize::from(class)];
        // Seldom stored, so that one point does not wait for the last.
        if record.0[0] > *highest {
            *highest = record.0[0];
        }
    }

    /// The kinds that there are.
    fn each(&self) -> impl Iterator<Item = (Kind, u32)> {
        let sets = (0u8..).zip(&self.0).filter_map(|(bits, of)| Some((Flags::of(bits), of.as_ref()?)));
        sets.flat_map(|(flags, of)| (0u8..=255).map(move |class| ((class, flags), of[usize::from(class)])))
            .filter(|(_, h)| *h != 0)
    }

    /// Bytes held.
    fn bytes(&self) -> usize {
        self.0.iter().flatten().map(|of_flags| size_of_val(&**of_flags)).sum()
    }
}

/// Height of a record that is not empty.
fn of_record(record: &Record) -> Height {
    record.height().expect("columns hold no empty records")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attribute::Attributes;
    use proptest::prelude::*;
    use std::collections::{BTreeMap, BTreeSet};

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

    type Point = (u32, u32, Record);

    /// Packing as it is specified, from points: the words, and the runs of each column.
    fn pack_plainly(points: &[Point]) -> (Vec<u32>, BTreeMap<u16, Vec<Record>>, HighestOf) {
        let mut best = BTreeMap::<(u16, u8, u8), Record>::new();
        let mut highest_of = BTreeMap::<(u8, u8), Height>::new();
        for &(x, y, record) in points {
            let flags = record.flags() & 0xF;
            let best = best.entry((column_index(x, y), record.class(), flags)).or_insert(record);
            *best = record.max(*best);
            let highest = highest_of.entry((record.class(), flags)).or_insert(Height(i32::MIN));
            *highest = of_record(&record).max(*highest);
        }
        let mut columns = BTreeMap::<u16, Vec<Record>>::new();
        best.into_iter().for_each(|((column, ..), record)| columns.entry(column).or_default().push(record));
        for runs in columns.values_mut() {
            runs.sort_unstable_by(|a, b| b.cmp(a));
            runs.truncate(255);
        }
        let heights = || points.iter().map(|(_, _, record)| of_record(record).0);
        let (lowest, highest) =
            (heights().min().unwrap_or(i32::MAX), heights().max().unwrap_or(i32::MIN + 1));
        let blocks: BTreeSet<_> = columns.keys().map(|column| column / 64).collect();
        let further: Vec<_> = columns.values().flat_map(|runs| &runs[1..]).flat_map(|r| r.0).collect();
        let code = HeightCode::fit(lowest, highest);
        let counts_at = 16 + 2 * 1024 + 192 * blocks.len() as u32;
        let others_at = counts_at + 16 * blocks.len() as u32;
        let [wide, all] = [u32::from(code.wide), others_at + further.len() as u32];
        let mut words = vec![1, all, 8 << 16 | wide << 8, code.base as u32];
        words.extend([blocks.len() as u32, counts_at, others_at]);
        words.resize(others_at as usize, 0);
        let mut before = 0;
        for (n, &block) in blocks.iter().enumerate() {
            let at = 16 + 2 * 1024 + 192 * n;
            words[16 + 2 * usize::from(block)] = at as u32;
            words[16 + 2 * usize::from(block) + 1] = before;
            for (column, runs) in columns.range(64 * block..=64 * block + 63) {
                let c = usize::from(column % 64);
                words[at + 3 * c..at + 3 * c + 3].copy_from_slice(&runs[0].0);
                words[counts_at as usize + 16 * n + c / 4] |= (runs.len() as u32 - 1) << (8 * (c % 4));
                before += runs.len() as u32 - 1;
            }
        }
        words.extend(further);
        (
            words,
            columns,
            highest_of.into_iter().map(|((class, flags), h)| ((class, Flags::of(flags)), h)).collect(),
        )
    }

    /// Into memory that holds rubbish, which must be gone, and no further than it should.
    fn check_packing(points: &[Point]) {
        let mut section = Columns::default();
        points.iter().for_each(|&(x, y, record)| section.add(x, y, record));
        let (words, columns, highest_of) = pack_plainly(points);
        assert_eq!(section.layout().words as usize, words.len());
        for rubbish in [0xDEAD_BEEF, !0] {
            let mut ring = vec![rubbish; words.len() + 3];
            assert_eq!(section.pack_into(&mut ring), highest_of);
            assert!(ring[..words.len()] == words);
            assert!(ring[words.len()..] == [rubbish; 3]);
        }
        let packed = section.pack();
        assert!(packed.words == words);
        let mut read = BTreeMap::new();
        packed.columns(|column, runs| assert!(read.insert(column, runs.to_vec()).is_none()));
        assert!(read == columns);
    }

    #[test]
    fn packing_is_as_specified_where_it_is_hard() {
        check_packing(&[]);
        // More runs than a count holds, in two columns: 512 of 256 classes and two of sixteen sets of flags.
        let mut points = Vec::new();
        for k in 0..512 {
            let r = record(k * 37 % 1009, (k % 256) as u8, (k / 256 * 5 + k % 12) as u8);
            points.extend([(3, 200, r), (77, 5, r), (k as u32 % 256, 99, r)]);
            // As many as are counted with a column, and one more and less.
            points.extend((126..=128).filter(|most| k <= *most).map(|most| (most as u32, 250, r)));
        }
        check_packing(&points);
        // Every column once.
        let full = |k: u32| (k % 256, k / 256, record((k * 31 % 4001) as i32, 2, 0));
        check_packing(&(0..SECTION_COLUMNS as u32).map(full).collect::<Vec<_>>());
        for at in 0..=u16::MAX {
            let [x, y] = column_at(at);
            assert_eq!(column_index(x, y), at);
        }
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
            let point = |(x, y, h, class, flags)| (x % crowd, y % crowd, record(h * step, class, flags));
            check_packing(&points.into_iter().map(point).collect::<Vec<_>>());
        }
    }

    #[test]
    fn bytes_are_those_of_the_pages_that_are_touched() {
        let mut columns = Columns::default();
        let mut pages = BTreeSet::new();
        let mut others = 0;
        for k in 0..1500u32 {
            let (x, y) = (k.wrapping_mul(2_654_435_761) >> 24, k.wrapping_mul(40_503) >> 3 & 0xFF);
            columns.add(x, y, record(5, 2, 0));
            let block = usize::from(column_index(x, y)) / BLOCK_COLUMNS;
            pages.extend([(0, block * 768 / 4096), (0, (block * 768 + 767) / 4096)]);
            if k % 9 == 0 {
                columns.add(x, y, record(5, 3, 0));
                pages.extend([(1, block / 16), (2, block / 64)]);
                others += 1;
            }
            assert_eq!(columns.bytes(), 1024 + 4096 * pages.len() + 16 * others);
        }
        assert!(pages.len() > 200);
    }

    #[test]
    fn order_of_points_changes_nothing() {
        let mut points = Vec::new();
        for k in 0..4000u32 {
            let h = (k.wrapping_mul(2_654_435_761) >> 20) as i32 - 2000;
            points.push((
                k * 7 % 256,
                k * 13 % 256 / 8,
                record(h, (k % 5) as u8, if k % 11 == 0 { (k % 16) as u8 } else { 0 }),
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
    fn runs_are_sorted_downward() {
        let mut columns = Columns::default();
        columns.add(9, 8, record(100, 2, 0));
        columns.add(9, 8, record(900, 5, 0));
        columns.add(9, 8, record(500, 6, 0));
        columns.add(255, 255, record(50, 2, 0));
        let mut seen = Vec::new();
        columns.pack().columns(|at, runs| {
            seen.push((column_at(at), runs.iter().map(|r| r.class()).collect::<Vec<_>>()))
        });
        assert_eq!(seen, [([9, 8], vec![5, 6, 2]), ([255, 255], vec![2])]);
    }
}
