//! Stacks: columns whose runs may float.
//!
//! Of a column and a key (class and class flags) the highest record is kept in each slice of heights, with the lowest height
//! there: together they say where the points of a key leave gaps. Keys whose class never floats have one run, as in
//! columns. Which runs float is decided where sections are derived, under what is shown; here it is bounded, so that room
//! is made for no more than may.

use super::super::layout::{
    BLOCK_COLUMNS, BLOCK_WORDS, COUNT_WORDS, FIRST_STACK_BLOCK, Floats, HEADER_WORDS, MOST_OTHERS,
    SECTION_BLOCKS, STACK_BLOCK_WORDS, STACK_PLACE_WORDS, STACK_RUN_WORDS, column_at,
};
use super::super::surface::Surface;
use super::{Blocks, Columns, Pages, of_record};
use crate::attribute::{Record, always_floats, is_always_solid};
use crate::coords::{Height, SECTION_SIDE, Stacking};
use crate::shared::passes::{HALF_BLOCK_EAST, HALF_BLOCK_NORTH};
use crate::source::{FLAG_KEY_POINT, FLAG_OVERLAP, FLAG_SYNTHETIC, FLAG_WITHHELD};

/// Flags that tell keys apart.
const KEY_FLAGS: u8 = FLAG_SYNTHETIC | FLAG_KEY_POINT | FLAG_WITHHELD | FLAG_OVERLAP;

/// Columns of a half block, the southern or northern rows of a block.
const HALF_COLUMNS: usize = (HALF_BLOCK_EAST * HALF_BLOCK_NORTH) as usize;

/// Columns around one, each way, whose gaps let it float where its class does not tell.
const REACH: usize = 2;

/// What stacks have besides columns.
pub(super) struct Stacks {
    pub(super) stacking: Stacking,
    /// Of `Columns::others`.
    pub(super) lows: Vec<u16>,
    /// Runs that are not always solid.
    loose: u32,
    /// Blocks that hold such, in their southern rows and in their northern.
    halves: [Blocks; 2],
}

/// Whether two records belong to the same run: same key, and, unless that never floats, same slice.
#[inline]
pub(super) fn same_run(slice_log2: u32, a: Record, b: Record) -> bool {
    let is_same_key = a.class() == b.class() && (a.flags() ^ b.flags()) & KEY_FLAGS == 0;
    // First words are heights, of which the highest bit is turned.
    is_same_key && (is_always_solid(a.class()) || (a.0[0] ^ b.0[0]) >> slice_log2 == 0)
}

/// The low of a record's run, of which `lowest` is the lowest height.
#[inline]
pub(super) fn low_of(stacking: Stacking, record: Record, lowest: Height) -> u16 {
    if is_always_solid(record.class()) { 0 } else { stacking.low_of(lowest) }
}

impl Stacks {
    #[inline]
    pub(super) fn slice_log2(&self) -> u32 {
        self.stacking.slice_log2
    }

    /// A run begins with `record`.
    #[inline]
    pub(super) fn begin(&mut self, column: u16, record: Record) {
        if !is_always_solid(record.class()) {
            self.loose += 1;
            self.halves[half_of(column)].insert(usize::from(column) / BLOCK_COLUMNS);
        }
    }

    /// Bytes held.
    pub(super) fn bytes(&self) -> usize {
        size_of::<Stacks>() + (self.lows.len() - 1) * size_of::<u16>()
    }

    /// As much as any of its runs may be; more with every run, whatever came first.
    pub(super) fn floats_at_most(&self) -> Floats {
        Floats { spans: self.loose, lists: self.halves.iter().map(Blocks::count).sum() }
    }
}

/// 0: the southern rows of its block; 1: the northern.
fn half_of(column: u16) -> usize {
    usize::from(column) % BLOCK_COLUMNS / HALF_COLUMNS
}

/// Runs of a section that may float under some mask.
pub(super) struct Floating {
    /// How many, of the halves of each block.
    runs: Vec<[u32; 2]>,
}

impl Floating {
    pub(super) fn floats(&self) -> Floats {
        let halves = || self.runs.as_flattened().iter();
        Floats { spans: halves().sum(), lists: halves().filter(|runs| **runs > 0).count() as u32 }
    }
}

/// A bit a column, row by row.
#[derive(Clone)]
struct Marks(Vec<[u64; 4]>);

