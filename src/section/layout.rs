//! What a section is, word for word: what is uploaded of it, and what the device derives from that.

use crate::shared::payload::{self, BLOCK_LOG2, BLOCKS_SIDE, SECTION_LOG2};
pub(super) use crate::shared::payload::{FIRST_BLOCK, FIRST_STACK_BLOCK, HEADER_WORDS};

/// Columns in a block.
pub(super) const BLOCK_COLUMNS: usize = payload::BLOCK_COLUMNS as usize;

/// Blocks in a section.
pub const SECTION_BLOCKS: usize = payload::SECTION_BLOCKS as usize;

/// Index in block order (block · 64 + column in it) of the column at (x, y), both 0..256, counted from the south-west.
#[inline]
pub fn column_index(x: u32, y: u32) -> u16 {
    let mask = (1 << BLOCK_LOG2) - 1;
    let block = (y >> BLOCK_LOG2) * BLOCKS_SIDE + (x >> BLOCK_LOG2);
    (block << (2 * BLOCK_LOG2) | (y & mask) << BLOCK_LOG2 | (x & mask)) as u16
}

/// The column (x, y) at a [`column_index`].
pub fn column_at(index: u16) -> [u32; 2] {
    let mask = (1 << BLOCK_LOG2) - 1;
    let (block, column) = (u32::from(index) >> (2 * BLOCK_LOG2), u32::from(index));
    [
        (block % BLOCKS_SIDE) << BLOCK_LOG2 | column & mask,
        (block / BLOCKS_SIDE) << BLOCK_LOG2 | column >> BLOCK_LOG2 & mask,
    ]
}

/// Most runs of a column besides the highest on the device (their count is one byte). The highest are kept.
pub(super) const MOST_OTHERS: u8 = payload::MOST_OTHERS as u8;

/// How a section's derived part stores heights: `code = h - base`, never 0 (0 says "no point"). Every height is kept
/// to the last lattice step, so what is seen does not depend on which section a column is in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HeightCode {
    /// Lattice height of code 0.
    pub base: i32,
    /// Codes take 32 bits instead of 16.
    pub wide: bool,
}

impl HeightCode {
    /// 16 bits if lowest..=highest, 64 units of relief, fit them.
    pub(super) fn fit(lowest: i32, highest: i32) -> HeightCode {
        let spare = i64::from(payload::MOST_NARROW_CODE) - 1 - (i64::from(highest) - i64::from(lowest));
        // What is left goes to both sides: a bridge may lead to a neighbour that lies lower or higher.
        let base = i64::from(lowest) - 1 - spare.max(0) / 2;
        // `lowest` is above i32::MIN, which no height takes.
        HeightCode { base: base.max(i32::MIN.into()) as i32, wide: spare < 0 }
    }

    /// The code of a height, which is in its range.
    pub(super) fn encode(self, height: crate::coords::Height) -> u32 {
        (i64::from(height.0) - i64::from(self.base)) as u32
    }

    /// The height of a code.
    pub(super) fn decode(self, code: u32) -> crate::coords::Height {
        crate::coords::Height((i64::from(self.base) + i64::from(code)) as i32)
    }
}

/// Words of a block: a run, the highest of each column (empty where the column is).
pub(super) const BLOCK_WORDS: usize = payload::BLOCK_WORDS as usize;

/// Words for how many other runs each column of a block has: a byte each.
pub(super) const COUNT_WORDS: usize = payload::COUNT_WORDS as usize;

/// Words of a block's place.
pub(super) const PLACE_WORDS: usize = payload::PLACE_WORDS as usize;

/// Words of a run.
pub(super) const RUN_WORDS: usize = payload::RUN_WORDS as usize;

/// Words of a block's place in stacks.
pub(super) const STACK_PLACE_WORDS: usize = payload::STACK_PLACE_WORDS as usize;

/// What a section of stacks may have of spans that float, whatever is shown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Floats {
    /// Runs that may float under some mask.
    pub spans: u32,
    /// Half blocks, 8 columns from west to east and 4 from south to north, that hold any.
    pub lists: u32,
}

/// Where each part of what is uploaded of a section starts, in words from its start. The table of
/// [`crate::shared::payload`] is drawn in `docs/from-file-to-pixel.md`.
///
/// The header; two words for each of the 1,024 blocks, where it starts (0: it holds nothing) and how many further runs
/// those before it have; the blocks; their counts, in the same order; the further runs, highest first, column by column
/// in block order.
///
/// Of stacks: places have four words more, of spans that may float; spans are in the place of runs, with codes in the place of
/// heights, and say how deep they reach.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Layout {
    /// How derived heights are stored.
    pub code: HeightCode,
    /// Blocks that hold anything.
    pub blocks: u32,
    /// Counts of the first block.
    pub counts: u32,
    /// First further run.
    pub others: u32,
    /// All words.
    pub words: u32,
    /// Of stacks: what may float. `None`: columns.
    pub floats: Option<Floats>,
    /// What is solid is a smooth surface: corners of columns are derived, too.
    pub smooth: bool,
}

