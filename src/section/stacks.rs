//! Stacks: columns whose runs may float.
//!
//! Of a column and a key (the kind of a point: class and flags) the highest record is kept in each slice of heights, with the lowest height
//! there: together they say where the points of a key leave gaps. Keys whose class never floats have one run, as in
//! columns. Which runs float is decided where sections are derived, under what is shown; here it is bounded, so that room
//! is made for no more than may.

use super::blocks::Blocks;
use super::layout::{BLOCK_COLUMNS, Floats, MOST_OTHERS, SECTION_BLOCKS, column_at, column_index};
use crate::attribute::{Record, always_floats, is_always_solid};
use crate::coords::{Height, SECTION_COLUMNS, SECTION_SIDE, Stacking};
use crate::shared::passes::{HALF_BLOCK_EAST, HALF_BLOCK_NORTH};
use foldhash::fast::FixedState;
use std::collections::HashMap;

/// Columns of a half block, the southern or northern rows of a block.
const HALF_COLUMNS: usize = (HALF_BLOCK_EAST * HALF_BLOCK_NORTH) as usize;

/// Further runs of a column from which on they are looked up, not walked through: hardly any data have so many.
pub(super) const LONG: u8 = 32;
const _: () = assert!(LONG < MOST_OTHERS);

/// What stacks have besides columns.
pub(super) struct Stacks {
    pub(super) stacking: Stacking,
    /// Of `Columns::others`.
    pub(super) lows: Vec<u16>,
    /// Runs that are not always solid.
    loose: u32,
    /// Blocks that hold such, in their southern rows and in their northern.
    halves: [Blocks; 2],
    /// Where in `Columns::others` the further runs of columns are that have [`LONG`] and more: by column and run.
    index: HashMap<u64, u32, FixedState>,
}

/// Whether two records belong to the same run: same key, and, unless that never floats, same slice.
#[inline]
pub(super) fn same_run(slice_log2: u32, a: Record, b: Record) -> bool {
    // First words are heights, of which the highest bit is turned.
    a.kind() == b.kind() && (is_always_solid(a.class()) || (a.0[0] ^ b.0[0]) >> slice_log2 == 0)
}

/// The low of a record's run, of which `lowest` is the lowest height.
#[inline]
pub(super) fn low_of(stacking: Stacking, record: Record, lowest: Height) -> u16 {
    if is_always_solid(record.class()) { 0 } else { stacking.low_of(lowest) }
}

impl Stacks {
    pub(super) fn new(stacking: Stacking) -> Stacks {
        let index = HashMap::default();
        Stacks { stacking, lows: vec![0], loose: 0, halves: Default::default(), index }
    }

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

    /// The further run of a long column that a record belongs to; 0: none.
    pub(super) fn find(&self, column: u16, record: Record) -> u32 {
        self.index.get(&self.run_of(column, record)).copied().unwrap_or(0)
    }

    /// A further run of a long column is there.
    pub(super) fn note(&mut self, column: u16, record: Record, index: u32) {
        self.index.insert(self.run_of(column, record), index);
    }

    /// A further run of a long column has become the first, and the one that was has its place.
    pub(super) fn swapped(&mut self, column: u16, first: Record, other: Record, index: u32) {
        self.index.remove(&self.run_of(column, first));
        self.note(column, other, index);
    }

    /// A column and a run of it: records of equal numbers are of the same run.
    fn run_of(&self, column: u16, record: Record) -> u64 {
        let [height, ..] = record.0;
        let slice = if is_always_solid(record.class()) { 0 } else { height >> self.stacking.slice_log2 };
        let (class, flags) = record.kind();
        u64::from(column) << 48 | u64::from(class) << 40 | u64::from(flags.bits()) << 32 | u64::from(slice)
    }

    /// Bytes held.
    pub(super) fn bytes(&self) -> usize {
        // Such a map is half full, and a byte beside each entry tells whether there is one.
        let index = 2 * self.index.len() * (size_of::<(u64, u32)>() + 1);
        size_of::<Stacks>() + (self.lows.len() - 1) * size_of::<u16>() + index
    }

    /// As much as any of its runs may be; more with every run, whatever came first.
    pub(super) fn floats_at_most(&self) -> Floats {
        // Lists are in halves beside those, too.
        let halves: u32 = self.halves.iter().map(Blocks::count).sum();
        Floats { spans: self.loose, lists: (halves * 9).min(2 * SECTION_BLOCKS as u32) }
    }
}

/// 0: the southern rows of its block; 1: the northern.
fn half_of(column: u16) -> usize {
    usize::from(column) % BLOCK_COLUMNS / HALF_COLUMNS
}

/// Runs of a section that may float under some mask.
pub(super) struct Floating {
    /// How many, of the halves of each block.
    pub(super) runs: Vec<[u32; 2]>,
    /// Halves that have lists: they hold any, or what is around such.
    pub(super) lists: Vec<[bool; 2]>,
}

impl Floating {
    pub(super) fn floats(&self) -> Floats {
        let lists = self.lists.as_flattened().iter().filter(|is_listed| **is_listed).count() as u32;
        Floats { spans: self.runs.as_flattened().iter().sum(), lists }
    }
}

/// The lowest height of each column, row by row; none: `i32::MAX`.
struct Lowest(Vec<i32>);

impl Lowest {
    fn none() -> Lowest {
        Lowest(vec![i32::MAX; SECTION_COLUMNS])
    }