impl Marks {
    fn none() -> Marks {
        Marks(vec![[0; 4]; SECTION_SIDE as usize])
    }

    fn insert(&mut self, column: u16) {
        let [x, y] = column_at(column);
        self.0[y as usize][x as usize / 64] |= 1 << (x % 64);
    }

    fn has(&self, column: u16) -> bool {
        let [x, y] = column_at(column);
        self.0[y as usize][x as usize / 64] >> (x % 64) & 1 != 0
    }

    /// And all within [`REACH`] of any.
    fn spread(&self) -> Marks {
        let along: Vec<[u64; 4]> = self.0.iter().map(|row| spread_along(*row)).collect();
        let rows = (0..along.len()).map(|y| {
            let around = &along[y.saturating_sub(REACH)..along.len().min(y + REACH + 1)];
            around.iter().fold([0; 4], |all, row| std::array::from_fn(|k| all[k] | row[k]))
        });
        Marks(rows.collect())
    }
}

fn spread_along(row: [u64; 4]) -> [u64; 4] {
    let word = |k: usize| row.get(k).copied().unwrap_or(0);
    std::array::from_fn(|k| {
        let (west, here, east) = (word(k.wrapping_sub(1)), word(k), word(k + 1));
        (1..=REACH).fold(here, |all, n| all | here << n | here >> n | west >> (64 - n) | east << (64 - n))
    })
}

/// What a column's runs say of spans that float.
struct Seen {
    /// Highest of the runs' lowest heights, and lowest of their highest.
    low: i32,
    high: i32,
    /// Runs that always float, and those of which what is around tells.
    floating: u32,
    unclassified: u32,
}

impl Seen {
    const NOTHING: Seen = Seen { low: i32::MIN, high: i32::MAX, floating: 0, unclassified: 0 };

    fn see(&mut self, stacking: Stacking, (record, low): (Record, u16)) {
        let (class, high) = (record.class(), of_record(&record));
        let is_solid = is_always_solid(class);
        let low = if is_solid { high } else { stacking.low_height(high, low) };
        self.low = self.low.max(low.0);
        self.high = self.high.min(high.0);
        self.floating += u32::from(always_floats(class));
        self.unclassified += u32::from(!is_solid && !always_floats(class));
    }

    /// Under some mask there may be a gap: without it there is none under any.
    fn may_gape(&self, stacking: Stacking) -> bool {
        i64::from(self.low) - i64::from(self.high) > i64::from(stacking.gap())
    }
}

impl Columns {
    /// No points yet, in stacks: of every column and key the highest record in each slice, and the lowest height there; of
    /// classes that never float the highest alone.
    pub fn stacks(stacking: Stacking) -> Columns {
        let stacks = Stacks { stacking, lows: vec![0], loose: 0, halves: Default::default() };
        Columns { pages: Pages::new(Surface::Stacks), stacks: Some(Box::new(stacks)), ..Columns::default() }
    }

    /// What they are stacked by; `None`: columns.
    pub fn stacking(&self) -> Option<Stacking> {
        self.stacks.as_ref().map(|stacks| stacks.stacking)
    }

    /// A column's further runs and their lows, of columns 0.
    pub(super) fn chain_of(&self, head: u32) -> impl Iterator<Item = (Record, u16)> {
        let lows = self.stacks.as_ref().map_or(&[][..], |stacks| &stacks.lows);
        let next = |index: &u32| Some(self.others[*index as usize].next).filter(|next| *next != 0);
        std::iter::successors(Some(head), next).map(move |index| {
            let index = index as usize;
            (self.others[index].record, lows.get(index).copied().unwrap_or(0))
        })
    }

    /// A column's further runs that are uploaded, highest first: the highest, but not only such as float where others lie
    /// below them.
    fn kept(&self, head: u32, kept: &mut Vec<(Record, u16)>) {
        kept.clear();
        kept.extend(self.chain_of(head));
        kept.sort_unstable_by(|(a, _), (b, _)| b.cmp(a));
        let most = usize::from(MOST_OTHERS);
        if let Some(solid) = kept.iter().skip(most).find(|(record, _)| !always_floats(record.class())) {
            kept[most - 1] = *solid;
        }
        kept.truncate(most);
    }

