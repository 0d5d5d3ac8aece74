// What the derived passes share: one job a section, the mask under which they run, and codes four at a time.
// Needs pool.glsl and section.glsl. What is uploaded of a section: see the drawing in docs/from-file-to-pixel.md.
#include "passes.glsl"
#include "floats.glsl"

struct Job {
    uvec4 section; // its place; where counts and further runs start
    uvec4 near[9]; // derived parts of the 3x3 sections around, row by row from the south-west, [4] its own:
                   // where it starts (0: no section), base, 1 for wide codes + 2 where things may float
    uint steepest; // a gap between ends that differ by more than this a cell is no slope but an edge, lattice steps
    uint first;    // half blocks that are to be derived: the first, and how many, east in the lower half, north in the
    uint area;     // upper one
    uint tie;      // a run so many lattice steps below the top is as high, and shown if the top's class tells less; 0: never
    uint slice;    // of stacks: log2 lattice steps of a slice, which is as long as the longest gap within a span
    uint thickness; // lattice steps that a point of what floats reaches down
    uint lists;    // half blocks in which anything may float
    uint jump;     // of a smooth surface: tops of columns beside each other that differ by more are of two surfaces, lattice steps
    uint corners;  // and the first word of its corners
    uint reach;    // of stacks: columns each way that tell whether what is not classified floats
    uint joins;   // and words from a span to what it is joined with; 0: nothing may float
    uint spare;
};

