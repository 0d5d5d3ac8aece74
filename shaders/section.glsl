// A section's payload: the header that src/section.rs writes, and where a column's things are.
// Needs pool.glsl.

const uint SECTION_LOG2 = 8u;
const uint SECTION_SIDE = 1u << SECTION_LOG2;
const uint NO_RUN = 0xFFFFFFFFu;

// Words of the header.
const uint HEADER_CODE = 2u;       // wide << 8 | log2 side << 16
const uint HEADER_BASE = 3u;       // lattice height of code 0
const uint HEADER_BLOCKS = 5u;     // first run of each 8x8 block
const uint HEADER_COUNTS = 6u;     // runs of each column, a byte each, block order
const uint HEADER_HEIGHTS = 7u;    // height codes of runs
const uint HEADER_ATTRIBUTES = 8u; // two words a run
const uint HEADER_TOPS = 9u;       // derived: run on show of each column, block order
const uint HEADER_BRIDGES = 10u;   // derived: where a bridged top was taken from, a byte each, block order
const uint HEADER_PYRAMID = 11u;   // derived: maximum pyramid, finest level first, row-major

// Attributes, first word: class << 24 | intensity << 8 | red. Second: green << 24 | blue << 16 | returns << 8 | flags.
const uint FLAG_WITHHELD = 4u;

// Block order: 64 consecutive columns are an 8x8 block.
uint block_order(uvec2 column) {
    uvec2 block = column >> 3u, inner = column & 7u;
    return ((block.y << 5u | block.x) << 6u) | inner.y << 3u | inner.x;
}

// First element of pyramid level `level`, 0..8.
uint pyramid_offset(uint level) { return 0x15554u & ~((1u << (18u - 2u * level)) - 1u); }

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

// The tops plane lies before the bridges, and those before the pyramid.
const uint TOPS_BEFORE_PYRAMID = 65536u + 16384u;
uvec2 tops_place(uvec2 pyramid) { return pool_back(pyramid, TOPS_BEFORE_PYRAMID); }

// A bridged top's source, 1..81, as the offset in cells to the measured column it copies; 0 means measured.
uint encode_bridge(ivec2 offset) { return uint((offset.y + 4) * 9 + offset.x + 4) + 1u; }
ivec2 decode_bridge(uint code) { return ivec2(int(code - 1u) % 9 - 4, int(code - 1u) / 9 - 4); }
