// What the derived passes share: one job a section, the mask under which they run, and codes four at a time.
// Needs pool.glsl and section.glsl.

struct Job {
    uvec4 section; // its place; runs
    uvec4 near[9]; // derived parts of the 3x3 sections around, row by row from the south-west, [4] its own:
                   // place of what they show (0: no section), base, 1 for wide codes
};

struct Derive {
    uint visible[8];          // bit per class: shown
    uint visible_withheld[8]; // the same for points with the withheld flag
    uint bridge;              // longest gap to bridge, cells; 0: none
    uint values;              // columns show intensity and returns instead of colours
    int steep;                // a gap between ends that differ by more than this a cell is no slope but an edge, lattice steps
};

#ifdef POOL_SSBO
layout(set = 0, binding = 1, scalar) readonly buffer Jobs { Job jobs[]; };
layout(set = 0, binding = 2, scalar) readonly buffer DeriveBlock { Derive derive; };
#define JOB jobs
#define DERIVE derive
#else
layout(buffer_reference, scalar, buffer_reference_align = 8) readonly buffer Jobs { Job jobs[]; };
layout(buffer_reference, scalar, buffer_reference_align = 8) readonly buffer DeriveBlock { Derive derive; };
layout(push_constant, scalar) uniform Push { uvec2 jobs; uvec2 derive; } push;
#define JOB Jobs(push.jobs).jobs
#define DERIVE DeriveBlock(push.derive).derive
#endif

layout(constant_id = 0) const bool WIDE = false; // codes of the sections take 32 bits

// Parts of a section, words from its start.
const uint BLOCKS = 16u;
const uint COUNTS = BLOCKS + 1024u;
const uint HEIGHTS = COUNTS + 16384u;
// Derived: what columns show, then, words from there, the pyramid.
const uint PYRAMID = 65536u;

// Word of the measured bits of a half block.
uint measured_word(uint half_block, bool wide) {
    uint element = (half_block >> 1u) * BLOCK_ELEMENTS + MEASURED;
    return PYRAMID + (wide ? element : element / 2u) + (half_block & 1u);
}

// First element of a half block's level 0.
uint level_0_of(uint half_block) { return (half_block >> 1u) * BLOCK_ELEMENTS + LEVEL_0 + (half_block & 1u) * 32u; }

// Two codes of the pyramid, from an even element on.
uvec2 load_two(uvec2 derived, uint element) {
    if (WIDE) return uvec2(pool_load(derived, PYRAMID + element), pool_load(derived, PYRAMID + element + 1u));
    uint word = pool_load(derived, PYRAMID + element / 2u);
    return uvec2(word & 0xFFFFu, word >> 16u);
}

void store_two(uvec2 derived, uint element, uvec2 codes) {
    if (WIDE) {
        pool_store(derived, PYRAMID + element, codes.x);
        pool_store(derived, PYRAMID + element + 1u, codes.y);
    } else pool_store(derived, PYRAMID + element / 2u, codes.x | codes.y << 16u);
}

uvec4 load_four(uvec2 derived, uint element) {
    return uvec4(load_two(derived, element), load_two(derived, element + 2u));
}

void store_four(uvec2 derived, uint element, uvec4 codes) {
    store_two(derived, element, codes.xy);
    store_two(derived, element + 2u, codes.zw);
}

// A half block, 8x4 columns, is one thread's: it owns whole words of every plane.
uvec2 half_block_origin(uint half_block) {
    uint block = half_block >> 1u;
    return uvec2(block & 31u, (block >> 5u) * 2u + (half_block & 1u)) * uvec2(8u, 4u);
}

// Level 1 of two rows of eight codes, stored as row `row`, 0 or 1, of the half block's; gives their part of level 2.
uvec2 store_level_1(uvec2 derived, uint half_block, uint row, uvec4 south_west, uvec4 south_east, uvec4 north_west, uvec4 north_east) {
    uvec4 west = max(south_west, north_west), east = max(south_east, north_east);
    uvec4 nodes = uvec4(max(west.xz, west.yw), max(east.xz, east.yw));
    store_four(derived, (half_block >> 1u) * BLOCK_ELEMENTS + (half_block & 1u) * 8u + row * 4u, nodes);
    return max(nodes.xz, nodes.yw);
}

void store_level_2(uvec2 derived, uint half_block, uvec2 nodes) {
    store_two(derived, (half_block >> 1u) * BLOCK_ELEMENTS + LEVEL_2 + (half_block & 1u) * 2u, nodes);
}
