// Where a column's things are in what is derived of a section: see the drawing in docs/from-file-to-pixel.md.
// Needs pool.glsl.
#include "payload.glsl"

// What is derived of a section: 64x64 blocks of 4x4 columns, row by row, then the pyramid's levels 2 to 8, row by row each.
// A block is two cache lines (where codes are wide, three): level 0 of the pyramid, level 1, measured bits; and what each
// column shows. So a ray that comes down to a column waits for memory twice, whichever way it came.

uint block_words(uint wide) { return SHOWN + SHOWN_WORDS + SHOWN * wide; }
uint measured_in_block(uint wide) { return MEASURED << wide; }
uint shown_in_block(uint wide) { return SHOWN << wide; }

// First word of the pyramid's levels from 2 on; and the first code, counted from there, of level `level`, 2 to 8.
uint upper_levels(uint wide) { return block_words(wide) << 2u * DERIVED_BLOCKS_LOG2; }
uint upper_level(uint level) { return (CODES_BELOW_TOP & ~((1u << 2u * (SECTION_LOG2 + 1u) - 2u * level) - 1u)) - CODES_BELOW_UPPER; }

// The block that a column is in, and the column in it.
uint block_of(uvec2 column) { return (column.y >> DERIVED_BLOCK_LOG2) << DERIVED_BLOCKS_LOG2 | column.x >> DERIVED_BLOCK_LOG2; }
uint in_block(uvec2 column) { return (column.y & 3u) << DERIVED_BLOCK_LOG2 | column.x & 3u; }

// Code of `node` of pyramid level `level`: two a word, or one where they are wide.
uint pyramid_code(uvec2 place, uint level, uvec2 node, uint wide) {
    bool upper = level > 1u;
    uint log2_side = (upper ? SECTION_LOG2 : DERIVED_BLOCK_LOG2) - level;
    // Above the blocks there is only the first.
    uvec2 block = node >> log2_side, inner = node & (1u << log2_side) - 1u;
    uint code = (upper ? upper_level(level) : level * LEVEL_1) + (inner.y << log2_side | inner.x);
    uint first = upper ? upper_levels(wide) : (block.y << DERIVED_BLOCKS_LOG2 | block.x) * block_words(wide);
    uint word = pool_load(place, first + (code >> 1u - wide));
    return wide != 0u ? word : word >> (code & 1u) * 16u & MOST_NARROW_CODE;
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