    fn set(&mut self, column: u16, lowest: i32) {
        let [x, y] = column_at(column);
        self.0[(y * SECTION_SIDE + x) as usize] = lowest;
    }

    /// That of all columns within a reach, of each column.
    fn around(&self, reach: usize) -> Lowest {
        const SIDE: usize = SECTION_SIDE as usize;
        let near = |at: usize| at.saturating_sub(reach)..SIDE.min(at + reach + 1);
        let least = |some: &[i32]| some.iter().fold(i32::MAX, |least, v| least.min(*v));
        let along: Vec<i32> =
            self.0.chunks_exact(SIDE).flat_map(|row| (0..SIDE).map(move |x| least(&row[near(x)]))).collect();
        let mut around = vec![i32::MAX; SECTION_COLUMNS];
        for (y, row) in around.chunks_exact_mut(SIDE).enumerate() {
            for of in near(y) {
                let other = &along[of * SIDE..(of + 1) * SIDE];
                row.iter_mut().zip(other).for_each(|(least, v)| *least = (*v).min(*least));
            }
        }
        Lowest(around)
    }

    fn at(&self, column: u16) -> i32 {
        let [x, y] = column_at(column);
        self.0[(y * SECTION_SIDE + x) as usize]
    }
}

/// What a column's spans say of what floats.
struct Seen {
    /// Its lowest height.
    lowest: i32,
    /// Spans that always float.
    floating: u32,
    /// Where the lowest of them ends.
    bottom: Height,
}

impl Seen {
    const NOTHING: Seen = Seen { lowest: i32::MAX, floating: 0, bottom: Height(i32::MAX) };

    /// Gives the lowest height of a span of which what is around tells.
    fn see(&mut self, stacking: Stacking, (record, depth): (Record, u16)) -> Option<i32> {
        let (class, high) = (record.class(), record.height().expect("runs are not empty"));
        let is_solid = is_always_solid(class);
        // No height is i32::MIN.
        let low = Height(stacking.height_at_depth(high, depth).max(i64::from(i32::MIN) + 1) as i32);
        self.lowest = self.lowest.min(low.0);
        let bottom =
            if is_solid { low } else { Height(low.0.saturating_sub(stacking.thickness).max(i32::MIN + 1)) };
        self.bottom = self.bottom.min(bottom);
        self.floating += u32::from(always_floats(class));
        (!is_solid && !always_floats(class)).then_some(low.0)
    }
}

/// Sees the columns of a section, in block order, and then tells which runs may float.
pub(super) struct Gathering {
    stacking: Stacking,
    /// Of the halves of each block: runs that float whatever is around.
    runs: Vec<[u32; 2]>,
    lowest: Lowest,
    /// Blocks that hold anything.
    occupied: Vec<bool>,
    /// Columns of spans of which what is around tells, and their lowest heights.
    unclassified: Vec<(u16, i32)>,
    /// No span ends lower.
    lowest_bottom: Height,
}

impl Gathering {
    pub(super) fn new(stacking: Stacking) -> Gathering {
        let (runs, occupied) = (vec![[0; 2]; SECTION_BLOCKS], vec![false; SECTION_BLOCKS]);
        let lowest_bottom = Height(i32::MAX);
        Gathering {
            stacking,
            runs,
            lowest: Lowest::none(),
            occupied,
            unclassified: Vec::new(),
            lowest_bottom,
        }
    }

    /// No span that has been seen ends lower.
    pub(super) fn lowest_bottom(&self) -> Height {
        self.lowest_bottom
    }

    /// A column, and all of its spans that are uploaded, with their depths.
    pub(super) fn see(&mut self, column: u16, spans: &[(Record, u16)]) {
        let mut seen = Seen::NOTHING;
        let lows = spans.iter().filter_map(|span| seen.see(self.stacking, *span));
        self.unclassified.extend(lows.map(|low| (column, low)));
        let block = usize::from(column) / BLOCK_COLUMNS;
        self.occupied[block] = true;
        self.runs[block][half_of(column)] += seen.floating;
        self.lowest.set(column, seen.lowest);
        self.lowest_bottom = self.lowest_bottom.min(seen.bottom);
    }

    pub(super) fn finish(mut self) -> Floating {
        let mut lists: Vec<[bool; 2]> = self.runs.iter().map(|halves| halves.map(|n| n > 0)).collect();
        // Where nothing around is lower by a gap, nothing floats under any mask.
        let (gap, reach) = (i64::from(self.stacking.gap()), self.stacking.reach);
        let around =
            if self.unclassified.is_empty() { Lowest::none() } else { self.lowest.around(reach as usize) };
        let over = |(column, low): &(u16, i32)| i64::from(*low) - i64::from(around.at(*column)) > gap;
        let last = SECTION_SIDE - 1;
        for (column, _) in self.unclassified.into_iter().filter(over) {
            self.runs[usize::from(column) / BLOCK_COLUMNS][half_of(column)] += 1;
            // What is around tells it by its lowest points, which lists have.
            let ends = |at: u32| [at.saturating_sub(reach), (at + reach).min(last)];
            let [x, y] = column_at(column).map(ends);
            for corner in x.into_iter().flat_map(|x| y.map(|y| column_index(x, y))) {
                let block = usize::from(corner) / BLOCK_COLUMNS;
                lists[block][half_of(corner)] |= self.occupied[block];
            }
        }
        Floating { runs: self.runs, lists }
    }
}

