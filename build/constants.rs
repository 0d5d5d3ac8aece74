//! The table of the constants that Rust and the shaders share: where things lie in payloads and table nodes, and what
//! passes agree upon. `build.rs` writes it as Rust (`src/shared.rs`), as an include for GLSL a group, and as the drawing
//! of a payload in `docs/from-file-to-pixel.md`.
//!
//! Words are 32 bits, counted from the start of what they are of. A narrow code of a height is half a word, a wide one
//! a word.

use std::fmt::Write as _;

/// One line of the table.
pub struct Constant {
    name: &'static str,
    value: u32,
    docs: &'static [&'static str],
}

/// A group of the table: its constants, and `ALL` of them as lines.
macro_rules! group {
    ($group:ident: $($(#[doc = $doc:literal])* $name:ident = $value:expr;)*) => {
        mod $group {
            use super::Constant;
            #[allow(unused_imports)] // a group may need none of what came before
            use super::above::*;
            $(pub const $name: u32 = $value;)*
            pub const ALL: &[Constant] =
                &[$(Constant { name: stringify!($name), value: $name, docs: &[$($doc),*] }),*];
        }
    };
}

/// What values below are computed from.
mod above {
    pub const fn codes_of_levels(first: u32, last: u32) -> u32 {
        let (mut level, mut codes) = (first, 0);
        while level <= last {
            codes += 1 << (2 * (super::payload::SECTION_LOG2 - level));
            level += 1;
        }
        codes
    }
}

group! { payload:
    /// log2 of a section's side in columns.
    SECTION_LOG2 = 8;
    /// A section's side in columns.
    SECTION_SIDE = 1 << SECTION_LOG2;

    /// Words of a run: the record of a column's best point of one kind.
    RUN_WORDS = 3;
    /// Bit of a run's first word, its height, that is turned: heights compare as unsigned numbers, and 0 is no point.
    HEIGHT_SIGN = 0x8000_0000;
    /// Second word of a run: its class is the highest byte.
    RUN_CLASS_SHIFT = 24;
    /// Its intensity, 16 bits; red is the lowest byte.
    RUN_INTENSITY_SHIFT = 8;
    /// Third word of a run: green is the highest byte.
    RUN_GREEN_SHIFT = 24;
    /// Blue.
    RUN_BLUE_SHIFT = 16;
    /// Return number and count; flags are the lowest byte.
    RUN_RETURNS_SHIFT = 8;
    /// Those flags that show and hide points beside their class, and keep runs apart: synthetic 1, key-point 2, withheld 4, overlap 8
    /// (LAS 1.4 R15, table 9).
    KEY_FLAGS = 15;

    /// Words of the header of what is uploaded.
    HEADER_WORDS = 16;
    /// Word of the header: kind of payload.
    HEADER_KIND = 0;
    /// Words in all.
    HEADER_ALL = 1;
    /// How heights are coded: 1 << `CODE_WIDE_SHIFT` where codes are wide, `SECTION_LOG2` << `CODE_LOG2_SHIFT`.
    HEADER_CODE = 2;
    /// Lattice height of code 0.
    HEADER_BASE = 3;
    /// Blocks that are there.
    HEADER_BLOCKS = 4;
    /// Where counts start.
    HEADER_COUNTS = 5;
    /// Where further runs start.
    HEADER_OTHERS = 6;
    /// In the header's code.
    CODE_WIDE_SHIFT = 8;
    /// In the header's code.
    CODE_LOG2_SHIFT = 16;
    /// Runs of stacks that may float under some mask: room for as many spans is made where sections are derived.
    HEADER_SPANS = 7;
    /// Half blocks of stacks that hold such runs.
    HEADER_LISTS = 8;
    /// Kind of payload: columns of runs, each solid from its top down.
    KIND_COLUMNS = 1;
    /// Stacks: spans of columns, points of a key that lie close together; some float.
    KIND_STACKS = 2;

    /// log2 of the side in columns of a block of what is uploaded.
    BLOCK_LOG2 = 3;
    /// Columns in such a block.
    BLOCK_COLUMNS = 1 << (2 * BLOCK_LOG2);
    /// Blocks on a section's side.
    BLOCKS_SIDE = SECTION_SIDE >> BLOCK_LOG2;
    /// Blocks in a section.
    SECTION_BLOCKS = BLOCKS_SIDE * BLOCKS_SIDE;
    /// Where the places of blocks start.
    PLACES = HEADER_WORDS;
    /// Words of a place: where the block starts (0: it holds nothing), and how many further runs those before it have.
    PLACE_WORDS = 2;
    /// Where the first block starts.
    FIRST_BLOCK = PLACES + PLACE_WORDS * SECTION_BLOCKS;
    /// Words of a block: the highest run of each column, empty where the column is.
    BLOCK_WORDS = RUN_WORDS * BLOCK_COLUMNS;
    /// Words for how many other runs each column of a block has: a byte each.
    COUNT_WORDS = BLOCK_COLUMNS / 4;
    /// Most runs of a column besides the highest. The highest are kept.
    MOST_OTHERS = 254;

    /// Words of a place of stacks: beside the two of columns, for each half of the block (its southern rows, its northern) how
    /// many runs that may float lie in the halves before; then for each half its number among those that hold any, from 1 on,
    /// or 0.
    STACK_PLACE_WORDS = 6;
    /// Where the first block of stacks starts.
    FIRST_STACK_BLOCK = PLACES + STACK_PLACE_WORDS * SECTION_BLOCKS;
    /// Words of a span of stacks: those of a run, with its code in the place of its height, and how deep it reaches below that: in
    /// the upper half of its first word, or, where codes are wide, in a word of its own.
    STACK_RUN_WORDS = RUN_WORDS;
    /// The same where codes are wide.
    STACK_RUN_WORDS_WIDE = RUN_WORDS + 1;
    /// log2 of the steps that a low may count.
    LOW_BITS = 16;
    /// log2 of the highest slices in which depths, of 16 bits, count every step: four of these fit.
    DEPTH_SLICE_BITS = 14;

    /// log2 of the side in columns of a block of what is derived. Where things float, its columns' codes are of the highest thing,
    /// solid or not.
    DERIVED_BLOCK_LOG2 = 2;
    /// log2 of such blocks on a section's side.
    DERIVED_BLOCKS_LOG2 = SECTION_LOG2 - DERIVED_BLOCK_LOG2;
    /// First code of level 1 of the pyramid in a block, behind level 0.
    LEVEL_1 = 1 << (2 * DERIVED_BLOCK_LOG2);
    /// Word of a block that says which columns are measured, in blocks of even index of this block and the next; twice
    /// that where codes are wide.
    MEASURED = (LEVEL_1 + LEVEL_1 / 4) / 2;
    /// First word of what each column of a block shows, a cache line on; twice that where codes are wide.
    SHOWN = 16;
    /// Words of what the columns of a block show, one each: a block ends with them.
    SHOWN_WORDS = LEVEL_1;
    /// How what is derived of a section lies, bits: codes are wide.
    FORM_WIDE = 1;
    /// Something may float: blocks have a word for each node of levels 0 to 2, whatever the width of codes, which says what floats, too.
    FORM_FLOATS = 2;
    /// Narrow codes in such words leave bits from here on for how far the highest thing that is solid lies below the node's code, at least;
    STACK_SOLID_SHIFT = 16;
    /// and from here on for how far the lowest bottom of what floats does, at most. 0: nothing floats.
    STACK_BOTTOM_SHIFT = 24;
    /// Highest of either, in steps of the level's (see `coords::Stacking::word_step_log2`): so far or farther.
    STACK_MOST_BELOW = 0xFF;
    /// log2 of the longest of these steps: of what narrow codes tell apart none needs longer ones.
    MOST_WORD_STEP = 16;
    /// In a block where something may float, behind level 0: first word of level 1.
    STACK_LEVEL_1 = LEVEL_1;
    /// The word of level 2.
    STACK_LEVEL_2 = STACK_LEVEL_1 + LEVEL_1 / 4;
    /// Which columns are measured, as `MEASURED`.
    STACK_MEASURED = STACK_LEVEL_2 + 1;
    /// Place of the block's list, words from the start of what is derived; 0: nothing floats there, whatever is shown.
    STACK_LIST = STACK_MEASURED + 1;
    /// Where its spans start, likewise.
    STACK_SPANS = STACK_LIST + 1;
    /// First word of what its columns show.
    STACK_SHOWN = STACK_SPANS + 1;
    /// Highest narrow code.
    MOST_NARROW_CODE = 0xFFFF;
    /// Codes of the pyramid's levels 2 to 8, which lie behind the blocks, and one to make them even.
    UPPER_CODES = (codes_of_levels(2, SECTION_LOG2) + 1) & !1;
    /// What floats, behind the pyramid where anything may: first the mean height of what is solid and measured in nodes of levels 2 to 4, a code each, a word; 0: nothing is.
    FLOAT_MEANS = 0;
    /// Coarsest level of these.
    MEANS_LEVEL = 4;
    /// Then lists, from a cache line on.
    FLOAT_WORDS = (FLOAT_MEANS + codes_of_levels(2, MEANS_LEVEL) + 15) & !15;
    /// Words of a block's list.
    LIST_WORDS = 22;
    /// The same where codes are wide.
    LIST_WORDS_WIDE = 38;
    /// First word of a list: code of the highest thing that floats; 0: nothing does.
    LIST_TOP = 0;
    /// How many each column has, a byte each.
    LIST_COUNTS = 1;
    /// How many the first row of columns has; in the bits from `LIST_ROWS_2` on how many the first two have, in those from `LIST_ROWS_3`
    /// on how many the third has.
    LIST_ROWS = 5;
    /// See [`LIST_ROWS`].
    LIST_ROWS_2 = 10;
    /// See [`LIST_ROWS`].
    LIST_ROWS_3 = 21;
    /// Codes of the columns, `LIST_CODES` words, twice as many where they are wide: of the highest thing that is solid in each.
    LIST_SOLID = 6;
    /// Words of these. Behind them, as many, those of the lowest point of each, from which is told what floats.
    LIST_CODES = 8;
    /// Words of a span: codes of its top and bottom, a word, or two where they are wide, and what it shows.
    SPAN_WORDS = 2;
    /// The same where codes are wide.
    SPAN_WORDS_WIDE = 3;
    /// Words of the corners of a column of a smooth surface: codes of its height in the south-west, the south-east, the
    /// north-west and the north-east; twice that where codes are wide. Those of a section are last of what is derived, block by
    /// block, row by row in each.
    CORNER_WORDS = 2;
    /// Of what floats of a class in a column, whole from top to bottom: so many, from the highest down, are joined with those around; others
    /// stand alone.
    MOST_JOINED = 24;
    /// Runs of a column that are looked at for that.
    MOST_JOINED_RUNS = 128;
    /// Of what a span is joined with, a byte each: heights of ends of tubes, or of its corners. A byte of no end.
    NO_END = 0x80;
    /// And of a tube that is not drawn from its middle, but about its only end.
    END_ALONE = 0x81;
    /// First word of that of a span that goes on from one above it.
    JOINED_ABOVE = 0x8181_8181;
    /// And of one that stands upright, round.
    UPRIGHT = 0x8282_8282;
    /// log2 of the steps that heights of ends are rounded to is so much less than that of a slice.
    END_STEP = 7;
    /// And that of corners of spans.
    SPAN_CORNER_STEP = 6;
    /// Codes of all levels but the coarsest: a bit a level, so that those of the levels finer than one are the higher
    /// bits.
    CODES_BELOW_TOP = codes_of_levels(0, SECTION_LOG2 - 1);
    /// Codes of levels 0 and 1.
    CODES_BELOW_UPPER = codes_of_levels(0, 1);

    /// In what a column shows: its class. Red is the lowest byte.
    SHOWN_CLASS_SHIFT = 24;
    /// Green.
    SHOWN_GREEN_SHIFT = 8;
    /// Blue.
    SHOWN_BLUE_SHIFT = 16;
    /// In the place of the colours: return number and count; intensity is the lower half.
    SHOWN_RETURNS_SHIFT = 16;
}

group! { node:
    /// Words of a slot of the section table, a cache line.
    NODE_WORDS = 16;
    /// First word of a node's key.
    NODE_KEY = 0;
    /// Its highest thing.
    NODE_TOP = 2;
    /// Its level, and the detail of what is shown there.
    NODE_META = 3;
    /// First word of its pyramid's place.
    NODE_PYRAMID = 4;
    /// Lattice height of code 0.
    NODE_BASE = 6;
    /// How what is derived of its section lies: `FORM_WIDE`, `FORM_FLOATS`.
    NODE_FORM = 7;
    /// First word of the slots beside it.
    NODE_BESIDE = 8;
    /// Where something of its section may float: 1 + log2 of the lattice steps that the words of its blocks count by; 0: nothing does.
    NODE_FLOATS = 12;
    /// First word of its corners in what is derived, where its tops are a smooth surface; 0: they are not.
    NODE_CORNERS = 13;
    /// Words from a span to what it is joined with, where its tops are a smooth surface; 0: nothing may float.
    NODE_JOINS = 14;

    /// First word of the key of an unused slot.
    NO_KEY = u32::MAX;
    /// Slot of what is not there.
    NO_NODE = u32::MAX;
    /// In the key's first word: the level, above the index east.
    KEY_LEVEL_SHIFT = 26;
    /// The index east.
    KEY_INDEX_MASK = (1 << KEY_LEVEL_SHIFT) - 1;
    /// Bit of a node's top that sections have.
    TOP_SECTION = 1;
    /// In a node's meta: the detail level, above the level.
    META_DETAIL_SHIFT = 16;
    /// The level.
    META_LEVEL_MASK = 0xFFFF;

    /// Factor of the hash of a node: index east.
    HASH_EAST = 0x9E37_79B1;
    /// Index north.
    HASH_NORTH = 0x85EB_CA77;
    /// Level.
    HASH_LEVEL = 0xC2B2_AE3D;
    /// After the first shift.
    HASH_MIX = 0x2C1B_3C6D;
    /// First shift of the hash.
    HASH_SHIFT = 15;
    /// Last shift of the hash.
    HASH_LAST_SHIFT = 13;
}

group! { passes:
    /// Faces of hits: the column's top.
    FACE_TOP = 0;
    /// The ray went through the column's west side, going east.
    FACE_WEST = 1;
    /// Its east side.
    FACE_EAST = 2;
    /// Its south side.
    FACE_SOUTH = 3;
    /// Its north side.
    FACE_NORTH = 4;
    /// The eye is in the column.
    FACE_INSIDE = 5;
    /// The ray came from below into what floats.
    FACE_BOTTOM = 6;

    /// Third word of a hit record as it is traced: the face, above the column.
    HIT_FACE_SHIFT = 16;
    /// The face.
    HIT_FACE_MASK = 7;
    /// Nodes that were looked at, at most `MOST_STEPS`.
    HIT_STEPS_SHIFT = 19;
    /// Most that are told. Where anything floats, in their place: which span of its block was hit, from 1 on; 0: the solid
    /// part of the column.
    MOST_STEPS = 8191;
    /// Third word of a finished hit record: what the channel of the record holds where colours are by that, above the nodes.
    HIT_VALUE_SHIFT = 16;
    /// Second word of a finished hit record: the class, or `BITS_MISS`.
    BITS_CLASS_MASK = 0x1FF;
    /// Nothing was hit.
    BITS_MISS = 256;
    /// How the column came to be.
    BITS_ORIGIN_SHIFT = 9;
    /// Of the origin.
    BITS_ORIGIN_MASK = 7;
    /// The face.
    BITS_FACE_SHIFT = 12;
    /// Of the face.
    BITS_FACE_MASK = 7;
    /// Detail level of the column: log2 of its side in finest cells.
    BITS_DETAIL_SHIFT = 15;
    /// Of the level.
    BITS_DETAIL_MASK = 31;
    /// The column is of a section that stands in for a finer one.
    BITS_STANDS_IN = 1 << 20;
    /// Origin: points fell in the column.
    ORIGIN_MEASURED = 0;
    /// Origin: the column is bridged from those around.
    ORIGIN_BRIDGED = 1;

    /// Tops of a smooth surface rise by no more than so many quarters of a cell from a column to the next.
    JUMP_QUARTERS = 10;

    /// Pixels of the side of a beam's tile.
    TILE = 8;
    /// And of a wide beam's.
    WIDE_TILE = 64;
    /// Entries of the colour ramp.
    RAMP_ENTRIES = 256;
    /// Heights of the ground each way, in rough outline: what lit images end below.
    GROUND_SIDE = 64;

    /// Frame's `shade`: lit, not the column's very colour.
    SHADE_LIT = 1;
    /// Frame's `color_source`: the points' own colours.
    COLOR_RGB = 0;
    /// Height.
    COLOR_HEIGHT = 1;
    /// Class.
    COLOR_CLASS = 2;
    /// What the channel of a record holds, by a ramp.
    COLOR_CHANNEL = 3;
    /// Return number and count.
    COLOR_RETURNS = 4;
    /// What the channel of a record holds, by a palette.
    COLOR_PALETTE = 5;
    /// What the channel of a record holds, by a ramp; 0 is nothing, and grey.
    COLOR_KNOWN = 6;
    /// Frame's `background`: none, transparent.
    BACKGROUND_NONE = 0;
    /// White.
    BACKGROUND_WHITE = 1;
    /// A sky.
    BACKGROUND_SKY = 2;

    /// Specialisation constants of a frame's passes: threads of a workgroup across.
    ID_GROUP_X = 0;
    /// And down.
    ID_GROUP_Y = 1;
    /// Of beams: pixels of a tile's side.
    ID_SIDE = 2;
    /// And of the side of the tiles whose beams they go on from.
    ID_BEFORE = 3;
    /// Of passes that colour: colours are not RGB.
    ID_RAMPED = 3;
    /// Bytes for the screen, no records.
    ID_SCREEN = 4;
    /// Of the thesis' kernel: the same.
    ID_THESIS_SCREEN = 2;
    /// Rows of groups are dealt out.
    ID_DEALT = 5;
    /// Rays start behind beams.
    ID_BEAMED = 6;
    /// Specialisation constants of derived passes: codes are wide.
    ID_WIDE = 0;
    /// Every run is shown.
    ID_ALL = 1;
    /// Holes are bridged after this pass.
    ID_BRIDGE = 2;

    /// Columns of a half block from west to east.
    HALF_BLOCK_EAST = 8;
    /// And from south to north.
    HALF_BLOCK_NORTH = 4;
    /// Longest hole that is bridged, cells: so far bridges reach.
    LONGEST_BRIDGE = 4;
    /// Threads of a workgroup of the derived passes that have one a half block.
    DERIVE_THREADS = 64;
    /// And of the one that has a workgroup a section.
    PYRAMID_THREADS = 256;
    /// And of the one that packs the screen.
    SCREEN_THREADS = 64;

    /// Words of a thread's log.
    LOG_WORDS = 512;
    /// Where a step begins in a log; other words are lines that were loaded from.
    LOG_STEP = u32::MAX;
}

const GROUPS: [(&str, &str, &[Constant]); 3] = [
    ("payload", "Where things lie in what is uploaded and derived of a section.", payload::ALL),
    ("node", "Where things lie in a slot of the section table.", node::ALL),
    (
        "passes",
        "What passes agree upon: hit records, tiles, choices, specialisation constants, logs.",
        passes::ALL,
    ),
];

/// The table in Rust: a module a group.
pub fn rust() -> String {
    let mut text = String::new();
    for (group, about, constants) in GROUPS {
        let _ = writeln!(text, "/// {about}\npub mod {group} {{");
        for Constant { name, value, docs } in constants {
            for line in *docs {
                let _ = writeln!(text, "    ///{line}");
            }
            let _ = writeln!(text, "    pub const {name}: u32 = {value};");
        }
        text.push_str("}\n");
    }
    text
}

/// As [`drawing`], of a block in a section in which something may float.
fn draw_floating_block(line: &mut impl FnMut([String; 2], &str)) {
    use payload::*;
    let both = |word: u32| [word.to_string(), word.to_string()];
    line([String::new(), String::new()], "");
    line(["narrow".to_owned(), "wide".to_owned()], "word of a block where anything may float");
    line(both(0), &format!("level 0 of the pyramid, {LEVEL_1} words"));
    line(both(STACK_LEVEL_1), &format!("level 1, {} words", LEVEL_1 / 4));
    line(both(STACK_LEVEL_2), "level 2");
    line(both(STACK_MEASURED), "which columns of this and the next are measured");
    line(both(STACK_LIST), "place of its list, 0: nothing floats there");
    line(both(STACK_SPANS), "where its spans start");
    line(both(STACK_SHOWN), &format!("what each column shows, {SHOWN_WORDS} words"));
    line(both(STACK_SHOWN + SHOWN_WORDS), "the next block");
    line([String::new(), String::new()], "");
    line(["narrow".to_owned(), "bits".to_owned()], "such a word of levels 0 to 2 (wide: a code)");
    let bits = |low: u32, n: u32| [String::new(), format!("{}-{low}", low + n - 1)];
    line(
        bits(STACK_BOTTOM_SHIFT, 8),
        "how far the lowest bottom of what floats is below the code, at most; 0: nothing floats",
    );
    line(bits(STACK_SOLID_SHIFT, 8), "how far the highest thing that is solid is, at least");
    line(bits(0, 16), "code of the highest thing");
}

/// As [`drawing`], of what floats.
fn draw_floats(line: &mut impl FnMut([String; 2], &str)) {
    use payload::*;
    let both = |narrow: u32, wide: u32| [narrow.to_string(), wide.to_string()];
    line([String::new(), String::new()], "");
    line(
        ["narrow".to_owned(), "wide".to_owned()],
        "word of what floats, from the next cache line on, where anything may",
    );
    line(
        both(FLOAT_MEANS, FLOAT_MEANS),
        &format!("mean heights of what is solid in nodes of levels 2 to {MEANS_LEVEL}, a code each"),
    );
    line(both(FLOAT_WORDS, FLOAT_WORDS), "lists, then spans");
    line([String::new(), String::new()], "");
    line(["narrow".to_owned(), "wide".to_owned()], "word of a list");
    let after = |word: u32| both(word, word);
    line(after(LIST_TOP), "code of the highest thing that floats");
    line(after(LIST_COUNTS), "how many spans each column has, a byte each");
    line(
        after(LIST_ROWS),
        &format!(
            "spans of the first row of columns; << {LIST_ROWS_2}: of two; << {LIST_ROWS_3}: of the third"
        ),
    );
    line(after(LIST_SOLID), "codes of what is solid of each column");
    line(both(LIST_SOLID + LIST_CODES, LIST_SOLID + 2 * LIST_CODES), "codes of each column's lowest point");
    line(both(LIST_WORDS, LIST_WORDS_WIDE), "the next list");
    line([String::new(), String::new()], "");
    line(["narrow".to_owned(), "wide".to_owned()], "word of a span that floats");
    line(both(0, 0), "code of its top, and of its bottom");
    line(both(SPAN_WORDS - 1, SPAN_WORDS_WIDE - 1), "what it shows");
}

/// The table in GLSL: name and text of an include a group.
pub fn glsl() -> Vec<(String, String)> {
    let include = |(group, about, constants): (&str, &str, &[Constant])| {
        let guard = format!("SHARED_{}", group.to_uppercase());
        let mut text = format!("// {about} Written by build.rs.\n#ifndef {guard}\n#define {guard}\n");
        for Constant { name, value, docs } in constants {
            let _ = writeln!(text, "const uint {name} = {value}u; //{}", docs.concat());
        }
        text.push_str("#endif\n");
        (format!("{group}.glsl"), text)
    };
    GROUPS.into_iter().map(include).collect()
}

/// A payload as text, a line a part.
pub fn drawing() -> String {
    use payload::*;
    let mut text = String::new();
    let mut line = |[first, second]: [String; 2], what: &str| {
        let _ = writeln!(text, "{}", format!("{first:>8} {second:>8}  {what}").trim_end());
    };
    let words = |at: u32| [String::new(), at.to_string()];
    let named = |at: &str| [String::new(), at.to_owned()];
    let nothing = || [String::new(), String::new()];

    line(named("word"), "what is uploaded");
    line(words(HEADER_KIND), &format!("kind: {KIND_COLUMNS}, columns of runs"));
    line(words(HEADER_ALL), "words in all");
    line(
        words(HEADER_CODE),
        &format!("height code: wide << {CODE_WIDE_SHIFT} | {SECTION_LOG2} << {CODE_LOG2_SHIFT}"),
    );
    line(words(HEADER_BASE), "lattice height of code 0");
    line(words(HEADER_BLOCKS), "B, blocks that hold anything");
    line(words(HEADER_COUNTS), &format!("C = {FIRST_BLOCK} + {BLOCK_WORDS} B"));
    line(words(HEADER_OTHERS), &format!("R = C + {COUNT_WORDS} B"));
    let side = 1 << BLOCK_LOG2;
    line(
        words(PLACES),
        &format!(
            "{SECTION_BLOCKS} places, {PLACE_WORDS} words each: where the block starts or 0, further runs before it"
        ),
    );
    line(
        words(FIRST_BLOCK),
        &format!(
            "B blocks of {side} x {side} columns, {BLOCK_WORDS} words each: the highest run of each column"
        ),
    );
    line(named("C"), &format!("B x {COUNT_WORDS} words: further runs of each column, a byte each"));
    line(named("R"), &format!("further runs, {RUN_WORDS} words each, highest first"));
    line(nothing(), "");
    line(["word".to_owned(), "bits".to_owned()], "a run");
    let bits = |word: u32, [low, n]: [u32; 2]| [word.to_string(), format!("{}-{low}", low + n - 1)];
    line(bits(0, [0, 32]), &format!("height ^ {HEIGHT_SIGN:#x}; 0: no point"));
    line(bits(1, [RUN_CLASS_SHIFT, 8]), "class");
    line(bits(1, [RUN_INTENSITY_SHIFT, 16]), "intensity");
    line(bits(1, [0, 8]), "red");
    line(bits(2, [RUN_GREEN_SHIFT, 8]), "green");
    line(bits(2, [RUN_BLUE_SHIFT, 8]), "blue");
    line(bits(2, [RUN_RETURNS_SHIFT, 8]), "return number, count << 4");
    line(bits(2, [0, 8]), "flags; 1: synthetic, 2: key-point, 4: withheld, 8: overlap");
    line(nothing(), "");

    // Where codes are narrow, and where they are wide.
    let both = |narrow: u32, wide: u32| [narrow.to_string(), wide.to_string()];
    let side = 1 << DERIVED_BLOCK_LOG2;
    line(
        ["narrow".to_owned(), "wide".to_owned()],
        &format!("word of a derived block, {side} x {side} columns"),
    );
    line(both(0, 0), &format!("level 0 of the pyramid, {LEVEL_1} codes"));
    line(both(LEVEL_1 / 2, LEVEL_1), &format!("level 1, {} codes", LEVEL_1 / 4));
    line(
        both(MEASURED, 2 * MEASURED),
        "in blocks of even index: which columns of this and the next are measured",
    );
    line(both(SHOWN, 2 * SHOWN), &format!("what each column shows, {SHOWN_WORDS} words"));
    let (narrow, wide) = (SHOWN + SHOWN_WORDS, 2 * SHOWN + SHOWN_WORDS);
    line(both(narrow, wide), "the next block");
    draw_floating_block(&mut line);
    line(nothing(), "");
    line(["narrow".to_owned(), "wide".to_owned()], "word of what is derived");
    let blocks = 1 << DERIVED_BLOCKS_LOG2;
    line(both(0, 0), &format!("{blocks} x {blocks} blocks, row by row"));
    for level in 2..=SECTION_LOG2 {
        let before = if level > 2 { above::codes_of_levels(2, level - 1) } else { 0 };
        let side = SECTION_SIDE >> level;
        let at = |block: u32, codes: u32| block * blocks * blocks + codes;
        line(
            both(at(narrow, before / 2), at(wide, before)),
            &format!("level {level}, {side} x {side} codes"),
        );
    }
    let end = |block: u32, codes: u32| block * blocks * blocks + codes;
    line(both(end(narrow, UPPER_CODES / 2), end(wide, UPPER_CODES)), "all words");
    draw_floats(&mut line);
    line(nothing(), "");
    line([String::new(), "bits".to_owned()], "what a column shows");
    let bits = |low: u32, n: u32| [String::new(), format!("{}-{low}", low + n - 1)];
    line(bits(SHOWN_CLASS_SHIFT, 8), "class");
    line(bits(SHOWN_BLUE_SHIFT, 8), "blue");
    line(bits(SHOWN_GREEN_SHIFT, 8), "green");
    line(bits(0, 8), "red");
    line(bits(SHOWN_RETURNS_SHIFT, 8), "or, for images of those: return number, count << 4");
    line(bits(0, 16), "and intensity");
    text
}