struct Derive {
    uint visible[8];   // bit per class: shown
    uint hidden_flags; // bit per flag of KEY_FLAGS: points that have it are hidden
    uint bridge;       // longest gap to bridge, cells; 0: none
    uint values;       // columns show intensity and returns instead of colours
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

layout(constant_id = ID_WIDE) const bool WIDE = false; // codes of the sections take 32 bits

// First word of the western of a half block's two blocks.
uint western_block(uint half_block, uint wide) {
    uint block = half_block >> 1u;
    uint row = (block >> 5u) * 2u + (half_block & 1u);
    return (row << DERIVED_BLOCKS_LOG2 | (block & 31u) * 2u) * block_words(wide);
}

const uint IS_WIDE = WIDE ? 1u : 0u;

// Two codes, from an even one on, counted from word `first`.
uvec2 load_two(uvec2 derived, uint first, uint code) {
    if (WIDE) return uvec2(pool_load(derived, first + code), pool_load(derived, first + code + 1u));
    uint word = pool_load(derived, first + code / 2u);
    return uvec2(word & MOST_NARROW_CODE, word >> 16u);
}

void store_two(uvec2 derived, uint first, uint code, uvec2 codes) {
    if (WIDE) {
        pool_store(derived, first + code, codes.x);
        pool_store(derived, first + code + 1u, codes.y);
    } else pool_store(derived, first + code / 2u, codes.x | codes.y << 16u);
}

uvec4 load_four(uvec2 derived, uint first, uint code) {
    return uvec4(load_two(derived, first, code), load_two(derived, first, code + 2u));
}

const uvec2 HALF_BLOCK = uvec2(HALF_BLOCK_EAST, HALF_BLOCK_NORTH);
const uvec2 HALF_BLOCKS = uvec2(SECTION_SIDE) / HALF_BLOCK;

// A half block of what was uploaded, 8x4 columns, is one thread's, and two blocks of what is derived: whole words, all
// its own.
uvec2 half_block_origin(uint half_block) {
    uint block = half_block >> 1u;
    return uvec2(block & 31u, (block >> 5u) * 2u + (half_block & 1u)) * HALF_BLOCK;
}

// The half block of a thread, of those that a job is for; false: there is none.
bool half_block_of(uint thread, uint first, uint area, out uint half_block) {
    uvec2 size = uvec2(area & 0xFFFFu, area >> 16u);
    uvec2 at = uvec2(first & 0xFFFFu, first >> 16u) + uvec2(thread % size.x, thread / size.x);
    half_block = ((at.y >> 1u) * 32u + at.x) << 1u | at.y & 1u;
    return thread < size.x * size.y;
}

// Stores what is solid of a column of a derived block, whose first word is `first`: in its list, if there is one, and then level 0 is
// as high as what floats there, too.
void store_solid(uvec2 derived, uint first, uint list, uint inner, uint code) {
    if (list != 0u) {
        uint at = codes_at(list, OF_SOLID, IS_WIDE) + (inner >> 1u - IS_WIDE);
        if (WIDE) pool_store(derived, at, code);
        else {
            uint word = pool_load(derived, at);
            pool_store(derived, at, (inner & 1u) == 0u ? word & 0xFFFF0000u | code : word & 0xFFFFu | code << 16u);
        }
        code = max(code, floating_top(derived, list, inner, IS_WIDE));
    }
    if (WIDE) pool_store(derived, first + inner, code);
    else {
        uint word = pool_load(derived, first + inner / 2u);
        word = (inner & 1u) == 0u ? word & 0xFFFF0000u | code : word & 0xFFFFu | code << 16u;
        pool_store(derived, first + inner / 2u, word);
    }
}

// A code of levels 1 and 2 in a section in which things may float: rounded up, its last bit says whether any does in the node.
uint marked(uint code, bool floats) {
    if (floats) return code | 1u;
    return (code & 1u) != 0u && code != (WIDE ? 0xFFFFFFFFu : MOST_NARROW_CODE) ? code + 1u : code;
}

// Levels 1 and 2 of a half block, from its level 0, whose first word is `west`; where its blocks have lists, these say how high what is
// solid is. `floats`: something may float in the section.
// `solids_of`: what is solid is no higher than that in nodes of level 1, row by row, four of the western block's and the eastern's each; level 0 may be
// lower.
void store_levels_1_and_2(uvec2 derived, uint half_block, uint west, bool floats, uint solids_of[8]) {
    uvec2 level_2 = uvec2(0u);
    uvec2 node = half_block_origin(half_block) >> 2u;
    for (uint side = 0u; side < 2u; side++) {
        uint first = west + side * block_words(IS_WIDE), solid = 0u;
        uint list = floats ? list_of(derived, node.y << DERIVED_BLOCKS_LOG2 | node.x + side, IS_WIDE) : 0u;
        bool any = false;
        for (uint pair = 0u; pair < 2u; pair++) {
            uint row = pair * 8u;
            uvec4 columns = max(load_four(derived, first, row), load_four(derived, first, row + 4u));
            uint of_pair = pair * 4u + side * 2u;
            uvec2 no_higher = uvec2(solids_of[of_pair], solids_of[of_pair + 1u]);
            uvec2 nodes = max(max(columns.xz, columns.yw), no_higher);
            solid = max(solid, max(no_higher.x, no_higher.y));
            level_2[side] = max(level_2[side], max(nodes.x, nodes.y));
            if (floats) {
                uint counted = 0u;
                if (list != 0u) {
                    uint solids = codes_at(list, OF_SOLID, IS_WIDE), counts = list + 1u + IS_WIDE + LIST_COUNTS + pair * 2u;
                    counted = pool_load(derived, counts) | pool_load(derived, counts + 1u);
                    uvec4 codes = max(load_four(derived, solids, row), load_four(derived, solids, row + 4u));
                    solid = max(solid, max(max(codes.x, codes.y), max(codes.z, codes.w)));
                }
                nodes = uvec2(marked(nodes.x, (counted & 0xFFFFu) != 0u), marked(nodes.y, counted >> 16u != 0u));
                any = any || counted != 0u;
            }
            store_two(derived, first, LEVEL_1 + pair * 2u, nodes);
        }
        if (floats) level_2[side] = marked(level_2[side], any);
        if (list == 0u) continue;
        if (WIDE) pool_store(derived, list, solid);
        else pool_store(derived, list, pool_load(derived, list) & 0xFFFF0000u | solid);
    }
    store_two(derived, upper_levels(IS_WIDE), upper_level(2u) + (node.y << DERIVED_BLOCKS_LOG2 | node.x), level_2);
}

void store_levels_1_and_2(uvec2 derived, uint half_block, uint west, bool floats) {
    store_levels_1_and_2(derived, half_block, west, floats, uint[](0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u));
}
