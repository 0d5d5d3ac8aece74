// Picks each column's top under the mask: its highest run of a visible class. What it shows may be another's that is as high
// but for a few centimetres, where the top's class tells nothing.
// Reads runs; writes what columns show, the measured bits and level 0 of the pyramid; without bridges, levels 1 and 2
// too. One thread a half block; y is the job.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "pool.glsl"
#include "section.glsl"
#include "derive.glsl"
#include "runs.glsl"

layout(local_size_x = DERIVE_THREADS) in;
layout(constant_id = ID_BRIDGE) const bool BRIDGE = false; // bridge.comp follows

uint block, counts, column, other;
uint measured = 0u;

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
    pool_store(derived, to, shows_of(top));
    return any ? (height ^ HEIGHT_SIGN) - base : 0u;
}

void main() {
    uint job = gl_WorkGroupID.y, half_block = gl_GlobalInvocationID.x;
    uvec4 section = JOB[job].section;
    begin_runs(job);
    begin_form(job);

    uint west = western_block(half_block), before = 0u;
    block = pool_load(place, PLACES + (half_block & ~1u));
    counts = section.z + (block - FIRST_BLOCK) / BLOCK_WORDS * COUNT_WORDS;
    column = (half_block & 1u) * 32u;
    if (!ALL && block != 0u) {
        // Further runs of the blocks before, and of the half before.
        before = pool_load(place, PLACES + (half_block | 1u));
        for (uint w = 0u; w < column / 4u; w++) before += sum_of_bytes(pool_load(place, counts + w));
    }
    other = section.w + RUN_WORDS * before;
    // Two at a time, of one word where codes are narrow.
    for (uint two = 0u; two < 16u; two++) {
        uint first = west + (two >> 1u & 1u) * block_words(form), inner = (two >> 2u) * 4u + (two & 1u) * 2u;
        uint to = first + shown_in_block(form) + inner;
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
    pool_store(derived, west + measured_in_block(form), measured);
    if (!BRIDGE) store_levels_1_and_2(derived, half_block, west);
}