/// What differs between columns and stacks; words.
pub(super) struct Sizes {
    pub(super) place: usize,
    pub(super) first_block: u32,
    pub(super) block: u32,
    pub(super) run: usize,
}

impl Sizes {
    const COLUMNS: Sizes =
        Sizes { place: PLACE_WORDS, first_block: FIRST_BLOCK, block: payload::BLOCK_WORDS, run: RUN_WORDS };
    const fn of_stacks(run: u32) -> Sizes {
        let block = run * payload::BLOCK_COLUMNS;
        Sizes { place: STACK_PLACE_WORDS, first_block: FIRST_STACK_BLOCK, block, run: run as usize }
    }

    fn of(code: HeightCode, floats: Option<Floats>) -> Sizes {
        match (floats, code.wide) {
            (None, _) => Sizes::COLUMNS,
            (Some(_), false) => Sizes::of_stacks(payload::STACK_RUN_WORDS),
            (Some(_), true) => Sizes::of_stacks(payload::STACK_RUN_WORDS_WIDE),
        }
    }
}

impl Layout {
    pub(super) fn new(blocks: u32, further_runs: u32, code: HeightCode, floats: Option<Floats>) -> Layout {
        let sizes = Sizes::of(code, floats);
        let counts = sizes.first_block + blocks * sizes.block;
        let others = counts + blocks * payload::COUNT_WORDS;
        let words = others + sizes.run as u32 * further_runs;
        Layout { code, blocks, counts, others, words, floats, smooth: false }
    }

    pub(super) fn sizes(&self) -> Sizes {
        Sizes::of(self.code, self.floats)
    }

    pub(super) fn header(&self) -> [u32; HEADER_WORDS as usize] {
        let code =
            u32::from(self.code.wide) << payload::CODE_WIDE_SHIFT | SECTION_LOG2 << payload::CODE_LOG2_SHIFT;
        let mut header = [0; HEADER_WORDS as usize];
        let kind = if self.floats.is_some() { payload::KIND_STACKS } else { payload::KIND_COLUMNS };
        let Floats { spans, lists } = self.floats.unwrap_or_default();
        for (word, value) in [
            (payload::HEADER_KIND, kind),
            (payload::HEADER_ALL, self.words),
            (payload::HEADER_CODE, code),
            (payload::HEADER_BASE, self.code.base as u32),
            (payload::HEADER_BLOCKS, self.blocks),
            (payload::HEADER_COUNTS, self.counts),
            (payload::HEADER_OTHERS, self.others),
            (payload::HEADER_SPANS, spans),
            (payload::HEADER_LISTS, lists),
        ] {
            header[word as usize] = value;
        }
        header
    }

    /// Bytes that are uploaded.
    pub fn uploaded_bytes(&self) -> u64 {
        u64::from(self.words) * 4
    }

    /// Bytes that are derived from them.
    pub fn derived_bytes(&self) -> u64 {
        let corner_bytes = |first: u32| 4 * (u64::from(first) + u64::from(self.derived().corner_words()));
        self.corners().map_or(self.bytes_before_corners(), corner_bytes)
    }

    /// First word of the corners of columns in what is derived, a cache line's first. `None`: there are none.
    pub fn corners(&self) -> Option<u32> {
        let first = (self.bytes_before_corners() / 4) as u32;
        self.smooth.then(|| first.next_multiple_of(LINE_WORDS))
    }

    /// Words from a span to what it is joined with, in what is derived of a smooth surface. `None`: nothing may float.
    pub fn joins(&self) -> Option<u32> {
        let spans = self.floats.filter(|_| self.smooth)?.spans;
        (spans > 0).then(|| spans * self.derived().span_words())
    }

    fn bytes_before_corners(&self) -> u64 {
        let bytes = self.floats.map_or(self.derived().bytes(), |floats| self.derived().bytes_with(floats));
        bytes + 4 * u64::from(self.joins().unwrap_or(0))
    }

    /// Where what is derived lies.
    pub fn derived(&self) -> Derived {
        Derived { wide: self.code.wide, floats: self.floats.is_some_and(|floats| floats.spans > 0) }
    }
}

/// Where what is derived of a section lies, in a place of its own: 64×64 blocks of 4×4 columns, row by row, then levels
/// 2 to 8 of the maximum pyramid, row by row each; 16 or 32 bits a code. Where something may float, blocks have a word for each node. The table of [`crate::shared::payload`] is drawn in
/// `docs/from-file-to-pixel.md`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Derived {
    /// Codes take 32 bits.
    pub wide: bool,
    /// Something may float.
    pub floats: bool,
}

