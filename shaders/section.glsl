// Where a column's things are in a section's payload (src/section.rs).
// Needs pool.glsl.

const uint SECTION_LOG2 = 8u;
const uint SECTION_SIDE = 1u << SECTION_LOG2;
// Attributes, first word: class << 24 | intensity << 8 | red. Second: green << 24 | blue << 16 | returns << 8 | flags.
const uint FLAG_WITHHELD = 4u;

// Block order: 64 consecutive columns are an 8x8 block.
uint block_order(uvec2 column) {
    uvec2 block = column >> 3u, inner = column & 7u;
    return ((block.y << 5u | block.x) << 6u) | inner.y << 3u | inner.x;
}

// The pyramid's levels 0 to 3 lie block by block, 96 elements for 8x8 columns: level 1 row by row, level 2, level 3,
// the measured bits (words 12 and 13 of the block, or 24 and 25 where codes are wide), and from element 32 on level 0: a way down to a column reads two cache lines, whichever way it came. Levels 4 to 8
// follow, row by row.
const uint BLOCK_ELEMENTS = 96u;
const uint LEVEL_0 = 32u;
const uint LEVEL_2 = 16u;
const uint LEVEL_3 = 20u;
const uint MEASURED = 24u;
const uint UPPER_LEVELS = 1024u * BLOCK_ELEMENTS;

// First element of pyramid level `level`, 4 to 8.
uint upper_level(uint level) { return UPPER_LEVELS - 0x15400u + (0x15554u & ~((1u << 18u - 2u * level) - 1u)); }

// Element of `node` of pyramid level `level`.
uint pyramid_element(uint level, uvec2 node) {
    bool upper = level > 3u;
    uint log2_side = (upper ? 8u : 3u) - level;
    uint first = upper ? upper_level(level) : 0x14100020u >> 8u * level & 0xFFu;
    // Above the blocks there is only the first.
    uvec2 block = node >> log2_side, inner = node & (1u << log2_side) - 1u;
    return first + (block.y << 5u | block.x) * BLOCK_ELEMENTS + (inner.y << log2_side | inner.x);
}

// Code `index` of an array of 16-bit (or, if wide, 32-bit) codes that starts at word `start`.
uint load_code(uvec2 place, uint start, uint index, bool wide) {
    if (wide) return pool_load(place, start + index);
    uint word = pool_load(place, start + (index >> 1u));
    return (index & 1u) == 0u ? word & 0xFFFFu : word >> 16u;
}

// A section's pyramid and whether its codes are wide, from the table's word for both.
uvec2 pyramid_place(uvec2 marked) { return uvec2(marked.x, marked.y & 0x7FFFFFFFu); }
uint pyramid_wide(uvec2 marked) { return marked.y >> 31u; }

// Code `index` of a pyramid: two a word, or one.
uint pyramid_code(uvec2 place, uint index, uint wide) {
    uint word = pool_load(place, index >> 1u - wide);
    return wide != 0u ? word : word >> (index & 1u) * 16u & 0xFFFFu;
}

// The plane of what columns show lies before the pyramid: class << 24 | red | green << 8 | blue << 16, or in place of
// the colours intensity | returns << 16; block order. A bridged column shows what it was taken from shows.
uvec2 shown_place(uvec2 pyramid) { return pool_back(pyramid, SECTION_SIDE * SECTION_SIDE); }

// Whether the top of a column is measured, not bridged.
bool is_measured(uvec2 pyramid, uint wide, uvec2 column) {
    uint ordered = block_order(column);
    uint bits = pool_load(pyramid, ((ordered >> 6u) * BLOCK_ELEMENTS + MEASURED >> 1u - wide) + (ordered >> 5u & 1u));
    return (bits >> (ordered & 31u) & 1u) != 0u;
}
