// Where a column's things are in what is derived of a section: see the drawing in docs/from-file-to-pixel.md.
// Needs pool.glsl.
#include "payload.glsl"

// What is derived of a section: 64x64 blocks of 4x4 columns, row by row, then the pyramid's levels 2 to 8, row by row each.
// A block is two cache lines (where codes are wide, three): level 0 of the pyramid, level 1, measured bits; and what each
// column shows. So a ray that comes down to a column waits for memory twice, whichever way it came.
// Where something may float, a block has a word for each of its nodes, level 2 among them.
// `form`: FORM_WIDE, FORM_FLOATS.

uint wide_of(uint form) { return form & FORM_WIDE; }
uint floats_of(uint form) { return form / FORM_FLOATS; }
uint block_words(uint form) { return floats_of(form) != 0u ? STACK_SHOWN + SHOWN_WORDS : SHOWN + SHOWN_WORDS + SHOWN * wide_of(form); }
uint measured_in_block(uint form) { return floats_of(form) != 0u ? STACK_MEASURED : MEASURED << wide_of(form); }
uint shown_in_block(uint form) { return floats_of(form) != 0u ? STACK_SHOWN : SHOWN << wide_of(form); }

// First word of the pyramid's levels from 2 on; and the first code, counted from there, of level `level`, 2 to 8.
uint upper_levels(uint form) { return block_words(form) << 2u * DERIVED_BLOCKS_LOG2; }
uint upper_level(uint level) { return (CODES_BELOW_TOP & ~((1u << 2u * (SECTION_LOG2 + 1u) - 2u * level) - 1u)) - CODES_BELOW_UPPER; }

// The block that a column is in, and the column in it.
uint block_of(uvec2 column) { return (column.y >> DERIVED_BLOCK_LOG2) << DERIVED_BLOCKS_LOG2 | column.x >> DERIVED_BLOCK_LOG2; }
uint in_block(uvec2 column) { return (column.y & 3u) << DERIVED_BLOCK_LOG2 | column.x & 3u; }

// How many codes of a level lie before `level`, 0 to 2, in a block: of those where something may float, too, whose words are in the same order.
uint before_in_block(uint level) { return level == 2u ? STACK_LEVEL_2 : level * LEVEL_1; }

// Code of `node` of pyramid level `level`. 0: nothing is there. Two codes a word, or one where they are wide, and in blocks where something
// may float.
uint pyramid_code(uvec2 place, uint level, uvec2 node, uint form) {
    bool upper = level > 1u;
    uint log2_side = (upper ? SECTION_LOG2 : DERIVED_BLOCK_LOG2) - level;
    // Above the blocks there is only the first.
    uvec2 block = node >> log2_side, inner = node & (1u << log2_side) - 1u;
    uint code = (upper ? upper_level(level) : before_in_block(level)) + (inner.y << log2_side | inner.x);
    uint first = upper ? upper_levels(form) : (block.y << DERIVED_BLOCKS_LOG2 | block.x) * block_words(form);
    uint halves = wide_of(form) != 0u || floats_of(form) != 0u && !upper ? 0u : 1u;
    uint word = pool_load(place, first + (code >> halves));
    return wide_of(form) != 0u ? word : word >> (code & halves) * 16u & MOST_NARROW_CODE;
}

// What `column` shows.
uint shown_of(uvec2 place, uvec2 column, uint form) {
    return pool_load(place, block_of(column) * block_words(form) + shown_in_block(form) + in_block(column));
}

// Whether the top of a column is measured, not bridged.
bool is_measured(uvec2 place, uvec2 column, uint form) {
    uint bits = pool_load(place, (block_of(column) & ~1u) * block_words(form) + measured_in_block(form));
    return (bits >> ((column.y & 3u) << 3u | column.x & 7u) & 1u) != 0u;
}