    /// Which runs may float; `None`: these are columns.
    pub(super) fn floating(&self) -> Option<Floating> {
        let stacking = self.stacking()?;
        let (first, heads, counts, lows) = self.pages.planes();
        let mut runs = vec![[0; 2]; SECTION_BLOCKS];
        let mut gaps = Marks::none();
        let mut unclassified = Vec::new();
        let mut kept = Vec::new();
        for b in (0..SECTION_BLOCKS).filter(|&b| self.occupied.has(b)) {
            for c in (b * BLOCK_COLUMNS..(b + 1) * BLOCK_COLUMNS).filter(|&c| !first[c].is_empty()) {
                let mut seen = Seen::NOTHING;
                seen.see(stacking, (first[c], lows[c]));
                match counts[c] {
                    0 => {}
                    MOST_OTHERS => {
                        self.kept(heads[c], &mut kept);
                        kept.iter().for_each(|&run| seen.see(stacking, run));
                    }
                    _ => self.chain_of(heads[c]).for_each(|run| seen.see(stacking, run)),
                }
                let column = c as u16;
                runs[b][half_of(column)] += seen.floating;
                if seen.may_gape(stacking) {
                    gaps.insert(column);
                }
                if seen.unclassified > 0 {
                    unclassified.push((column, seen.unclassified));
                }
            }
        }
        let near = gaps.spread();
        for (column, n) in unclassified.into_iter().filter(|(column, _)| near.has(*column)) {
            runs[usize::from(column) / BLOCK_COLUMNS][half_of(column)] += n;
        }
        Some(Floating { runs })
    }

    /// As [`Columns::pack_with`], of what may float.
    pub(super) fn pack_stacks(
        &self,
        floating: &Floating,
        words: &mut [u32],
        copy: impl Fn(&mut [u32], &[u32]),
    ) {
        let layout = self.layout_with(Some(floating.floats()));
        let (header, rest) = words[..layout.words as usize].split_at_mut(HEADER_WORDS as usize);
        let (places, rest) = rest.split_at_mut(STACK_PLACE_WORDS * SECTION_BLOCKS);
        let (blocks, rest) = rest.split_at_mut((layout.blocks * STACK_BLOCK_WORDS) as usize);
        let (counts, others) = rest.split_at_mut(layout.blocks as usize * COUNT_WORDS);
        header.copy_from_slice(&layout.header());
        let (first, heads, of_columns, lows) = self.pages.planes();
        let places = places.as_chunks_mut::<STACK_PLACE_WORDS>().0;
        let blocks = blocks.as_chunks_mut::<{ STACK_BLOCK_WORDS as usize }>().0.iter_mut();
        let counts = counts.as_chunks_mut::<COUNT_WORDS>().0.iter_mut();
        let mut parts = blocks.zip(counts);
        let mut others = others.as_chunks_mut::<STACK_RUN_WORDS>().0.iter_mut();
        let mut kept = Vec::new();
        let (mut at, mut written, mut spans, mut lists) = (FIRST_STACK_BLOCK, 0, 0, 0);
        for (b, place) in places.iter_mut().enumerate() {
            if !self.occupied.has(b) {
                *place = [0; STACK_PLACE_WORDS];
                continue;
            }
            let [south, north] = floating.runs[b];
            let [of_south, of_north] = [south, north].map(|runs| {
                lists += u32::from(runs > 0);
                if runs > 0 { lists } else { 0 }
            });
            *place = [at, written, spans, spans + south, of_south, of_north];
            at += STACK_BLOCK_WORDS;
            spans += south + north;
            let columns = b * BLOCK_COLUMNS..(b + 1) * BLOCK_COLUMNS;
            let (block, counts) = parts.next().expect("as many as are counted");
            let (of_records, of_lows) = block.split_at_mut(BLOCK_WORDS);
            copy(of_records, bytemuck::cast_slice(&first[columns.clone()]));
            of_lows.copy_from_slice(bytemuck::cast_slice(&lows[columns.clone()]));
            counts.copy_from_slice(bytemuck::cast_slice(&of_columns[columns.clone()]));
            if !self.chained.has(b) {
                continue;
            }
            for c in columns.filter(|&c| of_columns[c] > 0) {
                self.kept(heads[c], &mut kept);
                for (record, low) in &kept {
                    let [height, class, rest] = record.0;
                    *others.next().expect("as many as are counted") = [height, class, rest, (*low).into()];
                }
                written += u32::from(of_columns[c]);
            }
        }
    }
}
