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
const uint IS_WIDE = WIDE ? FORM_WIDE : 0u;

// How what is derived of the job's section lies; and log2 steps that the words of its blocks count by.
uint form, word_step;

void begin_form(uint job) {
    form = IS_WIDE | (JOB[job].lists != 0u ? FORM_FLOATS : 0u);
    word_step = min(max(JOB[job].slice, 1u) - 1u, MOST_WORD_STEP);
}

// First word of the western of a half block's two blocks.
uint western_block(uint half_block) {
    uint block = half_block >> 1u;
    uint row = (block >> 5u) * 2u + (half_block & 1u);
    return (row << DERIVED_BLOCKS_LOG2 | (block & 31u) * 2u) * block_words(form);
}

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

// The word of a node where something may float: of the highest thing, the highest that is solid, and the lowest bottom of what floats.
uint word_of(uint top, uint solid, uint bottom) {
    if (WIDE || bottom == NO_BOTTOM) return top;
    // That what floats begins at the top is no way to say that nothing does.
    uint solid_below = min(top - solid >> word_step, STACK_MOST_BELOW);
    uint bottom_below = clamp(top - bottom + (1u << word_step) - 1u >> word_step, 1u, STACK_MOST_BELOW);
    return top | solid_below << STACK_SOLID_SHIFT | bottom_below << STACK_BOTTOM_SHIFT;
}

// No bottom of what floats in a node is lower, as its word says.
uint bottom_in(uint word) {
    uint below = below_code(word).y;
    if (WIDE || below == 0u) return NO_BOTTOM;
    return below == STACK_MOST_BELOW ? 0u : uint(max(int(word & MOST_NARROW_CODE) - int(below << word_step), 0));
}

// Four codes of level 0 of a block, whose first word is `first`, from an even one on.
uvec4 load_tops(uvec2 derived, uint first, uint code) {
    if (floats_of(form) == 0u) return load_four(derived, first, code);
    uvec4 four;
    for (uint k = 0u; k < 4u; k++) four[k] = pool_load(derived, first + code + k) & (WIDE ? 0xFFFFFFFFu : MOST_NARROW_CODE);
    return four;
}

// Stores codes of two columns that are solid, from an even one on.
void store_tops(uvec2 derived, uint first, uint code, uvec2 codes) {
    if (floats_of(form) == 0u) store_two(derived, first, code, codes);
    else {
        pool_store(derived, first + code, codes.x);
        pool_store(derived, first + code + 1u, codes.y);
    }
}

// Stores a code, counted from word `first` on, one of two in a word where codes are narrow.
void store_code(uvec2 derived, uint first, uint at, uint code) {
    if (WIDE) pool_store(derived, first + at, code);
    else {
        uint word = pool_load(derived, first + at / 2u);
        pool_store(derived, first + at / 2u, (at & 1u) == 0u ? word & 0xFFFF0000u | code : word & 0xFFFFu | code << 16u);
    }
}

// Stores what is solid of a column of derived block `block`, whose first word is `first`: where it has a list, in that, and then level 0 is
// as high as what floats there, too.
void store_solid(uvec2 derived, uint block, uint first, uint inner, uint code) {
    if (floats_of(form) == 0u) {
        store_code(derived, first, inner, code);
        return;
    }
    uint list = list_of(derived, block), word = code;
    if (list != 0u) {
        store_code(derived, codes_at(list, OF_SOLID, form), inner, code);
        uvec2 ends = floating_ends(derived, block, list, inner, form);
        word = word_of(max(code, ends.x), code, ends.y);
    }
    pool_store(derived, first + inner, word);
}

// Levels 1 and 2 of a half block, from its level 0, whose first word is `west`.
// `solids_of`: what is solid is as high as that in nodes of level 1, row by row, four of the western block's and the eastern's each; level 0 may be
// lower.
void store_levels_1_and_2(uvec2 derived, uint half_block, uint west, uint solids_of[8]) {
    uvec2 level_2 = uvec2(0u);
    uvec2 node = half_block_origin(half_block) >> 2u;
    bool floats = floats_of(form) != 0u;
    for (uint side = 0u; side < 2u; side++) {
        uint first = west + side * block_words(form), solid = 0u, bottom = NO_BOTTOM;
        uint list = floats ? pool_load(derived, first + STACK_LIST) : 0u;
        for (uint pair = 0u; pair < 2u; pair++) {
            uint row = pair * 8u;
            uvec4 columns = max(load_tops(derived, first, row), load_tops(derived, first, row + 4u));
            uint of_pair = pair * 4u + side * 2u;
            uvec2 solids = uvec2(solids_of[of_pair], solids_of[of_pair + 1u]), bottoms = uvec2(NO_BOTTOM);
            uvec2 nodes = max(max(columns.xz, columns.yw), solids);
            level_2[side] = max(level_2[side], max(nodes.x, nodes.y));
            if (!floats) {
                store_two(derived, first, LEVEL_1 + pair * 2u, nodes);
                continue;
            }
            if (list != 0u) {
                uint at = codes_at(list, OF_SOLID, form);
                uvec4 codes = max(load_four(derived, at, row), load_four(derived, at, row + 4u));
                solids = max(solids, max(codes.xz, codes.yw));
                for (uint k = 0u; k < 8u; k++) bottoms[k >> 1u & 1u] = min(bottoms[k >> 1u & 1u], bottom_in(pool_load(derived, first + row + k)));
                solid = max(solid, max(solids.x, solids.y));
                bottom = min(bottom, min(bottoms.x, bottoms.y));
            }
            for (uint k = 0u; k < 2u; k++)
                pool_store(derived, first + STACK_LEVEL_1 + pair * 2u + k, word_of(nodes[k], solids[k], bottoms[k]));
        }
        if (floats) pool_store(derived, first + STACK_LEVEL_2, word_of(level_2[side], solid, bottom));
    }
    store_two(derived, upper_levels(form), upper_level(2u) + (node.y << DERIVED_BLOCKS_LOG2 | node.x), level_2);
}

void store_levels_1_and_2(uvec2 derived, uint half_block, uint west) {
    store_levels_1_and_2(derived, half_block, west, uint[](0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u));
}