impl Derived {
    /// Blocks on a side.
    pub const SIDE: u32 = 1 << payload::DERIVED_BLOCKS_LOG2;

    /// As shaders and table nodes have it: `FORM_WIDE`, `FORM_FLOATS`.
    pub fn form(self) -> u32 {
        let bit = |is: bool, bit: u32| if is { bit } else { 0 };
        bit(self.wide, payload::FORM_WIDE) | bit(self.floats, payload::FORM_FLOATS)
    }

    /// Words of a block: its level 0 of the pyramid, row by row, from word 0 on; level 1 behind it.
    pub fn block_words(self) -> u32 {
        self.shown() + payload::SHOWN_WORDS
    }

    /// In blocks of even index: which columns of this and the next are measured, a bit each, row by row over both.
    pub fn measured(self) -> u32 {
        if self.floats { payload::STACK_MEASURED } else { payload::MEASURED << u32::from(self.wide) }
    }

    /// What each column of the block shows: class, and colour or values, a word each, row by row.
    pub fn shown(self) -> u32 {
        if self.floats { payload::STACK_SHOWN } else { payload::SHOWN << u32::from(self.wide) }
    }

    /// First word of the pyramid's levels from 2 on.
    pub fn upper_levels(self) -> u32 {
        self.block_words() * Self::SIDE * Self::SIDE
    }

    /// All bytes but of what is behind the pyramid.
    pub fn bytes(self) -> u64 {
        let code_bytes = if self.wide { 4 } else { 2 };
        4 * u64::from(self.upper_levels()) + u64::from(payload::UPPER_CODES) * code_bytes
    }

    /// How many times as many words codes take as narrow ones.
    const fn code_words(self) -> u32 {
        if self.wide { 2 } else { 1 }
    }

    /// Words of the list of a block of 4×4 columns in which runs may float.
    pub const fn list_words(self) -> u32 {
        if self.wide { payload::LIST_WORDS_WIDE } else { payload::LIST_WORDS }
    }

    /// Words of a span.
    pub const fn span_words(self) -> u32 {
        if self.wide { payload::SPAN_WORDS_WIDE } else { payload::SPAN_WORDS }
    }

    /// Where runs may float: first word of what floats, behind the pyramid; a cache line's first.
    pub fn floats(self) -> u32 {
        ((self.bytes() / 4) as u32).next_multiple_of(LINE_WORDS)
    }

    /// First word of the lists, two a half block.
    pub fn lists(self) -> u32 {
        self.floats() + payload::FLOAT_WORDS
    }

    /// First word of the spans.
    pub fn spans(self, floats: Floats) -> u32 {
        self.lists() + 2 * floats.lists * self.list_words()
    }

    /// Words of the corners of all columns: those of a block of 4×4 columns one after the other, row by row, four codes each.
    pub const fn corner_words(self) -> u32 {
        payload::SECTION_SIDE * payload::SECTION_SIDE * payload::CORNER_WORDS * self.code_words()
    }

    /// All bytes, those of what may float included.
    pub fn bytes_with(self, floats: Floats) -> u64 {
        if !self.floats {
            return self.bytes();
        }
        4 * (u64::from(self.spans(floats)) + u64::from(floats.spans) * u64::from(self.span_words()))
    }
}

/// Words of a cache line.
const LINE_WORDS: u32 = 16;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::coords::Height;

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
    fn what_floats_lies_behind_the_pyramid() {
        let floats = Floats { spans: 1000, lists: 10 };
        let derived = |wide| Derived { wide, floats: true };
        let starts = |d: Derived| [d.floats(), d.lists(), d.spans(floats)];
        assert_eq!(starts(derived(false)), [166_576, 171_952, 172_392]);
        assert_eq!(derived(false).bytes_with(floats), 4 * (172_392 + 2 * 1000));
        assert_eq!(starts(derived(true)), [169_312, 174_688, 175_448]);
        assert_eq!(derived(true).bytes_with(floats), 4 * (175_448 + 3 * 1000));
        for wide in [false, true] {
            let nothing = Derived { wide, floats: false };
            assert_eq!(nothing.bytes_with(Floats::default()), nothing.bytes());
            assert_eq!(derived(wide).lists() % 16, 0);
        }
        // Of smooth surfaces what spans are joined with, as much again as these, and corners.
        for (wide, joins, corners) in [(false, 2000, 176_400), (true, 3000, 181_456)] {
            let layout = Layout::new(1, 0, HeightCode { base: 0, wide }, Some(floats));
            assert_eq!((layout.joins(), layout.corners()), (None, None));
            let smooth = Layout { smooth: true, ..layout };
            assert_eq!((smooth.joins(), smooth.corners()), (Some(joins), Some(corners)));
            assert_eq!(smooth.derived_bytes(), 4 * u64::from(corners + derived(wide).corner_words()));
        }
    }
}
