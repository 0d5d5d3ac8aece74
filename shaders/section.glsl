// Where a column's things are in what is derived of a section (src/section.rs).
// Needs pool.glsl.

const uint SECTION_LOG2 = 8u;
const uint SECTION_SIDE = 1u << SECTION_LOG2;
// Attributes, first word: class << 24 | intensity << 8 | red. Second: green << 24 | blue << 16 | returns << 8 | flags.
const uint FLAG_WITHHELD = 4u;

// What is derived of a section: 64x64 blocks of 4x4 columns, row by row, then the pyramid's levels 2 to 8, row by row each.
// A block is two cache lines: level 0 of the pyramid, level 1, a word of measured bits (in blocks of even index, for
// themselves and the next, row by row); and what each column shows: class << 24 | red | green << 8 | blue << 16, or in
// place of the colours intensity | returns << 16. (Where codes are wide: three lines.) So a ray that comes down to a
// column waits for memory twice, whichever way it came.
const uint BLOCK_LOG2 = 2u;
const uint BLOCKS_LOG2 = SECTION_LOG2 - BLOCK_LOG2; // along a side of the section
const uint LEVEL_1 = 16u; // first code of level 1 in a block

uint block_words(uint wide) { return 32u + 16u * wide; }
uint measured_in_block(uint wide) { return 10u << wide; }
uint shown_in_block(uint wide) { return 16u << wide; }

// First word of the pyramid's levels from 2 on; and the first code, counted from there, of level `level`, 2 to 8.
uint upper_levels(uint wide) { return block_words(wide) << 2u * BLOCKS_LOG2; }
uint upper_level(uint level) { return (0x15554u & ~((1u << 18u - 2u * level) - 1u)) - 0x14000u; }

// The block that a column is in, and the column in it.
uint block_of(uvec2 column) { return (column.y >> BLOCK_LOG2) << BLOCKS_LOG2 | column.x >> BLOCK_LOG2; }
uint in_block(uvec2 column) { return (column.y & 3u) << BLOCK_LOG2 | column.x & 3u; }

// Code of `node` of pyramid level `level`: two a word, or one where they are wide.
uint pyramid_code(uvec2 place, uint level, uvec2 node, uint wide) {
    bool upper = level > 1u;
    uint log2_side = (upper ? SECTION_LOG2 : BLOCK_LOG2) - level;
    // Above the blocks there is only the first.
    uvec2 block = node >> log2_side, inner = node & (1u << log2_side) - 1u;
    uint code = (upper ? upper_level(level) : level * LEVEL_1) + (inner.y << log2_side | inner.x);
    uint first = upper ? upper_levels(wide) : (block.y << BLOCKS_LOG2 | block.x) * block_words(wide);
    uint word = pool_load(place, first + (code >> 1u - wide));
    return wide != 0u ? word : word >> (code & 1u) * 16u & 0xFFFFu;
}

// What `column` shows.
uint shown_of(uvec2 place, uvec2 column, uint wide) {
    return pool_load(place, block_of(column) * block_words(wide) + shown_in_block(wide) + in_block(column));
}

// Whether the top of a column is measured, not bridged.
bool is_measured(uvec2 place, uvec2 column, uint wide) {
    uint bits = pool_load(place, (block_of(column) & ~1u) * block_words(wide) + measured_in_block(wide));
    return (bits >> ((column.y & 3u) << 3u | column.x & 7u) & 1u) != 0u;
}
