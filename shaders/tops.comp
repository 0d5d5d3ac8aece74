// Picks each column's top under the mask: its highest run of a visible class. What it shows may be another's that is as high
// but for a few centimetres, where the top's class tells nothing.
// Reads runs; writes what columns show, the measured bits and level 0 of the pyramid; without bridges, levels 1 and 2
// too. One thread a half block; y is the job.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "pool.glsl"
#include "section.glsl"
#include "derive.glsl"

layout(local_size_x = DERIVE_THREADS) in;
layout(constant_id = ID_ALL) const bool ALL = false;    // every run of the sections is shown
layout(constant_id = ID_BRIDGE) const bool BRIDGE = false; // bridge.comp follows

uvec2 place, derived;
uint base; // lattice height of code 0
uint block, counts, column, other;
bool values;
uint measured = 0u;
uvec4 visible_low, visible_high;
bool show_withheld;
uint tie; // see Job

uvec3 run_at(uint at) { return uvec3(pool_load(place, at), pool_load(place, at + 1u), pool_load(place, at + 2u)); }

bool shown(uvec3 run) {
    uint class_ = run.y >> RUN_CLASS_SHIFT;
    uvec4 some = class_ < 128u ? visible_low : visible_high;
    uvec2 pair = (class_ & 64u) == 0u ? some.xy : some.zw;
    uint word = (class_ & 32u) == 0u ? pair.x : pair.y;
    return (word >> (class_ & 31u) & 1u) != 0u && (show_withheld || (run.z & FLAG_WITHHELD) == 0u);
}

// As `tells_nothing` in src/attribute/class.rs.
bool tells_nothing(uvec3 run) {
    uint class_ = run.y >> RUN_CLASS_SHIFT;
    return class_ <= 1u || class_ == 12u;
}

// Stores what the next column shows, gives its top's code; `others` is how many further runs it has.
uint next_column(uint others, uint to) {
    uvec3 top = run_at(block + RUN_WORDS * column++);
    uint below = other;
    if (!ALL) {
        uint end = other + RUN_WORDS * others;
        while (top.x != 0u && !shown(top)) {
            top = other < end ? run_at(other) : uvec3(0u);
            other += RUN_WORDS;
        }
        below = other;
        other = end;
    }
    bool any = top.x != 0u;
    uint height = top.x;
    if (!ALL && tie != 0u && any && tells_nothing(top)) {
        uint least = height - min(tie, height - 1u);
        for (uint at = below; at < other; at += RUN_WORDS) {
            uvec3 run = run_at(at);
            if (run.x < least) break;
            if (shown(run) && !tells_nothing(run)) {
                top = run;
                break;
            }
        }
    }
    measured = measured >> 1u | (any ? 0x80000000u : 0u);
    uint shows = top.y >> RUN_CLASS_SHIFT << SHOWN_CLASS_SHIFT;
    shows |= values ? top.y >> RUN_INTENSITY_SHIFT & 0xFFFFu | (top.z >> RUN_RETURNS_SHIFT & 0xFFu) << SHOWN_RETURNS_SHIFT
                    : top.y & 0xFFu | top.z >> RUN_GREEN_SHIFT << SHOWN_GREEN_SHIFT
                      | (top.z >> RUN_BLUE_SHIFT & 0xFFu) << SHOWN_BLUE_SHIFT;
    pool_store(derived, to, shows);
    return any ? (height ^ HEIGHT_SIGN) - base : 0u;
}

void main() {
    uint job = gl_WorkGroupID.y, half_block = gl_GlobalInvocationID.x;
    uvec4 section = JOB[job].section;
    place = section.xy;
    // Read whole: lavapipe gave a wrong third component when it was read by itself.
    uvec4 here = JOB[job].near[4];
    derived = here.xy;
    base = here.z;
    values = DERIVE.values != 0u;
    tie = JOB[job].tie;
    if (!ALL) {
        visible_low = uvec4(DERIVE.visible[0], DERIVE.visible[1], DERIVE.visible[2], DERIVE.visible[3]);
        visible_high = uvec4(DERIVE.visible[4], DERIVE.visible[5], DERIVE.visible[6], DERIVE.visible[7]);
        // Withheld points are shown as the others, or not at all.
        uint any_withheld = 0u;
        for (int w = 0; w < 8; w++) any_withheld |= DERIVE.visible_withheld[w];
        show_withheld = any_withheld != 0u;
    }

    uint west = western_block(half_block, IS_WIDE), before = 0u;
    block = pool_load(place, PLACES + (half_block & ~1u));
    counts = section.z + (block - FIRST_BLOCK) / BLOCK_WORDS * COUNT_WORDS;
    column = (half_block & 1u) * 32u;
    if (!ALL && block != 0u) {
        // Further runs of the blocks before, and of the half before.
        uint pairs = 0u;
        for (uint w = 0u; w < column / 4u; w++) {
            uint four = pool_load(place, counts + w);
            pairs += (four & 0x00FF00FFu) + (four >> 8u & 0x00FF00FFu);
        }
        before = pool_load(place, PLACES + (half_block | 1u)) + (pairs & 0xFFFFu) + (pairs >> 16u);
    }
    other = section.w + RUN_WORDS * before;
    // Two at a time, of one word where codes are narrow.
    for (uint two = 0u; two < 16u; two++) {
        uint first = west + (two >> 1u & 1u) * block_words(IS_WIDE), inner = (two >> 2u) * 4u + (two & 1u) * 2u;
        uint to = first + shown_in_block(IS_WIDE) + inner;
        uvec2 codes = uvec2(0u);
        if (block == 0u) {
            pool_store(derived, to, 0u);
            pool_store(derived, to + 1u, 0u);
        } else {
            uint others = ALL ? 0u : pool_load(place, counts + (column >> 2u)) >> (two & 1u) * 16u;
            codes.x = next_column(others & 0xFFu, to);
            codes.y = next_column(others >> 8u & 0xFFu, to + 1u);
        }
        store_two(derived, first, inner, codes);
    }
    pool_store(derived, west + measured_in_block(IS_WIDE), measured);
    if (!BRIDGE) store_levels_1_and_2(derived, half_block, west);
}