/// The spans of a column, whose runs come in any order, with their lows: runs of a key whose ends are no farther apart than a slice
/// are one, which has the highest record, and how deep it reaches below that. Highest first, and no more than are uploaded: the highest, but
/// of those below them the highest that is always solid, and the highest of which what is around tells, too.
pub(super) fn join(stacking: Stacking, runs: &mut Vec<(Record, u16)>, spans: &mut Vec<(Record, u16)>) {
    // Key by key, so that what a run joins is the one before.
    runs.sort_unstable_by(|(a, _), (b, _)| a.kind().cmp(&b.kind()).then(b.cmp(a)));
    spans.clear();
    let height = |record: Record| record.height().expect("runs are not empty");
    for &(record, low) in &*runs {
        let high = height(record);
        let lowest = if is_always_solid(record.class()) { high } else { stacking.low_height(high, low) };
        let lowest = i64::from(lowest.0);
        if let Some((above, depth)) = spans.last_mut().filter(|(above, _)| above.kind() == record.kind()) {
            let top = height(*above);
            let end = stacking.height_at_depth(top, *depth);
            if end - i64::from(high.0) <= i64::from(stacking.gap()) {
                if i64::from(top.0) - lowest <= stacking.most_depth() {
                    *depth = stacking.depth_of(top, lowest.min(end));
                    continue;
                }
                // Longer than a depth can tell: it ends where the next begins.
                *depth = stacking.depth_of(top, end.min(high.0.into()));
            }
        }
        spans.push((record, stacking.depth_of(high, lowest)));
    }
    spans.sort_unstable_by(|(a, _), (b, _)| b.cmp(a));
    let most = usize::from(MOST_OTHERS) + 1;
    if spans.len() > most {
        let dropped = spans.split_off(most);
        let highest = |is: fn(u8) -> bool| dropped.iter().find(|(record, _)| is(record.class()));
        let of_solid = highest(is_always_solid);
        let of_others = highest(|class| !is_always_solid(class) && !always_floats(class));
        let kept: Vec<_> = of_others.into_iter().chain(of_solid).collect();
        spans.truncate(most - kept.len());
        spans.extend(kept);
        spans.sort_unstable_by(|(a, _), (b, _)| b.cmp(a));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attribute::Attributes;
    use crate::section::layout::HeightCode;
    use crate::section::{Columns, Payload, column_index};
    use proptest::prelude::*;
    use std::collections::BTreeMap;

    const SOLID: [u8; 6] = [2, 6, 9, 10, 11, 41];
    const FLOATING: [u8; 11] = [3, 4, 5, 7, 13, 14, 15, 16, 17, 18, 19];
    const CLASSES: [u8; 8] = [0, 1, 2, 5, 6, 17, 18, 64];

    type Point = (u32, u32, Record);
    /// Of each column, highest first: spans and their depths.
    type Runs = BTreeMap<u16, Vec<(Record, u16)>>;

    fn stacking(thickness: i32, slice_log2: u32) -> Stacking {
        Stacking { thickness, slice_log2, reach: 2 }
    }

    fn record(h: i64, class: u8, flags: u8) -> Record {
        let height = Height(h.clamp(i64::from(i32::MIN) + 1, i32::MAX.into()) as i32);
        Record::pack(Attributes { height, class, intensity: 7, rgb: [1, 2, 3], returns: 0x11, flags })
    }

    fn height(record: Record) -> i64 {
        record.height().unwrap().0.into()
    }

    fn key(record: Record) -> (u8, u8) {
        (record.class(), record.flags() & 0xF)
    }

    fn stacks_of(stacking: Stacking, points: &[Point]) -> Columns {
        let mut stacks = Columns::stacks(stacking);
        points.iter().for_each(|&(x, y, record)| stacks.add(x, y, record));
        stacks
    }

    /// Steps that a low, and a depth, counts by.
    fn units(slice_log2: u32) -> [i64; 2] {
        [1 << slice_log2.saturating_sub(16), 1 << slice_log2.saturating_sub(14)]
    }

    /// The spans that are uploaded, as it is specified, from points.
    fn runs_plainly(Stacking { slice_log2, .. }: Stacking, points: &[Point]) -> Runs {
        let [low_unit, unit] = units(slice_log2);
        let gap = 1i64 << slice_log2;
        // Of each column, key and slice, the highest first: the highest record and the lowest height, rounded down.
        let mut all = BTreeMap::new();
        for &(x, y, record) in points {
            let h = height(record);
            let slice = (!SOLID.contains(&record.class())).then(|| -h.div_euclid(gap));
            let at = (column_index(x, y), key(record), slice);
            let (best, lowest) = all.entry(at).or_insert((record, h));
            *best = record.max(*best);
            *lowest = h.div_euclid(low_unit).min(lowest.div_euclid(low_unit)) * low_unit;
        }
        let mut spans = BTreeMap::<_, Vec<(Record, i64)>>::new();
        for ((column, key, slice), (best, lowest)) in all {
            let lowest = if slice.is_some() { lowest } else { height(best) };
            let of_key = spans.entry((column, key)).or_default();
            if let Some((top, depth)) = of_key.last_mut()
                && height(*top) - *depth * unit - height(best) <= gap
            {
                let reach = height(*top) - lowest;
                if reach <= 0xFFFF * unit - gap {
                    *depth = (*depth).max(-(-reach).div_euclid(unit));
                    continue;
                }
                *depth = (*depth).max(-(height(best) - height(*top)).div_euclid(unit));
            }
            of_key.push((best, -(lowest - height(best)).div_euclid(unit)));
        }
        let mut runs = Runs::new();
        for ((column, _), spans) in spans {
            let spans = spans.into_iter().map(|(top, depth)| (top, depth.try_into().unwrap()));
            runs.entry(column).or_default().extend(spans);
        }
        for runs in runs.values_mut() {
            runs.sort_unstable_by(|a, b| b.cmp(a));
            let dropped = runs.split_off(runs.len().min(255));
            let highest = |is: &dyn Fn(u8) -> bool| dropped.iter().find(|(record, _)| is(record.class()));
            let of_others = highest(&|class| !SOLID.contains(&class) && !FLOATING.contains(&class));
            let of_solid = highest(&|class| SOLID.contains(&class));
            let kept: Vec<_> = of_others.into_iter().chain(of_solid).collect();
            runs.truncate(runs.len() - kept.len());
            runs.extend(kept);
            runs.sort_unstable_by(|a, b| b.cmp(a));
        }
        runs
    }

    /// Highest and lowest height of a span.
    fn ends(Stacking { slice_log2, .. }: Stacking, (record, depth): (Record, u16)) -> [i64; 2] {
        let high = height(record);
        let low = high - i64::from(depth) * units(slice_log2)[1];
        [high, low.max(i64::from(i32::MIN) + 1)]
    }

    /// What is known of the columns around one, itself included.
    fn around<T>(of: &BTreeMap<u16, T>, column: u16, reach: u32) -> impl Iterator<Item = &T> {
        let [x, y] = column_at(column).map(|v| v as i32);
        let steps = -(reach as i32)..=reach as i32;
        let places = steps.clone().flat_map(move |dy| steps.clone().map(move |dx| [x + dx, y + dy]));
        places.filter_map(|place| {
            let inside = place.iter().all(|v| (0..256).contains(v));
            inside.then(|| of.get(&column_index(place[0] as u32, place[1] as u32)))?
        })
    }

    /// Runs that may float, and whether there is a list, by block and half.
    fn may_float_plainly(stacking: Stacking, runs: &Runs) -> BTreeMap<[u16; 2], (u32, bool)> {
        let low = |run: &(Record, u16)| ends(stacking, *run)[1];
        let lowest: BTreeMap<u16, i64> =
            runs.iter().map(|(column, runs)| (*column, runs.iter().map(low).min().unwrap())).collect();
        let half = |column: u16| [column / 64, column % 64 / 32];
        let mut halves: BTreeMap<_, (u32, bool)> = BTreeMap::new();
        for (&column, runs) in runs {
            let tells_nothing = |(record, _): &&(Record, u16)| {
                !FLOATING.contains(&record.class()) && !SOLID.contains(&record.class())
            };
            let least = around(&lowest, column, stacking.reach).min().unwrap();
            let over = |run: &&(Record, u16)| low(run) - least > i64::from(stacking.gap());
            let n_over = runs.iter().filter(tells_nothing).filter(over).count();
            let is_over = n_over > 0;
            let floating = runs.iter().filter(|(record, _)| FLOATING.contains(&record.class())).count();
            let n = (floating + n_over) as u32;
            let of = halves.entry(half(column)).or_default();
            *of = (of.0 + n, of.1 || n > 0);
            if is_over {
                let [x, y] = column_at(column).map(|v| v as i32);
                let steps = -(stacking.reach as i32)..=stacking.reach as i32;
                for (dx, dy) in steps.clone().flat_map(|dx| steps.clone().map(move |dy| (dx, dy))) {
                    let [x, y] = [x + dx, y + dy].map(|v| v.clamp(0, 255) as u32);
                    halves.entry(half(column_index(x, y))).or_default().1 = true;
                }
            }
        }
        // What holds nothing has none.
        halves.retain(|[block, _], _| runs.range(64 * block..=64 * block + 63).next().is_some());
        halves
    }

    /// Packing as it is specified, from points.
    fn pack_plainly(stacking: Stacking, points: &[Point]) -> (Vec<u32>, Runs) {
        let runs = runs_plainly(stacking, points);
        let may_float = may_float_plainly(stacking, &runs);
        let all = || runs.values().flatten();
        let bottom = |run: &(Record, u16)| {
            let thickness = if SOLID.contains(&run.0.class()) { 0 } else { i64::from(stacking.thickness) };
            ends(stacking, *run)[1] - thickness
        };
        let bottom = all().map(bottom).min().unwrap_or(i32::MAX.into()).max(i64::from(i32::MIN) + 1);
        let highest = points.iter().map(|(_, _, record)| height(*record)).max().unwrap_or(i32::MIN.into());
        let code = HeightCode::fit(bottom as i32, highest as i32);
        let words_of = |(record, depth): (Record, u16)| {
            let [at, depth] = [(height(record) - i64::from(code.base)) as u32, u32::from(depth)];
            match code.wide {
                false => vec![at | depth << 16, record.0[1], record.0[2]],
                true => vec![at, record.0[1], record.0[2], depth],
            }
        };
        let run_words = 3 + usize::from(code.wide);
        let mut blocks: Vec<u16> = runs.keys().map(|column| column / 64).collect();
        blocks.dedup();
        let counts_at = 16 + 6 * 1024 + 64 * run_words * blocks.len();
        let others_at = counts_at + 16 * blocks.len();
        let mut words = vec![0; others_at];
        for (n, &block) in blocks.iter().enumerate() {
            let at = 16 + 6 * 1024 + 64 * run_words * n;
            let place = 16 + 6 * usize::from(block);
            words[place] = at as u32;
            words[place + 1] = ((words.len() - others_at) / run_words) as u32;
            for half in 0..2 {
                let here = [block, half];
                words[place + 2 + usize::from(half)] = may_float.range(..here).map(|(_, (n, _))| n).sum();
                if may_float.get(&here).is_some_and(|(_, is_listed)| *is_listed) {
                    let lists = may_float.range(..=here).filter(|(_, (_, is_listed))| *is_listed).count();
                    words[place + 4 + usize::from(half)] = lists as u32;
                }
            }
            for (column, runs) in runs.range(64 * block..=64 * block + 63) {
                let c = usize::from(column % 64);
                words[at + run_words * c..at + run_words * (c + 1)].copy_from_slice(&words_of(runs[0]));
                words[counts_at + 16 * n + c / 4] |= (runs.len() as u32 - 1) << (8 * (c % 4));
                runs[1..].iter().for_each(|span| words.extend(words_of(*span)));
            }
        }
        let header = [2, words.len(), 8 << 16 | usize::from(code.wide) << 8, code.base as usize];
        let spans = may_float.values().map(|(n, _)| n).sum::<u32>() as usize;
        let lists = may_float.values().filter(|(_, is_listed)| *is_listed).count();
        let header = header.into_iter().chain([blocks.len(), counts_at, others_at, spans, lists]);
        words.iter_mut().zip(header).for_each(|(word, value)| *word = value as u32);
        (words, runs)
    }

    fn runs_of(packed: &Payload) -> Runs {
        let mut read = Runs::new();
        packed.columns_with_depths(|column, runs, depths| {
            assert_eq!(runs.len(), depths.len());
            let runs = runs.iter().copied().zip(depths.iter().copied()).collect();
            assert!(read.insert(column, runs).is_none());
        });
        read
    }

    /// Into memory that holds rubbish, which must be gone, and no further than it should.
    fn check_packing(stacking: Stacking, points: &[Point]) {
        let section = stacks_of(stacking, points);
        let (words, runs) = pack_plainly(stacking, points);
        let packed = section.pack();
        assert_eq!(packed.words.len(), words.len());
        if let Some(at) = (0..words.len()).find(|&at| packed.words[at] != words[at]) {
            panic!("word {at} is {:#x}, not {:#x}", packed.words[at], words[at]);
        }
        assert!(runs_of(&packed) == runs);
        let layout = section.layout();
        assert_eq!(packed.layout, layout);
        assert_eq!(layout.uploaded_bytes(), 4 * words.len() as u64);
        for rubbish in [0xDEAD_BEEF, !0] {
            let mut ring = vec![rubbish; words.len() + 3];
            assert_eq!(section.pack_into(&mut ring), packed.highest_of);
            assert!(ring[..words.len()] == words);
            assert!(ring[words.len()..] == [rubbish; 3]);
        }
        // Columns of the same points say the same of classes.
        let mut columns = Columns::default();
        points.iter().for_each(|&(x, y, record)| columns.add(x, y, record));
        assert_eq!(columns.pack().highest_of, packed.highest_of);
        assert_eq!(columns.points(), section.points());
        let most = section.layout_at_most();
        let [floats, at_most] = [layout, most].map(|layout| layout.floats.unwrap());
        assert!(floats.spans <= at_most.spans && floats.lists <= at_most.lists);
        assert!(layout.uploaded_bytes() <= most.uploaded_bytes());
        assert!(layout.derived_bytes() <= most.derived_bytes());
    }

    #[test]
    fn packing_is_as_specified_where_it_is_hard() {
        let stacking = stacking(100, 7);
        check_packing(stacking, &[]);
        check_packing(stacking, &[(255, 255, record(i64::from(i32::MIN) + 1, 5, 0))]);
        check_packing(stacking, &[(0, 0, record(i32::MAX.into(), 1, 0)), (0, 0, record(0, 2, 0))]);
        let mut points = Vec::new();
        for k in 0..300 {
            // More runs than a count holds, those that float above, and below them one that is solid.
            points.extend([(3, 200, record(500 * k, 5, 0)), (77, 5, record(500 * k, 5, 0))]);
            points.push((77, 5, record(-9 * k, 2, 0)));
            // As many as are counted, and one more and less, above one whose class does not tell.
            for most in [253, 254, 255].into_iter().filter(|most| k < *most) {
                points.extend([
                    (most as u32, 250, record(500 * k, 18, 0)),
                    (most as u32, 250, record(-900, 1, 0)),
                ]);
            }
            // Nothing but what may float or not.
            points.push((k as u32 % 7, 99, record(130 * k, 64, (k % 16) as u8)));
        }
        check_packing(stacking, &points);
        let kept = runs_plainly(stacking, &points);
        let lowest = |x, y| {
            let runs = &kept[&column_index(x, y)];
            (runs.len(), runs.last().unwrap().0.class())
        };
        assert_eq!(lowest(3, 200), (255, 5));
        // The ground is kept.
        assert_eq!(lowest(77, 5), (255, 2));
        assert_eq!([253, 254, 255].map(|x| lowest(x, 250)), [(254, 1), (255, 1), (255, 1)]);
        // Every column once.
        let full = |k: u32| (k % 256, k / 256, record((k * 31 % 4001).into(), CLASSES[k as usize % 8], 0));
        check_packing(stacking, &(0..1 << 16).map(full).collect::<Vec<_>>());
    }

    #[test]
    fn what_tells_nothing_may_float_over_lower_points_alone() {
        let stacking = stacking(50, 7);
        let floats = |points: &[Point]| stacks_of(stacking, points).layout().floats.unwrap();
        let ground = |x, y| (x, y, record(0, 2, 0));
        let roof = |x, y, h| (x, y, record(h, 1, 0));
        // No farther from the ground than points of a span may be from each other.
        assert_eq!(floats(&[ground(9, 9), roof(9, 9, 128)]), Floats { spans: 0, lists: 0 });
        assert_eq!(floats(&[ground(9, 9), roof(9, 9, 129)]), Floats { spans: 1, lists: 1 });
        let gap = [ground(63, 8), roof(63, 8, 500)];
        for (x, y, may) in [
            (65, 8, true),
            (66, 8, false),
            (61, 8, true),
            (60, 8, false),
            (63, 6, true),
            (63, 5, false),
            (65, 10, true),
            (65, 11, false),
        ] {
            let spans = floats(&[gap[0], gap[1], roof(x, y, 500)]).spans;
            assert_eq!(spans, 1 + u32::from(may), "{x}, {y}");
        }
        // Not around the section's border.
        let border = [ground(255, 255), roof(255, 255, 500), ground(0, 100), roof(0, 100, 500)];
        let far = [(0, 255), (255, 0), (255, 100), (255, 99), (0, 0)].map(|(x, y)| roof(x, y, 500));
        assert_eq!(floats(&[&border[..], &far].concat()).spans, 2);
        // What always floats does so without gaps; what never does, never.
        let (wire, deck) = ((1, 1, record(3, 14, 0)), (1, 200, record(-3, 17, 0)));
        assert_eq!(floats(&[wire, deck, ground(4, 4)]), Floats { spans: 2, lists: 2 });
    }

    #[test]
    fn bytes_are_those_of_the_pages_that_are_touched() {
        let mut stacks = Columns::stacks(stacking(5, 4));
        // And the highest record of each class, of one set of flags.
        let own = stacks.bytes() + 1024;
        let mut pages = std::collections::BTreeSet::new();
        let mut others = 0;
        for k in 0..1500u32 {
            let (x, y) = (k.wrapping_mul(2_654_435_761) >> 24, k.wrapping_mul(40_503) >> 3 & 0xFF);
            stacks.add(x, y, record(5, 5, 0));
            let block = usize::from(column_index(x, y)) / BLOCK_COLUMNS;
            pages.extend([(0, block * 768 / 4096), (0, (block * 768 + 767) / 4096), (3, block / 32)]);
            if k % 9 == 0 {
                // Of another slice.
                stacks.add(x, y, record(500, 5, 0));
                pages.extend([(1, block / 16), (2, block / 64)]);
                others += 1;
            }
            assert_eq!(stacks.bytes(), own + 4096 * pages.len() + 18 * others);
        }
        assert!(pages.len() > 200);
    }

    /// Spans of a column's runs of each key, from the top down: highest and lowest point.
    fn spans_of_runs(stacking: Stacking, runs: &[(Record, u16)]) -> BTreeMap<(u8, u8), Vec<[i64; 2]>> {
        let mut spans = BTreeMap::<_, Vec<[i64; 2]>>::new();
        for &run in runs {
            let [high, low] = ends(stacking, run);
            let of_key = spans.entry(key(run.0)).or_default();
            match of_key.last_mut() {
                Some([_, lowest]) if *lowest - high <= stacking.gap().into() => *lowest = low,
                _ => of_key.push([high, low]),
            }
        }
        spans
    }

    /// The same of points.
    fn spans_of_points(
        stacking: Stacking,
        points: &[Point],
        column: u16,
    ) -> BTreeMap<(u8, u8), Vec<[i64; 2]>> {
        let mut heights = BTreeMap::<_, Vec<i64>>::new();
        for &(_, _, record) in points.iter().filter(|(x, y, _)| column_index(*x, *y) == column) {
            heights.entry(key(record)).or_default().push(height(record));
        }
        let split = |mut heights: Vec<i64>| {
            heights.sort_unstable();
            heights.reverse();
            let pieces = heights.chunk_by(|upper, lower| upper - lower <= stacking.gap().into());
            pieces.map(|piece| [piece[0], piece[piece.len() - 1]]).collect()
        };
        heights.into_iter().map(|(key, heights)| (key, split(heights))).collect()
    }

    /// Spans that float where what `shows` gives is shown, by block and half, and how many of these were not of a class
    /// that always floats.
    fn floating_plainly(
        stacking: Stacking,
        runs: &Runs,
        shows: impl Fn(Record) -> bool,
    ) -> (BTreeMap<[u16; 2], u32>, u32) {
        let shown: Runs = runs
            .iter()
            .map(|(&column, runs)| (column, runs.iter().copied().filter(|(r, _)| shows(*r)).collect()))
            .collect();
        let lowest = |runs: &[(Record, u16)]| runs.iter().map(|&run| ends(stacking, run)[1]).min();
        let lowest: BTreeMap<u16, Option<i64>> =
            shown.iter().map(|(&column, runs)| (column, lowest(runs))).collect();
        let (mut halves, mut untold) = (BTreeMap::new(), 0);
        for (&column, runs) in &shown {
            let floats = |class: u8, low: i64| {
                let beneath = |lowest: &&Option<i64>| {
                    lowest.is_some_and(|lowest| lowest < low - i64::from(stacking.gap()))
                };
                let is_over_lower = || {
                    around(&lowest, column, stacking.reach).filter(beneath).count() > stacking.reach as usize
                };
                FLOATING.contains(&class) || !SOLID.contains(&class) && is_over_lower()
            };
            let is_solid = |run: &&(Record, u16)| !floats(run.0.class(), ends(stacking, **run)[1]);
            let solid = runs.iter().find(is_solid).map(|(record, _)| *record);
            let floating = runs
                .iter()
                .map(|(record, _)| *record)
                .filter(|record| solid.is_none_or(|solid| *record > solid));
            for class in floating.map(Record::class) {
                *halves.entry([column / 64, column % 64 / 32]).or_insert(0) += 1;
                untold += u32::from(!FLOATING.contains(&class));
            }
        }
        (halves, untold)
    }

    /// Spans that there is room for, by block and half, as places say.
    fn room(packed: &Payload) -> BTreeMap<[u16; 2], u32> {
        let places = packed.words[16..16 + 6 * 1024].as_chunks::<6>().0;
        let occupied = (0..).zip(places).filter(|(_, place)| place[0] != 0);
        let mut starts: Vec<_> =
            occupied.flat_map(|(b, place)| [([b, 0], place[2]), ([b, 1], place[3])]).collect();
        starts.push(([1024, 0], packed.words[7]));
        starts.windows(2).map(|pair| (pair[0].0, pair[1].1 - pair[0].1)).collect()
    }

    /// Places, heights in 64ths of slices, and the rest of points.
    fn points(slice_log2: u32, reach: i64) -> impl Strategy<Value = Vec<Point>> {
        let point =
            (0u32..256, 0u32..256, -reach..reach, prop::sample::select(&CLASSES[..]), 0u8..16, any::<bool>());
        let points = prop::collection::vec(point, 0..1500);
        (points, 1u32..=256, [0u32..256, 0u32..256]).prop_map(move |(points, crowd, corner)| {
            let place = |v: u32, axis: usize| (corner[axis] + v % crowd) % 256;
            let flags = |flags: u8, has: bool| if has { flags } else { 0 };
            let h = |k: i64| k * (1 << slice_log2) / 64 + k.rem_euclid(5);
            let point = |(x, y, k, class, f, has): (u32, u32, i64, u8, u8, bool)| {
                (place(x, 0), place(y, 1), record(h(k), class, flags(f, has)))
            };
            points.into_iter().map(point).collect()
        })
    }

    /// Slices, and points that suit them.
    fn stacked() -> impl Strategy<Value = (Stacking, Vec<Point>)> {
        let slices = prop::sample::select(vec![0, 3, 9, 16, 18, 29, 30]);
        (slices, prop::sample::select(vec![1, 30, 5000, 1 << 30]), 0u32..3).prop_flat_map(
            |(slice_log2, thickness, reach)| {
                let stacking = Stacking { reach, ..stacking(thickness, slice_log2) };
                (Just(stacking), points(slice_log2, 1000))
            },
        )
    }

    /// So many points of random heights and some keys in two columns.
    fn in_two_columns(points: u32, classes: &[u8]) -> Vec<Point> {
        let numbers =
            (0..points).map(|k| k.wrapping_mul(2_654_435_761).rotate_left(7).wrapping_mul(0x85eb_ca6b));
        let point = |number: u32| {
            let class = classes[number as usize % classes.len()];
            (number >> 9 & 1, 3, record(i64::from(number >> 3), class, (number >> 5 & 3) as u8))
        };
        numbers.map(point).collect()
    }

    #[test]
    fn columns_of_many_runs_are_as_specified_in_any_order() {
        for (stacking, points) in
            [(stacking(7, 22), 3000), (stacking(7, 16), 700), (stacking(7, 9), 300), (stacking(7, 4), 80)]
        {
            let mut points = in_two_columns(points, &CLASSES);
            check_packing(stacking, &points);
            let packed = stacks_of(stacking, &points).pack().words;
            for reverse in [false, true] {
                points.sort_unstable_by(|(.., a), (.., b)| if reverse { b.cmp(a) } else { a.cmp(b) });
                let one = stacks_of(stacking, &points);
                assert!(one.pack().words == packed);
                assert_eq!(one.bytes(), stacks_of(stacking, &points[..]).bytes());
            }
        }
    }

    #[test]
    fn many_runs_in_a_column_are_gathered_quickly() {
        let begun = std::time::Instant::now();
        for classes in [&[1][..], &CLASSES] {
            let stacks = stacks_of(stacking(7, 4), &in_two_columns(200_000, classes));
            assert!(stacks.pack().words.len() > 500);
        }
        // Walking through all of them took minutes.
        assert!(begun.elapsed().as_secs() < 10, "{:?}", begun.elapsed());
    }

    proptest! {
        #[test]
        fn packing_is_as_specified((stacking, points) in stacked()) {
            check_packing(stacking, &points);
        }

        #[test]
        fn order_of_points_changes_nothing((stacking, points) in stacked(), by in any::<u64>()) {
            let mut others = points.clone();
            others.sort_by_key(|(x, y, r)| {
                (u64::from(r.0[0]) ^ u64::from(*x) << 40 ^ u64::from(*y) << 50).wrapping_mul(by | 1)
            });
            let (one, other) = (stacks_of(stacking, &points), stacks_of(stacking, &others));
            prop_assert_eq!(one.layout_at_most(), other.layout_at_most());
            prop_assert_eq!(one.bytes(), other.bytes());
            prop_assert!(one.pack().words == other.pack().words);
        }

        /// Three levels, over every way of rounding lows.
        #[test]
        fn coarse_from_children_equals_coarse_from_points(
            points in prop::collection::vec(
                (0u32..1024, 0u32..1024, any::<i32>(), prop::sample::select(&CLASSES[..]), 0u8..16), 0..1500),
            crowd in prop::sample::select(vec![8, 64, 1024]),
            shift in 0u32..24,
            slice_log2 in prop::sample::select(vec![2, 9, 14, 15, 16, 20, 28, 29, 30]),
        ) {
            let levels: Vec<_> = (0..3).map(|level| stacking(7 << level, (slice_log2 + level).min(30))).collect();
            let mut direct = Columns::stacks(levels[2]);
            let mut sections = BTreeMap::<[u32; 2], Columns>::new();
            for (x, y, h, class, flags) in points {
                let (x, y, record) = (x % crowd, y % crowd, record((h >> shift).into(), class, flags));
                direct.add(x / 4, y / 4, record);
                let section = sections.entry([x / 256, y / 256]).or_insert_with(|| Columns::stacks(levels[0]));
                section.add(x % 256, y % 256, record);
            }
            for stacking in &levels[1..] {
                let mut parents = BTreeMap::<[u32; 2], Columns>::new();
                for ([i, j], child) in sections {
                    let parent = parents.entry([i / 2, j / 2]).or_insert_with(|| Columns::stacks(*stacking));
                    child.coarsen_into(i as i32, j as i32, parent);
                }
                sections = parents;
            }
            let parent = sections.remove(&[0, 0]).unwrap_or_else(|| Columns::stacks(levels[2]));
            prop_assert_eq!(parent.points(), direct.points());
            prop_assert_eq!(parent.layout_at_most(), direct.layout_at_most());
            prop_assert!(parent.pack().words == direct.pack().words);
        }

        /// Where depths are exact. What a span covers: its highest point down to its lowest, and the thickness further.
        #[test]
        fn runs_join_to_the_spans_of_the_points(
            slice_log2 in prop::sample::select(vec![0, 2, 9, 14]),
            thickness in 1i32..3000,
            points in points(9, 900),
            crowd in 1u32..6,
        ) {
            let stacking = stacking(thickness, slice_log2);
            let points: Vec<_> = points.into_iter().map(|(x, y, r)| (x % crowd, y % crowd, r)).collect();
            for (column, runs) in runs_of(&stacks_of(stacking, &points).pack()) {
                if runs.len() == 255 {
                    continue;
                }
                let mut of_points = spans_of_points(stacking, &points, column);
                let mut of_runs = spans_of_runs(stacking, &runs);
                // Of what never floats the highest point is all that counts.
                of_points.retain(|(class, _), _| !SOLID.contains(class));
                of_runs.retain(|(class, _), spans| {
                    let is_solid = SOLID.contains(class);
                    assert!(!is_solid || spans.len() == 1);
                    !is_solid
                });
                let covered = |spans: BTreeMap<(u8, u8), Vec<[i64; 2]>>| -> Vec<_> {
                    let of_key = |(key, spans): ((u8, u8), Vec<[i64; 2]>)| {
                        spans.into_iter().map(move |[high, low]| (key, [high, low - i64::from(thickness)]))
                    };
                    spans.into_iter().flat_map(of_key).collect()
                };
                prop_assert_eq!(covered(of_runs), covered(of_points));
            }
        }

        #[test]
        fn there_is_room_for_what_floats_whatever_is_shown(
            (stacking, points) in stacked(),
            crowd in 1u32..30,
            masks in prop::collection::vec((any::<[bool; 8]>(), 0u8..16), 1..5),
        ) {
            let points: Vec<_> = points.into_iter().map(|(x, y, r)| (x % crowd, y % crowd, r)).collect();
            let packed = stacks_of(stacking, &points).pack();
            let (runs, room) = (runs_of(&packed), room(&packed));
            prop_assert_eq!(room.values().sum::<u32>(), packed.layout.floats.unwrap().spans);
            for (classes, hidden_flags) in masks.iter().chain([&([true; 8], 0)]) {
                let shows = |record: Record| {
                    let class = CLASSES.iter().position(|&class| class == record.class()).unwrap();
                    classes[class] && record.flags() & hidden_flags == 0
                };
                for (half, floating) in floating_plainly(stacking, &runs, shows).0 {
                    prop_assert!(floating <= room[&half], "{floating} float in {half:?}, room is for {}", room[&half]);
                }
            }
        }
    }

    #[test]
    fn a_roof_floats_over_the_ground_and_a_wall_does_not() {
        let stacking = stacking(50, 7);
        let mut points = Vec::new();
        for (x, y) in (0..12).flat_map(|x| (0..12).map(move |y| (x, y))) {
            points.push((x, y, record(0, 2, 0)));
            if x < 6 {
                points.push((x, y, record(900, 1, 0)));
            }
            if x == 9 {
                points.extend((0..10).map(|k| (x, y, record(100 * k, 1, 0))));
            }
        }
        let packed = stacks_of(stacking, &points).pack();
        let (_, untold) = floating_plainly(stacking, &runs_of(&packed), |_| true);
        assert_eq!(untold, 6 * 12);
        assert!(packed.layout.floats.unwrap().spans >= 6 * 12);
    }
}
